"""Tasks in plain values, files of runs, and which instance is which."""

from __future__ import annotations

import json
import math
import os
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import acp_lab
from acp_lab.bench import protocol
from acp_lab.bench.protocol import SequenceKey, Task, Variant, dataset_name, task_of
from acp_lab.bench.record import read_run
from acp_lab.errors import InputFileError, ParameterError, SequenceError
from acp_lab.geometry.pose import make_pose
from acp_lab.sample import sample_dataset
from acp_lab.sequences.bop import BopDataset
from acp_lab.sequences.scene_truth import SceneTruth, instance_truths
from acp_lab.tracking.method import ACP, METHODS
from tests.bench.made_runs import made_run
from tests.commands.conftest import write_dataset

KEY = SequenceKey("sample", 1, 1)


def sample_task(variant: Variant | None = None) -> Task:
    return task_of(sample_dataset(), "test", Path("parts"), KEY, ACP, variant or Variant())


@pytest.fixture
def dataset(tmp_path: Path) -> Path:
    """Drawn boxes that a test may change."""
    return write_dataset(tmp_path / "data")


def test_a_task_survives_the_way_to_another_process() -> None:
    task = sample_task(Variant(2, 5.0, 5.0, 3, True))
    again = Task.from_json(task.to_json())
    assert again == task
    assert again.settings() == ACP
    assert again.sequence == KEY


def test_every_task_has_a_file_of_its_own() -> None:
    variants = [Variant(), Variant(2), Variant(1, 2.0, 2.0), Variant(1, 2.0, 2.0, 1), Variant(resets=True)]
    tasks = [sample_task(variant) for variant in variants]
    tasks += [replace(tasks[0], method_name="other"), replace(tasks[0], instance=1), replace(tasks[0], scene_id=2)]
    assert len({task.file_name for task in tasks}) == len(tasks)


def test_other_settings_are_another_state() -> None:
    tasks = [task_of(sample_dataset(), "test", Path("parts"), KEY, method, Variant()) for method in METHODS.values()]
    assert len({task.state for task in tasks}) == len(METHODS)


def test_another_preparation_of_the_part_is_another_state(tmp_path: Path) -> None:
    task = replace(sample_task(), parts=str(tmp_path))
    header = tmp_path / BopDataset(sample_dataset()).part_path(1).stem / "part.json"
    header.parent.mkdir()
    states = [task.state]
    for text in ("{}", '{"files": 1}'):
        header.write_text(text)
        states.append(task.state)
    assert len(set(states)) == 3


def test_the_sample_is_called_sample() -> None:
    assert dataset_name(sample_dataset()) == "sample"


@pytest.mark.parametrize("values", [{"step": 0}, {"noise_deg": 181.0}, {"noise_mm": math.nan}, {"noise_deg": -1.0}])
def test_variants_that_make_no_sense(values: dict[str, float]) -> None:
    with pytest.raises(ParameterError):
        Variant(**values)  # type: ignore[arg-type]


def test_a_run_survives_its_file(tmp_path: Path) -> None:
    run = made_run([0.01, math.inf, 0.2], resets=(3,))
    path = tmp_path / "runs" / "one.json"
    run.write(path)
    again = read_run(path)
    assert again is not None
    for name in ("distance", "rotation_deg", "ms", "scores", "poses"):
        np.testing.assert_allclose(getattr(again, name), getattr(run, name), atol=1e-9)
    assert (again.sequence, again.variant, again.resets) == (run.sequence, run.variant, (3,))
    assert [path.name for path in path.parent.iterdir()] == ["one.json"]


@pytest.mark.parametrize("text", ["", "{}", '{"format": 0}', "[]", '{"format": 1, "frame_ids": [1]}'])
def test_a_file_that_is_no_run_is_named(tmp_path: Path, text: str) -> None:
    (tmp_path / "x.json").write_text(text)
    with pytest.raises(InputFileError, match=r"x\.json"):
        read_run(tmp_path / "x.json")


def test_instances_are_followed_from_their_first_places_whatever_their_order(tmp_path: Path) -> None:
    def entry(x_mm: float) -> dict[str, object]:
        return {"obj_id": 7, "cam_R_m2c": np.eye(3).ravel().tolist(), "cam_t_m2c": [x_mm, 0.0, 500.0]}

    places = ((-50, 50), (40, -40), (-30,), (20, -20))
    truth = {str(image): [entry(x_mm) for x_mm in of_image] for image, of_image in enumerate(places)}
    path = tmp_path / "scene_gt.json"
    path.write_text(json.dumps(truth))
    with pytest.raises(SequenceError, match="more than once"):
        SceneTruth.from_file(path)
    first, second = instance_truths(path)[7]
    np.testing.assert_allclose([first.pose(i, 7)[0, 3] for i in range(4)], [-50, -40, -30, -20])  # type: ignore[index]
    np.testing.assert_allclose([second.pose(i, 7)[0, 3] for i in (0, 1, 3)], [50, 40, 20])  # type: ignore[index]
    assert second.pose(2, 7) is None


