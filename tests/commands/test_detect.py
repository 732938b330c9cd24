"""`acp-lab detect` and `acp-lab track --init auto`: from files to results, and bad input."""

from __future__ import annotations

import csv
import json
import shutil
from functools import cache
from pathlib import Path

import cv2
import numpy as np
import pytest

from acp_lab.geometry.pose import transform
from acp_lab.sample import sample_dataset
from acp_lab.sequences.results_csv import read_results
from tests.cli_runner import assert_one_error, run
from tests.commands.conftest import CAMERA
from tests.prepared_sample import sample_model, sample_scene


@pytest.fixture(scope="module")
def sample_parts(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The sample's part, as `prepare --generator templates` would store it, with fewer views."""
    folder = tmp_path_factory.mktemp("parts")
    sample_model().save(folder / "obj_000001")
    return folder


@pytest.fixture(scope="module")
def few_frames(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The sample with its first four frames; the very first one is black."""
    root = tmp_path_factory.mktemp("few") / "data"
    shutil.copytree(sample_dataset(), root)
    scene = root / "test" / "000001"
    images = sorted((scene / "rgb").iterdir())
    for path in images[4:]:
        path.unlink()
    black = np.zeros_like(cv2.imread(str(images[0])))
    assert cv2.imwrite(str(images[0]), black)
    kept = {str(int(path.stem)) for path in images[:4]}
    for name in ("scene_camera.json", "scene_gt.json"):
        values = json.loads((scene / name).read_text())
        (scene / name).write_text(json.dumps({key: value for key, value in values.items() if key in kept}))
    (scene / "scene_gt_info.json").unlink(missing_ok=True)
    return root


@cache
def true_pose(frame_id: int) -> np.ndarray:
    pose = sample_scene().truth(frame_id, 1)
    assert pose is not None
    return pose


def error_share(pose: np.ndarray, frame_id: int) -> float:
    part = sample_model().part
    apart = transform(pose, part.vertices) - transform(true_pose(frame_id), part.vertices)
    return float(np.linalg.norm(apart, axis=1).mean() / part.diameter)


def test_data_set(capsys: pytest.CaptureFixture[str], few_frames: Path, sample_parts: Path, tmp_path: Path) -> None:
    out = tmp_path / "found.csv"
    words = ("--parts", sample_parts, "--out", out, "--step", "2", "--top", "2", "--depth-mm", "300", "900")
    outcome = run(capsys, "detect", few_frames, *words)
    assert outcome.status == 0, outcome.err
    assert "of 2 frames" in outcome.out
    with out.open() as file:
        rows = list(csv.DictReader(file))
    assert list(rows[0]) == ["scene_id", "im_id", "obj_id", "score", "R", "t", "time"]
    first, third = (sample_scene().frame_ids[k] for k in (0, 2))
    assert first not in {int(row["im_id"]) for row in rows}, "a black image shows nothing"
    mine = [row for row in rows if int(row["im_id"]) == third]
    assert 1 <= len(mine) <= 2
    assert [float(row["score"]) for row in mine] == sorted((float(row["score"]) for row in mine), reverse=True)
    pose = np.eye(4)
    pose[:3, :3] = np.array(mine[0]["R"].split(), float).reshape(3, 3)
    pose[:3, 3] = np.array(mine[0]["t"].split(), float)
    assert error_share(pose, third) < 0.05
    picture = cv2.imread(str(tmp_path / "found.png"))
    assert picture is not None
    assert picture.shape[1] == 2 * 640


def test_each_counts_for_itself(
    capsys: pytest.CaptureFixture[str], few_frames: Path, sample_parts: Path, tmp_path: Path
) -> None:
    """The sample's part is there once; without a number more is told than the three of a search for the one."""
    out = tmp_path / "found.csv"
    outcome = run(capsys, "detect", few_frames, "--each", "--parts", sample_parts, "--out", out, "--step", "3")
    assert outcome.status == 0, outcome.err
    assert "1 found in 2 frames" in outcome.out
    last = sample_scene().frame_ids[3]
    with out.open() as file:
        mine = [row for row in csv.DictReader(file) if int(row["im_id"]) == last]
    assert 3 < len(mine) <= 20
    pose = np.eye(4)
    pose[:3, :3] = np.array(mine[0]["R"].split(), float).reshape(3, 3)
    pose[:3, 3] = np.array(mine[0]["t"].split(), float)
    assert error_share(pose, last) < 0.05
    assert float(mine[0]["score"]) >= 0.8 > float(mine[1]["score"])
    assert (tmp_path / "found.png").is_file()


def test_one_image(capsys: pytest.CaptureFixture[str], few_frames: Path, sample_parts: Path, tmp_path: Path) -> None:
    frame_id = sample_scene().frame_ids[1]
    image = next(path for path in (few_frames / "test/000001/rgb").iterdir() if int(path.stem) == frame_id)
    sample_scene().camera(frame_id).to_json(tmp_path / "camera.json")
    out = tmp_path / "one.csv"
    words = ("--parts", sample_parts, "--out", out, "--camera", tmp_path / "camera.json", "--top", "1")
    outcome = run(capsys, "detect", image, *words)
    assert outcome.status == 0, outcome.err
    (row,) = read_results(out)
    assert (row.scene_id, row.im_id, row.obj_id) == (1, 0, 1)
    assert error_share(row.cam_T_obj, frame_id) < 0.05


def test_the_picture_does_not_replace_the_table(
    capsys: pytest.CaptureFixture[str], few_frames: Path, sample_parts: Path, tmp_path: Path
) -> None:
    outcome = run(capsys, "detect", few_frames, "--parts", sample_parts, "--out", tmp_path / "found.png")
    assert_one_error(outcome, "found.png: --out is the table", "name it found.csv")
    assert not (tmp_path / "found.png").exists()


def test_a_folder_of_images(
    capsys: pytest.CaptureFixture[str], few_frames: Path, sample_parts: Path, tmp_path: Path
) -> None:
    sample_scene().camera(0).to_json(tmp_path / "CAMERA.json")
    words = (few_frames / "test/000001/rgb", "--parts", sample_parts, "--out", tmp_path / "found.csv", "--step", "2")
    outcome = run(capsys, "detect", *words, "--camera", tmp_path / "CAMERA.json", "--top", "1")
    assert outcome.status == 0, outcome
    assert "of 2 frames" in outcome.out
    assert {row.im_id for row in read_results(tmp_path / "found.csv")} <= {0, 2}
    assert_one_error(run(capsys, "detect", tmp_path / "no.mp4", *words[1:]), "no.mp4: no such data set, image or video")


def test_track_from_where_it_is_found(
    capsys: pytest.CaptureFixture[str], few_frames: Path, sample_parts: Path, tmp_path: Path
) -> None:
    out = tmp_path / "results.csv"
    outcome = run(capsys, "track", few_frames, "--parts", sample_parts, "--out", out, "--init", "auto")
    assert outcome.status == 0, outcome.err
    rows = read_results(out)
    assert [row.im_id for row in rows] == list(sample_scene().frame_ids[1:4])
    assert all(error_share(row.cam_T_obj, row.im_id) < 0.01 for row in rows), "a found pose is not taken for exact"


def test_track_finds_nothing(
    capsys: pytest.CaptureFixture[str], few_frames: Path, sample_parts: Path, tmp_path: Path
) -> None:
    root = shutil.copytree(few_frames, tmp_path / "grey")
    for path in (root / "test/000001/rgb").iterdir():
        assert cv2.imwrite(str(path), np.full((512, 640, 3), 90, np.uint8))
    outcome = run(capsys, "track", root, "--parts", sample_parts, "--out", tmp_path / "r.csv", "--init", "auto")
    told = "--init auto: object 1 is not found in the first 4 frames", "250 to 1200 mm", "a results file or"
    assert_one_error(outcome, *told)


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (("--depth-mm", "900", "300"), ("--depth-mm 900 300",)),
        (("--depth-mm", "0", "300"), ("--depth-mm 0 300",)),
        (("--depth-mm", "nan", "300"), ("--depth-mm",)),
        (("--depth-mm", "300"), ("--depth-mm",)),
        (("--top", "0"), ("--top",)),
        (("--step", "0"), ("--step",)),
        (("--scene", "9"), ("no scene 9",)),
        (("--camera", "c.json"), ("--camera c.json", "image")),
        (("--mesh", "a.ply"), ("--mesh a.ply", "image")),
    ],
)
def test_bad_options(
    capsys: pytest.CaptureFixture[str],
    dataset: Path,
    parts: Path,
    tmp_path: Path,
    words: tuple[str, ...],
    expected: tuple[str, ...],
) -> None:
    out = tmp_path / "found.csv"
    assert_one_error(run(capsys, "detect", dataset, "--parts", parts, "--out", out, *words), *expected)
    assert not out.exists()


