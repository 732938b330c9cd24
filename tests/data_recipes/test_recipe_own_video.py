"""A part and a camera of one's own: what goes in comes out ready to be tracked."""

from __future__ import annotations

import json
import shlex
import shutil
import subprocess
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import trimesh

from acp_lab.geometry.camera import Camera, Undistorter
from acp_lab.sequences import BopDataset, Frame, VideoFile, read_pose, start_rows
from acp_lab.sequences.json_file import was_found, write_pose
from acp_lab.sequences.pixel_coding import PixelCoding
from acp_lab.tracking.find import ACCEPTED
from data_recipes.own_video import main
from tests.board_pictures import SQUARE_MM, chessboard_print, pictures
from tests.data_recipes.fake_downloads import HEIGHT, WIDTH, pose_entry, tiny_views, write_image

LENS = (-0.3, 0.1, 0.0, 0.0, 0.0)
INTRINSICS = ("--intrinsics", "80,80,31.5,23.5," + ",".join(map(str, LENS)))
CAMERA = Camera(WIDTH, HEIGHT, 80.0, 80.0, 31.5, 23.5, LENS)


@pytest.fixture
def bench(tmp_path: Path) -> Path:
    """A folder of images, a mesh in metres and a start pose."""
    views = tiny_views(4)
    for i, image in enumerate(views.images):
        write_image(tmp_path / "clip" / f"img{i}.png", image)
    box = trimesh.creation.box((60.0, 40.0, 25.0))
    box.apply_scale(1 / 1000.0)
    box.export(tmp_path / "box.stl")
    (tmp_path / "POSE.json").write_text(json.dumps(pose_entry(views.poses[0], 1)))
    return tmp_path


def make(bench: Path, *options: str, frames: str = "clip") -> int:
    given = [str(bench / frames) if not frames.isdigit() else frames, "--mesh", str(bench / "box.stl")]
    return main([*given, "--out", str(bench / "out"), *options])


