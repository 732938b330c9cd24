"""One frame taken apart, on the sample."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from acp_lab.errors import SequenceError, TrackingError
from acp_lab.sequences.altered import AlteredSequence
from acp_lab.sequences.frame import Frame, UnreadableFrame
from acp_lab.studies.frame_story import FrameStory, frame_story
from acp_lab.tracking.method import ACP_EDGES, ACP_PAPER_SAMPLES
from acp_lab.tracking.prediction import ConstantVelocityPrediction, LastPosePrediction
from acp_lab.tracking.sources.rigid import CadSamples
from acp_lab.tracking.tracker import Tracker
from tests.prepared_sample import sample_model, sample_scene


@pytest.fixture(scope="module")
def sequence() -> AlteredSequence:
    return AlteredSequence(sample_scene(), frame_ids=sample_scene().frame_ids[::4])


@pytest.fixture(scope="module")
def story(sequence: AlteredSequence) -> FrameStory:
    return frame_story(sample_model(), sequence, 3)


def test_each_stage_brings_the_edges_nearer(story: FrameStory) -> None:
    assert story.frame.index == 12
    last, predicted, end = (story.off_px(pose) for pose in (story.last, story.predicted, story.result.cam_T_obj))
    assert last > 2.0 * predicted > 4.0 * end
    assert story.off_px(story.cam_T_true) == 0.0
    assert 3 <= len(story.result.steps) <= 9


def test_the_memory_helps_to_choose(story: FrameStory) -> None:
    seen = story.observation
    assert seen.scores.shape == seen.candidates.scores.shape == (len(story.way_px), seen.scores.shape[1])
    assert story.is_right(seen.scores).mean() > story.is_right(seen.candidates.scores).mean() + 0.1
    assert not story.is_right(np.zeros_like(seen.scores)).any()


def test_the_story_is_that_of_the_tracker(sequence: AlteredSequence, story: FrameStory) -> None:
    run = Tracker(sample_model()).run(sequence, sequence.first_pose)
    np.testing.assert_allclose(story.result.cam_T_obj, run.results[1][3].cam_T_obj, atol=1e-9)
    np.testing.assert_allclose(story.last, run.results[1][2].cam_T_obj, atol=1e-9)


@pytest.mark.parametrize("prediction", [ConstantVelocityPrediction(), LastPosePrediction()], ids=lambda p: p.kind)
def test_the_prediction_is_the_trackers_own(
    sequence: AlteredSequence, prediction: ConstantVelocityPrediction | LastPosePrediction
) -> None:
    story = frame_story(sample_model(), sequence, 2, replace(ACP_EDGES, prediction=prediction))
    np.testing.assert_array_equal(story.predicted, story.result.predicted)
    np.testing.assert_array_equal(story.observation.at.cam_T_obj, story.predicted)
    assert np.allclose(story.predicted, story.last) == (prediction.kind == "last-pose")


def test_a_method_without_a_search_cannot_be_told(sequence: AlteredSequence) -> None:
    method = replace(ACP_PAPER_SAMPLES, source=CadSamples(), control_points="mid-section")
    with pytest.raises(TrackingError, match="acp-paper-samples does not search"):
        frame_story(sample_model(), sequence, 2, method)


@pytest.mark.parametrize("number", [-1, 0, 1, 40])
def test_frames_that_cannot_be_told(sequence: AlteredSequence, number: int) -> None:
    with pytest.raises(SequenceError, match="cannot be shown"):
        frame_story(sample_model(), sequence, number)


def test_an_unreadable_frame_cannot_be_told(sequence: AlteredSequence) -> None:
    def torn(frame: Frame) -> Frame | UnreadableFrame:
        return UnreadableFrame(frame.index, frame.camera, "torn") if frame.index == 12 else frame

    with pytest.raises(SequenceError, match="choose a readable one"):
        frame_story(sample_model(), AlteredSequence(sequence, torn), 3)