def test_bad_sources(capsys: pytest.CaptureFixture[str], dataset: Path, parts: Path, tmp_path: Path) -> None:
    out = tmp_path / "found.csv"
    fixed = ("--parts", parts, "--out", out)
    image = next((dataset / "test/000001/rgb").iterdir())
    CAMERA.to_json(tmp_path / "camera.json")
    camera = ("--camera", tmp_path / "camera.json")
    assert_one_error(run(capsys, "detect", tmp_path / "nowhere", *fixed), "nowhere")
    assert_one_error(run(capsys, "detect", image, *fixed), image, "--camera")
    assert_one_error(run(capsys, "detect", image, *fixed, *camera), parts, "obj_000001, obj_000004", "--mesh")
    assert_one_error(run(capsys, "detect", tmp_path / "camera.json", *fixed, *camera), "camera.json")
    command = f"obj_000001.ply --out '{tmp_path / 'my parts'}'"
    assert_one_error(run(capsys, "detect", dataset, "--parts", tmp_path / "my parts", "--out", out), command)
    one = parts / "obj_000001"
    outcome = run(capsys, "detect", image, "--parts", one, "--out", out, *camera)
    assert_one_error(outcome, f"{one}: is a prepared part itself: --parts is the folder above, {parts}")
    truth = dataset / "test/000001/scene_gt.json"
    assert_one_error(run(capsys, "detect", dataset, "--parts", parts, "--out", truth), "not results")
    assert not out.exists()


