"""The sparse region tracker: posteriors against a plain twin, lines by view, and what the whole method follows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from acp_lab.cad.part import Part
from acp_lab.cad.raycast import hit_map, make_caster
from acp_lab.errors import TrackingError
from acp_lab.geometry.arrays import ByteImage, FloatArray
from acp_lab.geometry.camera import Camera
from acp_lab.geometry.pose import disturb_pose, transform
from acp_lab.prepared_part import PreparedPart
from acp_lab.sequences.frame import Frame
from acp_lab.tracking.frame_solver import FrameSolver
from acp_lab.tracking.learning.knowledge import Off, TargetLearning
from acp_lab.tracking.method import ACP, REGION
from acp_lab.tracking.motions import PoseVariables
from acp_lab.tracking.priors import TikhonovPrior
from acp_lab.tracking.schedule import Level
from acp_lab.tracking.targets.contour_regions import ContourRegions, ContourTarget
from acp_lab.tracking.targets.correspondence_lines import CorrespondenceLines
from acp_lab.tracking.targets.normals import NormalSearch
from acp_lab.tracking.targets.step_posterior import PLACES, SEGMENTS, WINDOW, SmoothStep, fill_posteriors
from acp_lab.tracking.tracker import Tracker
from tests.made_parts import looking_at
from tests.tracking.rendered import add_percent, poses, prepared

CAMERA = Camera(width=400, height=320, fx=640.0, fy=650.0, cx=199.5, cy=159.5)
PART_COLOUR, GROUND_COLOUR = (180, 60, 40), (40, 90, 150)


@pytest.fixture
def truth(part: Part) -> FloatArray:
    return looking_at(part, np.array([0.8, 0.6, 1.0]), 330.0, 0.3)


@pytest.fixture
def model(part: Part) -> PreparedPart:
    return prepared(part)


def painted(part: Part, cam_T_obj: FloatArray) -> ByteImage:
    """Two flat colours."""
    _, face = hit_map(part, make_caster(part), CAMERA, cam_T_obj)
    return np.where((face >= 0)[..., None], np.array(PART_COLOUR, np.uint8), np.array(GROUND_COLOUR, np.uint8))


# ---- posteriors ----------------------------------------------------------------------------------------------


def plain_posterior(log_odds: FloatArray, scale: int, step: FloatArray) -> FloatArray:
    """(12,) probabilities, word for word: log_odds (19 * scale,) of the pixels from inside to outside."""
    inside = 1.0 / (1.0 + np.exp(-log_odds.reshape(SEGMENTS, scale).sum(1)))
    found = [np.prod(step * inside[d : d + WINDOW] + (1 - step) * (1 - inside[d : d + WINDOW])) for d in range(PLACES)]
    return np.array(found) / np.sum(found)


@pytest.mark.parametrize("scale", [1, 2, 5])
def test_posteriors_are_those_of_the_formula(scale: int, rng: np.random.Generator) -> None:
    width = SEGMENTS * scale
    bins = np.arange(width, dtype=np.uint16)[None].repeat(3, 0)
    log_odds = rng.normal(0.0, 1.0, width).astype(np.float32)
    step = SmoothStep(0.4, 0.7)
    found = np.empty((1, PLACES + 2))
    middle = np.array([[0.5 * (width - 1), 1.0]])
    fill_posteriors(bins, log_odds, middle, np.array([[1.0, 0.0]]), scale, step.values, found)
    expected = plain_posterior(log_odds.astype(float), scale, step.values)
    probability = np.exp(found[0, :PLACES]) / np.exp(found[0, :PLACES]).sum()
    np.testing.assert_allclose(probability, expected, rtol=1e-6)
    offsets = np.arange(PLACES) - 0.5 * (PLACES - 1)
    assert found[0, PLACES] == pytest.approx(expected @ offsets, abs=1e-6)
    assert found[0, PLACES + 1] == pytest.approx(expected @ offsets**2 - (expected @ offsets) ** 2, abs=1e-6)


@pytest.mark.parametrize("shift", [-3, 0, 2])
def test_a_clear_step_is_found_where_it_is(shift: int) -> None:
    width = 40
    log_odds = np.where(np.arange(width) < 20 + shift, 3.0, -3.0).astype(np.float32)
    bins = np.arange(width, dtype=np.uint16)[None].repeat(2, 0)
    found = np.empty((1, PLACES + 2))
    # The step lies between two pixels, half a pixel beyond the line's middle.
    fill_posteriors(bins, log_odds, np.array([[19.0, 0.0]]), np.array([[1.0, 0.0]]), 1, SmoothStep().values, found)
    assert found[0, PLACES] == pytest.approx(shift + 0.5, abs=0.15)


def test_pixels_beyond_the_crop_say_nothing() -> None:
    found = np.empty((1, PLACES + 2))
    bins, log_odds = np.zeros((2, 2), np.uint16), np.array([5.0], np.float32)
    fill_posteriors(bins, log_odds, np.array([[900.0, 900.0]]), np.array([[1.0, 0.0]]), 2, SmoothStep().values, found)
    assert found[0, PLACES] == pytest.approx(0.0, abs=1e-9)
    assert found[0, PLACES + 1] == pytest.approx(np.mean((np.arange(PLACES) - 5.5) ** 2))


# ---- lines and steps -----------------------------------------------------------------------------------------


def looked_at(model: PreparedPart, image: ByteImage, prior: FloatArray) -> tuple[FrameSolver, ContourTarget]:
    solver = FrameSolver(model, REGION)
    seen = solver.look(image, CAMERA, prior, 4)
    assert seen is not None
    target = seen.targets[0]
    assert isinstance(target, ContourTarget)
    return solver, target


def test_lines_point_off_the_part_and_end_where_it_ends(part: Part, model: PreparedPart, truth: FloatArray) -> None:
    image = painted(part, truth)
    solver, target = looked_at(model, image, truth)
    seen = solver.look(image, CAMERA, truth, 4)
    assert seen is not None
    at = seen.view.at_pose(truth)
    edges = solver.source.generate(at, 300)
    assert edges.outline.all()
    lines = target.lines(edges, at)
    assert len(lines) > 100

    def on_part(way_px: float) -> float:
        x, y = np.rint(lines.points + way_px * lines.outward).astype(int).T
        return float((image[y, x] == PART_COLOUR).all(1).mean())

    assert on_part(-1.5) > 0.97
    assert on_part(1.5) < 0.03
    # A second time from what is kept of the view: the same.
    again = target.lines(edges, at)
    np.testing.assert_allclose(again.free, lines.free)


@pytest.mark.parametrize("reach_px", [19, 57, 76])  # lines that are free for 6, 18 and 24 px
def test_rounding_does_not_choose_the_lines(
    part: Part, model: PreparedPart, truth: FloatArray, reach_px: int, rng: np.random.Generator
) -> None:
    solver, target = looked_at(model, painted(part, truth), truth)
    seen = solver.look(painted(part, truth), CAMERA, truth, 4)
    assert seen is not None
    at = seen.view.at_pose(truth)
    target.memory.learn(target.lines(solver.source.generate(at, 300), at))
    chosen = []
    for _ in range(4):
        pose = truth * (1.0 + 1e-14 * rng.standard_normal((4, 4)))
        at = seen.view.at_pose(pose)
        edges = solver.source.generate(at, 300)
        chosen.append(np.flatnonzero(target.bind(edges, at, Level(reach_px, 3.0))(edges).weights))
    assert len(chosen[0]) > 20
    for other in chosen[1:]:
        np.testing.assert_array_equal(other, chosen[0])


def test_a_step_goes_towards_the_truth_and_the_next_is_local(
    part: Part, model: PreparedPart, truth: FloatArray
) -> None:
    image = painted(part, truth)
    solver, target = looked_at(model, image, truth)
    seen = solver.look(image, CAMERA, truth, 4)
    assert seen is not None
    at = seen.view.at_pose(truth)
    edges = solver.source.generate(at, 300)
    target.memory.learn(target.lines(edges, at))
    # As if the part were drawn three pixels further right.
    moved = replace(edges, points=edges.points + np.array([3.0, 0.0]))
    measure = target.bind(moved, at, Level(19, 3.0))
    first = measure(moved)
    weights = first.weights
    assert first.loss == pytest.approx(0.5 * (weights @ first.residuals**2) / len(moved)), "over the edge points"
    back_px = -3.0 * first.directions[:, 0]
    assert (weights > 0).sum() > 50
    assert np.median(np.abs(first.residuals - back_px)[weights > 0.5]) < 0.6
    after = replace(moved, points=moved.points - np.array([1.0, 0.0]))
    rest = measure(after)
    across = (weights > 0.5) & (np.abs(first.directions[:, 0]) > 0.7)
    # The local step overshoots on purpose, by its rate.
    assert (np.sign(rest.residuals) == np.sign(-first.directions[:, 0]))[across].mean() > 0.8
    assert rest.loss < first.loss


def test_unknown_colours_move_nothing(part: Part, model: PreparedPart, truth: FloatArray) -> None:
    tracker = Tracker(model, REGION)
    off = disturb_pose(truth, part.box_centre, 2.0, 2.0, np.random.default_rng(0))
    started = tracker.start(Frame(0, painted(part, truth), CAMERA), off)
    np.testing.assert_allclose(started.cam_T_obj, off, atol=1e-9)
    assert started.state == "tracking"


def test_the_method_follows_a_part_in_two_colours(part: Part, model: PreparedPart, truth: FloatArray) -> None:
    tracker = Tracker(model, "region")
    path = poses(part, truth, 8)
    tracker.start(Frame(0, painted(part, path[0]), CAMERA), path[0])
    off, still = [], []
    for number, pose in enumerate(path[1:], start=1):
        result = tracker.track(Frame(number, painted(part, pose), CAMERA))
        off.append(add_percent(part, result.cam_T_obj, pose))
        still.append(add_percent(part, path[0], pose))
    assert max(off) < 4.0
    assert np.median(off) < 1.5
    assert max(still) > 8.0
    assert result.quality > 0.8


def at_distance(part: Part, cam_T_obj: FloatArray, times: float) -> FloatArray:
    """The pose at so many times its distance."""
    moved = cam_T_obj.copy()
    moved[:3, 3] += (times - 1.0) * transform(cam_T_obj, part.box_centre)
    return moved


def test_a_part_that_was_first_seen_near_has_lines_far_away(part: Part, model: PreparedPart, truth: FloatArray) -> None:
    """Looked along for so many px, lines of a near part are known to be free for few mm only."""
    far, near = at_distance(part, truth, 1.5), at_distance(part, truth, 0.7)

    def lines_far_away(first: FloatArray | None) -> int:
        solver, _ = looked_at(model, painted(part, truth), truth)
        for pose in (far,) if first is None else (first, far):
            seen = solver.look(painted(part, pose), CAMERA, pose, 4)
            assert seen is not None
            target, at = seen.targets[0], seen.view.at_pose(pose)
            assert isinstance(target, ContourTarget)
            lines = target.lines(solver.source.generate(at, 300), at)
        return int((lines.free.min(0) >= 18.0).sum())

    assert lines_far_away(None) > 50
    assert lines_far_away(near) > 0.9 * lines_far_away(None)


def test_of_a_part_whose_outline_is_never_seen_nothing_is_known(
    part: Part, model: PreparedPart, truth: FloatArray, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As in a close-up that shows no outline, and so no colours beside it."""
    monkeypatch.setattr(CorrespondenceLines, "bins_beside", lambda *_: (np.zeros(0, np.int64),) * 2)
    tracker = Tracker(model, "region")
    tracker.start(Frame(0, painted(part, truth), CAMERA), truth)
    assert tracker.track(Frame(1, painted(part, truth), CAMERA)).quality == 0.0


