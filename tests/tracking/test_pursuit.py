"""What is carried from frame to frame, and what is left behind where a track ends or the part was not seen."""

from __future__ import annotations

from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from acp_lab.cad.part import Part
from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.pose import transform
from acp_lab.prepared_part import PreparedPart
from acp_lab.sequences.frame import Frame
from acp_lab.tracking.frame_solver import FrameSolver
from acp_lab.tracking.frame_view import Estimate
from acp_lab.tracking.method import ACP, DIRECT_6DOF
from acp_lab.tracking.motions import ControlPointVariables
from acp_lab.tracking.pursuit import Pursuit
from acp_lab.tracking.result import TrackResult
from acp_lab.tracking.solution import SeenFrame, Solution
from acp_lab.tracking.sources.rigid import CadSamples
from acp_lab.tracking.stopwatch import Stopwatch
from acp_lab.tracking.targets.normals import NormalSearch
from acp_lab.tracking.tracker import Tracker
from acp_lab.tracking.usual_fit import UsualFit
from tests.made_parts import looking_at
from tests.tracking.rendered import AS_DRAWN, CAMERA, MadeSequence

POINTS = replace(
    DIRECT_6DOF,
    name="points",
    source=CadSamples(),
    control_points="mid-section",
    variables=ControlPointVariables("autograd", carry="points"),
    targets=(NormalSearch(bind="step"),),
)


def test_a_new_track_knows_nothing_of_the_one_before(model: PreparedPart, sequence: MadeSequence) -> None:
    tracker = Tracker(model, AS_DRAWN)
    frames = list(sequence.frames(4))
    tracker.start(frames[0], sequence.first_pose)  # type: ignore[arg-type]
    for frame in frames[1:]:
        tracker.track(frame)
    pursuit = tracker._pursuit
    assert pursuit.picture_memory is not None

    def knows() -> tuple[bool, ...]:
        usual = pursuit.usual
        scores = (usual.mean_quality, usual.mean_score, usual.last_score)
        things = (pursuit.predictor.motion, pursuit.carried, pursuit.picture_memory and pursuit.picture_memory.kept)
        return (*(thing is not None for thing in things), *(score != 0.0 for score in scores), pursuit.region != 0)

    assert all(knows()), "the test's own point is gone"
    pursuit.forget()
    assert not any(knows())
    with pytest.raises(ValueError, match="no pose observed yet"):
        _ = pursuit.last


def test_control_points_go_on_from_a_frame_that_was_seen_and_begin_anew_after_one_that_was_not(
    model: PreparedPart, sequence: MadeSequence, monkeypatch: pytest.MonkeyPatch
) -> None:
    tracker, starts, solve, look = Tracker(model, POINTS), list[FloatArray](), FrameSolver.solve, FrameSolver.look

    def noted(solver: FrameSolver, seen: SeenFrame, start: Estimate, *others: Any) -> Solution | None:
        starts.append(start.control_points)
        return solve(solver, seen, start, *others)

    monkeypatch.setattr(FrameSolver, "solve", noted)
    frames = list(sequence.frames(5))
    results = [tracker.start(frames[0], sequence.first_pose)]  # type: ignore[arg-type]
    results += [tracker.track(frame) for frame in frames[1:3]]
    monkeypatch.setattr(FrameSolver, "look", lambda *_, **__: None)
    assert tracker.track(frames[3]).note, "the part is not seen"
    monkeypatch.setattr(FrameSolver, "look", look)
    again = tracker.track(frames[4])
    assert {result.region for result in (*results, again)} == {4}, "W is the same all the time"
    # The part is expected where it was last, so I goes on as it was found, which is no projection of the pose.
    w = tracker.control_points_obj[4]
    projected = [CAMERA.project(transform(result.cam_T_obj, w)) for result in results]
    for k in (1, 2):
        np.testing.assert_allclose(starts[k], results[k - 1].control_points, atol=1e-6)
        assert np.abs(results[k].control_points - projected[k]).max() > 0.05
    np.testing.assert_allclose(starts[3], projected[2], atol=1e-6)


def test_control_points_go_on_where_the_camera_changes(model: PreparedPart, sequence: MadeSequence) -> None:
    """The second image is cut out of the whole one: I is the same points, in px of another camera."""

    def followed(cut: int) -> TrackResult:
        tracker, frames = Tracker(model, POINTS), list(sequence.frames(2))
        tracker.start(frames[0], sequence.first_pose)  # type: ignore[arg-type]
        second, width, height = frames[1], CAMERA.width - cut, CAMERA.height
        assert isinstance(second, Frame)
        camera = CAMERA.cropped(cut, 0, width, height)
        return tracker.track(Frame(second.index, np.ascontiguousarray(second.image[:, cut:]), camera))

    whole, cut = followed(0), followed(30)
    np.testing.assert_allclose(cut.control_points + np.array([30.0, 0.0]), whole.control_points, atol=0.2)


