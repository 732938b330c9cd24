"""Films of replays: what a player needs, and what is drawn."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from acp_lab.display.colours import OBJECT_COLOURS, lighter, to_bytes
from acp_lab.display.replay.budget import SizeBudget
from acp_lab.display.replay.file import ReplayContent, check_replay, read_replay
from acp_lab.display.replay.frames import ShownFrame, ShownObject, fps_of, images_of, shown_frames
from acp_lab.display.replay.overlay_video import BACKGROUND, _decode, _drawn, _Panel, in_step, write_film
from acp_lab.display.replay.recorder import Replay
from acp_lab.errors import InputFileError
from tests.display.made_run import FRAME_IDS, UNREADABLE_ID, frames, play, result
from tests.display.recording import Recording
from tests.sequences.turned_jpeg import turned

av = pytest.importorskip("av")


def content(path: Path, object_ids: tuple[int, ...] = (1,), with_truth: bool = True) -> ReplayContent:
    play([Replay(path)], object_ids, with_truth)
    return read_replay(check_replay(path))


def decoded(path: Path) -> list[np.ndarray]:
    with av.open(str(path)) as film:
        return [frame.to_ndarray(format="rgb24") for frame in film.decode(film.streams.video[0])]


def test_what_is_shown_is_what_was_logged(tmp_path: Path) -> None:
    shown = shown_frames(content(tmp_path / "run.rrd", object_ids=(1, 7)))
    assert [frame.image_id for frame in shown] == list(FRAME_IDS)
    assert [frame.jpeg is None for frame in shown] == [i == UNREADABLE_ID for i in FRAME_IDS]
    assert fps_of(shown) == pytest.approx(30.0, rel=0.01)
    for made, frame in zip(frames(), shown, strict=True):
        for object_id in (1, 7):
            wanted, got = result(made, object_id), frame.objects[f"obj_{object_id:06d}"]
            assert got.state == str(wanted.state)
            assert got.quality == wanted.quality
            np.testing.assert_allclose(got.quad, wanted.control_points + 0.5, atol=1e-4)
            assert len(got.strokes) == len(got.colours) == (0 if wanted.edges is None else len(wanted.edges))


def test_browsers_play_it(tmp_path: Path) -> None:
    path = tmp_path / "new" / "film.mp4"
    told: list[int] = []
    count = write_film([content(tmp_path / "run.rrd")], path, lambda name, done, total: told.append(done))
    assert count == len(FRAME_IDS)
    assert told == list(range(1, count + 1))
    with av.open(str(path)) as film:
        stream = film.streams.video[0]
        assert stream.codec_context.name == "h264"
        assert stream.codec_context.pix_fmt == "yuv420p"
        assert stream.frames == count
        assert stream.width % 2 == stream.height % 2 == 0
    # The index comes first: players start before all is there.
    head = path.read_bytes()
    assert head.index(b"moov") < head.index(b"mdat")
    assert [file.name for file in path.parent.iterdir()] == ["film.mp4"]


def test_edges_and_captions_are_drawn(tmp_path: Path) -> None:
    path = tmp_path / "film.mp4"
    write_film([content(tmp_path / "run.rrd")], path)
    first, _, dark, _ = decoded(path)
    made = next(iter(frames()))
    scale = first.shape[1] / made.camera.width
    quad = (result(made, 1).control_points + 0.5) * scale
    middle = quad[:2].mean(0)  # of the side on which the edge points lie
    image_colour = np.array([0, 60, 90])
    row, column = round(middle[1]), round(middle[0])
    around = first[row - 3 : row + 4, column - 30 : column + 30].reshape(-1, 3).astype(float)
    assert np.abs(around - image_colour).max() > 80
    assert np.abs(first[20, 20].astype(float) - image_colour).max() < 12  # nothing is drawn there
    # Of the unreadable frame the last image is shown, darker.
    assert dark[20, 20].sum() < 0.6 * decoded(path)[1][20, 20].sum()
    captions = first[round(made.camera.height * scale) :]
    assert captions.std() > 10


def test_images_that_were_dropped_to_save_room_are_not_called_unreadable(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def spend(budget: SizeBudget, *_: object) -> None:
        budget.images_end = 1

    monkeypatch.setattr(SizeBudget, "spend", spend)
    replay = Replay(tmp_path / "run.rrd", most_mb=1.0)
    play([replay])
    assert "has no images from frame 1 on" in replay.lacks
    monkeypatch.undo()
    film = read_replay(check_replay(replay.path))
    shown = shown_frames(film)
    assert [frame.jpeg is None for frame in shown] == [False, True, True, True]
    assert [frame.is_left_out for frame in shown] == [False, True, True, True]
    assert not any(frame.is_left_out for frame in shown_frames(content(tmp_path / "whole.rrd")))
    write_film([film], tmp_path / "film.mp4")
    first, second, *_ = decoded(tmp_path / "film.mp4")
    assert np.abs(first[20, 20].astype(int) - (0, 60, 90)).max() < 12
    assert np.abs(second[20, 20].astype(int) - BACKGROUND).max() < 12  # not the image of another moment


def test_an_object_is_shown_only_in_scenes_that_have_it(tmp_path: Path) -> None:
    replay = Replay(tmp_path / "two.rrd", sessions=2)
    play([replay], (1, 7))
    play([replay], (1,))
    shown = shown_frames(read_replay(check_replay(replay.path)))
    states = [frame.objects["obj_000007"].state if "obj_000007" in frame.objects else "" for frame in shown]
    count = len(FRAME_IDS)
    assert states[:count] == ["tracking", "tracking", "lost", "tracking"]
    assert states[count:] == [""] * count
    assert [frame.objects["obj_000001"].state for frame in shown] == states[:count] * 2


def test_the_same_images_stand_beside_each_other() -> None:
    assert in_step([[4, 5, 9]]) == [(0,), (1,), (2,)]
    assert in_step([[4, 5, 9], [4, 5, 9]]) == [(0, 0), (1, 1), (2, 2)]
    assert in_step([[4, 5, 6, 7], [6, 7]]) == [(0, 0), (1, 0), (2, 0), (3, 1)]  # a run that went on behind another
    assert in_step([[4, 5], [4, 5, 6]]) == [(0, 0), (1, 1), (1, 2)]
    assert in_step([[0, 1, 2, 3, 4], [0, 2, 4]]) == [(0, 0), (1, 0), (2, 1), (3, 1), (4, 2)]
    assert in_step([[0, 1, 0, 1], [0, 1]]) == [(0, 0), (1, 1), (2, 1), (3, 1)]  # two scenes, and the first of them
    assert in_step([[1, 2], [7, 8, 9]]) == [(0, 0), (1, 1), (1, 2)]


def test_two_runs_beside_each_other(tmp_path: Path) -> None:
    both = [content(tmp_path / "a.rrd"), content(tmp_path / "b.rrd", object_ids=(1, 7))]
    write_film(both, tmp_path / "film.mp4")
    write_film(both[:1], tmp_path / "one.mp4")
    two, one = decoded(tmp_path / "film.mp4")[0], decoded(tmp_path / "one.mp4")[0]
    assert two.shape[1] == pytest.approx(2 * one.shape[1], abs=2)
    assert two.shape[0] > one.shape[0]  # two objects, two captions


def test_scenes_stand_beside_the_same_scenes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Two scenes and the second of them: their image ids are the same."""
    both = Replay(tmp_path / "both.rrd", sessions=2)
    for name in ("one", "two"):
        play([both], name=name)
    play([Replay(tmp_path / "two.rrd")], name="two", begin=1)
    contents = [read_replay(check_replay(tmp_path / name)) for name in ("both.rrd", "two.rrd")]
    assert images_of(contents[0]) == [(name, image_id) for name in ("one", "two") for image_id in FRAME_IDS]
    assert images_of(contents[1]) == [("two", image_id) for image_id in FRAME_IDS[1:]]
    drawn: list[int] = []

    def watched(panel: _Panel, number: int) -> np.ndarray:
        drawn.append(number)
        return _drawn(panel, number)

    monkeypatch.setattr("acp_lab.display.replay.overlay_video._drawn", watched)
    assert write_film(contents, tmp_path / "film.mp4") == 8
    assert drawn == [0, 0, 1, 0, 2, 0, 3, 0, 4, 0, 5, 0, 6, 1, 7, 2]


