"""The frame loop: who is told what and when, also when it ends badly; and the rows of a run."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np
import pytest

from acp_lab.cad.part import Part
from acp_lab.errors import SequenceError
from acp_lab.geometry.arrays import FloatArray
from acp_lab.sequences.frame import Frame, UnreadableFrame
from acp_lab.tracking.observer import SessionInfo
from acp_lab.tracking.result import Timings, TrackResult, TrackState
from acp_lab.tracking.session import TrackRun, track_sequence
from tests.made_parts import box
from tests.tracking.rendered import MadeSequence

PART = box()
IMAGE = np.zeros((160, 200, 3), np.uint8)
POSES = [np.eye(4) + 0.001 * k for k in range(4)]


class PlayTracker:
    """Says that the part is where it started, and writes down what it was asked; may trip over a frame."""

    part: Part = PART
    control_points_obj: tuple[FloatArray, ...] = (np.ones((4, 3)),) * 6

    def __init__(
        self, log: list[str], name: str = "tracker", trip_at: int | None = None, method: str = "played"
    ) -> None:
        self.name = method
        self.records_steps = self.records_target = False
        self._log, self._name, self._trip_at = log, name, trip_at
        self._pose = np.eye(4)

    def start(self, frame: Frame, cam_T_obj: FloatArray) -> TrackResult:
        self._pose = cam_T_obj
        return self._tell("start", frame)

    def track(self, frame: Frame | UnreadableFrame) -> TrackResult:
        return self._tell("track", frame)

    def _tell(self, what: str, frame: Frame | UnreadableFrame) -> TrackResult:
        self._log.append(f"{self._name} {what} {frame.index}")
        if frame.index == self._trip_at:
            raise KeyboardInterrupt
        return TrackResult(
            frame_id=frame.index,
            cam_T_obj=self._pose,
            predicted=self._pose,
            control_points=np.zeros((4, 2)),
            loss=0.5,
            quality=0.25 * (1 + frame.index),
            state=TrackState.TRACKING,
            region=0,
            edges=None,
            residuals_px=None,
            iterations=1,
            timings=Timings(total_s=0.01 * (1 + frame.index)),
        )


class Listener:
    """Writes down what it hears; may trip when it is told of a frame."""

    def __init__(self, log: list[str], name: str = "listener", trip_at: int | None = None) -> None:
        self._log, self._name, self._trip_at = log, name, trip_at
        self.session: SessionInfo | None = None

    def on_start(self, session: SessionInfo) -> None:
        self.session = session
        self._log.append(f"{self._name} starts")

    def on_frame(self, frame: Frame | UnreadableFrame, results: Mapping[int, TrackResult]) -> None:
        assert all(result.frame_id == frame.index for result in results.values())
        self._log.append(f"{self._name} hears of {frame.index}: {sorted(results)}")
        if frame.index == self._trip_at:
            raise OSError("disk full")

    def on_end(self) -> None:
        self._log.append(f"{self._name} ends")


def sequence(images: int = 2, object_ids: tuple[int, ...] = (1,)) -> MadeSequence:
    return MadeSequence([IMAGE] * images, dict.fromkeys(object_ids, POSES[:images]))


def test_everybody_is_told_in_order() -> None:
    log: list[str] = []
    made = sequence(2, (5, 2))
    listener = Listener(log, "first")
    trackers = {5: PlayTracker(log, "five"), 2: PlayTracker(log, "two")}
    track_sequence(trackers, made, made.first_poses, (listener, Listener(log, "second")), method="acp-paper")
    assert log == [
        "first starts",
        "second starts",
        "five start 0",
        "two start 0",
        "first hears of 0: [2, 5]",
        "second hears of 0: [2, 5]",
        "five track 2",
        "two track 2",
        "first hears of 2: [2, 5]",
        "second hears of 2: [2, 5]",
        "first ends",
        "second ends",
    ]
    session = listener.session
    assert session is not None
    assert all(tracked.control_points_obj is PlayTracker.control_points_obj for tracked in session.objects)
    assert (session.name, session.scene_id, session.method) == ("made", 7, "acp-paper")
    assert [(tracked.object_id, tracked.part.name) for tracked in session.objects] == [(5, "box"), (2, "box")]
    assert session.truth is not None
    np.testing.assert_array_equal(session.truth(2, 5), POSES[1])


def test_the_end_is_told_also_after_an_interruption() -> None:
    log: list[str] = []
    made = sequence(3)
    with pytest.raises(KeyboardInterrupt):
        track_sequence({1: PlayTracker(log, trip_at=2)}, made, made.first_poses, [Listener(log)])
    assert log[-2:] == ["tracker track 2", "listener ends"]


def test_an_interrupt_is_how_the_run_of_a_live_camera_ends() -> None:
    class Camera(MadeSequence):
        frame_ids = ()  # nobody knows how many there will be

        def frames(self, max_frames: int | None = None) -> Iterator[Frame | UnreadableFrame]:
            return sequence(3).frames(max_frames)

    log: list[str] = []
    camera = Camera([], {1: POSES[:3]})
    run = track_sequence({1: PlayTracker(log, trip_at=4)}, camera, camera.first_poses, [Listener(log)])
    assert [result.frame_id for result in run.results[1]] == [0, 2]
    assert run.session is not None
    assert log[-1] == "listener ends"
    with pytest.raises(KeyboardInterrupt):  # nothing was tracked yet
        track_sequence({1: PlayTracker(log, trip_at=0)}, camera, camera.first_poses)


def test_without_trackers_nobody_is_told_anything() -> None:
    """An observer may replace a file of results when it is told."""
    log: list[str] = []
    with pytest.raises(SequenceError, match="made: there is no object to track"):
        track_sequence({}, sequence(), {}, [Listener(log)])
    assert log == []


def test_a_listener_that_trips_ends_the_session_for_all() -> None:
    log: list[str] = []
    made = sequence(3)
    listeners = [Listener(log, "first", trip_at=0), Listener(log, "second")]
    with pytest.raises(OSError, match="disk full"):
        track_sequence({1: PlayTracker(log)}, made, made.first_poses, listeners)
    assert log[-2:] == ["first ends", "second ends"]
    assert "tracker track 2" not in log


def test_every_listener_is_told_the_end_whatever_the_others_do() -> None:
    class Clumsy(Listener):
        def on_end(self) -> None:
            super().on_end()
            raise OSError("disk full")

    log: list[str] = []
    made = sequence(2)
    with pytest.raises(OSError, match="disk full"):
        track_sequence({1: PlayTracker(log)}, made, made.first_poses, [Clumsy(log, "first"), Listener(log, "second")])
    assert log[-2:] == ["first ends", "second ends"]


def test_an_unreadable_frame_in_the_middle_is_passed_on() -> None:
    log: list[str] = []
    made = MadeSequence([IMAGE, None, IMAGE], {1: POSES[:3]})
    run = track_sequence({1: PlayTracker(log)}, made, made.first_poses, [Listener(log)])
    assert [result.frame_id for result in run.results[1]] == [0, 2, 4]
    assert "listener hears of 2: [1]" in log


def test_an_unreadable_first_frame_is_an_error() -> None:
    log: list[str] = []
    made = MadeSequence([None, IMAGE], {1: POSES[:2]})
    with pytest.raises(SequenceError, match=r"000000\.png: the file is empty: the first frame must be readable"):
        track_sequence({1: PlayTracker(log)}, made, made.first_poses, [Listener(log)])
    assert log == ["listener starts", "listener ends"]


def test_a_sequence_without_frames_is_an_error() -> None:
    made = sequence(0)
    with pytest.raises(SequenceError, match="made: there is no frame to track"):
        track_sequence({1: PlayTracker([])}, made, {1: np.eye(4)})


def test_no_more_frames_than_asked_for() -> None:
    made = sequence(4)
    run = track_sequence({1: PlayTracker([])}, made, made.first_poses, max_frames=3)
    assert [result.frame_id for result in run.results[1]] == [0, 2, 4]


# ---- the run -------------------------------------------------------------------------------------------------


@pytest.fixture
def run() -> TrackRun:
    made = sequence(3, (5, 2))
    return track_sequence({5: PlayTracker([]), 2: PlayTracker([])}, made, {5: POSES[1], 2: POSES[2]})


def test_rows_run_frame_by_frame(run: TrackRun) -> None:
    rows = run.rows
    assert [(row.im_id, row.obj_id) for row in rows] == [(0, 2), (0, 5), (2, 2), (2, 5), (4, 2), (4, 5)]
    assert {row.scene_id for row in rows} == {7}
    np.testing.assert_array_equal(rows[0].cam_T_obj, POSES[2])
    np.testing.assert_array_equal(rows[1].cam_T_obj, POSES[1])
    assert rows[2].score == 0.75
    assert rows[2].time_s == pytest.approx(0.03)


def test_a_run_tells_itself_in_a_line_per_object(run: TrackRun) -> None:
    lines = str(run).splitlines()
    assert lines[0] == "made, object 5, played: 3 frames, median quality 0.75, 40.0 ms per frame, last state tracking"
    assert lines[1].startswith("made, object 2, played: 3 frames")


def test_a_run_is_called_after_the_method_of_its_trackers_unless_told() -> None:
    made = sequence(1)
    tracker = PlayTracker([], method="direct-6dof")
    listener = Listener([])
    run = track_sequence({1: tracker}, made, made.first_poses, [listener])
    assert listener.session is not None
    assert run.method == listener.session.method == "direct-6dof"
    assert track_sequence({1: tracker}, made, made.first_poses, method="mine").method == "mine"


def test_a_run_tells_which_objects_have_no_frames(run: TrackRun) -> None:
    lines = str(replace(run, results={**run.results, 2: ()})).splitlines()
    assert lines[0].startswith("made, object 5, played: 3 frames")
    assert lines[1] == "made, object 2, played: no frames"


def test_a_run_of_one_frame_has_no_time_per_frame() -> None:
    made = sequence(1)
    assert "nan ms per frame" in str(track_sequence({1: PlayTracker([])}, made, made.first_poses))