@pytest.mark.parametrize("other", [[1.0, 0.1, 0.3], [0.1, 0.2, -1.0]], ids=["from region 0", "from region 5"])
@pytest.mark.parametrize("first", [True, False])
def test_a_proposal_that_was_not_taken_leaves_no_view_region_behind(
    part: Part,
    model: PreparedPart,
    sequence: MadeSequence,
    monkeypatch: pytest.MonkeyPatch,
    other: list[float],
    first: bool,
) -> None:
    """Whichever of the two is tried first, and also where none of them is solved at all."""
    beside = looking_at(part, np.array(other), 330.0)
    pursuit, frame, solve = Pursuit(FrameSolver(model, ACP)), next(sequence.frames()), FrameSolver.solve
    assert isinstance(frame, Frame)
    assert pursuit.solver.choose_region(beside) != pursuit.solver.choose_region(sequence.first_pose) == 4

    def told(*given: Any) -> Solution | None:
        found = solve(*given)
        assert found is not None
        found.__dict__["score"] = 1.0 if pursuit.region == 4 else 0.5
        return found

    proposals = [sequence.first_pose, beside] if first else [beside, sequence.first_pose]
    monkeypatch.setattr(FrameSolver, "solve", told)
    best = pursuit.best_of(frame, proposals, Stopwatch())
    assert best is not None
    assert (best.score, pursuit.region) == (1.0, 4)
    monkeypatch.setattr(FrameSolver, "solve", lambda *_: None)
    pursuit.region = 2
    assert pursuit.best_of(frame, proposals, Stopwatch()) is None
    assert pursuit.region == 2


def test_the_view_region_is_that_of_the_try_that_was_taken(
    model: PreparedPart, sequence: MadeSequence, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The last level alone sees the part from region 4 and fits better than what all levels find, from region 2."""
    pursuit, frame = Pursuit(FrameSolver(model, ACP)), next(sequence.frames())
    assert isinstance(frame, Frame)
    tries = iter([(4, 0.5), (2, 0.4)])

    def tried(*_: Any) -> Any:
        pursuit.region, score = next(tries)
        return SimpleNamespace(score=score, estimate=SimpleNamespace(view=SimpleNamespace(region=pursuit.region)))

    monkeypatch.setattr(pursuit.predictor, "is_sure", lambda _: True)
    monkeypatch.setattr(pursuit, "sight", lambda *_: False)
    monkeypatch.setattr(pursuit, "try_from", tried)
    pursuit.predictor.restart(sequence.first_pose)
    pursuit.usual.begin(1.0, 1.0)
    _, found = pursuit.follow(frame, Stopwatch())
    assert found is not None
    assert (found.score, pursuit.region) == (0.5, 4)


@dataclass
class Scored:
    """Stands for a solution."""

    score: float


@pytest.mark.parametrize(("mean", "last"), [(1.0, 0.5), (0.5, 1.0)], ids=["the last was poor", "the last was good"])
def test_a_fit_is_as_usual_by_the_lower_of_the_last_score_and_the_mean(mean: float, last: float) -> None:
    usual = UsualFit()
    usual.mean_score, usual.last_score = mean, last
    assert usual.reached(Scored(0.46), 0.9)  # type: ignore[arg-type]
    assert not usual.reached(Scored(0.44), 0.9)  # type: ignore[arg-type]
    assert not usual.reached(None, 0.0)


def test_what_is_usual_is_the_mean_of_all_frames_at_first_and_then_a_running_one() -> None:
    """A first frame fits too well: soon it must not count for more than the others."""
    usual = UsualFit()
    usual.begin(1.0, 1.3)
    for number in range(2, 11):
        usual.take_in(fitted(0.9))
        assert usual.mean_score == pytest.approx((1.3 + 0.9 * (number - 1)) / number)
    before = usual.mean_score
    usual.take_in(fitted(0.5))
    assert usual.mean_score == pytest.approx(before + 0.1 * (0.5 - before))
    usual.begin(1.0, 1.1)
    usual.take_in(fitted(0.9))
    assert usual.mean_score == pytest.approx(1.0)


def fitted(score: float) -> Any:
    """Stands for a solution."""
    return SimpleNamespace(score=score, judgement=SimpleNamespace(quality=score))