def test_a_picture_of_another_kind_stays(
    capsys: pytest.CaptureFixture[str], dataset: Path, parts: Path, tmp_path: Path
) -> None:
    (tmp_path / "found.png").write_text("my notes")
    outcome = run(capsys, "detect", dataset, "--parts", parts, "--out", tmp_path / "found.csv")
    assert_one_error(outcome, "found.png")
    assert (tmp_path / "found.png").read_text() == "my notes"


def test_a_picture_without_results_beside_it_stays(
    capsys: pytest.CaptureFixture[str], dataset: Path, parts: Path, tmp_path: Path
) -> None:
    """The next image of a series has the name that the picture of --out would have."""
    CAMERA.to_json(tmp_path / "camera.json")
    images = sorted((dataset / "test/000001/rgb").iterdir())
    before = images[1].read_bytes()
    words = ("--parts", parts, "--camera", tmp_path / "camera.json", "--mesh", dataset / "models" / "obj_000001.ply")
    outcome = run(capsys, "detect", images[0], *words, "--out", images[1].with_suffix(".csv"))
    assert_one_error(outcome, images[1], "choose another name")
    assert images[1].read_bytes() == before
    assert not images[1].with_suffix(".csv").exists()


@pytest.mark.parametrize("place", ["frames", "data/test/000001/rgb", "data/test/000001/gray"])
def test_its_picture_does_not_come_among_images(
    capsys: pytest.CaptureFixture[str], dataset: Path, parts: Path, tmp_path: Path, place: str
) -> None:
    CAMERA.to_json(tmp_path / "camera.json")
    shutil.copytree(dataset / "test" / "000001" / "rgb", tmp_path / "frames")
    out = tmp_path / place / "found.csv"
    words = ("--camera", tmp_path / "camera.json", "--mesh", dataset / "models" / "obj_000001.ply", "--parts", parts)
    outcome = run(capsys, "detect", tmp_path / "frames", *words, "--out", out)
    assert_one_error(outcome, out.with_suffix(".png"), "one of the images there")
    assert not out.exists()


