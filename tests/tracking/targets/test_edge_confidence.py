"""Edges across the outline, chosen by colours and distance: against a plain twin, and what the method follows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from acp_lab.cad.part import Part
from acp_lab.cad.raycast import hit_map, make_caster
from acp_lab.errors import TrackingError
from acp_lab.geometry.arrays import ByteImage, FloatArray
from acp_lab.geometry.camera import Camera
from acp_lab.geometry.pose import disturb_pose
from acp_lab.prepared_part import PreparedPart
from acp_lab.sequences.frame import Frame
from acp_lab.tracking.frame_solver import FrameSolver
from acp_lab.tracking.learning.knowledge import Off
from acp_lab.tracking.method import REGION_POINTS, SLET
from acp_lab.tracking.motions import ControlPointVariables
from acp_lab.tracking.schedule import Level
from acp_lab.tracking.targets.edge_confidence import ConfidenceTarget, EdgeConfidence, _outline_shares
from acp_lab.tracking.tracker import Tracker
from tests.made_parts import looking_at
from tests.tracking.rendered import add_percent, poses, prepared

CAMERA = Camera(width=400, height=320, fx=640.0, fy=650.0, cx=199.5, cy=159.5)
PART_COLOUR, GROUND_COLOUR, STRIPE_COLOUR = (180, 60, 40), (40, 90, 150), (60, 130, 210)


@pytest.fixture
def truth(part: Part) -> FloatArray:
    return looking_at(part, np.array([0.8, 0.6, 1.0]), 330.0, 0.3)


@pytest.fixture
def model(part: Part) -> PreparedPart:
    return prepared(part)


def painted(part: Part, cam_T_obj: FloatArray, stripes: bool = False) -> ByteImage:
    """The part in one colour; the ground in one, or in stripes of two, whose edges are as strong as the outline's."""
    _, face = hit_map(part, make_caster(part), CAMERA, cam_T_obj)
    across = (np.arange(CAMERA.width) // 12 % 2 == 1) & stripes
    ground = np.where(across[None, :, None], np.array(STRIPE_COLOUR), np.array(GROUND_COLOUR))
    ground = np.broadcast_to(ground, (*face.shape, 3))
    return np.where((face >= 0)[..., None], np.array(PART_COLOUR), ground).astype(np.uint8)


def test_shares_are_those_of_the_three_products(rng: np.random.Generator) -> None:
    width, gap_px, beside_px = 60, 1, 4
    part_likelihood, ground_likelihood = rng.uniform(0.05, 1.0, (2, width))
    log_odds = np.log(part_likelihood / ground_likelihood).astype(np.float32)
    bins = np.arange(width, dtype=np.uint16)[None].repeat(3, 0)
    offsets = np.arange(-20.0, 21.0)[None]
    found = np.zeros_like(offsets)
    _outline_shares(
        bins, log_odds, np.array([[30.0, 1.0]]), np.array([[1.0, 0.0]]), offsets, gap_px, beside_px, found
    )
    kept = 0
    for offset, share in zip(offsets[0], found[0], strict=True):
        edge = 30 + int(offset)
        inside = np.arange(edge - gap_px - beside_px, edge - gap_px)
        outside = np.arange(edge + gap_px + 1, edge + gap_px + beside_px + 1)
        outline = np.prod(part_likelihood[inside]) * np.prod(ground_likelihood[outside])
        in_part = np.prod(part_likelihood[inside]) * np.prod(part_likelihood[outside])
        in_ground = np.prod(ground_likelihood[inside]) * np.prod(ground_likelihood[outside])
        expected = outline / (outline + in_part + in_ground) if outline > max(in_part, in_ground) else 0.0
        assert share == pytest.approx(expected, rel=1e-4, abs=1e-9)
        kept += share > 0.0
    assert 0 < kept < len(offsets[0])


def test_edges_of_the_background_are_passed_over(part: Part, model: PreparedPart, truth: FloatArray) -> None:
    image = painted(part, truth, stripes=True)
    solver = FrameSolver(model, SLET)
    seen = solver.look(image, CAMERA, truth, 4)
    assert seen is not None
    target = seen.targets[0]
    assert isinstance(target, ConfidenceTarget)
    at = seen.view.at_pose(truth)
    edges = solver.source.generate(at, 200)
    target.colours.memory.learn(target.colours.lines(edges, at))
    level = Level(20, 12.0, 200)
    shifted = replace(edges, points=edges.points + np.array([5.0, 0.0]))
    measure = target.bind(shifted, at, level)
    told = measure(shifted)
    sideways = (told.weights > 0.5) & (np.abs(told.directions[:, 0]) > 0.7)
    off_px = np.abs(told.residuals + 5.0 * told.directions[:, 0])[sideways]
    assert told.loss == pytest.approx(0.5 * (told.weights @ told.residuals**2) / len(shifted)), "over the edge points"
    assert sideways.sum() > 15
    assert np.median(off_px) < 1.0
    # The nearest image edge, whatever its colours, is often a stripe.
    nearest = np.abs(measure._offsets).min(1)[np.abs(measure.lines.outward[:, 0]) > 0.7]
    assert (nearest < 3.0).mean() > 0.2


def test_unknown_colours_move_nothing(part: Part, model: PreparedPart, truth: FloatArray) -> None:
    off = disturb_pose(truth, part.box_centre, 2.0, 2.0, np.random.default_rng(0))
    started = Tracker(model, SLET).start(Frame(0, painted(part, truth), CAMERA), off)
    np.testing.assert_allclose(started.cam_T_obj, off, atol=1e-9)
    assert started.state == "tracking"


def test_the_method_follows_a_part_on_striped_ground(part: Part, model: PreparedPart, truth: FloatArray) -> None:
    tracker = Tracker(model, "slet")
    path = poses(part, truth, 8)
    tracker.start(Frame(0, painted(part, path[0], stripes=True), CAMERA), path[0])
    off, still = [], []
    for number, pose in enumerate(path[1:], start=1):
        result = tracker.track(Frame(number, painted(part, pose, stripes=True), CAMERA))
        off.append(add_percent(part, result.cam_T_obj, pose))
        still.append(add_percent(part, path[0], pose))
    assert max(off) < 4.0
    assert max(still) > 8.0
    assert result.quality > 0.6


def test_a_part_that_is_gone_lowers_the_quality(part: Part, model: PreparedPart, truth: FloatArray) -> None:
    tracker = Tracker(model, SLET)
    tracker.start(Frame(0, painted(part, truth), CAMERA), truth)
    seen = tracker.track(Frame(1, painted(part, truth), CAMERA))
    blank = np.full((CAMERA.height, CAMERA.width, 3), GROUND_COLOUR, np.uint8)
    assert tracker.track(Frame(2, blank, CAMERA)).quality < 0.2 < 0.6 < seen.quality


def test_sums_in_which_a_setting_would_be_ignored() -> None:
    with pytest.raises(TrackingError, match="colours, must be learnt"):
        replace(SLET, learning=Off())
    with pytest.raises(TrackingError, match="colours follow those of a level"):
        replace(REGION_POINTS, variables=ControlPointVariables(direction="autograd"))


@pytest.mark.parametrize(
    "values", [{"lines": 2}, {"beside_px": 0}, {"gap_px": -1}, {"least_contrast": 1.0}, {"reach_px": 1.0}]
)
def test_settings_that_make_no_sense(values: dict[str, float]) -> None:
    with pytest.raises(TrackingError, match=f"targets.{next(iter(values))}"):
        EdgeConfidence(**values)  # type: ignore[arg-type]
