"""Small JSON files: poses in, numbers checked, writing whole or not at all."""

from __future__ import annotations

import json
import os
from pathlib import Path

import numpy as np
import pytest

from acp_lab.errors import InputFileError
from acp_lab.input_file import read_json_object
from acp_lab.sequences.json_file import read_pose, was_found, write_json, write_pose
from tests.sequences.tiny_dataset import pose, pose_entry

IDENTITY = [1, 0, 0, 0, 1, 0, 0, 0, 1]


def test_a_pose_reads_back(tmp_path: Path) -> None:
    path = tmp_path / "POSE.json"
    path.write_text(json.dumps(pose_entry(pose(3))))
    np.testing.assert_allclose(read_pose(path), pose(3), atol=1e-12)
    write_pose(tmp_path / "again.json", pose(3))
    np.testing.assert_allclose(read_pose(tmp_path / "again.json"), pose(3), atol=1e-12)
    assert not was_found(tmp_path / "again.json")
    write_pose(tmp_path / "again.json", pose(3), found=True)
    np.testing.assert_allclose(read_pose(tmp_path / "again.json"), pose(3), atol=1e-12)
    assert was_found(tmp_path / "again.json")


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("", "the file is empty"),
        ("[1, 2]", "no JSON object"),
        ('{"cam_R_m2c": ', "not valid JSON"),
        ('{"cam_t_m2c": [0, 0, 1]}', "lacks cam_R_m2c"),
        ("{}", "lacks cam_R_m2c and cam_t_m2c"),
        (json.dumps({"cam_R_m2c": IDENTITY, "cam_t_m2c": [0, 0]}), r"cam_t_m2c is \[0, 0\]: give a list"),
        (json.dumps({"cam_R_m2c": IDENTITY, "cam_t_m2c": [0, 0, "5"]}), "cam_t_m2c holds '5'"),
        (json.dumps({"cam_R_m2c": IDENTITY, "cam_t_m2c": [0, 0, float("nan")]}), "cam_t_m2c holds nan"),
        (json.dumps({"cam_R_m2c": IDENTITY, "cam_t_m2c": [0, True, 1]}), "cam_t_m2c holds True"),
        (json.dumps({"cam_R_m2c": [2, *IDENTITY[1:]], "cam_t_m2c": [0, 0, 1]}), "not a rotation"),
        (json.dumps({"cam_R_m2c": [*IDENTITY[:8], -1], "cam_t_m2c": [0, 0, 1]}), "mirrored"),
        (
            '{"cam_R_m2c": [1,0,0,0,1,0,0,0,1], "cam_t_m2c": [0, 0, 1' + "0" * 400 + "]}",
            "cam_t_m2c holds 1000",
        ),
    ],
)
def test_whatever_is_wrong_with_a_pose_file_is_one_line(tmp_path: Path, content: str, message: str) -> None:
    path = tmp_path / "POSE.json"
    path.write_text(content)
    with pytest.raises(InputFileError, match=message) as error:
        read_pose(path)
    assert str(path) in str(error.value)
    assert "\n" not in str(error.value)


def test_a_pose_replaces_poses_and_nothing_else(tmp_path: Path) -> None:
    path, cad = tmp_path / "POSE.json", tmp_path / "mine.stl"
    for content in ("", json.dumps(pose_entry(pose(3)), indent=None, separators=(" , ", ":   "))):
        path.write_text(content)
        write_pose(path, pose(4))
        np.testing.assert_allclose(read_pose(path), pose(4), atol=1e-12)
    for content in ("solid mine", '{"a": 1}', "\0\xff"):
        cad.write_text(content)
        with pytest.raises(InputFileError, match="replace a file that is not a pose: choose another name") as told:
            write_pose(cad, pose(4))
        assert str(cad) in str(told.value)
        assert "\n" not in str(told.value)
        assert cad.read_text() == content
    for name in ("", "a" * 300, "a\0b"):
        with pytest.raises(InputFileError, match="no file can have that name: choose another one for the pose"):
            write_pose(Path(name), pose(4))


@pytest.mark.skipif(os.name == "nt", reason="pipes are those of POSIX")
def test_a_pose_does_not_replace_a_pipe(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(InputFileError, match="give the pose another place"):
        write_pose(tmp_path / "pipe", pose(4))


def test_missing_and_binary_files(tmp_path: Path) -> None:
    with pytest.raises(InputFileError, match="no such file: fix it"):
        read_json_object(tmp_path / "none.json", "fix it")
    (tmp_path / "a.json").write_bytes(b"\xff\xfe\x00\x80")
    with pytest.raises(InputFileError, match="UTF-8: fix it"):
        read_json_object(tmp_path / "a.json", "fix it")


def test_writing_replaces_and_leaves_nothing_else(tmp_path: Path) -> None:
    path = tmp_path / "new" / "a.json"
    write_json(path, {"a": 1})
    write_json(path, {"b": [2.5]})
    assert json.loads(path.read_text()) == {"b": [2.5]}
    assert [p.name for p in path.parent.iterdir()] == ["a.json"]


def test_writing_where_a_file_is_in_the_way(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(InputFileError, match="cannot be written"):
        write_json(tmp_path / "file" / "a.json", {})
    with pytest.raises(InputFileError, match="cannot be written"):
        write_json(tmp_path, {})