def test_older_results_stay_until_a_frame_is_done(
    capsys: pytest.CaptureFixture[str], dataset: Path, parts: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "found.csv"
    words = ("detect", dataset, "--parts", parts, "--out", out, "--step", "3")
    assert run(capsys, *words).status == 0
    before = out.read_bytes()

    def stopped(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("acp_lab.tracking.find.Finder.find", stopped)
    assert run(capsys, *words).status == 130
    assert out.read_bytes() == before


def test_the_results_of_a_run_are_not_replaced(
    capsys: pytest.CaptureFixture[str], dataset: Path, parts: Path, tmp_path: Path
) -> None:
    out = tmp_path / "results.csv"
    assert run(capsys, "track", dataset, "--parts", parts, "--out", out, "--max-frames", "1").status == 0
    before = out.read_bytes()
    outcome = run(capsys, "detect", dataset, "--parts", parts, "--out", out)
    assert_one_error(outcome, out, "holds a run of acp-lab track, as results.run.json says: choose another --out")
    assert out.read_bytes() == before
    assert (tmp_path / "results.run.json").exists()


def test_an_image_of_more_bits_is_read_as_pixels_json_says(
    capsys: pytest.CaptureFixture[str], dataset: Path, parts: Path, tmp_path: Path
) -> None:
    CAMERA.to_json(tmp_path / "camera.json")
    image = next((dataset / "test/000001/rgb").iterdir())
    assert cv2.imwrite(str(image), 16 * cv2.imread(str(image)).astype(np.uint16))
    words = ["detect", image, "--parts", parts, "--camera", tmp_path / "camera.json", "--out", tmp_path / "found.csv"]
    words += ["--mesh", dataset / "models" / "obj_000001.ply"]
    assert_one_error(run(capsys, *words), image, "pixels.json")
    (image.parent / "pixels.json").write_text('{"bits": 12}')
    assert run(capsys, *words).status == 0
    assert run(capsys, *words).status == 0  # its own picture may be replaced


def test_an_image_of_another_size_and_parts_that_are_not_there(
    capsys: pytest.CaptureFixture[str], dataset: Path, parts: Path, tmp_path: Path
) -> None:
    CAMERA.to_json(tmp_path / "camera.json")
    image = next((dataset / "test/000001/rgb").iterdir())
    words = ("detect", image, "--camera", tmp_path / "camera.json", "--out", tmp_path / "found.csv", "--parts")
    assert_one_error(run(capsys, *words, tmp_path / "nowhere"), "nowhere", "run: acp-lab prepare MESH")
    assert cv2.imwrite(str(image), np.zeros((20, 30, 3), np.uint8))
    assert_one_error(run(capsys, *words, parts), f"{image}: image is 30 x 20 px")


def test_track_without_anything_to_look_for(
    capsys: pytest.CaptureFixture[str], dataset: Path, parts: Path, tmp_path: Path
) -> None:
    (dataset / "test/000001/scene_gt.json").unlink()
    shutil.rmtree(dataset / "models")
    out = tmp_path / "results.csv"
    for words in ((), ("--object", "1")):
        outcome = run(capsys, "track", dataset, "--parts", parts, "--out", out, "--init", "auto", *words)
        assert_one_error(outcome, dataset / "models", "nothing to look for")
    assert not out.exists()
