"""`acp-lab track`: from options to scenes, prepared parts and start poses, then through the frame loop.

All errors in the input are found before the first file is written, so that a mistake costs no older results.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from acp_lab.commands import console
from acp_lab.errors import AcpLabError, InputFileError, SequenceError, TrackingError
from acp_lab.files import check_replaces_own

if TYPE_CHECKING:
    from acp_lab.geometry.arrays import FloatArray
    from acp_lab.prepared_part import PreparedPart
    from acp_lab.sequences.bop import BopDataset, BopScene
    from acp_lab.sequences.protocol import Sequence
    from acp_lab.sequences.results_csv import ResultRow

DEFAULT_METHOD = "acp"
_MOST_NOISE_MM = 1e4
"""From that far off no part is found; beyond it a mistake."""


@dataclass(frozen=True)
class TrackOptions:
    """What to track, from where and how: the one argument of `acp-lab track`.

    Empty `scenes` and `objects` mean all; `init` None means truth, `method` None the default one, `first_frame` None
    the first image, or the first one for which `init` tells start poses.

    Raises:
        AcpLabError: options that contradict each other, or files that cannot be written.
    """

    parts: Path
    out: Path
    dataset: Path | None = None
    video: Path | None = None
    mesh: Path | None = None
    camera: Path | None = None
    split: str = "test"
    scenes: tuple[int, ...] = ()
    objects: tuple[int, ...] = ()
    method: str | None = None
    config: Path | None = None
    init: str | None = None
    noise_deg: float = 0.0
    noise_mm: float = 0.0
    seed: int = 0
    replay: Path | None = None
    replay_iterations: Literal["off", "failures", "all"] = "off"
    replay_max_mb: float | None = None
    threads: int = 1
    max_frames: int | None = None
    resume: bool = False
    first_frame: int | None = None

    def __post_init__(self) -> None:
        if self.config is not None and self.method is not None:
            raise AcpLabError(f"--config {self.config}: says the method already: leave --method {self.method} out")
        from acp_lab.tracking.method import method_named

        method_named(self.method_name)
        if self.init == "":
            raise AcpLabError("--init: is empty: give a file, gt or auto")
        for option, value in (("--init-noise-deg", self.noise_deg), ("--init-noise-mm", self.noise_mm)):
            if not math.isfinite(value):
                raise AcpLabError(f"{option} {value}: give a finite number")
        if self.noise_mm > _MOST_NOISE_MM:
            raise AcpLabError(f"--init-noise-mm {self.noise_mm:g}: give at most {_MOST_NOISE_MM:g} mm")
        if self.noise_deg > 180.0:
            raise AcpLabError(f"--init-noise-deg {self.noise_deg:g}: give at most 180 degrees")
        if self.first_frame is not None and self.init in (None, "gt"):
            raise AcpLabError(f"--first-frame {self.first_frame}: needs its start pose: give --init a file, or auto")
        if self.replay is None and self.replay_iterations != "off":
            raise AcpLabError(f"--replay-iterations {self.replay_iterations}: only goes with --replay: leave it out")
        if self.replay_max_mb is not None:
            if self.replay is None:
                raise AcpLabError(f"--replay-max-mb {self.replay_max_mb:g}: only goes with --replay: leave it out")
            if not math.isfinite(self.replay_max_mb):
                raise AcpLabError(f"--replay-max-mb {self.replay_max_mb}: give a finite number")
        if self.dataset is not None and self.video is not None:
            raise AcpLabError(f"--video {self.video}: track a data set or a video, not both")
        if self.dataset is None and self.video is None:
            raise AcpLabError("nothing to track: give a data set, or --video with --mesh, --camera and --init")
        if self.video is None:
            why = "only goes with a video or a folder of images, given as --video"
            self._refuse(why, mesh=self.mesh, camera=self.camera)
            if Path(self.init or "").suffix.lower() == ".json":
                raise AcpLabError(
                    f"--init {self.init}: a POSE.json only goes with --video: for a data set give a results file, or "
                    "--init auto"
                )
        else:
            self._check_video(self.video)
        self._check_outputs()
        if self.replay is not None and self.replay.suffix.lower() != ".rrd":
            raise InputFileError(
                f"{self.replay}: --replay writes .rrd only: name it {self.replay.with_suffix('.rrd').name} (a film is "
                "made of it by acp-lab replay --mp4)"
            )

    @property
    def method_name(self) -> str:
        """The method's, also where none is named."""
        return DEFAULT_METHOD if self.method is None else self.method

    def _check_video(self, video: Path) -> None:
        for option, value in (("--mesh", self.mesh), ("--camera", self.camera), ("--init", self.init)):
            if value is None:
                raise AcpLabError(f"--video {video}: needs {option} too: give --mesh, --camera and --init")
        if self.init == "gt":
            raise AcpLabError(f"--init gt: {video} has no truth: give the start pose as POSE.json")
        for scene in self.scenes:
            if scene != 1:
                raise SequenceError(f"--scene {scene}: a video is scene 1")
        for object_id in self.objects:
            if object_id != 1:
                raise SequenceError(f"--object {object_id}: a video shows object 1")

    def _refuse(self, why: str, **paths: Path | None) -> None:
        for name, path in paths.items():
            if path is not None:
                raise AcpLabError(f"--{name} {path}: {why}: leave it out")

    def _check_outputs(self) -> None:
        from acp_lab.locks import check_no_writer
        from acp_lab.sequences.results_csv import check_results_place, run_info_path

        inputs = [Path(self.init)] if self.init not in (None, "gt", "auto") else []
        inputs += [path for path in (self.video, self.mesh, self.camera, self.config) if path is not None]
        outputs = [("--out", self.out)] + ([("--replay", self.replay)] if self.replay is not None else [])
        for option, path in outputs:
            if path.is_dir():
                raise InputFileError(f"{path}: is a folder: {option} needs a file name")
            if any(path.resolve() == other.resolve() for other in inputs):
                raise InputFileError(f"{path}: {option} would overwrite an input: choose another file")
            if not _is_writable(path):
                raise InputFileError(f"{path}: {option} cannot be written there: choose another place")
        info = run_info_path(self.out)
        if any(info.resolve() == other.resolve() for other in inputs):
            raise InputFileError(f"{info}: the run information of --out would overwrite an input: choose another name")
        written = {self.out.resolve(), info.resolve()}
        if self.replay is not None and self.replay.resolve() in written:
            raise InputFileError(f"{self.replay}: --replay and --out are the same file: choose two")
        if self.resume and self.replay is not None and self.replay.exists():
            raise InputFileError(
                f"{self.replay}: holds the frames before, and --resume would replace it: give --replay another name"
            )
        check_results_place(self.out, "--out")
        if self.replay is not None:
            check_replaces_own(self.replay, b"RRF", "--replay", "a replay")
            # Both before one of them is replaced.
            check_no_writer(self.out, "the results")
            check_no_writer(self.replay, "the replay")


