"""Runs of methods through the frames of BOP scenes in a chosen order, from a chosen start, kept as JSON lines.

One run: one method, one object of one scene, one order of the frames, one start. Its errors are ADD, or ADD-S for a
part with symmetries, as a share of the diameter; frames in which less than 30% of the part is visible do not count.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from functools import lru_cache
from itertools import dropwhile, islice
from multiprocessing import get_context
from pathlib import Path
from typing import TYPE_CHECKING, Any

from acp_lab.commands import machine

# Before NumPy is imported, here and in every process of the pool.
machine.limit_threads(1)

import numpy as np  # noqa: E402

from acp_lab.bench.protocol import digest  # noqa: E402
from acp_lab.errors import InputFileError  # noqa: E402

if TYPE_CHECKING:
    from acp_lab.prepared_part import PreparedPart
    from acp_lab.sequences.bop import BopScene
    from acp_lab.sequences.frame import Frame
    from acp_lab.sequences.protocol import Sequence
    from acp_lab.tracking.method import Method

ORDERS = {"forwards": slice(None), "backwards": slice(None, None, -1), "second": slice(None, None, 2),
          "third": slice(None, None, 3), "fourth": slice(None, None, 4),
          "fourth-backwards": slice(None, None, -4)}  # fmt: skip
"""Which frames, in which order: "second" is every second frame."""
STARTS = {"truth": (0.0, 0.0), "0.5": (0.5, 0.5), "2": (2.0, 2.0), "5": (5.0, 5.0)}
"""How far the start pose is off: degrees, mm."""
VISIBLE = 0.3
LOST = 0.3


@dataclass(frozen=True)
class Job:
    """What to run. root: of the data set; parts: folder of its prepared parts."""

    root: Path
    parts: Path
    scene_id: int
    object_id: int
    method: Method
    order: str
    start: str
    seed: int

    @property
    def key(self) -> tuple[str, ...]:
        """What tells two runs apart, in a file and in memory."""
        sequence = f"{self.root.resolve().name}/{self.scene_id}/{self.object_id}"
        return self.method.name, state_of(self.method), sequence, self.order, self.start, str(self.seed)


@dataclass(frozen=True)
class Run:
    """A finished job: frame by frame, the first one left out.

    state: of method and sources. sequence: data set, scene and object. part: see `part_name`. frames: image ids.
    errors: share of the diameter; ms: CPU time; both None without a pose. counts: whether the frame counts.
    """

    method: str
    state: str
    sequence: str
    order: str
    start: str
    seed: str
    part: str
    kind: str
    frames: list[int]
    errors: list[float | None]
    counts: list[bool]
    ms: list[float | None]

    @property
    def key(self) -> tuple[str, ...]:
        """As `Job.key`."""
        return self.method, self.state, self.sequence, self.order, self.start, self.seed

    @property
    def counted(self) -> np.ndarray:
        """(n,) errors of the frames that count, infinite without a pose."""
        return np.array([math.inf if e is None else e for e, c in zip(self.errors, self.counts, strict=True) if c])

    @property
    def lost(self) -> bool:
        """Whether any error that counts is above 30% of the diameter."""
        return bool((self.counted > LOST).any())

    @property
    def ms_while_tracked(self) -> list[float]:
        """Times of the frames that are not lost."""
        pairs = zip(self.errors, self.ms, strict=True)
        return [ms for error, ms in pairs if ms is not None and error is not None and error <= LOST]


def part_name(root: Path, object_id: int) -> str:
    """The name that models_info.json gives a part, else data set and object id: "metal_dev/2"."""
    info = json.loads((root / "models" / "models_info.json").read_text(encoding="utf-8"))
    return str(info[str(object_id)].get("name", f"{root.resolve().name}/{object_id}"))


def state_of(method: Method) -> str:
    """Changes when the method's parts or the sources that track change, so that old runs are not taken for new."""
    return digest(repr(method))


def read_runs(path: Path) -> list[Run]:
    """All runs of a file; a last line that was cut off is left out. Raises InputFileError for any other bad line."""
    if not path.exists():
        return []
    runs = []
    for number, line in enumerate(path.read_text(encoding="utf-8").split("\n")[:-1], start=1):
        try:
            runs.append(Run(**json.loads(line)))
        except (ValueError, TypeError) as error:
            raise InputFileError(f"{path}: line {number} is no run ({error}): give another file") from None
    return runs


def complete(jobs: list[Job], path: Path, processes: int) -> Iterator[Run]:
    """The runs of all jobs: first those that the file holds, then new ones, each written as soon as it is there."""
    known = {run.key: run for run in read_runs(path)}
    yield from (known[job.key] for job in jobs if job.key in known)
    missing = [job for job in jobs if job.key not in known]
    if not missing:
        return
    path.parent.mkdir(parents=True, exist_ok=True)
    # Spawned, not forked: the limit on threads must stand before NumPy is imported.
    pool = ProcessPoolExecutor(processes, mp_context=get_context("spawn"))
    try:
        with path.open("a+", encoding="utf-8") as file:
            _end_line(path, file)
            for run in pool.map(track, missing):
                file.write(json.dumps(asdict(run)) + "\n")
                file.flush()
                yield run
    finally:
        pool.shutdown(cancel_futures=True)


