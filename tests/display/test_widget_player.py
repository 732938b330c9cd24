"""The player: frame, slider, curves and picture in step; runs of data sets and of streams."""

from __future__ import annotations

import copy
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from acp_lab.display.widgets.frame_shelf import FrameShelf
from acp_lab.display.widgets.track_player import TrackPlayer, result_overlays
from acp_lab.errors import SequenceError
from acp_lab.sequences.frame import Frame, UnreadableFrame
from acp_lab.tracking.observer import SessionInfo, TrackedObject
from acp_lab.tracking.result import TargetView, TrackStep
from acp_lab.tracking.session import TrackRun
from tests.display.made_run import FRAME_IDS, UNREADABLE_ID, box, frames, result, true_pose
from tests.prepared_sample import sample_scene
from tests.sequences.turned_jpeg import turned


class MadeStream:
    """Frames that only come in their order, as from a video."""

    name, scene_id, frame_ids, object_ids = "made", 1, FRAME_IDS, (1,)

    def __init__(self) -> None:
        self.begun = 0
        self.first_pose = true_pose(0)
        self.first_poses = {1: self.first_pose}

    def frames(self, max_frames: int | None = None) -> Iterator[Frame | UnreadableFrame]:
        self.begun += 1
        yield from frames()

    def truth(self, frame_id: int, object_id: int) -> np.ndarray:
        return true_pose(frame_id, object_id)


def run(stream: MadeStream, object_ids: tuple[int, ...] = (1,)) -> TrackRun:
    results = {i: tuple(result(frame, i) for frame in frames()) for i in object_ids}
    session = SessionInfo("made", 1, "acp", tuple(TrackedObject(i, box()) for i in object_ids))
    return TrackRun("made", 1, "acp", results, stream, session)


def test_everything_moves_with_the_frame_and_moves_it() -> None:
    player = TrackPlayer(run(MadeStream()))
    for place, move in enumerate(
        (
            lambda: None,
            lambda: setattr(player, "frame", 1),
            lambda: player.curves.set_state({"cursor": 2}),
            lambda: player.canvas._hear(None, {"kind": "at", "frame": 3}, []),
        )
    ):
        move()
        assert player.frame == player.canvas.frame == player.curves.cursor == place
        assert f"image {FRAME_IDS[place]}" in player.canvas.picture().title
    player.frame = 99
    assert player.frame == 3


def test_an_unreadable_frame_says_why_and_shows_no_picture() -> None:
    player = TrackPlayer(run(MadeStream()))
    player.frame = FRAME_IDS.index(UNREADABLE_ID)
    assert player.canvas.picture().image == b""
    assert "the file is empty" in player.canvas.picture().status
    player.frame = 0
    assert player.canvas.picture().image != b""
    assert "ADD" in player.canvas.picture().status


def test_the_curves_are_those_of_the_run() -> None:
    player = TrackPlayer(run(MadeStream()))
    rows = {curve.row: curve.values for curve in player.curves.curves}
    np.testing.assert_allclose(rows["loss e(I)"], [1.5, 1.5, 0.0, 1.5])
    # One millimetre off, in percent of the box's diameter.
    np.testing.assert_allclose(rows["ADD [% of diameter]"], 100.0 / box().diameter, rtol=1e-6)


def test_overlays_show_edges_image_edges_and_the_way_of_the_points() -> None:
    first = result(next(iter(frames())), 1)
    labels = [overlay.label for overlay in result_overlays(first)]
    assert labels[0] == "image edges"
    assert any("generated edges" in label for label in labels)
    found = result_overlays(first)[0].coordinates
    assert len(found) == 8  # the ninth edge point found none
    np.testing.assert_allclose(np.abs(found[:, 1] - first.edges.points[0, 1]).max(), 4.0)
    steps = tuple(TrackStep(first.control_points + k, first.cam_T_obj, 1.0, 0) for k in range(3))
    target = TargetView(np.array([[3.0, 4.0]]), (0, 0), (10, 10))
    overlays = result_overlays(replace(first, steps=steps, target=target))
    np.testing.assert_allclose(overlays[0].coordinates, [[3.0, 4.0]])
    assert sum(overlay.label == "way of I in this frame" for overlay in overlays) == 4