def _is_writable(path: Path) -> bool:
    """Whether a file can be made, or replaced, at a path whose folders may have to be made first."""
    if path.exists():
        return os.access(path, os.W_OK)
    above = next(folder for folder in path.absolute().parents if folder.exists())
    return above.is_dir() and os.access(above, os.W_OK)


@dataclass(frozen=True)
class SceneJob:
    """One scene, and the parts to track in it with their start poses (4, 4), by object id.

    tracked_before: frames that an earlier run of the same job has done, which count among --max-frames.
    found: the objects whose start pose was found in the first image, not given.
    """

    sequence: Sequence
    models: Mapping[int, PreparedPart]
    starts: Mapping[int, FloatArray]
    tracked_before: int = 0
    found: frozenset[int] = frozenset()


@dataclass
class PartShelf:
    """Prepared parts, each loaded once however many scenes show it."""

    folder: Path
    _loaded: dict[Path, PreparedPart] = field(default_factory=dict)

    def part(self, mesh: Path) -> PreparedPart:
        """The prepared part of a mesh; PreparationError, naming the command to run, when there is none."""
        from acp_lab.prepared_part import PreparedPart, part_folder

        if mesh not in self._loaded:
            if not mesh.is_file():
                raise InputFileError(f"{mesh}: no such mesh file: check the path")
            loaded = PreparedPart.load(part_folder(self.folder, mesh.stem, mesh), mesh)
            if loaded.lacks:
                console.warn_on_success(
                    f"{loaded.folder}: lacks {loaded.lacks}, as after an interrupted prepare; {loaded.mend_command}"
                )
            self._loaded[mesh] = loaded
        return self._loaded[mesh]


