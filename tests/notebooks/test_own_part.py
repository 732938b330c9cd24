"""Notebook 10 and the pose that somebody made by hand: Run All keeps its file, byte for byte."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

import acp_lab as acp
from acp_lab.sequences.json_file import read_pose
from tests.notebooks.notebook_files import FOLDER, Run, code_cells, read
from tests.prepared_sample import sample_model, sample_scene

NOTEBOOK = FOLDER / "10_your_own_part.ipynb"


def hand_written(path: Path) -> bytes:
    """Writes the true start pose as no program of ours would; the file's bytes."""
    truth = sample_scene().first_pose
    pose = {"cam_t_m2c": truth[:3, 3].tolist(), "cam_R_m2c": truth[:3, :3].ravel().tolist(), "note": "by hand"}
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(pose, indent=7))
    return path.read_bytes()


def run_pose_cells(folder: Path, are_yours: bool) -> dict[str, Any]:
    """The cells of the first pose, on the sample's first frame; their names. Raises what they raise."""
    names: dict[str, Any] = {
        "acp": acp,
        "model": sample_model(),
        "video": sample_scene(),
        "folder": folder,
        "files": SimpleNamespace(are_yours=are_yours),
    }
    for cell in code_cells(read(NOTEBOOK)):
        if cell.id in ("aligner", "hand"):
            exec(compile(cell.source, f"cell {cell.id}", "exec"), names)
    assert "aligner" in names, "the cells were renamed"
    return names


@pytest.mark.parametrize("are_yours", [True, False])
def test_a_pose_that_is_there_is_used_and_kept(are_yours: bool, tmp_path: Path) -> None:
    before = hand_written(tmp_path / "POSE.json")
    names = run_pose_cells(tmp_path, are_yours)
    assert (tmp_path / "POSE.json").read_bytes() == before
    assert (names["aligner"].cam_T_obj == read_pose(tmp_path / "POSE.json")).all()


def test_a_damaged_pose_stops_the_notebook_and_is_kept(tmp_path: Path) -> None:
    (tmp_path / "POSE.json").write_text('{"cam_R_m2c": [1, 0')
    with pytest.raises(acp.AcpLabError, match=r"POSE\.json"):
        run_pose_cells(tmp_path, are_yours=False)
    assert (tmp_path / "POSE.json").read_text() == '{"cam_R_m2c": [1, 0'


def test_without_a_pose_the_own_video_waits_for_a_hand_and_the_stand_in_does_not(tmp_path: Path) -> None:
    with pytest.raises(acp.AcpLabError, match="not found yet"):
        run_pose_cells(tmp_path, are_yours=True)
    assert not (tmp_path / "POSE.json").exists()
    names = run_pose_cells(tmp_path, are_yours=False)
    assert names["is_found"]
    assert (tmp_path / "POSE.json").exists()


@pytest.mark.slow
def test_run_all_keeps_the_pose(run_notebook: Run, course_files: Path) -> None:
    file = course_files / "own_part" / "POSE.json"
    before = hand_written(file)
    run_notebook(read(NOTEBOOK))
    assert file.read_bytes() == before
