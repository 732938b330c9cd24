"""From a results file or a run to scores per object, a table, and the JSON of the command line.

Convention: the first frame of a scene is left out (a tracker starts there, often from the truth). Of the
other frames those count in which scene_gt.json shows the object; one without a row is a failure with infinite
errors. Objects with symmetries in models_info.json are scored by ADD-S, the others by ADD, over all vertices
of the model (`part_metric`).
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Collection, Iterable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Protocol, TypeAlias

import numpy as np

from acp_lab.cad.part import Part
from acp_lab.errors import SequenceError, check_kind
from acp_lab.evaluation.metrics import FrameErrors, Scores, number_cell, pooled_scores, pose_error, scores
from acp_lab.evaluation.part_metric import PartMetric, metric_name
from acp_lab.geometry.arrays import FloatArray
from acp_lab.sequences.bop import BopDataset, BopScene, image_files
from acp_lab.sequences.json_file import write_json
from acp_lab.sequences.results_csv import ResultRow, read_results
from acp_lab.sequences.scene_truth import SceneTruth

_SHARES = ("@2%", "@5%", "@10%", "AUC %", "5cm5° %")
_COLUMNS = ("scene", "object", "metric", "frames", *_SHARES, "rot °", "trans mm", "until lost", "ms")


class HasRows(Protocol):
    """A finished run: anything that has results, one row per frame and object."""

    @property
    def rows(self) -> Iterable[ResultRow]:
        """The rows, in any order."""


Results: TypeAlias = HasRows | Iterable[ResultRow] | str | Path


@dataclass(frozen=True)
class ObjectScores:
    """The scores of one object in one scene. metric: "ADD" or "ADD-S". errors: frame by frame, for plots."""

    scene_id: int
    obj_id: int
    metric: str
    scores: Scores
    errors: FrameErrors = field(repr=False, compare=False)


@dataclass(frozen=True)
class Evaluation:
    """Scores per (scene, object), in that order, and pooled over all their frames. Prints as a table."""

    objects: tuple[ObjectScores, ...]
    pooled: Scores

    @property
    def metric(self) -> str:
        """The metric behind `pooled`: "ADD", "ADD-S", or "ADD(-S)" when the objects differ."""
        metrics = {scored.metric for scored in self.objects}
        return metrics.pop() if len(metrics) == 1 else "ADD(-S)"

    def __str__(self) -> str:
        table = [_COLUMNS, *self._cells()]
        widths = [max(len(row[i]) for row in table) for i in range(len(_COLUMNS))]
        aligned = ([cell.rjust(width) for cell, width in zip(row, widths, strict=True)] for row in table)
        return "\n".join("  ".join(cells) for cells in aligned)

    def _repr_html_(self) -> str:
        head = "".join(f"<th>{name}</th>" for name in _COLUMNS)
        rows = ("".join(f"<td>{cell}</td>" for cell in row) for row in self._cells())
        body = "".join(f"<tr>{row}</tr>" for row in rows)
        return f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"

    def to_json(self) -> dict[str, Any]:
        """{"objects": [{scene_id, obj_id, metric, frames, recall_2, …}], "pooled": {metric, frames, …}}.

        Shares are in [0, 1]; null where a number is not known or infinite. The pooled frames_until_lost is
        the sum over the objects.
        """
        objects = [
            {"scene_id": item.scene_id, "obj_id": item.obj_id, "metric": item.metric, **_plain(item.scores)}
            for item in self.objects
        ]
        return {"objects": objects, "pooled": {"metric": self.metric, **_plain(self.pooled)}}

    def write_json(self, path: str | Path) -> None:
        """Write `to_json()` whole or not at all; InputFileError when the place cannot be written."""
        write_json(path, self.to_json())

    def _cells(self) -> list[tuple[str, ...]]:
        rows = [(str(o.scene_id), str(o.obj_id), o.metric, *_score_cells(o.scores)) for o in self.objects]
        return [*rows, ("all", "", self.metric, *_score_cells(self.pooled))]


def evaluate(results: Results, truth: BopScene | BopDataset | str | Path, split: str = "test") -> Evaluation:
    """Score results against a data set, or a run against its scene.

    results: a finished run, its rows, or the path of a results file. truth: a data set (or its path), or one
    scene, whose rows alone may then be given. split: where the scenes of a data set are.
    Every (scene, object) that has a row is scored; of these, frames without a row are failures.
    Raises SequenceError for a truth that has none, such as a video, for no rows, for two rows of one frame and object,
    and for rows of a scene, image or object that the data set does not have; InputFileError for files that are missing
    or malformed.

    Example:
        >>> import acp_lab as acp
        >>> from acp_lab.sample import sample_dataset
        >>> scene = acp.open_sequence(sample_dataset())
        >>> model = acp.prepare(scene.dataset.part(1), out="parts")  # doctest: +SKIP
        >>> run = acp.Tracker(model).run(scene, start=scene.first_pose)
        >>> acp.evaluate(run, scene).pooled.recall_5
        1.0
    """
    if isinstance(truth, BopScene):
        dataset, split, only_scene = truth.dataset, truth.split, truth.scene_id
    else:
        if not isinstance(truth, BopDataset | str | Path):
            raise SequenceError(
                f"{getattr(truth, 'name', type(truth).__name__)}: has no truth to score against: give a data set in "
                "the BOP layout, or its folder, after the run: evaluate(run, scene)"
            )
        dataset = truth if isinstance(truth, BopDataset) else BopDataset(truth)
        only_scene = None
    by_object = _by_object(results)
    truths: dict[int, _SceneFrames] = {}
    parts: dict[int, Part] = {}
    scored = []
    for (scene_id, object_id), rows in sorted(by_object.items()):
        if only_scene not in (None, scene_id):
            raise SequenceError(
                f"results of scene {scene_id}: the scene given is {only_scene}: give the data set instead"
            )
        if scene_id not in truths:
            scored_ids = {of_object for of_scene, of_object in by_object if of_scene == scene_id}
            truths[scene_id] = _SceneFrames.read(dataset, scene_id, split, scored_ids)
        poses = truths[scene_id].evaluated(object_id, rows)
        if object_id not in parts:
            parts[object_id] = dataset.part(object_id)
        errors = frame_errors(parts[object_id], poses, rows)
        scored.append(ObjectScores(scene_id, object_id, metric_name(parts[object_id]), scores(errors), errors))
    return Evaluation(tuple(scored), pooled_scores(item.errors for item in scored))


def frame_errors(part: Part, truth: dict[int, FloatArray], rows: dict[int, ResultRow]) -> FrameErrors:
    """The errors of one object.

    truth: true cam_T_obj (4, 4) by image id, of the frames to evaluate. rows: the results by image id; a
    frame that has none gets infinite errors.
    """
    metric = PartMetric(part)
    errors = np.full((4, len(truth)), np.inf)
    errors[3] = np.nan
    for i, (frame_id, cam_T_true) in enumerate(truth.items()):
        row = rows.get(frame_id)
        if row is None:
            continue
        apart = pose_error(row.cam_T_obj, cam_T_true, part.symmetries)
        time_s = row.time_s if row.time_s >= 0.0 else math.nan
        errors[:, i] = metric.share(row.cam_T_obj, cam_T_true), apart.rotation_deg, apart.translation_mm, time_s
    return FrameErrors(tuple(truth), *errors)


@dataclass(frozen=True)
class _SceneFrames:
    """What scoring needs of a scene: the images it has and the truth, without opening any image."""

    folder: Path
    frame_ids: tuple[int, ...]
    truth: SceneTruth

    @classmethod
    def read(cls, dataset: BopDataset, scene_id: int, split: str, asked: Collection[int]) -> _SceneFrames:
        folder = dataset.scene_folder(scene_id, split)
        return cls(folder, tuple(image_files(folder)), SceneTruth.from_file(folder / "scene_gt.json", asked))

    def evaluated(self, object_id: int, rows: dict[int, ResultRow]) -> dict[int, FloatArray]:
        """Truth by image id of the frames to score: all but the first; SequenceError for rows without
        such an image or object."""
        if object_id not in self.truth.object_ids:
            known = ", ".join(str(i) for i in self.truth.object_ids) or "none"
            raise SequenceError(
                f"{self.folder}: no object {object_id}, of which there are results: its truth has {known}"
            )
        unknown = sorted(set(rows) - set(self.frame_ids))
        if unknown:
            raise SequenceError(
                f"{self.folder}: no image {unknown[0]}, of which there are results: give those of this scene"
            )
        poses = ((frame_id, self.truth.pose(frame_id, object_id)) for frame_id in self.frame_ids[1:])
        return {frame_id: pose for frame_id, pose in poses if pose is not None}


_RUN = "what tracker.run returned, or a results file"


def _by_object(results: Results) -> dict[tuple[int, int], dict[int, ResultRow]]:
    """Rows by (scene id, object id), then image id."""
    if isinstance(results, str | Path):
        rows: Iterable[ResultRow] = read_results(results)
        source = f"{results}"
    else:
        # A run has rows; anything else is rows.
        rows = results.rows if hasattr(results, "rows") else results
        check_kind(rows, Iterable, "results", _RUN)
        source = "results"
    by_object: dict[tuple[int, int], dict[int, ResultRow]] = defaultdict(dict)
    for row in rows:
        check_kind(row, ResultRow, "a row of results", _RUN)
        of_object = by_object[row.scene_id, row.obj_id]
        if row.im_id in of_object:
            raise SequenceError(
                f"{source}: scene {row.scene_id}, image {row.im_id}, object {row.obj_id} has two rows: keep one"
            )
        of_object[row.im_id] = row
    if not by_object:
        raise SequenceError(f"{source}: no rows to evaluate: run the tracker first")
    return by_object


def _plain(values: Scores) -> dict[str, int | float | None]:
    # NaN and infinity are not JSON.
    return {key: value if math.isfinite(value) else None for key, value in asdict(values).items()}


def _score_cells(values: Scores) -> tuple[str, ...]:
    shares = (values.recall_2, values.recall_5, values.recall_10, values.auc_10pct, values.cm5deg5)
    return (
        str(values.frames),
        *(number_cell(100.0 * share, 1) for share in shares),
        number_cell(values.rot_deg_median, 2),
        number_cell(values.trans_mm_median, 2),
        str(values.frames_until_lost),
        number_cell(1000.0 * values.time_s_median, 1),
    )