def scene_jobs(options: TrackOptions) -> tuple[SceneJob, ...]:
    """Everything that the options name, opened and checked; errors name the file at fault."""
    shelf = PartShelf(options.parts)
    if options.video is not None:
        return (_video_job(options, options.video, shelf),)
    from acp_lab.sequences.bop import BopDataset

    assert options.dataset is not None
    dataset = BopDataset(options.dataset)
    ids = dict.fromkeys(options.scenes or dataset.scenes(options.split))
    asked = options.objects or None
    scenes = [dataset.open_scene(scene_id, options.split, asked) for scene_id in ids]
    if options.init == "auto":
        return _found_jobs(options, dataset, scenes, shelf)
    sequences = [_from_first_start(options, scene) for scene in scenes]
    starts = [_start_poses(options, sequence) for sequence in sequences]
    jobs = []
    for scene, sequence, (poses, found) in zip(scenes, sequences, starts, strict=True):
        chosen = _chosen(options.objects, poses)
        if chosen:
            job = _job(options, sequence, _meshes(dataset, chosen, shelf), chosen, shelf)
            job = replace(job, found=found & chosen.keys())
            _check_in_sight(scene, job, options)
            jobs.append(job)
    _check_all_found(options.objects, [poses for poses, _ in starts])
    return tuple(jobs)


def _from_first_start(options: TrackOptions, sequence: Sequence) -> Sequence:
    """The sequence from --first-frame on, or from the first image for which --init tells start poses."""
    from acp_lab.sequences import first_start
    from acp_lab.sequences.rest import RestOfSequence

    first, init = options.first_frame, Path(options.init or "")
    if first is None:
        tells_images = options.init not in (None, "gt", "auto") and (not options.video or init.suffix.lower() == ".csv")
        if not tells_images or not sequence.frame_ids:  # a live camera announces none: from its first on
            return sequence
        start = first_start(init, sequence.scene_id, sequence.frame_ids, (1,) if options.video else options.objects)
        first = start.frame_id
        if start.later:
            others = ", ".join(map(str, start.later))
            console.warn_on_success(
                f"scene {sequence.scene_id}: starts in image {first}; object {others} is not tracked: {init} has start "
                "poses of it in later images only: track it on its own with --object"
            )
        if first == sequence.frame_ids[0]:
            return sequence
        console.note(f"scene {sequence.scene_id}: starts in image {first}, the first with start poses in {init}")
    return RestOfSequence(sequence, first)


def _video_job(options: TrackOptions, video: Path, shelf: PartShelf) -> SceneJob:
    from acp_lab.geometry.camera import Camera
    from acp_lab.sequences import open_images, read_pose, start_rows
    from acp_lab.sequences.json_file import was_found

    assert options.mesh is not None
    assert options.camera is not None
    assert options.init is not None
    images = open_images(video, Camera.from_json(options.camera))
    if options.init == "auto":
        jobs, lacks = _job_found(options, images, {1: options.mesh}, shelf)
        if not jobs:
            raise SequenceError(lacks)
        return jobs[0]
    sequence = _from_first_start(options, images)
    init = Path(options.init)
    if init.suffix.lower() == ".csv":
        first = next(iter(sequence.frame_ids), 0)
        rows = start_rows(init, sequence.scene_id, first)
        if 1 not in rows:
            raise SequenceError(f"{init}: no row for scene 1, image {first}, object 1: a video shows object 1")
        _warn_of_doubtful(options, [rows[1]])
        job = _job(options, sequence, {1: options.mesh}, {1: rows[1].cam_T_obj}, shelf)
        return replace(job, found=_estimated(rows))
    job = _job(options, sequence, {1: options.mesh}, {1: read_pose(init)}, shelf)
    return replace(job, found=frozenset({1} if was_found(init) else ()))


