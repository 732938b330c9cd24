"""The quality as a probability: what it is made of, and that it tells right poses from wrong ones."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest

from acp_lab.cad.part import Part
from acp_lab.errors import TrackingError
from acp_lab.geometry.pose import disturb_pose
from acp_lab.prepared_part import PreparedPart
from acp_lab.sequences.frame import Frame
from acp_lab.tracking.confidence import EDGES_ALONE, RIGHT_SHARE, Confidence, weight_of_evidence
from acp_lab.tracking.learning.knowledge import Off
from acp_lab.tracking.method import ACP, ACP_EDGES, DIRECT_6DOF, Method
from acp_lab.tracking.schedule import Level
from acp_lab.tracking.stopwatch import Stopwatch
from acp_lab.tracking.tracker import Tracker
from acp_lab.tracking.uncertainty import ExpectedError, PoseUncertainty
from tests.tracking.rendered import MadeSequence


@dataclass
class Said:
    score: float


@pytest.mark.parametrize("name", ["constant", "agreement", "contrast", "margin"])
@pytest.mark.parametrize("value", [float("nan"), float("inf"), -1e4])
def test_nonsense_is_refused(name: str, value: float) -> None:
    with pytest.raises(TrackingError, match=f"confidence.{name}"):
        Confidence(**{name: value})


def test_a_method_without_a_search_cannot_have_one() -> None:
    with pytest.raises(TrackingError, match="confidence"):
        replace(DIRECT_6DOF, confidence=Confidence())


def test_the_weight_of_evidence() -> None:
    assert weight_of_evidence(0.0) == 0.0
    assert weight_of_evidence(0.99) == pytest.approx(2.0 * weight_of_evidence(0.63), rel=0.1)
    weights = [weight_of_evidence(quality) for quality in np.linspace(0.0, 1.0, 101)]
    assert all(np.isfinite(weights))
    assert (np.diff(weights) >= 0.0).all()


@pytest.mark.parametrize("method", [ACP, ACP_EDGES], ids=lambda method: method.name)
def test_right_poses_are_likely_and_wrong_ones_are_not(
    part: Part, model: PreparedPart, sequence: MadeSequence, method: object
) -> None:
    """At poses as they are: 24 disturbed by 5 to 20 degrees and as many mm, and those that were tracked."""
    tracker = Tracker(model, method)  # type: ignore[arg-type]
    frames = [frame for frame in sequence.frames(6) if isinstance(frame, Frame)]
    right = [tracker.start(frames[0], sequence.first_pose).quality]
    right += [tracker.track(frame).quality for frame in frames[1:]]
    confidence = method.confidence  # type: ignore[attr-defined]
    rng, wrong, truth = np.random.default_rng(2), list[float](), sequence.truth(frames[-1].index, 1)
    assert truth is not None
    for size in np.linspace(5.0, 20.0, 24):
        pose = disturb_pose(truth, part.box_centre, size, size, rng)
        seen = tracker.look(frames[-1], pose)
        assert seen is not None
        solution = tracker.solver.look_at(seen, seen.view.at_pose(pose), Level(5, 1.0, 600), Stopwatch())
        wrong.append(0.0 if solution is None else confidence.of(solution))
    assert min(right) > 0.8
    assert np.median(wrong) < 0.35
    assert np.quantile(wrong, 0.9) < 0.5  # by chance a wrong pose may lie on edges


def test_what_the_log_odds_are_made_of(model: PreparedPart, sequence: MadeSequence) -> None:
    tracker = Tracker(model)
    frame = next(frame for frame in sequence.frames(1) if isinstance(frame, Frame))
    tracker.start(frame, sequence.first_pose)
    seen = tracker.look(frame, sequence.first_pose)
    assert seen is not None
    solution = tracker.solver.look_at(seen, seen.view.at_pose(sequence.first_pose), Level(5, 1.0), Stopwatch())
    assert solution is not None
    first, regions = solution.judgements
    agreement, contrast = first.quality, first.contrast  # type: ignore[attr-defined]
    assert 0.0 < contrast <= 1.0
    odds = -2.0 + 3.0 * agreement + 4.0 * contrast + 5.0 * regions.score
    assert Confidence(-2.0, 3.0, 4.0, 5.0).of(solution) == pytest.approx(1.0 / (1.0 + np.exp(-odds)))
    alone = replace(solution, judgements=(first,))
    assert EDGES_ALONE.of(alone) == pytest.approx(EDGES_ALONE.of(solution))


def test_an_inexact_pose_is_less_likely_right() -> None:
    confidence = replace(Confidence(), spread=1.0)
    assert confidence.exactness(0.0) == 1.0
    # One standard deviation is 5%: as many are within as within one sigma.
    assert confidence.exactness(RIGHT_SHARE) == pytest.approx(0.6827, abs=1e-4)
    assert replace(confidence, spread=0.5).exactness(RIGHT_SHARE) == pytest.approx(0.9545, abs=1e-4)
    assert replace(confidence, spread=0.0).exactness(10.0) == 1.0
    shares = [confidence.exactness(error) for error in np.linspace(0.0, 1.0, 101)]
    assert (np.diff(shares) <= 0.0).all()
    assert shares[-1] < 0.05
    assert confidence.exactness(float("inf")) == 0.0
    assert confidence.exactness(float("nan")) == 0.0, "whoever knows nothing of a pose does not call it exact"
    for value in (-0.1, float("nan"), float("inf")):
        with pytest.raises(TrackingError, match=r"confidence\.spread"):
            Confidence(spread=value)


@pytest.fixture
def unsure() -> Method:
    """Of whose edges' breaks nothing is known, nor where the part lies: no pose is exact."""
    return replace(ACP, uncertainty=PoseUncertainty(outline_mm=20, crease_mm=20, shift_px=20))


