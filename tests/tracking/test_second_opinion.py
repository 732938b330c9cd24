"""A first frame's pose is contradicted by what the detector finds elsewhere, where that is clearly likelier."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from acp_lab.detection.view_templates import make_views
from acp_lab.errors import TrackingError
from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.pose import disturb_pose
from acp_lab.prepared_part import PreparedPart
from acp_lab.sequences.frame import Frame
from acp_lab.tracking.find import Detection, Finder
from acp_lab.tracking.frame_solver import FrameSolver
from acp_lab.tracking.learning.knowledge import Off
from acp_lab.tracking.method import ACP
from acp_lab.tracking.second_opinion import Question, second_opinion
from acp_lab.tracking.snap import snap
from acp_lab.tracking.solution import SeenFrame, Solution
from acp_lab.tracking.start import Contradiction, SecondOpinion
from acp_lab.tracking.stopwatch import Stopwatch
from acp_lab.tracking.tracker import Tracker
from tests.prepared_sample import sample_model, sample_scene
from tests.tracking.rendered import add_percent

UNASKED = replace(ACP, start=replace(ACP.start, second_opinion=Off()))


@pytest.fixture(scope="module")
def model() -> PreparedPart:
    """With stored views, as `prepare` makes them."""
    plain = sample_model()
    return replace(plain, views=make_views(plain.part, plain.best_generator()))


@pytest.fixture(scope="module")
def frame() -> Frame:
    first = sample_scene().frame(0)
    assert isinstance(first, Frame)
    return first


@pytest.fixture
def truth() -> FloatArray:
    return sample_scene().first_pose


def turned(truth: FloatArray, angle_deg: float, seed: int) -> FloatArray:
    return disturb_pose(truth, sample_model().part.box_centre, angle_deg, 10.0, np.random.default_rng(seed))


@pytest.mark.parametrize("seed", [0, 4, 9])
def test_a_start_that_leads_elsewhere_is_mended(
    model: PreparedPart, frame: Frame, truth: FloatArray, seed: int
) -> None:
    start = turned(truth, 60.0, seed)
    alone = Tracker(model, UNASKED).start(frame, start)
    assert add_percent(model.part, alone.cam_T_obj, truth) > 20.0
    assert "elsewhere" not in alone.note
    tracker = Tracker(model)
    result = tracker.start(frame, start)
    assert add_percent(model.part, result.cam_T_obj, truth) < 2.0
    assert result.note == "the detector finds it elsewhere"
    assert not tracker.start_was_trusted
    # As if it had begun there: nothing is kept of where it was sought first.
    after = tracker.track(Frame(1, frame.image, frame.camera))
    assert add_percent(model.part, after.cam_T_obj, truth) < 2.0
    assert add_percent(model.part, snap(model, frame, start).cam_T_obj, truth) < 2.0


@pytest.mark.parametrize(("angle_deg", "asked"), [(0.0, 0), (5.0, 1)])
def test_the_detector_is_asked_where_a_start_is_not_trusted(
    model: PreparedPart, frame: Frame, truth: FloatArray, angle_deg: float, asked: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    find, calls = Finder.find, []

    def counted(self: Finder, *args: object, **named: object) -> object:
        calls.append(args)
        return find(self, *args, **named)  # type: ignore[arg-type]

    monkeypatch.setattr(Finder, "find", counted)
    start = truth if angle_deg == 0.0 else turned(truth, angle_deg, 0)
    results = [Tracker(model, method).start(frame, start) for method in (ACP, UNASKED)]
    assert len(calls) == asked
    # It agrees: nothing changes.
    assert np.array_equal(results[0].cam_T_obj, results[1].cam_T_obj)
    assert results[0].note == ""


def test_a_part_without_stored_views_is_not_kept_waiting(
    frame: Frame, truth: FloatArray, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Finder, "find", lambda *_, **__: pytest.fail("the detector was asked"))
    assert sample_model().views is None
    start = turned(truth, 60.0, 0)
    assert Tracker(sample_model()).start(frame, start).note != "the detector finds it elsewhere"
    snap(sample_model(), frame, start)


class Told:
    """Stands for a finder whose hypotheses are told, the best first."""

    def __init__(self, *hypotheses: tuple[FloatArray, float]) -> None:
        self.found = tuple(Detection(pose, score, np.array([0.0, 0.0, 1.0])) for pose, score in hypotheses)
        self.model = sample_model()

    def find(self, *_: object, **__: object) -> tuple[Detection, ...]:
        return self.found

    def is_same(self, cam_T_obj: FloatArray, others: tuple[FloatArray, ...]) -> bool:
        return any(np.allclose(cam_T_obj, other) for other in others)


@pytest.mark.parametrize(
    ("own", "other", "aside", "contradicts"),
    [
        (0.015, 0.98, 0.6, False),  # both are likely where they are, in whatever pose: two parts
        (0.015, 0.98, 0.0, True),  # in one place only one of them is
        (0.001, 0.5, 0.6, True),  # the pose in question is hardly likely
    ],
)
def test_what_is_found_in_another_place_is_another_part(
    model: PreparedPart, frame: Frame, truth: FloatArray, own: float, other: float, aside: float, contradicts: bool
) -> None:
    wrong = turned(truth, 60.0, 0)
    wrong[0, 3] += aside * model.part.diameter
    solver = FrameSolver(model, ACP)

    def look(pose: FloatArray) -> SeenFrame | None:
        return solver.look(frame.image, frame.camera, pose, solver.choose_region(pose))

    def held(solution: Solution) -> float:
        return 1.0 if add_percent(model.part, solution.cam_T_obj, truth) < 2.0 else 0.0

    beside = wrong.copy()
    beside[2, 3] += 8.0
    finder = Told((truth, other), (wrong, own / 2), (beside, own / 2))
    question = Question(frame, look, truth, wrong)
    elsewhere = second_opinion(question, solver, finder, ACP.start, held, Stopwatch())  # type: ignore[arg-type]
    assert (elsewhere is not None) is contradicts


def test_where_the_place_is_right_another_part_does_not_hide_the_pose_that_is(
    model: PreparedPart, frame: Frame, truth: FloatArray
) -> None:
    wrong, aside = turned(truth, 60.0, 0), truth.copy()
    aside[0, 3] += 0.8 * model.part.diameter
    solver = FrameSolver(model, ACP)

    def look(pose: FloatArray) -> SeenFrame | None:
        return solver.look(frame.image, frame.camera, pose, solver.choose_region(pose))

    def held(solution: Solution) -> float:
        return 1.0 if add_percent(model.part, solution.cam_T_obj, truth) < 2.0 else 0.0

    finder = Told((aside, 0.6), (truth, 0.38), (wrong, 0.001))
    question = Question(frame, look, truth, wrong)
    elsewhere = second_opinion(question, solver, finder, ACP.start, held, Stopwatch())  # type: ignore[arg-type]
    assert elsewhere is not None
    assert add_percent(model.part, elsewhere, truth) < 2.0


@pytest.mark.parametrize(
    ("own", "other", "is_near", "contradicts"),
    [
        (0.01, 0.5, True, True),
        (0.05, 0.5, True, False),  # not clearly likelier than what the start speaks for
        (0.05, 0.5, False, True),
        (0.0, 0.2, True, False),  # hardly likely itself
        (0.0, 0.2, False, True),
        (0.5, 0.4, False, False),
    ],
)
def test_more_is_asked_of_what_contradicts_a_pose_near_the_start(
    model: PreparedPart, frame: Frame, truth: FloatArray, own: float, other: float, is_near: bool, contradicts: bool
) -> None:
    wrong = turned(truth, 60.0, 0)
    solver = FrameSolver(model, ACP)
    finder = Told(*sorted([(wrong, own), (truth, other)], key=lambda one: -one[1]))

    def look(pose: FloatArray) -> SeenFrame | None:
        return solver.look(frame.image, frame.camera, pose, solver.choose_region(pose))

    def asked(confidence: float | None) -> FloatArray | None:
        def held(solution: Solution) -> float:
            return solution.quality if confidence is None else confidence

        opinion = SecondOpinion(near=Contradiction(0.3, 20.0), far=Contradiction(0.15, 3.0))
        config = replace(ACP.start, second_opinion=opinion)
        question = Question(frame, look, wrong if is_near else truth, wrong)
        return second_opinion(question, solver, finder, config, held, Stopwatch())  # type: ignore[arg-type]

    elsewhere = asked(None)
    assert (elsewhere is not None) is contradicts
    if elsewhere is not None:
        assert add_percent(model.part, elsewhere, truth) < 2.0
    # Nor is it taken where the tracker holds it no likelier.
    assert asked(0.5) is None


@pytest.mark.parametrize(
    "setting",
    [
        {"within_deg": 0.0}, {"depth_ratio": 0.9}, {"around_px": -1.0}, {"around_px": float("nan")},
        {"near": Contradiction(1.1, 2.0)}, {"far": Contradiction(0.1, 0.5)},
    ],
)  # fmt: skip
def test_nonsense_is_refused(setting: dict[str, float]) -> None:
    with pytest.raises(TrackingError, match=rf"start.second_opinion.{next(iter(setting))}.* = "):
        SecondOpinion(**setting)  # type: ignore[arg-type]
