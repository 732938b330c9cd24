"""The tracking benchmark: scenes of several objects are tracked object by object."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path

from acp_lab.sequences.bop import BopDataset
from benchmarks.tracking import track_scene
from tests.prepared_sample import sample_model, sample_scene


def test_each_object_of_a_scene_is_tracked(tmp_path: Path) -> None:
    """The sample's part twice, as objects 2 and 1 at one place."""
    sample, folder = sample_scene(), tmp_path / "test" / "000001"
    (folder / "rgb").mkdir(parents=True)
    for image in (sample.image_paths[0], sample.image_paths[1]):
        shutil.copyfile(image, folder / "rgb" / image.name)
    (tmp_path / "models").mkdir()
    models = sample.dataset.root / "models"
    infos = json.loads((models / "models_info.json").read_text())
    for object_id in (1, 2):
        shutil.copyfile(models / "obj_000001.ply", tmp_path / "models" / f"obj_{object_id:06d}.ply")
    (tmp_path / "models" / "models_info.json").write_text(json.dumps({"1": infos["1"], "2": infos["1"]}))
    truth = json.loads((sample.folder / "scene_gt.json").read_text())
    both = {i: [{**truth[i][0], "obj_id": object_id} for object_id in (2, 1)] for i in ("0", "1")}
    (folder / "scene_gt.json").write_text(json.dumps(both))
    shutil.copyfile(sample.folder / "scene_camera.json", folder / "scene_camera.json")
    dataset = BopDataset(tmp_path)
    scene = dataset.open_scene(1)
    assert len(scene.first_poses) == 2
    rows = [track_scene(dataset, scene, sample_model(), *first) for first in scene.first_poses.items()]
    assert [row.recall_2 for row in rows] == [1.0, 1.0]
    assert replace(rows[0], ms=0.0) == replace(rows[1], ms=0.0)