def test_an_inexact_pose_is_said_to_be_one_and_tracked_as_any_other(
    model: PreparedPart, sequence: MadeSequence, unsure: Method
) -> None:
    frames = [frame for frame in sequence.frames(4) if isinstance(frame, Frame)]
    one, other = (Tracker(model, method) for method in (ACP, unsure))
    # A pose that was given, and with which the image agrees, is taken as it is.
    assert [tracker.start(frames[0], sequence.first_pose).exactness for tracker in (one, other)] == [1.0, 1.0]
    for frame in frames[1:]:
        exact, inexact = one.track(frame), other.track(frame)
        np.testing.assert_array_equal(exact.cam_T_obj, inexact.cam_T_obj)
        assert (exact.quality, exact.state) == (inexact.quality, inexact.state)
        assert exact.exactness > 0.9
        assert inexact.exactness < 0.4
        assert inexact.right == inexact.quality * inexact.exactness
        assert inexact.quality_in_words == f"quality {inexact.quality:.2f}, exactness {inexact.exactness:.2f}"
        assert replace(exact, exactness=0.96).quality_in_words == f"quality {exact.quality:.2f}"
        assert inexact.covariance is not None
        rms = ExpectedError(model.part).rms_mm(inexact.covariance, inexact.cam_T_obj) / model.part.diameter
        assert inexact.exactness == pytest.approx(Confidence().exactness(rms))


def test_a_start_that_is_not_trusted_has_a_covariance(
    part: Part, model: PreparedPart, sequence: MadeSequence, unsure: Method
) -> None:
    (frame,) = sequence.frames(1)
    assert isinstance(frame, Frame)
    off = disturb_pose(sequence.first_pose, part.box_centre, 5.0, 5.0, np.random.default_rng(1))
    sure, doubtful = Tracker(model), Tracker(model, unsure)
    found, vague = sure.start(frame, off), doubtful.start(frame, off)
    assert not sure.start_was_trusted
    assert found.covariance is not None
    assert vague.covariance is not None
    assert found.exactness > 0.8
    assert vague.exactness < 0.4
    np.testing.assert_array_equal(found.cam_T_obj, vague.cam_T_obj)


def test_without_it_the_quality_is_the_agreement(model: PreparedPart, sequence: MadeSequence) -> None:
    frame = next(frame for frame in sequence.frames(1) if isinstance(frame, Frame))
    plain, probable = (
        Tracker(model, method).start(frame, sequence.first_pose) for method in (replace(ACP, confidence=Off()), ACP)
    )
    assert plain.quality < 0.95 < probable.quality
