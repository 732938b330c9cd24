"""Bad input of `acp-lab track`: one line that names file and fix, exit 2, and older results stay."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from acp_lab.locks import only_writer
from acp_lab.sequences import write_pose
from tests.cli_runner import Outcome, assert_one_error, run
from tests.commands.conftest import CAMERA, FRAME_IDS, OBJECT_IDS, edit_json, true_pose, write_dataset
from tests.sequences.tiny_dataset import write_json

OLD = "scene_id,im_id,obj_id,score,R,t,time\nolder results\n"
OLD_REPLAY = "RRF2 older replay"


@pytest.fixture
def out(tmp_path: Path) -> Path:
    """A results file of an earlier run."""
    path = tmp_path / "results.csv"
    path.write_text(OLD)
    return path


def track(capsys: pytest.CaptureFixture[str], dataset: Path, parts: Path, out: Path, *words: str | Path) -> Outcome:
    outcome = run(capsys, "track", dataset, "--parts", parts, "--out", out, *words)
    assert out.read_text() == OLD, "bad input must not cost older results"
    return outcome


def test_no_such_data_set(capsys: pytest.CaptureFixture[str], tmp_path: Path, parts: Path, out: Path) -> None:
    assert_one_error(track(capsys, tmp_path / "nowhere", parts, out), "nowhere")


def test_empty_data_set(capsys: pytest.CaptureFixture[str], tmp_path: Path, parts: Path, out: Path) -> None:
    (tmp_path / "empty").mkdir()
    assert_one_error(track(capsys, tmp_path / "empty", parts, out), "empty")


def test_a_replay_that_another_run_writes_costs_no_results(
    capsys: pytest.CaptureFixture[str], dataset: Path, parts: Path, out: Path, tmp_path: Path
) -> None:
    with only_writer(tmp_path / "run.rrd"):
        outcome = track(capsys, dataset, parts, out, "--replay", tmp_path / "run.rrd")
    assert_one_error(outcome, "run.rrd", "another acp-lab is writing the replay")


def test_a_diameter_that_the_data_set_tells_otherwise(
    capsys: pytest.CaptureFixture[str], dataset: Path, parts: Path, out: Path
) -> None:
    def in_inches(infos: dict[str, dict[str, float]]) -> None:
        infos["1"]["diameter"] /= 25.4

    edit_json(dataset / "models" / "models_info.json", in_inches)
    assert_one_error(track(capsys, dataset, parts, out), "models_info.json", "looks like inches")


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (("--method", ""), ("no such method",)),
        (("--init", ""), ("--init: is empty",)),
        (("--init-noise-mm", "1e6"), ("--init-noise-mm 1e+06", "at most")),
        (("--scene", "9"), ("no scene 9", "1")),
        (("--object", "9"), ("object 9", "1, 4")),
        (("--split", "train"), ("train",)),
        (("--method", "magic"), ("magic", "acp")),
        (("--method", "acp-paper"), ("obj_000001", "acp-lab prepare", "--generator autoencoder")),
        (("--config", "nowhere.toml"), ("nowhere.toml", "--config")),
        (("--method", "acp", "--config", "a.toml"), ("a.toml", "--method acp")),
        (("--init-noise-deg", "nan"), ("--init-noise-deg",)),
        (("--init-noise-mm", "inf"), ("--init-noise-mm",)),
        (("--init", "nowhere.csv"), ("nowhere.csv",)),
        (("--mesh", "a.ply"), ("--mesh", "--video")),
        (("--replay-max-mb", "9"), ("--replay-max-mb 9", "--replay")),
        (("--replay-iterations", "all"), ("--replay-iterations all", "--replay")),
        (("--replay", "a.rrd", "--replay-max-mb", "inf"), ("--replay-max-mb inf", "finite")),
        (("--replay", "a.rrd", "--replay-max-mb", "0.1"), ("--replay-max-mb",)),
        (("--video", "a.mp4"), ("--video",)),
    ],
)
def test_bad_choices(
    capsys: pytest.CaptureFixture[str],
    dataset: Path,
    parts: Path,
    out: Path,
    words: tuple[str, ...],
    expected: tuple[str, ...],
) -> None:
    assert_one_error(track(capsys, dataset, parts, out, *words), *expected)


@pytest.mark.parametrize("name", ["scene_camera.json", "models", "rgb"])
def test_missing_pieces(capsys: pytest.CaptureFixture[str], dataset: Path, parts: Path, out: Path, name: str) -> None:
    root = dataset if name == "models" else dataset / "test" / "000001"
    target = root / name
    if target.is_dir():
        shutil.rmtree(target)
    else:
        target.unlink()
    assert_one_error(track(capsys, dataset, parts, out), name)


@pytest.mark.parametrize("name", ["scene_camera.json", "scene_gt.json"])
@pytest.mark.parametrize("content", ["", "{", "[]", '{"0": 3}'])
def test_damaged_json(
    capsys: pytest.CaptureFixture[str], dataset: Path, parts: Path, out: Path, name: str, content: str
) -> None:
    (dataset / "test" / "000001" / name).write_text(content)
    assert_one_error(track(capsys, dataset, parts, out), name)


def test_no_truth_file(capsys: pytest.CaptureFixture[str], dataset: Path, parts: Path, out: Path) -> None:
    (dataset / "test" / "000001" / "scene_gt.json").unlink()
    assert_one_error(track(capsys, dataset, parts, out), "scene_gt.json")


def test_no_truth_in_the_first_frame(capsys: pytest.CaptureFixture[str], dataset: Path, parts: Path, out: Path) -> None:
    edit_json(dataset / "test" / "000001" / "scene_gt.json", lambda truth: truth.pop("0"))
    assert_one_error(track(capsys, dataset, parts, out), "scene_gt.json", "first image")


def test_two_instances_of_one_object(capsys: pytest.CaptureFixture[str], dataset: Path, parts: Path, out: Path) -> None:
    edit_json(dataset / "test" / "000001" / "scene_gt.json", lambda truth: truth["0"].append(truth["0"][0]))
    assert_one_error(track(capsys, dataset, parts, out), "object 1", "more than once")


def test_intrinsics_of_a_larger_image(
    capsys: pytest.CaptureFixture[str], dataset: Path, parts: Path, out: Path
) -> None:
    def enlarge(cameras: dict[str, Any]) -> None:
        for camera in cameras.values():
            camera["cam_K"] = [1600, 0, 640, 0, 1600, 480, 0, 0, 1]

    edit_json(dataset / "test" / "000001" / "scene_camera.json", enlarge)
    assert_one_error(track(capsys, dataset, parts, out), "scene_camera.json")


@pytest.mark.parametrize("content", [b"", b"\x89PNG\r\n\x1a\nnonsense", b"nonsense"])
def test_first_image_unreadable(
    capsys: pytest.CaptureFixture[str], dataset: Path, parts: Path, out: Path, content: bytes
) -> None:
    (dataset / "test" / "000001" / "rgb" / "000000.png").write_bytes(content)
    assert_one_error(track(capsys, dataset, parts, out), "000000.png")


def test_what_is_no_data_set_and_what_has_no_truth_name_the_option(
    capsys: pytest.CaptureFixture[str], dataset: Path, parts: Path, out: Path
) -> None:
    scene = dataset / "test" / "000001"
    assert_one_error(track(capsys, scene / "rgb" / "000000.png", parts, out), "is a file, no data set", "--video FILE")
    assert_one_error(track(capsys, scene / "rgb", parts, out), "a plain folder of images goes with --video DIR")
    outcome = track(capsys, dataset, parts, out, "--camera", dataset / "camera.json")
    assert_one_error(outcome, "--camera", "only goes with a video or a folder of images, given as --video")
    (scene / "scene_gt.json").unlink()
    assert_one_error(track(capsys, dataset, parts, out), "--init results.csv", "--init auto")


def test_part_not_prepared(capsys: pytest.CaptureFixture[str], dataset: Path, parts: Path, out: Path) -> None:
    shutil.rmtree(parts / "obj_000004")
    mesh = dataset / "models" / "obj_000004.ply"
    assert_one_error(track(capsys, dataset, parts, out), f"acp-lab prepare {mesh} --out {parts}")


def test_part_of_another_mesh(capsys: pytest.CaptureFixture[str], dataset: Path, parts: Path, out: Path) -> None:
    mesh = dataset / "models" / "obj_000004.ply"
    mesh.write_text(mesh.read_text().replace("-20 ", "-21 "))
    edit_json(dataset / "models" / "models_info.json", lambda infos: infos["4"].update(diameter=54.6))
    assert_one_error(track(capsys, dataset, parts, out), "obj_000004", "acp-lab prepare")


@pytest.mark.parametrize("content", ["", "{}", "nonsense"])
def test_damaged_part(capsys: pytest.CaptureFixture[str], dataset: Path, parts: Path, out: Path, content: str) -> None:
    (parts / "obj_000001" / "part.json").write_text(content)
    assert_one_error(track(capsys, dataset, parts, out), "obj_000001", "acp-lab prepare")


def test_part_with_cut_off_arrays(capsys: pytest.CaptureFixture[str], dataset: Path, parts: Path, out: Path) -> None:
    for path in (parts / "obj_000001").glob("*.safetensors"):
        path.write_bytes(path.read_bytes()[:100])
    assert_one_error(track(capsys, dataset, parts, out), "obj_000001", "acp-lab prepare")


@pytest.mark.parametrize(
    "content",
    [
        "",
        "scene,image\n",
        "scene_id,im_id,obj_id,score,R,t,time\n",
        "scene_id,im_id,obj_id,score,R,t,time\n1,0\n",
    ],
)
def test_damaged_start_poses(
    capsys: pytest.CaptureFixture[str], dataset: Path, parts: Path, out: Path, tmp_path: Path, content: str
) -> None:
    (tmp_path / "poses.csv").write_text(content)
    outcome = track(capsys, dataset, parts, out, "--init", tmp_path / "poses.csv")
    assert_one_error(outcome, "poses.csv")


def test_a_start_out_of_sight_in_a_later_scene(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, parts: Path, out: Path
) -> None:
    root = write_dataset(tmp_path / "two", scenes=(1, 2))

    def put_behind(truth: dict[str, Any]) -> None:
        for entry in truth[str(FRAME_IDS[0])]:
            entry["cam_t_m2c"][2] *= -1.0

    edit_json(root / "test" / "000002" / "scene_gt.json", put_behind)
    outcome = track(capsys, root, parts, out)
    told = "000002/scene_gt.json: image 0: obj_000001: at the start pose", "behind the camera, outside the"
    assert_one_error(outcome, *told)


@pytest.mark.parametrize("name", ["POSE.json", "missing.JSON"])
def test_a_pose_of_a_video_is_no_start_of_a_data_set(
    capsys: pytest.CaptureFixture[str], dataset: Path, parts: Path, out: Path, tmp_path: Path, name: str
) -> None:
    write_pose(tmp_path / "POSE.json", true_pose(0))
    outcome = track(capsys, dataset, parts, out, "--init", tmp_path / name)
    told = f"--init {tmp_path / name}: a POSE.json only goes with --video: for a data set give a results file, or"
    assert_one_error(outcome, f"{told} --init auto\n")


def test_outputs_that_would_overwrite_something(
    capsys: pytest.CaptureFixture[str], dataset: Path, parts: Path, out: Path
) -> None:
    assert_one_error(track(capsys, dataset, parts, out, "--init", out), "results.csv", "overwrite")
    assert_one_error(track(capsys, dataset, parts, out, "--replay", out), "results.csv", "same file")
    assert_one_error(track(capsys, dataset, parts, out, "--replay", dataset), "folder")
    film = track(capsys, dataset, parts, out, "--replay", out.with_name("film.mp4"))
    assert_one_error(film, "film.mp4: --replay writes .rrd only: name it film.rrd", "acp-lab replay --mp4")
    # Not an input that was named, but none of ours either.
    truth = dataset / "test" / "000001" / "scene_gt.json"
    before = truth.read_bytes()
    outcome = run(capsys, "track", dataset, "--parts", parts, "--out", truth)
    assert_one_error(outcome, "--out would replace a file that is not results")
    assert_one_error(track(capsys, dataset, parts, out, "--replay", truth), "--replay would replace")
    assert truth.read_bytes() == before
    outcome = track(capsys, dataset, parts, out, "--replay", out / "below" / "a_file.rrd")
    assert_one_error(outcome, "a_file.rrd", "--replay")
    outcome = run(capsys, "track", dataset, "--parts", parts, "--out", dataset)
    assert_one_error(outcome, "folder", "--out")


@pytest.fixture
def video(tmp_path: Path, dataset: Path) -> dict[str, Path]:
    """A folder of images with all that --video needs."""
    CAMERA.to_json(tmp_path / "camera.json")
    pose = true_pose(0)
    entry = {"cam_R_m2c": pose[:3, :3].ravel().tolist(), "cam_t_m2c": pose[:3, 3].tolist()}
    write_json(tmp_path / "pose.json", entry)
    return {
        "--video": dataset / "test" / "000001" / "rgb",
        "--mesh": dataset / "models" / "obj_000001.ply",
        "--camera": tmp_path / "camera.json",
        "--init": tmp_path / "pose.json",
    }


def track_video(
    capsys: pytest.CaptureFixture[str], video: dict[str, Path], parts: Path, out: Path, *words: str
) -> Outcome:
    pairs = [word for option, path in video.items() for word in (option, str(path))]
    outcome = run(capsys, "track", *pairs, "--parts", parts, "--out", out, *words)
    assert out.read_text() == OLD
    return outcome


@pytest.mark.parametrize("missing", ["--mesh", "--camera", "--init"])
def test_video_needs_all_of_it(
    capsys: pytest.CaptureFixture[str], video: dict[str, Path], parts: Path, out: Path, missing: str
) -> None:
    video.pop(missing)
    assert_one_error(track_video(capsys, video, parts, out), missing)


def test_run_information_that_would_overwrite_the_start_pose(
    capsys: pytest.CaptureFixture[str], video: dict[str, Path], parts: Path, out: Path
) -> None:
    pose = video["--init"].rename(out.with_name("results.run.json"))
    before = pose.read_bytes()
    outcome = track_video(capsys, {**video, "--init": pose}, parts, out)
    assert_one_error(outcome, "results.run.json", "overwrite an input")
    assert pose.read_bytes() == before


@pytest.mark.parametrize("option", ["--video", "--mesh", "--camera", "--init"])
@pytest.mark.parametrize("kind", ["missing", "empty", "nonsense"])
def test_video_files(
    capsys: pytest.CaptureFixture[str],
    video: dict[str, Path],
    parts: Path,
    out: Path,
    tmp_path: Path,
    option: str,
    kind: str,
) -> None:
    suffix = ".mp4" if option == "--video" else video[option].suffix
    path = tmp_path / f"other{suffix}"
    if kind != "missing":
        path.write_text("" if kind == "empty" else "{nonsense")
    video[option] = path
    assert_one_error(track_video(capsys, video, parts, out), f"other{suffix}")


def test_video_of_another_size(
    capsys: pytest.CaptureFixture[str], video: dict[str, Path], parts: Path, out: Path
) -> None:
    edit_json(video["--camera"], lambda camera: camera.update(width=640, height=480))
    assert_one_error(track_video(capsys, video, parts, out), "320 x 240", "640 x 480")


def test_video_has_one_scene_and_one_object(
    capsys: pytest.CaptureFixture[str], video: dict[str, Path], parts: Path, out: Path
) -> None:
    assert_one_error(track_video(capsys, video, parts, out, "--scene", "2"), "--scene 2")
    assert_one_error(track_video(capsys, video, parts, out, "--object", "4"), "--object 4")
    video["--init"] = Path("gt")
    assert_one_error(track_video(capsys, video, parts, out), "--init gt")


def test_images_of_two_sizes(capsys: pytest.CaptureFixture[str], dataset: Path, parts: Path, tmp_path: Path) -> None:
    """In the middle of a scene that is an unreadable frame: a warning, no error."""
    odd = dataset / "test" / "000001" / "rgb" / "000003.png"
    assert cv2.imwrite(str(odd), np.zeros((120, 160, 3), np.uint8))
    outcome = run(capsys, "track", dataset, "--parts", parts, "--out", tmp_path / "new.csv")
    assert outcome.status == 0
    assert outcome.err.startswith("warning: image 3: ")
    assert len((tmp_path / "new.csv").read_text().splitlines()) == 1 + 5 * len(OBJECT_IDS)


def test_a_start_pose_that_does_not_show_the_part(
    capsys: pytest.CaptureFixture[str], dataset: Path, parts: Path, out: Path, tmp_path: Path
) -> None:
    def move_away(truth: dict[str, Any]) -> None:
        for pose in truth["0"]:
            pose["cam_t_m2c"] = [5000.0, 0.0, 300.0]

    edit_json(dataset / "test" / "000001" / "scene_gt.json", move_away)
    (tmp_path / "old.rrd").write_text(OLD_REPLAY)
    refused = track(capsys, dataset, parts, out, "--replay", tmp_path / "old.rrd")
    told = f"{dataset / 'test' / '000001' / 'scene_gt.json'}: image 0: obj_000001: at the start pose t = [5000.0"
    assert_one_error(refused, f"error: {told}")
    assert (tmp_path / "old.rrd").read_text() == OLD_REPLAY
