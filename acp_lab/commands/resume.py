"""`acp-lab track --resume`: go on after the rows that a stopped run left, if everything it read is the same.

Rows stand in the order of tracking, so a file that was cut off is a whole run up to some frame. The tracker starts
anew in the last frame in which no object was lost, from the poses of its rows: that of a lost part is no start. What it
had learnt of the part's look is not kept.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import groupby
from pathlib import Path
from typing import Any

from acp_lab.commands.track import SceneJob
from acp_lab.errors import InputFileError, SequenceError
from acp_lab.geometry.arrays import FloatArray
from acp_lab.input_file import read_json_object
from acp_lab.prepared_part import part_folder
from acp_lab.prepared_part.integrity import checksum, checksum_for_poses, checksum_of_values
from acp_lab.sequences.images import VideoFile
from acp_lab.sequences.pixel_coding import PixelCoding
from acp_lab.sequences.protocol import Sequence as Frames
from acp_lab.sequences.rest import RestOfSequence
from acp_lab.sequences.results_csv import KeptRows, ResultRow, rows_with_ends, run_info_path
from acp_lab.tracking.result import TrackState
from acp_lab.tracking.states import StateConfig, StateMachine

ANEW = "give --out another name, or run without --resume, which replaces these rows"
_WHETHER_FOUND = "whether it was found"
"""End of the names that the runs of earlier versions do not tell."""


@dataclass(frozen=True)
class Resumption:
    """Where to go on.

    Attributes:
        file: what is kept of the results file; what stands behind it is tracked again.
        done: ids of the scenes that are complete.
        scene_id, im_id: the image whose rows are the last ones kept, of the scene that is not; None between scenes.
        starts: (4, 4) cam_T_obj by object id in that image.
        again: how many whole frames stand behind it and are tracked again, as an object was lost or not seen in each.
        rows: those that are kept. info: what results.run.json said of the run that made them.
    """

    file: KeptRows
    done: frozenset[int]
    scene_id: int | None = None
    im_id: int | None = None
    starts: Mapping[int, FloatArray] | None = None
    again: int = 0
    rows: tuple[ResultRow, ...] = ()
    info: Mapping[str, Any] = field(default_factory=dict)

    def kept(self, name: str) -> list[Any]:
        """The entries of a list in results.run.json, each with its scene_id and im_id, of rows that are kept."""
        frames, entries = {row.key[:2] for row in self.rows}, self.info.get(name)
        return [
            entry
            for entry in (entries if isinstance(entries, list) else ())
            if isinstance(entry, dict) and (entry.get("scene_id"), entry.get("im_id")) in frames
        ]

    def rest_of(self, job: SceneJob) -> SceneJob | None:
        """What is left of a scene; None when it is complete."""
        if job.sequence.scene_id in self.done:
            return None
        if job.sequence.scene_id != self.scene_id or self.im_id is None or self.starts is None:
            return job
        rest = RestOfSequence(job.sequence, self.im_id)
        done = len(job.sequence.frame_ids) - len(rest.frame_ids)
        return replace(job, sequence=rest, starts=self.starts, tracked_before=done)

    def told(self, is_left: bool) -> str:
        """One line: what happens."""
        if not is_left:
            return "--resume: all frames have their rows already, nothing is tracked"
        frames = "1 frame" if self.again == 1 else f"{self.again} frames"
        again = f"; tracks {frames} again in which an object was lost or not seen" if self.again else ""
        if self.im_id is None:
            scenes = f"scene{'s'[: len(self.done) != 1]} {', '.join(map(str, sorted(self.done)))}"
            return f"--resume: {scenes} {'has its' if len(self.done) == 1 else 'have their'} rows already{again}"
        return (
            f"--resume: goes on behind scene {self.scene_id}, image {self.im_id}, from its pose{again}; what the "
            "tracker had learnt before is not kept"
        )


def inputs_of(jobs: Sequence[SceneJob], parts: Path, configuration: Any) -> dict[str, str]:
    """Checksums of all that the poses depend on, by name; images count by their names and sizes.

    Of several words one is enough to be the same.
    """
    inputs = {"the method": checksum_of_values(configuration)}
    for job in jobs:
        scene = f"scene {job.sequence.scene_id}"
        inputs[f"{scene}, its images or camera"] = checksum_of_values(_frames_in_words(job.sequence))
        for object_id, pose in job.starts.items():
            start = f"{scene}, the start pose of object {object_id}"
            inputs[start] = checksum_of_values(pose.tolist())
            inputs[f"{start}, {_WHETHER_FOUND}"] = "found" if object_id in job.found else "given"
            part = part_folder(parts, job.models[object_id].part.name)
            inputs[f"the prepared part {part.name}"] = _part_in_words(part / "part.json")
    return inputs


def resumption(
    results: Path, jobs: Sequence[SceneJob], inputs: Mapping[str, str], max_frames: int | None, states: StateConfig
) -> Resumption | None:
    """Where to go on with a results file; None to begin anew, where it has no whole rows.

    states: of the method, for which objects were lost when.

    Raises:
        InputFileError: it was made from something else, cannot be read, or has a scene that ends too early and is not
            the last one.
        SequenceError: a sequence that does not announce its frames, such as a live camera.
    """
    for job in jobs:
        if not job.sequence.frame_ids:
            raise SequenceError(
                f"{job.sequence.name}: cannot be resumed, it does not say how many frames it has: leave --resume out, "
                "and give --out another name"
            )
    if not results.exists():
        return None
    # Its length before its rows: whatever another run writes in between is noticed.
    length, rows = results.stat().st_size, rows_with_ends(results)
    if not rows:
        return None
    info = _same_inputs(results, inputs)
    by_scene = _by_scene(results, jobs)
    last: Resumption | None = None
    done: set[int] = set()
    before: int | None = None
    frames = 0
    states_of: dict[int, StateMachine] = {}
    for (scene_id, im_id), group in groupby(rows, key=lambda row: row[0].key[:2]):
        of_frame = tuple(group)
        if before not in (None, scene_id, *done):  # its rest would come behind another scene, or twice
            raise InputFileError(
                f"{results}: cannot be resumed: scene {before} ends after {frames} frames, and scene {scene_id} "
                f"follows: it was run with another --max-frames or order of scenes: {ANEW}"
            )
        states_of = states_of if scene_id == before else {}
        before, frames = scene_id, frames + 1 if scene_id == before else 1
        if scene_id not in by_scene or im_id not in by_scene[scene_id].sequence.frame_ids:
            raise InputFileError(f"{results}: has scene {scene_id}, image {im_id}, which is not tracked: {ANEW}")
        found, job = tuple(row for row, _ in of_frame), by_scene[scene_id]
        if {row.obj_id for row in found} != set(job.starts):
            break  # cut off within the frame
        for row in found:
            states_of.setdefault(row.obj_id, StateMachine(states)).replay(row.score)
        if im_id == job.sequence.frame_ids[:max_frames][-1]:
            done.add(scene_id)
            last = Resumption(KeptRows(of_frame[-1][1], length), frozenset(done))
        elif all(_is_a_start(row, states_of[row.obj_id]) for row in found):
            last = Resumption(KeptRows(of_frame[-1][1], length), frozenset(done), scene_id, im_id, _poses(found))
        elif last is not None:
            last = replace(last, again=last.again + 1)
    return (
        None if last is None else replace(last, rows=tuple(r for r, end in rows if end <= last.file.end), info=info)
    )


def _is_a_start(row: ResultRow, states: StateMachine) -> bool:
    """Whether the object was seen there: one that is followed above where it counts as lost, one that is lost again."""
    config = states.config
    return row.score > max(0.0, config.found_above if states.state is TrackState.LOST else config.lost_below)


def _by_scene(results: Path, jobs: Sequence[SceneJob]) -> dict[int, SceneJob]:
    by_scene: dict[int, SceneJob] = {}
    for job in jobs:
        other = by_scene.setdefault(job.sequence.scene_id, job)
        if other is not job:  # of `--init auto`: one set of rows behind the other, and an image in both
            first, second = (f"object {', '.join(map(str, sorted(one.starts)))}" for one in (other, job))
            raise InputFileError(
                f"{results}: cannot be resumed: in scene {job.sequence.scene_id}, {first} and {second} start in "
                f"different images: {ANEW}"
            )
    return by_scene


def _poses(rows: Sequence[ResultRow]) -> dict[int, FloatArray]:
    return {row.obj_id: row.cam_T_obj for row in rows}


def _same_inputs(results: Path, inputs: Mapping[str, str]) -> Mapping[str, Any]:
    """What results.run.json says; InputFileError when it is of other inputs."""
    path = run_info_path(results)
    info = read_json_object(path, f"{results} cannot be resumed without it: {ANEW}")
    before = info.get("inputs")
    if not isinstance(before, dict):
        raise InputFileError(f"{path}: does not say what {results.name} was made from: {ANEW}")
    for name in sorted(set(before) | set(inputs)):
        is_told = name in before or not name.endswith(_WHETHER_FOUND)
        if is_told and not _is_same(before.get(name), inputs.get(name)):
            raise InputFileError(f"{results}: cannot be resumed: another run made it ({name} differs): {ANEW}")
    return info


def _is_same(before: object, now: str | None) -> bool:
    return isinstance(before, str) and now is not None and not set(before.split()).isdisjoint(now.split())


def _part_in_words(header: Path) -> str:
    """Of a part.json what poses depend on, and the whole, which is what the runs of earlier versions tell."""
    content = header.read_bytes()
    return f"{checksum_for_poses(json.loads(content))} {checksum(content)}"


def _frames_in_words(frames: Frames) -> list[Any]:
    while isinstance(frames, RestOfSequence):
        frames = frames.sequence
    files = files_of(frames)
    codings = _codings(files)
    if isinstance(frames, VideoFile):
        files = [frames.path]
    camera = getattr(frames, "camera", None)
    cameras = [camera(frame_id) for frame_id in frames.frame_ids] if callable(camera) else [camera]
    return [*(str(one) for one in cameras), *_sizes(files), *codings]


def files_of(frames: object) -> list[Path]:
    """The image files of a data set's scene or of a folder; none of a video, a camera or nothing."""
    paths = getattr(frames, "image_paths", None)
    return list(paths.values() if isinstance(paths, Mapping) else paths or ())


def _codings(files: Iterable[Path]) -> list[str]:
    """What pixels.json says beside images; nothing where it says nothing, so that older runs can be resumed."""
    codings = {folder: PixelCoding.beside(folder) for folder in dict.fromkeys(path.parent for path in files)}
    return [str(coding) for coding in codings.values() if coding != PixelCoding()]


def _sizes(files: Iterable[Path]) -> Iterator[tuple[str, int]]:
    for path in files:
        yield path.name, path.stat().st_size if path.exists() else -1
