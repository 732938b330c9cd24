"""What is kept of a run: its poses, their errors and times, one JSON file per run, written whole or not at all."""

from __future__ import annotations

import json
import math
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from acp_lab.bench.protocol import SequenceKey, Variant
from acp_lab.errors import InputFileError
from acp_lab.evaluation.metrics import LOST_SHARE, FrameErrors
from acp_lab.files import write_whole
from acp_lab.geometry.arrays import FloatArray
from acp_lab.sequences.results_csv import ResultRow

FORMAT = 2


@dataclass(frozen=True, eq=False)
class Run:
    """A finished run, its first frame left out of the scores.

    Attributes:
        method: its name; state: of settings and sources, "" for an outside tracker; sequence, variant: what and how.
        kind: of the scene's motion, "" where nobody tells; metric: "ADD" or "ADD-S".
        frame_ids: n scored images; distance: (n,) ADD(-S) as a share of the diameter, rotation_deg, translation_mm
            (n,), infinite without a pose.
        ms: (n,) milliseconds, NaN where unknown: CPU of one thread of ours, what its file tells of an outside tracker.
        scores: (n,) the tracker's own quality in [0, 1]; poses: (n, 3, 4) cam_T_obj, NaN without one.
        resets: image ids at which the part was started again.
        size: (w, h) px of the images; threads: of the tracker, 0 where unknown; memory_mb: the most that its process
            held so far, prepare_s: CPU seconds of preparing what the method needs of the part, both NaN where unknown;
            cpu: of the machine; note: why poses are missing.
    """

    method: str
    state: str
    sequence: SequenceKey
    variant: Variant
    kind: str
    metric: str
    frame_ids: tuple[int, ...]
    distance: FloatArray
    rotation_deg: FloatArray
    translation_mm: FloatArray
    ms: FloatArray
    scores: FloatArray
    poses: FloatArray
    resets: tuple[int, ...] = ()
    size: tuple[int, int] = (0, 0)
    threads: int = 0
    memory_mb: float = math.nan
    prepare_s: float = math.nan
    cpu: str = ""
    note: str = ""

    @property
    def errors(self) -> FrameErrors:
        """For `evaluation.pooled_scores`."""
        return FrameErrors(self.frame_ids, self.distance, self.rotation_deg, self.translation_mm, 1e-3 * self.ms)

    @property
    def is_lost(self) -> bool:
        """Whether ADD(-S) was above 30% of the diameter in any frame, or a pose is missing."""
        return bool((~(self.distance <= LOST_SHARE)).any())

    @property
    def worst(self) -> int:
        """The row of the first frame that is lost, else of the largest error."""
        lost = np.flatnonzero(~(self.distance <= LOST_SHARE))
        return int(lost[0]) if len(lost) else int(np.argmax(self.distance))

    @property
    def rows(self) -> tuple[ResultRow, ...]:
        """The poses as rows of a results file."""
        scene_id, object_id = self.sequence.scene_id, self.sequence.object_id
        return tuple(
            ResultRow(
                scene_id, frame_id, object_id, float(score), np.vstack([pose, [0.0, 0.0, 0.0, 1.0]]),
                1e-3 * float(ms) if math.isfinite(ms) else -1.0,
            )
            for frame_id, score, pose, ms in zip(self.frame_ids, self.scores, self.poses, self.ms, strict=True)
            if np.isfinite(pose).all()
        )  # fmt: skip

    def to_json(self) -> str:
        """The run as text; null stands for what is not finite."""
        values = {name: _plain(value) for name, value in vars(self).items()}
        return json.dumps({"format": FORMAT, **values}, allow_nan=False) + "\n"

    @classmethod
    def from_json(cls, text: str, where: str) -> Run:
        """The inverse of `to_json`; InputFileError, beginning with `where`, for anything else."""
        try:
            values: dict[str, Any] = json.loads(text)
            if values.pop("format") != FORMAT:
                raise ValueError("of another version")
            count = len(values["frame_ids"])
            for name, missing in _ARRAYS.items():
                shape = (count, 3, 4) if name == "poses" else (count,)
                values[name] = np.array(_filled(values[name], missing), np.float64).reshape(shape)
            values |= {name: tuple(values[name]) for name in ("frame_ids", "resets", "size")}
            for name in ("memory_mb", "prepare_s"):
                values[name] = math.nan if values[name] is None else float(values[name])
            values["sequence"] = SequenceKey(**values["sequence"])
            return cls(**{**values, "variant": Variant(**values["variant"])})
        except (ValueError, TypeError, KeyError, AttributeError) as error:
            raise InputFileError(f"{where}: is no run of a bench ({error}): remove it") from None

    def write(self, path: Path) -> None:
        """Write the run, whole or not at all; InputFileError when the place cannot be written."""
        write_whole(path, self.to_json().encode(), "the run")


_ARRAYS = {
    "distance": math.inf, "rotation_deg": math.inf, "translation_mm": math.inf, "ms": math.nan, "scores": 0.0,
    "poses": math.nan,
}  # fmt: skip
"""What null stands for in each."""


def read_run(path: Path) -> Run | None:
    """A run that was kept, None where there is none; InputFileError for a file that is none."""
    try:
        text = path.read_text(encoding="utf-8")
    except FileNotFoundError:
        return None
    except (OSError, UnicodeDecodeError) as error:
        raise InputFileError(f"{path}: cannot be read ({error}): remove it") from None
    return Run.from_json(text, str(path))


def _plain(value: Any) -> Any:
    if isinstance(value, SequenceKey | Variant):
        return asdict(value)
    if isinstance(value, np.ndarray):
        # The last digits say nothing, and a bench has many poses.
        return _plain(np.round(value.ravel(), 9).tolist())
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value


def _filled(values: list[Any], missing: float) -> list[float]:
    return [missing if value is None else float(value) for value in values]
