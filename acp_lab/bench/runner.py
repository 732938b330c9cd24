"""One run: a tracker through the frames of one object, timed and scored. The same here and in a process far away."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from acp_lab.bench.protocol import SequenceKey, Task, dataset_name
from acp_lab.bench.rapid import environment
from acp_lab.bench.rapid.tracker import RapidTracker
from acp_lab.bench.record import Run
from acp_lab.cad.part import Part
from acp_lab.errors import AcpLabError, GeometryError, PreparationError, SequenceError, TrackingError
from acp_lab.evaluation.metrics import LOST_SHARE, pose_error
from acp_lab.evaluation.part_metric import PartMetric
from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.pose import disturb_pose
from acp_lab.input_file import read_json_object
from acp_lab.machine import cpu_model, peak_memory_mb
from acp_lab.prepared_part import PreparedPart, part_folder
from acp_lab.sequences.bop import BopDataset, BopScene, image_files
from acp_lab.sequences.frame import Frame, UnreadableFrame
from acp_lab.sequences.scene_truth import instance_truths
from acp_lab.tracking.method import Method
from acp_lab.tracking.observer import Observer
from acp_lab.tracking.session import PartTracker, follow_sequence
from acp_lab.tracking.sources.rigid import CadSamples
from acp_lab.tracking.tracker import Tracker

DECODED_MB = 256.0
"""Of decoded images that a process keeps: scenes of some hundred frames are decoded once, longer ones in each run."""
AnyFrame = Frame | UnreadableFrame
Truth = Callable[[int], FloatArray | None]
Error = Callable[[FloatArray, FloatArray], float]


@dataclass(frozen=True, eq=False)
class Step:
    """A tracked frame, without its image: a run of any length needs little memory.

    Attributes:
        frame_id: of the image; cam_T_obj: (4, 4) as tracked; quality: the tracker's own, in [0, 1].
        ms: CPU milliseconds of one thread; reset: whether the part was started again in it.
    """

    frame_id: int
    cam_T_obj: FloatArray
    quality: float
    ms: float
    reset: bool


def follow(
    tracker: PartTracker,
    frames: Iterable[AnyFrame],
    start: FloatArray,
    truth: Truth,
    error: Error,
    resets: bool = False,
) -> Iterator[Step]:
    """Track frame after frame from a start pose (4, 4); the first frame is the first step.

    truth: the true pose of an image id, None where unknown; only resets ask for it. error: ADD(-S) of a pose against
    the truth, as a share of the diameter. With resets a lost part is started again from the truth of that frame.

    Raises:
        SequenceError: there is no frame, or the first cannot be read.
        TrackingError, GeometryError: the start is refused.
    """
    number = -1
    for number, frame in enumerate(frames):
        begin_s = time.thread_time()
        if number == 0:
            if not isinstance(frame, Frame):
                raise SequenceError(f"{frame.reason}: the first frame must be readable, tracking starts there")
            result = tracker.start(frame, start)
        else:
            result = tracker.track(frame)
        # The work of a tracker in another process is not in this one's time: it tells.
        ms = 1e3 * (time.thread_time() - begin_s) + float(getattr(tracker, "ms", 0.0))
        again = number > 0 and resets and _start_again(tracker, frame, result.cam_T_obj, truth(frame.index), error)
        yield Step(frame.index, result.cam_T_obj, result.quality, ms, again)
    if number < 0:
        raise SequenceError("there is no frame to track: give a scene with images")


def _start_again(
    tracker: PartTracker, frame: AnyFrame, cam_T_obj: FloatArray, cam_T_true: FloatArray | None, error: Error
) -> bool:
    if cam_T_true is None or not isinstance(frame, Frame) or error(cam_T_obj, cam_T_true) <= LOST_SHARE:
        return False
    try:
        tracker.start(frame, cam_T_true)
    except TrackingError:  # hardly to be seen there: the next frame may do
        return False
    return True


def sequences_of(root: Path, split: str) -> list[SequenceKey]:
    """Every instance of every object that the first frame of a scene of a data set shows.

    Raises InputFileError for a data set without truth.
    """
    dataset = BopDataset(root)
    found = []
    for scene_id in dataset.scenes(split):
        folder = dataset.scene_folder(scene_id, split)
        first = next(iter(image_files(folder)))
        for object_id, instances in instance_truths(folder / "scene_gt.json").items():
            found += [
                SequenceKey(dataset_name(root), scene_id, object_id, instance)
                for instance, truth in enumerate(instances)
                if truth.pose(first, object_id) is not None
            ]
    return found


def run_task(text: str) -> str:
    """Do the task of a JSON text; the run as JSON. What a worker process is asked for.

    Raises AcpLabError for data or parts that are missing.
    """
    return run(Task.from_json(text)).to_json()


def run(task: Task) -> Run:
    """Do one task. A start that is refused, also for a view region that its part is not prepared for, is a run without
    poses, whose note says why.

    Raises AcpLabError for data or parts that are missing.
    """
    cv2.setNumThreads(1)
    state = task.state  # of what is read now, whatever happens to the files meanwhile
    opened = _opened_of(task)
    part, metric = _measured_of(task)
    tracker = tracker_of(task)
    frame_ids = opened.scene.frame_ids[:: task.variant.step]
    steps, note = list[Step](), ""
    try:
        frames = map(opened.frame, frame_ids)
        for step in follow(tracker, frames, start_pose(task, opened.scene, part), opened.truth, metric.share,
                           task.variant.resets):  # fmt: skip
            steps.append(step)
    except (TrackingError, GeometryError, PreparationError) as error:
        note = str(error)
    return _as_run(task, state, opened, part, metric, frame_ids, steps, note)


def tracker_of(task: Task) -> PartTracker:
    """The tracker of a task; PreparationError where its part, or cv2.rapid, is not prepared."""
    if not task.method:
        return RapidTracker(_measured_of(task)[0], task.method_name)
    return Tracker(_prepared_of(task), task.settings())


def start_pose(task: Task, scene: BopScene, part: Part) -> FloatArray:
    """The true pose (4, 4) of the first frame, disturbed as the task's variant says."""
    how, scene_id = task.variant, scene.scene_id
    key = [how.seed, scene_id, task.object_id] + ([task.instance] if task.instance else [])
    rng = np.random.default_rng(key)
    pose = scene.first_poses[task.object_id]
    return disturb_pose(pose, part.box_centre, how.noise_deg, how.noise_mm, rng)


