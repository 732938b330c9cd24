"""A data set as other cameras would have taken it."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

import acp_lab as acp
from acp_lab.sample import sample_dataset
from acp_lab.sequences import BopDataset, Frame
from acp_lab.studies.other_cameras import CAMERAS
from data_recipes.other_cameras import main


@pytest.fixture
def small(tmp_path: Path) -> Path:
    """The sample with its first three images, and what is seen of the part in them."""
    root = tmp_path / "bench"
    shutil.copytree(sample_dataset(), root, ignore=shutil.ignore_patterns("rgb"))
    scene = root / "test" / "000001"
    (scene / "rgb").mkdir()
    for path in sorted((sample_dataset() / "test" / "000001" / "rgb").iterdir())[:3]:
        shutil.copy(path, scene / "rgb")
    seen = {str(i): [{"px_count_all": 900, "visib_fract": 0.5, "bbox_obj": [1, 2, 3, 4]}] for i in range(3)}
    (scene / "scene_gt_info.json").write_text(json.dumps(seen))
    return root


def test_each_camera_writes_a_data_set_of_its_own(small: Path, tmp_path: Path) -> None:
    out = tmp_path / "taken"
    assert main([str(small), "--out", str(out), "--cameras", "dark,half"]) == 0
    assert sorted(path.name for path in out.iterdir()) == ["dark", "half"]
    original = acp.open_sequence(small)
    for name in ("dark", "half"):
        dataset = BopDataset(out / name / "bench")
        assert dataset.part(1).diameter == original.dataset.part(1).diameter
        scene = dataset.open_scene(1)
        assert scene.frame_ids == original.frame_ids
        for index in scene.frame_ids:
            frame, before = scene.frame(index), original.frame(index)
            assert isinstance(frame, Frame)
            assert isinstance(before, Frame)
            expected = CAMERAS[name].take(before)
            assert np.array_equal(frame.image, expected.image)
            assert frame.camera == expected.camera
            assert np.array_equal(np.asarray(scene.truth(index, 1)), np.asarray(original.truth(index, 1)))
        told = json.loads((scene.folder / "scene_gt_info.json").read_text())
        assert told["1"] == [{"visib_fract": 0.5}]  # boxes and counts are those of another size


def test_what_is_seen_may_be_told_in_part_and_look_alikes_stay(small: Path, tmp_path: Path) -> None:
    scene = small / "test" / "000001"
    seen = {"0": [{"px_count_all": 900}, {"visib_fract": float("nan")}], "1": [{"visib_fract": 0.5}]}
    (scene / "scene_gt_info.json").write_text(json.dumps(seen))
    (scene / "scene_look_alikes.json").write_text('{"0": []}')
    assert main([str(small), "--out", str(tmp_path / "taken"), "--cameras", "dark"]) == 0
    taken = tmp_path / "taken" / "dark" / "bench" / "test" / "000001"
    told = json.loads((taken / "scene_gt_info.json").read_text())
    assert told == {"0": [{}, {}], "1": [{"visib_fract": 0.5}]}
    assert (taken / "scene_look_alikes.json").read_text() == '{"0": []}'


@pytest.mark.parametrize("content", ['{"0": [{"visib_fr', '{"0": 5}', '{"0": [5]}'])
def test_what_is_seen_torn_is_one_line(
    small: Path, tmp_path: Path, content: str, capsys: pytest.CaptureFixture[str]
) -> None:
    (small / "test" / "000001" / "scene_gt_info.json").write_text(content)
    assert main([str(small), "--out", str(tmp_path / "taken"), "--cameras", "dark"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("error: ")
    assert "scene_gt_info.json" in line


def test_nothing_is_replaced_unasked_nor_left_half_written(
    small: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "taken"
    argv = [str(small), "--out", str(out), "--cameras", "grey"]
    assert main(argv) == 0
    assert main(argv) == 2
    assert "exists; give another --out, or --force" in capsys.readouterr().err
    assert main([*argv, "--force"]) == 0
    image = sorted((small / "test" / "000001" / "rgb").iterdir())[1]
    image.write_bytes(image.read_bytes()[:500])
    capsys.readouterr()
    assert main([str(small), "--out", str(out), "--cameras", "linear"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("error: ")
    assert image.name in line
    assert [path.name for path in (out / "linear").iterdir()] == []


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--cameras", "dark,pinhole"), "no camera pinhole: there are soft, half"),
        (("--out", "{small}"), "holds the source"),
    ],
)
def test_bad_usage_is_one_line(
    small: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], options: tuple[str, ...], words: str
) -> None:
    argv = [str(small), "--out", str(tmp_path / "taken"), *(option.format(small=small) for option in options)]
    try:
        status = main(argv)
    except SystemExit as stop:
        status = int(stop.code or 0)
    assert status == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("error: ")
    assert words in line
    assert not (tmp_path / "taken").exists()