def test_without_a_start_pose_it_can_be_found(bench: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert make(bench, *INTRINSICS) == 0
    said = capsys.readouterr().out
    assert "--init auto" in said
    assert "--init POSES.csv" in said


def test_the_next_commands_can_be_pasted(bench: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (bench / "clip").rename(bench / "my clip")
    out = str(bench / "my set")
    assert make(bench, *INTRINSICS, "--pose", str(bench / "POSE.json"), "--out", out, frames="my clip") == 0
    commands = [shlex.split(line) for line in capsys.readouterr().out.splitlines() if line.startswith("acp-lab")]
    assert commands[0][:3] == ["acp-lab", "prepare", f"{out}/models/obj_000001.ply"]
    assert commands[1][:3] == ["acp-lab", "track", out]
    assert commands[2][:4] == ["acp-lab", "track", "--video", str(bench / "my clip")]


def test_a_folder_becomes_a_data_set(bench: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert make(bench, *INTRINSICS, "--pose", str(bench / "POSE.json")) == 0
    said = capsys.readouterr().out
    assert "in m (by its size; --unit overrules it), diameter 76.3 mm" in said
    assert "acp-lab track --video" in said
    dataset = BopDataset(bench / "out")
    scene = dataset.open_scene(1)
    views = tiny_views(4)
    undistort = Undistorter(CAMERA)
    for image, frame in zip(views.images, scene.frames(), strict=True):
        assert isinstance(frame, Frame)
        np.testing.assert_array_equal(frame.image, undistort(image))
        assert frame.camera == CAMERA.pinhole()
    np.testing.assert_allclose(scene.first_pose, views.poses[0], atol=1e-9)
    np.testing.assert_allclose(read_pose(bench / "out" / "POSE.json"), views.poses[0], atol=1e-9)
    assert scene.truth(1, 1) is None  # only the start pose is known
    assert Camera.from_json(bench / "out" / "CAMERA.json") == CAMERA
    np.testing.assert_allclose(dataset.part(1).box_size, [60.0, 40.0, 25.0], rtol=1e-5)


def test_a_start_that_was_found_is_no_truth(bench: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pose = tiny_views(4).poses[0]
    write_pose(bench / "POSE.json", pose, found=True)
    assert make(bench, *INTRINSICS, "--pose", str(bench / "POSE.json")) == 0
    assert was_found(bench / "out" / "POSE.json")
    assert BopDataset(bench / "out").open_scene(1).ground_truth is None
    start = start_rows(bench / "out" / "POSES.csv", 1, 0)[1]
    assert ACCEPTED <= start.score < 1.0  # an estimate, and not doubted
    np.testing.assert_allclose(start.cam_T_obj, pose, atol=1e-9)
    track = next(line for line in capsys.readouterr().out.splitlines() if line.startswith("acp-lab track"))
    assert shlex.split(track)[5:7] == ["--init", str(bench / "out" / "POSES.csv")]
    assert make(bench, *INTRINSICS, "--force") == 0  # it is of this recipe


def test_a_video_and_a_known_camera(bench: Path) -> None:
    writer = cv2.VideoWriter(str(bench / "clip.mp4"), cv2.VideoWriter.fourcc(*"mp4v"), 25.0, (WIDTH, HEIGHT))
    for i in range(10):
        writer.write(np.full((HEIGHT, WIDTH, 3), 20 * i, np.uint8))
    writer.release()
    CAMERA.to_json(bench / "CAMERA.json")
    options = ("--camera", str(bench / "CAMERA.json"), "--every", "3", "--max-frames", "3")
    assert make(bench, *options, frames="clip.mp4") == 0
    scene = BopDataset(bench / "out").open_scene(1)
    assert scene.ground_truth is None
    levels = [int(frame.image[24, 32, 0]) for frame in scene.frames() if isinstance(frame, Frame)]
    np.testing.assert_allclose(levels, [0, 60, 120], atol=8)
    assert len(VideoFile(bench / "clip.mp4", CAMERA).frame_ids) == 10


def test_frames_that_cannot_be_read_leave_a_gap(bench: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for i in range(4, 9):
        shutil.copy(bench / "clip" / "img0.png", bench / "clip" / f"img{i}.png")
    (bench / "clip" / "img4.png").write_bytes(b"torn")
    assert make(bench, *INTRINSICS, "--every", "2", "--pose", str(bench / "POSE.json")) == 0
    assert "img4.png" in capsys.readouterr().err
    scene = BopDataset(bench / "out").open_scene(1)
    assert scene.frame_ids == (0, 1, 3, 4)
    assert scene.truth(0, 1) is not None


def test_a_camera_from_pictures_of_a_chessboard(bench: Path, capsys: pytest.CaptureFixture[str]) -> None:
    boards = pictures(chessboard_print(7, 5), 4)
    for i, image in enumerate(boards):
        write_image(bench / "boards" / f"{i}.png", image)
        write_image(bench / "large" / f"{i}.png", image)
    options = ("--chessboard", "7x5", "--square-mm", f"{SQUARE_MM:g}", "--views", str(bench / "boards"))
    assert make(bench, *options, frames="large") == 0
    said = capsys.readouterr()
    assert "camera 360 x 288 px: fx 3" in said.out
    assert "warning: only 4 views" in said.err
    assert Camera.from_json(bench / "out" / "CAMERA.json").fx == pytest.approx(330.0, rel=0.05)
    # Frames of another size than the views' are no frames of that camera.
    assert make(bench, *options, "--force") == 2
    assert "64 x 48 px but the camera is 360 x 288" in capsys.readouterr().err


class _FakeDevice:
    """Stands in for cv2.VideoCapture: an endless camera."""

    def __init__(self, *_: Any) -> None:
        self.count = 0

    def isOpened(self) -> bool:
        return True

    def set(self, key: int, value: float) -> bool:
        return True

    def get(self, key: int) -> float:
        return 0.0

    def read(self) -> tuple[bool, np.ndarray]:
        self.count += 1
        return True, np.full((HEIGHT, WIDTH, 3), self.count, np.uint8)

    def release(self) -> None:
        pass


def test_a_live_camera_is_recorded(bench: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("acp_lab.sequences.images.cv2.VideoCapture", _FakeDevice)
    assert make(bench, *INTRINSICS, "--max-frames", "3", frames="0") == 0
    assert len(BopDataset(bench / "out").open_scene(1).frame_ids) == 3


def test_raw_12_bit_images_become_colour(bench: Path) -> None:
    views = tiny_views(2)
    raw = np.zeros((HEIGHT, WIDTH), np.uint16)
    raw[0::2, 0::2], raw[0::2, 1::2], raw[1::2, 0::2], raw[1::2, 1::2] = 4095, 2000, 2000, 500  # rggb
    for i in range(len(views.images)):
        (bench / "raw").mkdir(exist_ok=True)
        assert cv2.imwrite(str(bench / "raw" / f"{i}.png"), raw)
    options = ("--intrinsics", "80,80,31.5,23.5", "--bits", "12", "--bayer", "rggb")
    assert make(bench, *options, frames="raw") == 0
    frame = BopDataset(bench / "out").open_scene(1).frame(0)
    assert isinstance(frame, Frame)
    np.testing.assert_allclose(frame.image[24, 32], [255, 125, 31], atol=1)


def test_what_the_options_say_of_pixels_the_next_command_is_told(
    bench: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (bench / "raw").mkdir()
    assert cv2.imwrite(str(bench / "raw" / "0.png"), np.full((HEIGHT, WIDTH), 4095, np.uint16))
    options = ("--intrinsics", "80,80,31.5,23.5", "--pose", str(bench / "POSE.json"), "--force")
    assert make(bench, *options, "--bits", "10", frames="raw") == 2
    assert "10 bits end at 1023: correct the options" in capsys.readouterr().err
    assert make(bench, *options, "--bits", "12", frames="raw") == 0
    echo = next(line for line in capsys.readouterr().out.splitlines() if line.startswith("echo"))
    subprocess.run(echo, shell=True, check=True)
    assert PixelCoding.beside(bench / "raw") == PixelCoding(12)
    assert make(bench, *options, "--bits", "12", frames="raw") == 0
    assert "echo" not in capsys.readouterr().out


def _pose(z: float, x: float = 0.0) -> str:
    return json.dumps({"cam_R_m2c": [1, 0, 0, 0, 1, 0, 0, 0, 1], "cam_t_m2c": [x, 0, z]})


@pytest.mark.parametrize(
    ("pose", "words"),
    [
        (_pose(-300.0), "at or behind the camera"),
        (_pose(0.3), "at or behind the camera"),
        (_pose(300.0, 900.0), "outside the picture"),
        ('{"cam_R_m2c": [1, 0, 0, 0, 1, 0, 0, 0, 0.5], "cam_t_m2c": [0, 0, 300]}', "cam_R_m2c"),
        ('{"cam_t_m2c": [0, 0, 300]}', "lacks cam_R_m2c"),
    ],
)
def test_start_poses_that_cannot_be(bench: Path, pose: str, words: str, capsys: pytest.CaptureFixture[str]) -> None:
    (bench / "POSE.json").write_text(pose)
    assert make(bench, *INTRINSICS, "--pose", str(bench / "POSE.json")) == 2
    said = capsys.readouterr().err
    assert said.startswith("error: ")
    assert said.count("\n") == 1
    assert words in said
    assert not (bench / "out").exists()


def test_a_pose_that_shows_the_part_tiny_is_doubted(bench: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (bench / "POSE.json").write_text(_pose(3000.0))
    assert make(bench, *INTRINSICS, "--pose", str(bench / "POSE.json")) == 0
    assert "warning: " in capsys.readouterr().err


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--intrinsics", "80,80,500,23"), "principal point (500, 23) lies outside the image of 64 x 48"),
        (("--intrinsics", "0,80,31,23"), "focal lengths"),
        (("--camera", "none.json"), "none.json: no such camera file"),
        ((*INTRINSICS, "--mesh", "none.stl"), "none.stl: no such mesh file"),
        ((*INTRINSICS, "--bits", "40"), "bits is 40"),
        (("--chessboard", "7x5", "--square-mm", "20", "--views", "none"), "none: no such video file"),
    ],
)
def test_bad_input_is_one_line_and_leaves_nothing(
    bench: Path, options: tuple[str, ...], words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert make(bench, *options) == 2
    said = capsys.readouterr().err
    assert said.startswith("error: ")
    assert said.count("\n") == 1
    assert words in said
    assert sorted(path.name for path in bench.iterdir()) == ["POSE.json", "box.stl", "clip"]


@pytest.mark.parametrize(
    ("frames", "options", "words"),
    [
        ("clip", (), "one of the arguments"),
        ("clip", ("--chessboard", "7x5"), "needs --views and --square-mm"),
        ("clip", ("--intrinsics", "1,2,3"), "fx,fy,cx,cy"),
        ("0", INTRINSICS, "give --max-frames"),
        ("0", (*INTRINSICS, "--bits", "12", "--max-frames", "3"), "are for a folder of images"),
        ("box.stl", (*INTRINSICS, "--bayer", "rggb"), "are for a folder of images"),
        ("clip", ("--chessboard", "100000x100000"), "two whole numbers up to 100"),
        ("clip", ("--chessboard", "7x5", "--square-mm", "1e300"), "give 1000 at most"),
    ],
)
def test_bad_usage(
    bench: Path, frames: str, options: tuple[str, ...], words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as stop:
        make(bench, *options, frames=frames)
    assert stop.value.code == 2
    said = capsys.readouterr().err
    assert said.startswith("error: ")
    assert said.count("\n") == 1
    assert words in said