def _found_jobs(
    options: TrackOptions, dataset: BopDataset, scenes: list[BopScene], shelf: PartShelf
) -> tuple[SceneJob, ...]:
    """Jobs whose start poses are found in the images; of their truth only the ids of the objects are asked for."""
    from acp_lab.commands.auto_start import FRAMES_TO_TRY

    wanted = dict[int, tuple[int, ...]]()
    for scene in scenes:
        looked_at = _from_first_start(options, scene).frame_ids[:FRAMES_TO_TRY]
        wanted[scene.scene_id] = scene.objects_in(looked_at) or tuple(dataset.models())
        if not wanted[scene.scene_id]:
            raise InputFileError(
                f"{dataset.root / 'models'}: holds no mesh, and the first frames of {scene.folder} have no truth that "
                "names objects: nothing to look for: put the meshes there, as obj_000001.ply"
            )
    known = sorted({object_id for ids in wanted.values() for object_id in ids})
    for object_id in options.objects:
        if object_id not in known:
            raise SequenceError(
                f"--object {object_id}: no truth of the images that --init auto looks at names it, the first "
                f"{FRAMES_TO_TRY} of each scene: there are {', '.join(map(str, known))}"
            )
    jobs, lacks = list[SceneJob](), list[str]()
    for scene in scenes:
        chosen = [i for i in wanted[scene.scene_id] if not options.objects or i in options.objects]
        found, of_scene = _job_found(options, scene, _meshes(dataset, chosen, shelf), shelf)
        jobs += found
        lacks += [of_scene] if of_scene else []
    is_asked = any(all(object_id not in job.starts for job in jobs) for object_id in options.objects)
    if lacks and (not jobs or is_asked):
        raise SequenceError(lacks[0])
    for of_scene in lacks:  # the others are no worse for it
        console.warn_on_success(f"{of_scene}; it is left out")
    return tuple(jobs)


def _job_found(
    options: TrackOptions, sequence: Sequence, meshes: Mapping[int, Path], shelf: PartShelf
) -> tuple[list[SceneJob], str]:
    """Jobs for the objects that are found, and a line on those that are not."""
    from acp_lab.commands.auto_start import find_starts
    from acp_lab.sequences.rest import RestOfSequence

    models = {object_id: shelf.part(mesh) for object_id, mesh in meshes.items()}
    sequence = _from_first_start(options, sequence)
    starts, lacks = find_starts(sequence, models)
    jobs = [
        _job(options, RestOfSequence(sequence, start.frame_id), {i: meshes[i] for i in start.poses}, start.poses, shelf)
        for start in starts
    ]
    return [replace(job, found=frozenset(job.starts)) for job in jobs], lacks


def _start_poses(options: TrackOptions, scene: Sequence) -> tuple[Mapping[int, FloatArray], frozenset[int]]:
    """Start poses in a scene's first frame: its truth alone, never a later one's, or rows of a file; and the objects
    whose pose was found in that image, as a row's score says.
    """
    if options.init in (None, "gt"):
        return scene.first_poses, frozenset()
    from acp_lab.sequences import start_rows

    starts = start_rows(str(options.init), scene.scene_id, scene.frame_ids[0])
    for object_id in scene.object_ids:  # of the truth in the first frame, where there is any
        if object_id not in starts and (not options.objects or object_id in options.objects):
            raise SequenceError(
                f"{options.init}: no row for scene {scene.scene_id}, image {scene.frame_ids[0]}, object {object_id}: "
                "add its start pose, or choose others with --object"
            )
    _warn_of_doubtful(options, [row for i, row in starts.items() if not options.objects or i in options.objects])
    return {object_id: row.cam_T_obj for object_id, row in starts.items()}, _estimated(starts)


def _estimated(starts: Mapping[int, ResultRow]) -> frozenset[int]:
    """The objects whose start poses are estimates: a detector or a tracker is never quite sure, as whoever knows is."""
    return frozenset(object_id for object_id, row in starts.items() if 0.0 <= row.score < 1.0)