def _end_line(path: Path, file: Any) -> None:
    """Cut off the part of a line that an interrupted run left."""
    content = path.read_bytes()
    file.truncate(content.rfind(b"\n") + 1)


def track(job: Job) -> Run:
    """Do one job. Raises AcpLabError for a part that is not prepared; a start that is refused is a lost run."""
    from acp_lab.bench.runner import follow
    from acp_lab.errors import TrackingError
    from acp_lab.geometry.pose import disturb_pose
    from acp_lab.sequences.frame import Frame
    from acp_lab.tracking.tracker import Tracker

    scene, frames, visible, kind = _opened(job.root, job.scene_id, job.object_id)
    model, metric = _prepared(job.root, job.parts, job.object_id)
    ordered = dropwhile(
        lambda frame: not isinstance(frame, Frame) or not visible.get(frame.index), frames[ORDERS[job.order]]
    )
    first, *others = ordered
    degrees, mm = STARTS[job.start]
    rng = np.random.default_rng([job.seed, job.scene_id, job.object_id])
    start = disturb_pose(scene.truth(first.index, job.object_id), model.part.box_centre, degrees, mm, rng)
    errors: list[float | None] = [None] * len(others)
    ms: list[float | None] = [None] * len(others)

    def truth(frame_id: int) -> Any:
        return scene.truth(frame_id, job.object_id)

    try:
        steps = follow(Tracker(model, job.method), [first, *others], start, truth, metric.share)
        for k, step in enumerate(islice(steps, 1, None)):
            ms[k] = round(step.ms, 3)
            cam_T_true = truth(step.frame_id)
            error = math.inf if cam_T_true is None else metric.share(step.cam_T_obj, cam_T_true)
            errors[k] = round(error, 5) if math.isfinite(error) else None
    except TrackingError:
        pass  # the errors stay None: lost
    name, state, sequence, order, start_name, seed = job.key
    part, ids = part_name(job.root, job.object_id), [frame.index for frame in others]
    counts = [visible.get(frame_id, False) for frame_id in ids]
    return Run(name, state, sequence, order, start_name, seed, part, kind, ids, errors, counts, ms)


@lru_cache(maxsize=1)
def _opened(root: Path, scene_id: int, object_id: int) -> tuple[Any, list[Any], dict[int, bool], str]:
    """Scene, decoded frames, whether a frame with truth counts, by its id, and the kind of motion where it is told."""
    from acp_lab.sequences.bop import BopDataset

    scene = BopDataset(root).open_scene(scene_id)
    meta = scene.folder / "scene_meta.json"
    kind = json.loads(meta.read_text(encoding="utf-8")).get("kind", "") if meta.exists() else ""
    frames = list(scene.frames())
    known = [frame_id for frame_id in scene.frame_ids if scene.truth(frame_id, object_id) is not None]
    return scene, frames, visible_frames(scene.folder, object_id, known), kind


@lru_cache(maxsize=1)
def _prepared(root: Path, parts: Path, object_id: int) -> tuple[Any, Any]:
    from acp_lab.evaluation import PartMetric
    from acp_lab.prepared_part import PreparedPart
    from acp_lab.sequences.bop import BopDataset

    mesh = BopDataset(root).part_path(object_id)
    model = PreparedPart.load(parts / mesh.stem, mesh)
    return model, PartMetric(model.part)


def prepared_part_of(scene: BopScene, parts: Path) -> PreparedPart:
    """The first object of a scene; parts: folder of prepared parts, or one folder of them per data set."""
    from acp_lab.prepared_part import PreparedPart

    mesh = scene.dataset.part_path(scene.object_ids[0])
    folder = parts / scene.dataset.name
    return PreparedPart.load((folder if folder.is_dir() else parts) / mesh.stem, mesh)


def readable_frames(sequence: Sequence, most: int | None = None) -> list[Frame]:
    """Those of a sequence's frames, or of its first `most`, whose images can be read."""
    from acp_lab.sequences.frame import Frame

    return [frame for frame in sequence.frames(most) if isinstance(frame, Frame)]


def visible_frames(folder: Path, object_id: int, frame_ids: Iterable[int]) -> dict[int, bool]:
    """By frame id: whether enough of the object is visible; True where scene_gt_info.json does not tell."""
    shares = visible_shares(folder, object_id)
    return {frame_id: shares.get(frame_id, 1.0) >= VISIBLE for frame_id in frame_ids}


def visible_shares(folder: Path, object_id: int) -> dict[int, float]:
    """By frame id: the visible share of the object, where scene_gt_info.json tells."""
    shares: dict[int, float] = {}
    if (folder / "scene_gt_info.json").exists():
        seen = json.loads((folder / "scene_gt_info.json").read_text(encoding="utf-8"))
        for frame_id, shown in json.loads((folder / "scene_gt.json").read_text(encoding="utf-8")).items():
            for entry, info in zip(shown, seen.get(frame_id, ()), strict=False):
                if entry["obj_id"] == object_id:
                    shares[int(frame_id)] = info["visib_fract"]
    return shares
