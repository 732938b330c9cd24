"""Through every recipe and out the other side: the shipped sample, dressed up as each data set, is tracked as well as
it is at home."""

from __future__ import annotations

import json
import os
import shlex
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest

from acp_lab.cli import main as acp_lab
from acp_lab.geometry.camera import Camera
from acp_lab.sequences.results_csv import read_results
from data_recipes import bcot, own_video, rbot, rt_less, t_less
from tests.data_recipes.fake_downloads import (
    Views,
    pose_entry,
    sample_views,
    write_bcot,
    write_image,
    write_mesh,
    write_rbot,
    write_rt_less,
    write_t_less,
)

pytestmark = pytest.mark.slow
FRAMES = 8


def _rt_less(root: Path, views: Views) -> Sequence[str]:
    write_rt_less(root, views)
    return [str(root), "--group", "2"]


def _t_less(root: Path, views: Views) -> Sequence[str]:
    write_t_less(root, views, object_id=7)
    return [str(root), "--group", "1"]


def _bcot(root: Path, views: Views) -> Sequence[str]:
    write_bcot(root, views)
    return [str(root)]


def _rbot(root: Path, views: Views) -> Sequence[str]:
    write_rbot(root, views)
    return [str(root), "--sequences", "a_regular"]


def _own_video(root: Path, views: Views) -> Sequence[str]:
    for i, image in enumerate(views.images):
        write_image(root / "clip" / f"{i}.png", image)
    write_mesh(root / "bracket.obj", views, 0.001)
    height, width = views.images[0].shape[:2]
    Camera.from_matrix(views.matrices[0], width, height).to_json(root / "CAMERA.json")
    (root / "POSE.json").write_text(json.dumps(pose_entry(views.poses[0], 1)))
    paths = ("--mesh", root / "bracket.obj", "--camera", root / "CAMERA.json", "--pose", root / "POSE.json")
    return [str(root / "clip"), *map(str, paths)]


@pytest.fixture(scope="module")
def views() -> Views:
    return sample_views(FRAMES)


@pytest.fixture(scope="module")
def parts(tmp_path_factory: pytest.TempPathFactory) -> Callable[[Path], Path]:
    """The folder of a prepared mesh; meshes of the same bytes share one."""
    root = tmp_path_factory.mktemp("parts")
    prepared: dict[bytes, Path] = {}

    def prepare(mesh: Path) -> Path:
        data = mesh.read_bytes()
        if data not in prepared:
            folder = root / str(len(prepared))
            assert acp_lab(["prepare", str(mesh), "--out", str(folder), "--generator", "templates"]) == 0
            prepared[data] = folder
        # Object ids differ from data set to data set, and a prepared part goes by its mesh's name.
        (there,) = [path for path in prepared[data].iterdir() if not path.is_symlink()]
        if not (prepared[data] / mesh.stem).exists():
            os.symlink(there, prepared[data] / mesh.stem)
        return prepared[data]

    return prepare


@pytest.mark.parametrize(
    ("recipe", "dress"),
    [
        (rt_less.main, _rt_less), (t_less.main, _t_less), (bcot.main, _bcot), (rbot.main, _rbot),
        (own_video.main, _own_video),
    ],
    ids=["rt_less", "t_less", "bcot", "rbot", "own_video"],
)  # fmt: skip
def test_a_converted_data_set_is_tracked_and_evaluated(
    tmp_path: Path,
    recipe: Callable[[list[str]], int],
    dress: Callable[[Path, Views], Sequence[str]],
    views: Views,
    parts: Callable[[Path], Path],
) -> None:
    source, out, results = tmp_path / "in", tmp_path / "out", tmp_path / "results.csv"
    assert recipe([*dress(source, views), "--out", str(out)]) == 0
    (mesh,) = (out / "models").glob("*.ply")
    folder = parts(mesh)
    assert acp_lab(["track", str(out), "--parts", str(folder), "--out", str(results)]) == 0
    assert len(results.read_text().splitlines()) == 1 + FRAMES
    if recipe is own_video.main:
        _check_video(source, out, mesh, folder, results)
        return
    assert acp_lab(["eval", str(out), str(results), "--json", str(tmp_path / "eval.json")]) == 0
    pooled = json.loads((tmp_path / "eval.json").read_text())["pooled"]
    assert pooled["frames"] == FRAMES - 1
    assert pooled["recall_5"] == 1.0


def _check_video(source: Path, out: Path, mesh: Path, folder: Path, results: Path) -> None:
    """The same frames as a folder of images give the same poses."""
    again = results.with_name("video.csv")
    given = ["--video", source / "clip", "--mesh", mesh, "--camera", out / "CAMERA.json", "--init", out / "POSE.json"]
    assert acp_lab(["track", *map(str, given), "--parts", str(folder), "--out", str(again)]) == 0
    # All but the last column, the times.
    poses = [[line.rsplit(",", 1)[0] for line in path.read_text().splitlines()] for path in (results, again)]
    assert poses[0] == poses[1]


def test_a_found_start_that_is_too_far_is_made_good_by_each_command_that_is_printed(
    tmp_path: Path, views: Views, parts: Callable[[Path], Path], capsys: pytest.CaptureFixture[str]
) -> None:
    out, start = tmp_path / "out", views.poses[0].copy()
    start[:3, 3] *= 1.0 + 8.0 / np.linalg.norm(start[:3, 3])
    options = _own_video(tmp_path / "in", views)
    (tmp_path / "in" / "POSE.json").write_text(json.dumps(pose_entry(start, 1) | {"found": True}))
    assert own_video.main([*options, "--out", str(out)]) == 0
    commands = [line for line in capsys.readouterr().out.splitlines() if line.startswith("acp-lab track")]
    assert len(commands) == 2
    folder = parts(out / "models" / "obj_000001.ply")
    for number, command in enumerate(commands):
        results = tmp_path / f"{number}.csv"
        words = [str(folder) if word == "PARTS_DIR" else word for word in shlex.split(command)[1:-1]]
        assert acp_lab([*words, str(results)]) == 0
        errors = [
            np.linalg.norm(row.cam_T_obj[:3, 3] - pose[:3, 3])
            for row, pose in zip(read_results(results), views.poses, strict=True)
        ]
        assert np.median(errors) < 0.3  # mm; twice that where the start is taken for exact
