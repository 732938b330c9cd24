"""The comparison lab on the course's sample: methods side by side, each run kept for the next time."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Iterable
from pathlib import Path

from acp_lab.bench.protocol import Variant
from acp_lab.bench.report import Report
from acp_lab.bench.workbench import Workbench
from acp_lab.course.workshop import files_folder, sample_scene
from acp_lab.files import write_whole
from acp_lab.input_file import read_json_object

BACKWARDS = "backwards"


def workbench(quick: bool = True) -> Workbench:
    """The sample, and its images in the other order, as two data sets of one sequence each.

    quick: which of the prepared samples, see `workshop.sample_model`; it must be there.
    """
    folder = files_folder()
    parts = folder / ("parts_quick" if quick else "parts")
    roots = {"sample": sample_scene().dataset.root, BACKWARDS: _backwards(folder / BACKWARDS)}
    return Workbench(roots, dict.fromkeys(roots, parts), folder / ("bench_quick" if quick else "bench"))


def compare(
    methods: Iterable[str], off: float = 0.0, step: int = 1, starts: int = 1, resets: bool = False, quick: bool = True
) -> Report:
    """Methods on the sample sequence, the first of them being what the others are held against.

    Args:
        off: how far start poses are off, in degrees and in mm; 0 for the truth. starts: how many, where they are off.
        step: use every step-th frame; resets: start a lost part again.
        quick: which of the prepared samples, see `workshop.sample_model`; it must be there.

    Raises:
        AcpLabError: no method is chosen, or one is none, or the sample is not prepared for it.
    """
    variants = [Variant(step, off, off, seed, resets) for seed in range(starts if off else 1)]
    bench = workbench(quick)
    return bench.compare(methods, [key for key in bench.sequences if key.dataset == "sample"], variants)


def _backwards(root: Path) -> Path:
    """The sample's data set with its images in the other order; made when it is missing."""
    scene = sample_scene()
    folder = root / "test" / scene.folder.name
    if (folder / "scene_gt.json").exists():
        return root
    (folder / "rgb").mkdir(parents=True, exist_ok=True)
    shutil.copytree(scene.dataset.root / "models", root / "models", dirs_exist_ok=True)
    other = dict(zip(map(str, scene.frame_ids), map(str, reversed(scene.frame_ids)), strict=True))
    for frame_id, path in scene.image_paths.items():
        target = folder / "rgb" / f"{int(other[str(frame_id)]):06d}{path.suffix}"
        shutil.copyfile(path, target.with_suffix(".part"))
        os.replace(target.with_suffix(".part"), target)
    for name in ("scene_camera.json", "scene_gt.json"):  # the truth last: with it the data set is complete
        content = read_json_object(scene.folder / name, "install acp_lab again")
        turned = {other[frame_id]: entry for frame_id, entry in content.items()}
        write_whole(folder / name, json.dumps(turned).encode(), "the sample backwards")
    return root