def test_rows_of_a_run_leave_out_frames_without_a_pose() -> None:
    run = made_run([0.01, 0.02, 0.03])
    run.poses[1] = math.nan
    assert [row.im_id for row in run.rows] == [1, 3]
    np.testing.assert_allclose(run.rows[0].cam_T_obj, make_pose(np.eye(3), np.array([0.0, 0.0, 500.0])))


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ({"dataset": "/data/a", "instance": 2}, {"dataset": "/data/a-1", "object_id": 2}),
        ({"dataset": "/data/a b"}, {"dataset": "/data/a_b"}),
        ({"dataset": "/data/Set"}, {"dataset": "/data/set"}),
        ({"method_name": "a$b"}, {"method_name": "a_b"}),
        ({"method_name": "a--step2"}, {"method_name": "a", "variant": Variant(2)}),
        ({"variant": Variant(noise_mm=1.0)}, {"variant": Variant(noise_mm=1.0000001)}),
        ({"dataset": f"/data/{'x' * 200}"}, {"dataset": f"/data/{'x' * 201}"}),
    ],
)
def test_what_reads_the_same_has_another_file(one: dict[str, Any], other: dict[str, Any]) -> None:
    names = {replace(sample_task(), **values).file_name.lower() for values in (one, other)}
    assert len(names) == 2
    assert all(len(name) < 200 for name in names)


TOUCHED = (
    "test/000001/rgb/000003.png", "test/000001/scene_camera.json", "test/000001/scene_gt.json",
    "models/obj_000001.ply", "models/models_info.json",
)  # fmt: skip


@pytest.mark.parametrize("name", TOUCHED)
@pytest.mark.parametrize("method", ["acp-edges", "GOS"])
def test_data_that_somebody_touched_is_another_state(dataset: Path, name: str, method: str) -> None:
    chosen = METHODS.get(method, method)
    task = task_of(dataset, "test", dataset / "parts", SequenceKey("data", 1, 1), chosen, Variant())
    path, before = dataset / name, task.state
    assert task.state == before
    told = path.stat()
    path.write_bytes(path.read_bytes())
    os.utime(path, ns=(told.st_atime_ns, told.st_mtime_ns + 1000))  # the same size, a moment later
    touched = task.state
    path.write_bytes(path.read_bytes() + b"\n")
    os.utime(path, ns=(told.st_atime_ns, told.st_mtime_ns))  # the same moment, another size
    assert len({before, touched, task.state}) == 3


def test_another_meaning_of_pixels_is_another_state(dataset: Path) -> None:
    task = task_of(dataset, "test", dataset / "parts", SequenceKey("data", 1, 1), ACP, Variant())
    states = [task.state]
    for bits in (10, 12):
        path = dataset / "test" / "000001" / "rgb" / "pixels.json"
        path.write_text(json.dumps({"bits": bits}))
        os.utime(path, ns=(0, bits))
        states.append(task.state)
    assert len(set(states)) == 3


def test_other_weights_of_a_network_are_another_state(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    weights = tmp_path / "tracking" / "learning" / "edge_profiles.safetensors"
    weights.parent.mkdir(parents=True)
    monkeypatch.setattr(protocol, "_SOURCES", ("tracking",))
    monkeypatch.setattr(acp_lab, "__file__", str(tmp_path / "__init__.py"))
    sources = []
    for content in (b"one", b"other"):
        weights.write_bytes(content)
        sources.append(protocol._sources.__wrapped__())
    assert sources[0] != sources[1]


def test_an_image_more_or_less_is_another_state_and_another_scene_is_not(dataset: Path) -> None:
    task = task_of(dataset, "test", dataset / "parts", SequenceKey("data", 1, 1), ACP, Variant())
    states = [task.state]
    shutil.copytree(dataset / "test" / "000001", dataset / "test" / "000002")
    assert task.state == states[0]
    folder = dataset / "test" / "000001" / "rgb"
    shutil.copy2(folder / "000003.png", folder / "000004.png")
    states.append(task.state)
    (folder / "000005.png").unlink()
    states.append(task.state)
    assert len(set(states)) == 3
