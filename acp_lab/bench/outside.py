"""Results files of other trackers (BOP results format) as runs, so that they stand in every table and plot.

A file is named TRACKER__DATASET.csv, or TRACKER.csv where there is one data set. Its tracker is taken to have started
from the first frame's truth, to have used every frame and to have been reset never. A frame without a row is a
failure; a sequence without any row was not run, and does not count for that tracker. Scores of the format are free;
beyond [0, 1], where ours lie, they are brought to its ends.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np

from acp_lab.bench.protocol import SequenceKey, Variant, dataset_name
from acp_lab.bench.record import Run
from acp_lab.bench.runner import kind_of
from acp_lab.errors import InputFileError, SequenceError
from acp_lab.evaluation.evaluation import frame_errors
from acp_lab.evaluation.part_metric import metric_name
from acp_lab.sequences.bop import BopDataset
from acp_lab.sequences.results_csv import ResultRow, read_results


def tracker_and_dataset(path: Path, roots: Mapping[str, Path]) -> tuple[str, str]:
    """What a results file is of: the tracker's name and the data set's.

    roots: of the data sets by name. Raises InputFileError where the name of the file does not tell.
    """
    tracker, separator, dataset = path.stem.partition("__")
    tracker = tracker.replace("_", " ")
    if separator and dataset in roots:
        return tracker, dataset
    if not separator and len(roots) == 1:
        return tracker, next(iter(roots))
    wanted = f"{path.stem.partition('__')[0]}__DATASET.csv"
    raise InputFileError(f"{path}: its name must tell the data set: call it {wanted}, with one of {', '.join(roots)}")


def outside_runs(path: Path, roots: Mapping[str, Path], split: str = "test") -> list[Run]:
    """The runs of a results file, one per scene and object that it has rows of.

    Raises InputFileError for a file that cannot be read or does not tell its data set, SequenceError for rows of a
    scene, image or object that the data set does not have.
    """
    tracker, name = tracker_and_dataset(path, roots)
    dataset = BopDataset(roots[name])
    by_sequence: dict[tuple[int, int], dict[int, ResultRow]] = defaultdict(dict)
    for row in read_results(path):
        by_sequence[row.scene_id, row.obj_id][row.im_id] = row
    if not by_sequence:
        raise InputFileError(f"{path}: has no rows: give the results of a tracker")
    return [
        _run(path, tracker, dataset, split, scene_id, object_id, rows)
        for (scene_id, object_id), rows in sorted(by_sequence.items())
    ]


def _run(
    path: Path, tracker: str, dataset: BopDataset, split: str, scene_id: int, object_id: int, rows: dict[int, ResultRow]
) -> Run:
    try:
        dataset.scene_folder(scene_id, split)
    except SequenceError:  # which names the data set, not the file that is wrong
        raise SequenceError(
            f"{path}: scene {scene_id}: {dataset.root / split} has none of it: remove its rows"
        ) from None
    scene = dataset.open_scene(scene_id, split)
    unknown = sorted(set(rows) - set(scene.frame_ids))
    if unknown:
        raise SequenceError(
            f"{path}: image {unknown[0]} of scene {scene_id}: {scene.folder} has none of it: remove its row"
        )
    known = {frame_id: scene.truth(frame_id, object_id) for frame_id in scene.frame_ids[1:]}
    truth = {frame_id: pose for frame_id, pose in known.items() if pose is not None}
    if not truth:
        raise SequenceError(f"{path}: object {object_id}: {scene.folder} has no truth of it: remove its rows")
    part = dataset.part(object_id)
    errors = frame_errors(part, truth, rows)
    count = len(truth)
    poses, scores = np.full((count, 3, 4), math.nan), np.zeros(count)
    for i, frame_id in enumerate(truth):
        if frame_id in rows:
            poses[i], scores[i] = rows[frame_id].cam_T_obj[:3], min(max(rows[frame_id].score, 0.0), 1.0)
    camera = scene.camera(scene.frame_ids[0])
    return Run(
        tracker, "", SequenceKey(dataset_name(dataset.root), scene_id, object_id), Variant(), kind_of(scene.folder),
        metric_name(part), tuple(truth), errors.distance, errors.rotation_deg, errors.translation_mm,
        1e3 * errors.time_s, scores, poses, (), (camera.width, camera.height),
    )  # fmt: skip


def roots_by_name(datasets: Iterable[Path]) -> dict[str, Path]:
    """Data sets by their names; InputFileError where two have the same, as nothing would tell them apart."""
    roots: dict[str, Path] = {}
    for root in datasets:
        name = dataset_name(root)
        if name in roots and roots[name].resolve() != root.resolve():
            raise InputFileError(f"{root}: {roots[name]} has the same name: rename one of the two folders")
        roots[name] = root
    return roots