def test_a_colour_like_the_ground_lowers_the_quality(part: Part, model: PreparedPart, truth: FloatArray) -> None:
    tracker = Tracker(model, "region")
    tracker.start(Frame(0, painted(part, truth), CAMERA), truth)
    seen = tracker.track(Frame(1, painted(part, truth), CAMERA))
    blank = np.full((CAMERA.height, CAMERA.width, 3), GROUND_COLOUR, np.uint8)
    hidden = tracker.track(Frame(2, blank, CAMERA))
    assert hidden.quality < 0.2 < 0.8 < seen.quality


# ---- sums that are none --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"learning": Off()}, "colours, must be learnt"),
        ({"targets": (NormalSearch(),)}, "no target of this method learns"),
    ],
)
def test_sums_in_which_a_setting_would_be_ignored(change: dict[str, object], words: str) -> None:
    with pytest.raises(TrackingError, match=words):
        replace(REGION, **change)  # type: ignore[arg-type]


def test_other_methods_keep_what_they_learn() -> None:
    with pytest.raises(TrackingError, match="no target of this method learns"):
        replace(ACP, targets=(NormalSearch(),), learning=TargetLearning())


@pytest.mark.parametrize("values", [{"lines": 2}, {"local_rate": 0.0}, {"free_segments": -1.0}, {"reach_px": 1.0}])
def test_settings_that_make_no_sense(values: dict[str, float]) -> None:
    with pytest.raises(TrackingError):
        ContourRegions(**values)  # type: ignore[arg-type]


@pytest.mark.parametrize("values", [{"amplitude": 0.5}, {"slope": -1.0}])
def test_steps_that_make_no_sense(values: dict[str, float]) -> None:
    with pytest.raises(TrackingError):
        SmoothStep(**values)


def test_tikhonov_adds_the_same_to_every_step(part: Part, model: PreparedPart, truth: FloatArray) -> None:
    solver, _ = looked_at(model, painted(part, truth), truth)
    seen = solver.look(painted(part, truth), CAMERA, truth, 4)
    assert seen is not None
    at = seen.view.at_pose(truth)
    prior = TikhonovPrior(100.0, 0.5).bind(PoseVariables(), at)
    found = prior.equations(at, 10.0)
    np.testing.assert_allclose(found.hessian, np.diag([10.0, 10.0, 10.0, 0.05, 0.05, 0.05]))
    np.testing.assert_allclose(found.downhill, 0.0)
    assert prior.loss(at, 10.0) == 0.0
    with pytest.raises(TrackingError, match=r"priors\.rotation"):
        TikhonovPrior(-1.0)
