"""How much of an image a part's edges explain: each image edge once, and no pose that leaves edges over wins."""

from __future__ import annotations

import numpy as np
import pytest

from acp_lab.geometry.arrays import ByteImage, FloatArray
from acp_lab.imaging.canny import CannyConfig, canny
from acp_lab.prepared_part import PreparedPart
from acp_lab.sequences.frame import Frame
from acp_lab.tracking.explained_edges import ImageEdges
from acp_lab.tracking.frame_solver import FrameSolver
from acp_lab.tracking.search import AGREEMENT_LEVEL, both_ways, one_way
from acp_lab.tracking.solution import SeenFrame
from tests.tracking.rendered import AS_DRAWN, CAMERA, MadeSequence

WHOLE = (0, 0, 120, 100)
SQUARE_PX = 30


@pytest.fixture
def square() -> ByteImage:
    """A bright square from (40, 40) on, without noise."""
    image = np.full((100, 120, 3), 60, np.uint8)
    image[40 : 40 + SQUARE_PX, 40 : 40 + SQUARE_PX] = 160
    return image


def border(share: float = 1.0, beside_px: float = 0.0) -> FloatArray:
    """(n, 2) px along the first part of the square's border, half a px apart, and beside it by so much to the right."""
    along = np.arange(0.0, SQUARE_PX - 1, 0.5)
    low, high = np.full_like(along, 0.0), np.full_like(along, SQUARE_PX - 1.0)
    sides = [(along, low), (high, along), (along[::-1], high), (low, along[::-1])]
    points = 40.0 + np.concatenate([np.stack(side, 1) for side in sides])
    return points[: round(share * len(points))] + np.array([beside_px, 0.0])


def test_what_lies_on_the_edges_explains_them_and_what_lies_elsewhere_nothing(square: ByteImage) -> None:
    edges = ImageEdges(square, WHOLE)
    all_px = edges.explained(border())
    assert 0.9 * 4 * (SQUARE_PX - 2) < all_px < 1.1 * 4 * SQUARE_PX
    assert edges.explained(border(0.5)) == pytest.approx(0.5 * all_px, abs=4)
    assert edges.explained(border(beside_px=45.0)) == 0
    # Only the sides that run to the right still lie on an edge.
    assert edges.explained(border(beside_px=4.0)) == pytest.approx(0.5 * all_px, abs=12)
    assert edges.explained(np.empty((0, 2))) == 0


def test_an_image_edge_counts_once_however_many_edges_of_the_part_lie_on_it(square: ByteImage) -> None:
    edges = ImageEdges(square, WHOLE)
    once = edges.explained(border())
    assert edges.explained(np.concatenate([border(), border(), border()])) == once


def test_a_box_and_points_may_reach_beyond_the_image(square: ByteImage) -> None:
    inside = ImageEdges(square, WHOLE).explained(border())
    beyond = ImageEdges(square, (-50, -20, 500, 400))
    assert beyond.explained(border()) == inside
    assert beyond.explained(np.concatenate([border(), [[-3.0, 5.0], [1e7, 5.0], [60.0, 1e9], [-1e9, -1e9]]])) == inside
    part_of_it = ImageEdges(square, (45, 30, 80, 80))
    assert 0 < part_of_it.explained(border()) < inside


def test_faint_edges_count_as_well(square: ByteImage) -> None:
    faint = square.copy()
    faint[40 : 40 + SQUARE_PX, 40 : 40 + SQUARE_PX] = 75  # too faint for Canny with its own thresholds
    inside = ImageEdges(square, WHOLE).explained(border())
    assert not canny(faint, CannyConfig(rule="median")).any()
    assert ImageEdges(faint, WHOLE).explained(border()) == pytest.approx(inside, abs=6)


@pytest.fixture
def solver(model: PreparedPart) -> FrameSolver:
    return FrameSolver(model, AS_DRAWN)


@pytest.fixture
def seen(solver: FrameSolver, sequence: MadeSequence) -> SeenFrame:
    (frame,) = sequence.frames(1)
    assert isinstance(frame, Frame)
    found = solver.look(frame.image, CAMERA, sequence.first_pose, 4)
    assert found is not None
    return found


def test_a_part_explains_more_of_its_image_where_it_is(
    solver: FrameSolver, seen: SeenFrame, sequence: MadeSequence
) -> None:
    truth = sequence.first_pose
    right, away = truth.copy(), truth.copy()
    right[0, 3] += 3.0
    away[2, 3] += 40.0
    explained = [solver.explained(seen, seen.view.at_pose(pose)) for pose in (truth, right, away)]
    assert explained[0] > 1.2 * max(explained[1:])
    at = seen.view.at_pose(truth)
    agrees = one_way(solver, seen, at, AGREEMENT_LEVEL)
    assert agrees == solver.agreement(seen, at, AGREEMENT_LEVEL) > 0.0
    assert both_ways(solver, seen, at, AGREEMENT_LEVEL) == pytest.approx(agrees * (1 + explained[0]))


def test_a_part_that_is_not_seen_explains_nothing(solver: FrameSolver, seen: SeenFrame) -> None:
    outside = seen.view.prior.copy()
    outside[0, 3] += 1000.0
    assert solver.explained(seen, seen.view.at_pose(outside)) == 0


def test_an_image_without_edges_leaves_it_to_one_way(solver: FrameSolver, seen: SeenFrame) -> None:
    view = seen.view
    grey = solver.look(np.full_like(view.image, 90), CAMERA, view.prior, 4)
    assert grey is not None
    at = grey.view.at_pose(view.prior)
    assert solver.explained(grey, at) == 0
    assert both_ways(solver, grey, at, AGREEMENT_LEVEL) == one_way(solver, grey, at, AGREEMENT_LEVEL)