def test_following_the_part_cuts_the_view() -> None:
    player = TrackPlayer(run(MadeStream()))
    assert player.canvas.view == ()
    player.follow.value = True
    x, y, width, height = player.canvas.view
    points = player.result.edges.points
    assert (points >= (x, y)).all()
    assert (points <= (x + width, y + height)).all()


def test_two_objects_can_be_chosen() -> None:
    player = TrackPlayer(run(MadeStream(), (1, 2)))
    before = player.result.cam_T_obj
    player.object.value = 2
    assert player.object_id == 2
    assert not np.allclose(player.result.cam_T_obj, before)


def test_objects_of_other_lengths_are_shown_in_the_same_images() -> None:
    """The second one begins two images later, the third has no result at all."""
    whole = run(MadeStream(), (3, 1, 2))
    results = {3: (), 1: whole.results[1], 2: whole.results[2][2:]}
    player = TrackPlayer(replace(whole, results=results))
    assert player.object_id == 1
    for frame, frame_id in enumerate(FRAME_IDS):
        player.frame = frame
        for object_id in (1, 2, 3):
            player.object.value = object_id
            assert f"image {frame_id}" in player.canvas.picture().title
            assert player.curves.x[player.curves.cursor] == frame_id
            tracked = object_id == 1 or (object_id == 2 and frame >= 2)
            assert (player.result is not None) == tracked
            if frame_id != UNREADABLE_ID:
                assert ("was not tracked in this image" in player.canvas.picture().status) == (not tracked)
                assert (len(player.canvas.picture().points) > 0) == tracked
    player.object.value = 2
    for curve in player.curves.curves:
        assert np.isfinite(curve.values).tolist() == [False, False, True, True]


def test_errors_that_are_cut_are_read_as_cut() -> None:
    made = run(MadeStream())
    lost = [replace(one, cam_T_obj=one.cam_T_obj + np.eye(4, k=3) * 300.0) for one in made.results[1]]
    player = TrackPlayer(replace(made, results={1: tuple(lost)}))
    cut, *others = player.curves.curves
    assert cut.most == 20.0
    np.testing.assert_array_equal(cut.values, 20.0)
    assert [curve.most for curve in others] == [None, None]


def test_what_cannot_be_played() -> None:
    with pytest.raises(SequenceError, match="nothing to play"):
        TrackPlayer(replace(run(MadeStream()), sequence=None))
    with pytest.raises(SequenceError, match="no object 7"):
        TrackPlayer(run(MadeStream()), object_id=7)


def test_a_stream_is_read_once_and_a_data_set_by_its_files() -> None:
    stream = MadeStream()
    shelf = FrameShelf(stream)
    assert shelf(FRAME_IDS[1]).content == shelf(FRAME_IDS[1]).content != b""
    assert shelf(FRAME_IDS[0]).size == (160, 128)
    assert stream.begun == 1
    with pytest.raises(SequenceError, match="no frame 99"):
        shelf(99)
    scene = sample_scene()
    assert FrameShelf(scene)(5).content == scene.image_paths[5].read_bytes()


def test_a_jpeg_that_browsers_would_turn_is_not_handed_on(tmp_path: Path) -> None:
    """Images are tracked as they are stored, and what is drawn over them is not turned."""
    scene = sample_scene()
    noted = tmp_path / scene.image_paths[5].name
    noted.write_bytes(turned(scene.image_paths[5].read_bytes(), 6))
    noted_scene = copy.copy(scene)
    noted_scene.image_paths = {**scene.image_paths, 5: noted}
    content = FrameShelf(noted_scene)(5).content
    shown = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_COLOR)
    frame = scene.frame(5)
    assert isinstance(frame, Frame)
    assert shown.shape == frame.image.shape
    assert np.abs(shown[..., ::-1].astype(int) - frame.image).mean() < 4.0
