"""`acp-lab track --video 0`: a camera, here the sample served as one."""

from __future__ import annotations

from pathlib import Path

import pytest

from acp_lab.evaluation import add_mm
from acp_lab.preparation import prepare
from acp_lab.prepared_part import PrepareOptions
from acp_lab.sample import sample_dataset
from acp_lab.sequences import read_results
from acp_lab.sequences.json_file import write_pose
from tests.cli_runner import assert_one_error, run
from tests.plugged_camera import PluggedCamera
from tests.prepared_sample import sample_model, sample_scene


@pytest.fixture(scope="module")
def parts(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("parts")
    prepare(sample_model().part, PrepareOptions(generator="templates", fast=True), out=folder)
    return folder


@pytest.mark.parametrize("start", ["POSE.json", "auto"])
def test_frames_of_a_camera_are_tracked(
    start: str, parts: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("acp_lab.sequences.images.cv2.VideoCapture", PluggedCamera)
    monkeypatch.setattr(PluggedCamera, "fps", 0.0)
    mesh = sample_dataset() / "models" / "obj_000001.ply"
    sample_scene().camera(0).to_json(tmp_path / "CAMERA.json")
    write_pose(tmp_path / "POSE.json", sample_scene().first_pose)
    out, camera = tmp_path / "results.csv", tmp_path / "CAMERA.json"
    words = ["track", "--video", "0", "--mesh", mesh, "--camera", camera, "--parts", parts, "--out", out]
    init = tmp_path / start if start.endswith("json") else start
    outcome = run(capsys, *words, "--init", init, "--max-frames", "15")
    assert outcome.status == 0, outcome
    rows = read_results(out)
    assert [row.im_id for row in rows] == list(range(15))
    part, truth = sample_model().part, sample_scene().truth(14, 1)
    assert truth is not None
    assert add_mm(part.vertices, rows[-1].cam_T_obj, truth) < 0.05 * part.diameter


def test_a_camera_that_is_not_there_is_one_line(
    parts: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("acp_lab.sequences.images.cv2.VideoCapture", PluggedCamera)
    monkeypatch.setattr(PluggedCamera, "isOpened", lambda self: False)
    mesh = sample_dataset() / "models" / "obj_000001.ply"
    sample_scene().camera(0).to_json(tmp_path / "CAMERA.json")
    words = ["track", "--video", "3", "--mesh", mesh, "--camera", tmp_path / "CAMERA.json", "--init", "auto"]
    outcome = run(capsys, *words, "--parts", parts, "--out", tmp_path / "results.csv")
    assert_one_error(outcome, "camera 3", "check its number")