def _warn_of_doubtful(options: TrackOptions, starts: Iterable[ResultRow]) -> None:
    """Of start poses that acp-lab detect, if it wrote them, does not call found; below 0 is no score."""
    from acp_lab.tracking.find import ACCEPTED

    for row in starts:
        if 0.0 <= row.score < ACCEPTED:
            console.warn_on_success(
                f"{options.init}: scene {row.scene_id}, image {row.im_id}, object {row.obj_id}: its start pose has a "
                f"score of {row.score:.2f}; acp-lab detect calls a part found from {ACCEPTED:g} on: look whether it is "
                "there"
            )


def start_source(job: SceneJob, options: TrackOptions) -> str:
    """Where the start poses of a scene come from, for an error about one of them."""
    from acp_lab.sequences.bop import BopScene

    if options.init == "auto":
        return f"--init auto: scene {job.sequence.scene_id}"
    if options.init not in (None, "gt"):
        scene = f": scene {job.sequence.scene_id}, image {job.sequence.frame_ids[0]}" if options.video is None else ""
        return f"{options.init}{scene}"
    if isinstance(job.sequence, BopScene):
        return f"{job.sequence.folder / 'scene_gt.json'}: image {job.sequence.frame_ids[0]}"
    return str(options.out)  # --resume goes on from its last row


def _check_in_sight(scene: BopScene, job: SceneJob, options: TrackOptions) -> None:
    """TrackingError for a start pose from which the part cannot be seen: else earlier scenes were tracked in vain."""
    from acp_lab.cad.part import box_corners
    from acp_lab.tracking.frame_view import LEAST_PART_PX, crop_box

    camera = scene.camera(job.sequence.frame_ids[0])
    for object_id, pose in job.starts.items():
        part = job.models[object_id].part
        if crop_box(box_corners(part), pose, camera, 0.0) is None:
            raise TrackingError(
                f"{start_source(job, options)}: {part.name}: at the start pose t = {pose[:3, 3].round(1).tolist()} mm "
                f"the part is behind the camera, outside the image or smaller than {LEAST_PART_PX} px in it; "
                "check pose, unit and camera"
            )


def _chosen(objects: tuple[int, ...], starts: Mapping[int, FloatArray]) -> dict[int, FloatArray]:
    return {i: pose for i, pose in sorted(starts.items()) if not objects or i in objects}


def _check_all_found(objects: tuple[int, ...], starts: Iterable[Iterable[int]]) -> None:
    known = sorted({object_id for poses in starts for object_id in poses})
    for object_id in objects:
        if object_id not in known:
            shown = ", ".join(map(str, known))
            raise SequenceError(f"--object {object_id}: no start pose for it in any first frame: there are {shown}")


def _meshes(dataset: BopDataset, objects: Iterable[int], shelf: PartShelf) -> dict[int, Path]:
    """By object id; PartError where models_info.json tells another diameter than the prepared part has."""
    from acp_lab.cad.part import check_against_info

    meshes = {object_id: dataset.part_path(object_id) for object_id in objects}
    if (dataset.root / "models" / "models_info.json").exists():  # without it parts are tracked, but not scored
        for object_id, mesh in meshes.items():
            with suppress(SequenceError):  # it leaves this one out
                check_against_info(shelf.part(mesh).part.diameter, dataset.part_info(object_id), mesh)
    return meshes


def _job(
    options: TrackOptions,
    sequence: Sequence,
    meshes: Mapping[int, Path],
    starts: Mapping[int, FloatArray],
    shelf: PartShelf,
) -> SceneJob:
    import numpy as np

    from acp_lab.geometry.pose import disturb_pose

    models = {object_id: shelf.part(mesh) for object_id, mesh in meshes.items()}
    if options.noise_deg or options.noise_mm:
        starts = {
            object_id: disturb_pose(
                pose,
                models[object_id].part.box_centre,
                options.noise_deg,
                options.noise_mm,
                np.random.default_rng([options.seed, sequence.scene_id, object_id]),
            )
            for object_id, pose in starts.items()
        }
    return SceneJob(sequence, models, starts)
