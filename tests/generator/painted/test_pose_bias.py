"""The pose that a painting shows: the true one of a perfect one, a nearer one of what is painted too large."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from acp_lab.cad.edges import sample_edges
from acp_lab.cad.part import Part
from acp_lab.cad.raycast import make_caster
from acp_lab.control_points.canonical_frame import CanonicalFrame, canonical_frame
from acp_lab.control_points.view_regions import ALL_REGIONS
from acp_lab.generator.painted.edge_images import EdgeView, analytic_view, draw_views
from acp_lab.generator.painted.edge_points import RidgePoints, ridge
from acp_lab.generator.painted.pose_bias import pose_bias
from acp_lab.geometry.arrays import FloatArray
from tests.made_parts import box

SIZE_MM = np.array([60.0, 40.0, 20.0])
DISTANCE_MM = 250.0


@pytest.fixture(scope="module")
def block() -> Part:
    return box(tuple(SIZE_MM))


def frame_of(part: Part) -> tuple[FloatArray, CanonicalFrame]:
    eye_obj = part.box_centre + DISTANCE_MM * np.array([0.3, 0.4, 1.0]) / np.linalg.norm([0.3, 0.4, 1.0])
    return eye_obj, canonical_frame(eye_obj, part.box_centre, part.radius, ALL_REGIONS[4])


def seen(shown: Part, part: Part) -> EdgeView:
    """The edges of a part in the canonical frame of another."""
    eye_obj, frame = frame_of(part)
    return analytic_view(shown, sample_edges(shown), make_caster(shown), eye_obj, frame)


def read(view: EdgeView) -> RidgePoints:
    return ridge(draw_views([view], np.eye(3)[None], 0.8)[0])


def test_a_perfect_painting_shows_the_true_pose(block: Part) -> None:
    view = seen(block, block)
    assert pose_bias(read(view), view, block) < 0.003


def test_what_is_painted_too_large_seems_nearer(block: Part) -> None:
    """1% larger is 1% nearer."""
    view = seen(block, block)
    larger = seen(box(tuple(1.01 * SIZE_MM)), block)
    assert pose_bias(read(larger), view, block) == pytest.approx(0.01 * DISTANCE_MM / block.diameter, rel=0.15)


def test_inventions_show_no_pose(block: Part) -> None:
    view = seen(block, block)
    elsewhere = replace(view, strokes=view.strokes + 500.0)
    assert np.isnan(pose_bias(read(view), elsewhere, block))
    assert np.isnan(pose_bias(RidgePoints(np.zeros((0, 2)), np.zeros((0, 2)), np.zeros(0)), view, block))