def _prepare_s(task: Task) -> float:
    """CPU seconds of preparing what the task's method needs of its part; NaN where they are not known."""
    if not task.method:
        return 0.0
    spent = _prepared_of(task).cpu_s
    return sum(spent.get(stage, math.nan) for stage in stages_of(task.settings()))


def stages_of(method: Method) -> tuple[str, ...]:
    """The stages of preparation that a method needs, by their names in `PreparedPart.cpu_s`."""
    if isinstance(method.source, CadSamples):
        return ("edges", "templates") + (() if method.source.generator == "templates" else ("networks", "views"))
    return "edges", "control points", "auto-encoder"


def watch(task: Task, observers: Iterable[Observer]) -> None:
    """Do a task without resets once more, for those who look on, such as a replay."""
    opened = _opened_of(task)
    start = start_pose(task, opened.scene, _measured_of(task)[0])
    scene, trackers = _EveryFew(opened.scene, task.variant.step), {task.object_id: tracker_of(task)}
    follow_sequence(trackers, scene, {task.object_id: start}, observers)


def true_pose(folder: Path, sequence: SequenceKey, frame_id: int) -> FloatArray | None:
    """The true pose (4, 4) of a sequence's instance in an image of its scene folder, None where it is not told."""
    truths = instance_truths(folder / "scene_gt.json").get(sequence.object_id, ())
    return truths[sequence.instance].pose(frame_id, sequence.object_id) if sequence.instance < len(truths) else None


def kind_of(folder: Path) -> str:
    """The kind of motion that a scene's scene_meta.json tells, "" without."""
    path = folder / "scene_meta.json"
    return str(read_json_object(path, "remove it").get("kind", "")) if path.exists() else ""


@dataclass(frozen=True, eq=False)
class _Opened:
    """A scene; its first frames stay decoded for the next run, up to `DECODED_MB`, the others are read each time."""

    scene: BopScene
    object_id: int
    kind: str
    decoded: dict[int, AnyFrame] = field(default_factory=dict)

    def frame(self, frame_id: int) -> AnyFrame:
        frame = self.decoded.get(frame_id) or self.scene.frame(frame_id)
        camera = self.scene.camera(frame_id)
        if (len(self.decoded) + 1) * 3 * camera.width * camera.height <= DECODED_MB * 1e6:
            self.decoded[frame_id] = frame
        return frame

    def truth(self, frame_id: int) -> FloatArray | None:
        return self.scene.truth(frame_id, self.object_id)