def test_a_replay_without_images(tmp_path: Path) -> None:
    from acp_lab.sequences.frame import UnreadableFrame
    from acp_lab.tracking.observer import SessionInfo, TrackedObject
    from tests.display.made_run import CAMERA, box

    replay = Replay(tmp_path / "run.rrd")
    replay.on_start(SessionInfo("clip", 1, "acp", (TrackedObject(1, box()),)))
    unreadable = UnreadableFrame(0, CAMERA, "gone")
    replay.on_frame(unreadable, {1: result(unreadable, 1)})
    replay.on_end()
    with pytest.raises(InputFileError, match="holds no image"):
        write_film([read_replay(check_replay(tmp_path / "run.rrd"))], tmp_path / "film.mp4")


def test_only_a_film_of_a_replay_is_replaced(tmp_path: Path) -> None:
    replay, path = content(tmp_path / "run.rrd"), tmp_path / "film.mp4"
    write_film([replay], path)
    assert write_film([replay], path) == len(FRAME_IDS)
    clip = tmp_path / "clip.mp4"  # such as the one that was tracked
    with av.open(str(clip), "w") as video:
        stream = video.add_stream("libx264", rate=30)
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
        picture = av.VideoFrame.from_ndarray(np.zeros((48, 64, 3), np.uint8), format="rgb24")
        video.mux(stream.encode(picture))
        video.mux(stream.encode(None))
    words = tmp_path / "words.mp4"
    words.write_text("no video at all")
    for other in (clip, words):
        before = other.read_bytes()
        with pytest.raises(InputFileError, match=rf"{other.name}.*would replace"):
            write_film([replay], other)
        assert other.read_bytes() == before


