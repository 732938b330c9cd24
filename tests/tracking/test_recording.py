"""What results carry for those who look inside: iterations and targets, only when somebody asks."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest

from acp_lab.cad.part import Part
from acp_lab.geometry.pose_step import move_pose
from acp_lab.prepared_part import PreparedPart
from acp_lab.sequences.frame import Frame, UnreadableFrame
from acp_lab.tracking.observer import SessionInfo
from acp_lab.tracking.result import TrackResult
from acp_lab.tracking.session import image_path_of, track_sequence
from acp_lab.tracking.tracker import Tracker
from tests.tracking.rendered import CAMERA, MadeSequence, add_percent


class Curious:
    """An observer with wishes."""

    def __init__(self, steps: bool = False, target: bool = False) -> None:
        self.wants_steps, self.wants_target = steps, target
        self.session: SessionInfo | None = None
        self.seen: list[TrackResult] = []

    def on_start(self, session: SessionInfo) -> None:
        self.session = session

    def on_frame(self, frame: Frame | UnreadableFrame, results: Mapping[int, TrackResult]) -> None:
        self.seen += results.values()

    def on_end(self) -> None:
        pass


def test_off_unless_somebody_asks(model: PreparedPart, sequence: MadeSequence) -> None:
    observer = Curious()
    Tracker(model).run(sequence, sequence.first_pose, [observer])
    assert all(result.steps == () and result.target is None for result in observer.seen)


def test_recording_changes_nothing_else(model: PreparedPart, sequence: MadeSequence) -> None:
    plain = Tracker(model).run(sequence, sequence.first_pose).results[1]
    watched = Tracker(model).run(sequence, sequence.first_pose, [Curious(True, True)]).results[1]
    for a, b in zip(plain, watched, strict=True):
        np.testing.assert_array_equal(a.cam_T_obj, b.cam_T_obj)
        assert (a.loss, a.quality, a.iterations) == (b.loss, b.quality, b.iterations)


def test_steps_lead_to_the_result(model: PreparedPart, sequence: MadeSequence) -> None:
    tracker, observer = Tracker(model), Curious(steps=True)
    tracker.run(sequence, sequence.first_pose, [observer])
    for result in observer.seen[1:]:
        assert len(result.steps) == result.iterations > 0
        last = result.steps[-1]
        np.testing.assert_array_equal(last.cam_T_obj, result.cam_T_obj)
        np.testing.assert_allclose(last.control_points, result.control_points)
        assert last.loss == pytest.approx(result.loss)
        levels = [step.level for step in result.steps]
        assert levels == sorted(levels)
        assert levels[-1] == 2  # also where only the last level is asked, from a sure prediction
    # The tracker is as it was before.
    assert not tracker.records_steps


def test_a_start_that_is_not_trusted_shows_its_search(part: Part, model: PreparedPart, sequence: MadeSequence) -> None:
    start = move_pose(sequence.first_pose, part.box_centre, np.array([0.03, 0.02, -0.03, 2.0, -1.0, 4.0]))
    tracker = Tracker(model)
    tracker.records_steps = True
    (frame,) = sequence.frames(1)
    assert isinstance(frame, Frame)
    assert tracker.start(frame, sequence.first_pose).steps == ()  # exact: nothing had to be moved
    found = tracker.start(frame, start)
    # From there the start itself drew the pose back a little.
    assert add_percent(part, found.steps[-1].cam_T_obj, found.cam_T_obj) < 5.0
    assert found.steps  # of the refinement; the poses that it was chosen among are not shown


def test_the_target_is_what_is_seen_in_the_image(model: PreparedPart, sequence: MadeSequence) -> None:
    observer = Curious(target=True)
    run = Tracker(model).run(sequence, sequence.first_pose, [observer])
    frames = [frame for frame in sequence.frames() if isinstance(frame, Frame)]
    for frame, result in zip(frames, observer.seen, strict=True):
        target = result.target
        assert target is not None
        (x, y), (width, height) = target.origin, target.size
        assert 0 <= x < x + width <= CAMERA.width
        assert 0 <= y < y + height <= CAMERA.height
        assert len(target.edge_points) > 50
        # There the image is steeper than elsewhere.
        grey = frame.image[..., 0].astype(float)
        steep = np.hypot(*np.gradient(grey))
        column, row = np.clip(np.round(target.edge_points).astype(int).T, 0, [[CAMERA.width - 1], [CAMERA.height - 1]])
        assert np.mean(steep[row, column]) > 3.0 * np.mean(steep)
    # They are large, so the run keeps them only for those who set the tracker up so.
    assert all(result.target is None for result in run.results[1])
    tracker = Tracker(model)
    tracker.records_target = True
    assert tracker.run(sequence, sequence.first_pose).results[1][-1].target is not None
    assert tracker.records_target


def test_observers_and_runs_know_the_session(model: PreparedPart, sequence: MadeSequence) -> None:
    observer, tracker = Curious(), Tracker(model)
    run = track_sequence({1: tracker}, sequence, {1: sequence.first_pose}, [observer], max_frames=3)
    assert observer.session is not None
    assert observer.session.frame_count == 3
    assert observer.session.image_path is None
    (tracked,) = observer.session.objects
    assert len(tracked.control_points_obj) == 6
    np.testing.assert_array_equal(tracked.control_points_obj[4], tracker.control_points_obj[4])
    assert run.sequence is sequence
    assert run.parts == {1: model.part}
    np.testing.assert_array_equal(run.starts[1], sequence.first_pose)


def test_data_sets_tell_where_their_images_are(sequence: MadeSequence) -> None:
    class DataSet(MadeSequence):
        image_paths: ClassVar = {0: Path("rgb/000000.jpg")}

    path_of = image_path_of(DataSet([], {}))
    assert path_of is not None
    assert path_of(0) == Path("rgb/000000.jpg")
    assert path_of(1) is None
    assert image_path_of(sequence) is None