class _EveryFew:
    """A scene of which every step-th frame is there."""

    def __init__(self, scene: BopScene, step: int) -> None:
        self._scene, self._step = scene, step
        self.frame_ids = scene.frame_ids[::step]

    def __getattr__(self, name: str) -> Any:
        return getattr(self._scene, name)

    def frames(self, max_frames: int | None = None) -> Iterator[AnyFrame]:
        return (self._scene.frame(frame_id) for frame_id in self.frame_ids[:max_frames])


def _opened_of(task: Task) -> _Opened:
    return _opened(task.dataset, task.split, task.scene_id, task.object_id, task.instance, task.scene_look)


@lru_cache(maxsize=1)
def _opened(dataset: str, split: str, scene_id: int, object_id: int, instance: int, look: str) -> _Opened:
    """The scene of all runs that follow each other on a sequence. look: of its files; others are another scene."""
    folder = BopDataset(dataset).scene_folder(scene_id, split)
    truths = instance_truths(folder / "scene_gt.json").get(object_id, ())
    if instance >= len(truths):
        raise SequenceError(f"{folder}: no instance {instance} of object {object_id}: it shows {len(truths)}")
    scene = BopScene(folder, truths[instance])
    return _Opened(scene, object_id, kind_of(folder))


def _prepared_of(task: Task) -> PreparedPart:
    return _prepared(task.dataset, task.parts, task.object_id, task.part_header, task.model_look)


@lru_cache(maxsize=1)
def _prepared(dataset: str, parts: str, object_id: int, header: str, look: str) -> PreparedPart:
    """header: of the part, look: of its model's files; others are another part, in processes that live long, too."""
    mesh = BopDataset(dataset).part_path(object_id)
    return PreparedPart.load(part_folder(Path(parts), mesh.stem, mesh), mesh)


def _measured_of(task: Task) -> tuple[Part, PartMetric]:
    return _measured(task.dataset, task.object_id, task.model_look)


@lru_cache(maxsize=1)
def _measured(dataset: str, object_id: int, look: str) -> tuple[Part, PartMetric]:
    """look: of the model's files; others are another part."""
    part = BopDataset(dataset).part(object_id)
    return part, PartMetric(part)


def check(task: Task) -> None:
    """Raise AcpLabError where the task's part lacks what its method needs, before anything is run."""
    if not task.method:
        environment.python()
        return
    model = _prepared_of(task)
    try:
        task.settings().open_source(model)
    except AcpLabError as error:
        raise type(error)(f"method {task.method_name}: {error}") from None


def _as_run(
    task: Task, state: str, opened: _Opened, part: Part, metric: PartMetric, frame_ids: tuple[int, ...],
    steps: list[Step], note: str,
) -> Run:  # fmt: skip
    by_id = {step.frame_id: step for step in steps}
    scored = [frame_id for frame_id in frame_ids[1:] if opened.truth(frame_id) is not None]
    count = len(scored)
    errors, poses = np.full((3, count), math.inf), np.full((count, 3, 4), math.nan)
    ms, scores = np.full(count, math.nan), np.zeros(count)
    for row, frame_id in enumerate(scored):
        step, cam_T_true = by_id.get(frame_id), opened.truth(frame_id)
        if step is None or cam_T_true is None:
            continue
        pose = step.cam_T_obj
        apart = pose_error(pose, cam_T_true, part.symmetries)
        errors[:, row] = metric.share(pose, cam_T_true), apart.rotation_deg, apart.translation_mm
        poses[row], ms[row], scores[row] = pose[:3], step.ms, step.quality
    camera = opened.scene.camera(opened.scene.frame_ids[0])
    resets = tuple(step.frame_id for step in steps if step.reset)
    size, memory_mb = (camera.width, camera.height), peak_memory_mb() or math.nan
    return Run(
        task.method_name, state, task.sequence, task.variant, opened.kind, metric.name, tuple(scored), errors[0],
        errors[1], errors[2], ms, scores, poses, resets, size, 1, memory_mb, _prepare_s(task), cpu_model(), note,
    )  # fmt: skip