def test_a_place_that_cannot_be_written(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(InputFileError, match=r"film\.mp4.*cannot be written"):
        write_film([content(tmp_path / "run.rrd")], tmp_path / "file" / "film.mp4")


def test_large_images_are_not_enlarged(tmp_path: Path) -> None:
    from acp_lab.display.replay.overlay_video import _panel

    replay = content(tmp_path / "run.rrd")
    assert _panel(replay, "").width == pytest.approx(1024, abs=80)
    jpeg = cv2.imencode(".jpg", np.zeros((1024, 1224, 3), np.uint8))[1]
    assert jpeg is not None


@pytest.mark.parametrize(("width", "height"), [(640, 512), (320, 256), (512, 640), (800, 200)])
def test_scenes_of_other_image_sizes_are_drawn_over_in_their_place(width: int, height: int) -> None:
    """The picture's size is that of the first scene's images."""
    half, middle = height / 8, np.array([0.4 * width, 0.3 * height])
    image = np.zeros((height, width, 3), np.uint8)
    low, high = np.round(middle - half).astype(int), np.round(middle + half).astype(int)
    image[low[1] : high[1], low[0] : high[0]] = 255
    quad = np.array([low, (high[0], low[1]), high, (low[0], high[1])], np.float32)  # in rerun's pixels
    bare, marked = (ShownFrame(0, 0.0, cv2.imencode(".jpg", image)[1].tobytes()) for _ in range(2))
    marked.objects["obj_000001"] = ShownObject(quad=quad)
    panel = _Panel([bare, marked], ("obj_000001",), "", 960, 768)
    without, drawn = (_drawn(panel, number)[:768].astype(int) for number in (0, 1))
    square = np.argwhere(without.min(2) > 128)[:, ::-1]
    overlay = np.argwhere(np.abs(drawn - without).max(2) > 60)[:, ::-1]
    assert np.ptp(square, axis=0) == pytest.approx(2 * half * min(960 / width, 768 / height), abs=4)
    # Corners are dots with a radius of 5 px.
    np.testing.assert_allclose(overlay.min(0), square.min(0) - 5, atol=3)
    np.testing.assert_allclose(overlay.max(0), square.max(0) + 5, atol=3)


def test_objects_have_the_colours_that_they_have_in_the_replay(tmp_path: Path) -> None:
    """Whatever order the session has; and in scenes that lack the first of them, or have another before it."""
    replay = Replay(tmp_path / "run.rrd", sessions=3)
    for object_ids in ((9, 5), (9,), (1, 5)):
        play([replay], object_ids)
    film = read_replay(check_replay(replay.path))
    frames_of, recording = shown_frames(film), Recording.read(replay.path)
    panel = _Panel(frames_of, film.objects, "", 960, 768)
    count = len(FRAME_IDS)
    for number, object_id, order in ((0, 5, 0), (0, 9, 1), (count, 9, 1), (2 * count, 1, 2), (2 * count, 5, 0)):
        name = f"obj_{object_id:06d}"
        logged = {row.value[0] for row in recording.of(f"/camera/control_points/{name}", "colors")}
        bright = to_bytes(lighter(OBJECT_COLOURS[order], 0.3)).tolist()
        assert logged == {int.from_bytes((*bright, 255))}
        x, y = np.round(frames_of[number].objects[name].quad[0] * 6).astype(int)
        np.testing.assert_allclose(_drawn(panel, number)[y, x], bright, atol=2)


def test_images_are_decoded_as_they_are_stored() -> None:
    """Replays of older versions hold files with a note that has viewers turn them."""
    jpeg = cv2.imencode(".jpg", np.zeros((40, 60, 3), np.uint8))[1].tobytes()
    assert _decode(turned(jpeg, 6)).shape == (40, 60, 3)
