"""`acp-lab explain`: what was likely wrong in a frame of a finished run, in words and with a picture.

The run is found by its results file. `results.run.json` beside it says what was tracked; a replay is found by the
results file of the same folder that names it, if only one does.
"""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

from acp_lab.errors import InputFileError, SequenceError, TrackingError

if TYPE_CHECKING:
    from acp_lab.cad.part import Part
    from acp_lab.diagnosis.diagnosis import Diagnosis
    from acp_lab.sequences.protocol import Sequence
    from acp_lab.sequences.results_csv import ResultRow
    from acp_lab.tracking.session import TrackRun
    from acp_lab.tracking.states import StateConfig


_IN_PYTHON = "a run made in Python is explained there, by acp.explain(run, frame)"
_NOT_OURS = "put back what acp-lab track wrote, or remove the file and name the data set with --dataset DIR"


@dataclass(frozen=True)
class ExplainOptions:
    """What to explain. source: results.csv or FILE.rrd. frame: counted from 0, None for the most telling one."""

    source: Path
    frame: int | None = None
    dataset: Path | None = None
    scene: int | None = None
    object_id: int | None = None
    out: Path | None = None


def explain_run(options: ExplainOptions) -> None:
    """Print the explanation, and write its picture beside the results."""
    from acp_lab.display.plots.diagnosis import explain
    from acp_lab.files import check_replaces_own
    from acp_lab.sequences.results_csv import read_results

    if options.out is not None and options.out.suffix.lower() != ".png":
        raise InputFileError(f"{options.out}: --out writes PNG only: name it {options.out.with_suffix('.png').name}")
    results = _results_file(options.source)
    if options.out is not None:
        check_replaces_own(options.out, b"\x89PNG", "--out", "a picture")
    rows = read_results(results)
    run = _run(results, rows, options)
    object_id = next(iter(run.results)) if options.object_id is None else options.object_id
    frame = _most_telling(run, object_id) if options.frame is None else options.frame
    explanation = explain(run, frame, object_id)
    scenes = len({row.scene_id for row in rows})
    picture = options.out or _picture_beside(results, scenes, run, explanation.diagnosis)
    _check_keeps_images(picture, run.sequence)
    explanation.save(picture)
    print(_verdict(run, object_id))
    print(explanation)
    print(f"{picture}: the picture")


def _check_keeps_images(picture: Path, sequence: Sequence | None) -> None:
    from acp_lab.commands.resume import files_of

    if picture.resolve() in {path.resolve() for path in files_of(sequence)}:
        raise InputFileError(f"{picture}: --out would replace an image of the run: choose another name")


def _verdict(run: TrackRun, object_id: int) -> str:
    """Whether the part was ever good, and lost, since when, where it was looked for, and what to do."""
    from acp_lab.diagnosis.recorded_run import first_loss
    from acp_lab.tracking.result import TrackState

    results = run.results[object_id]
    if not any(result.state is TrackState.TRACKING for result in results):
        return f"Object {object_id} was good in none of {len(results)} frames."
    lost = first_loss(results)
    if lost is None:
        return f"Object {object_id} was never lost in {len(results)} frames."
    told = f"Object {object_id} is lost since frame {lost} (image {results[lost].frame_id}) of {len(results)}"
    first = next(number for number in range(lost, len(results)) if results[number].state is TrackState.LOST)
    back = (number for number in range(first, len(results)) if results[number].state is not TrackState.LOST)
    found = next(back, None)
    if found is not None and results[-1].state is TrackState.LOST:
        again = max(number for number in range(len(results)) if results[number].state is not TrackState.LOST) + 1
        told = (
            f"Object {object_id} was lost more than once, first from frame {lost} (image {results[lost].frame_id}) on, "
            f"and is lost since frame {again} (image {results[again].frame_id}) of {len(results)}, start again there: "
            f"acp-lab track … --first-frame {results[again].frame_id}."
        )
        first, found = again, None
    elif found is not None:
        told = (
            f"Object {object_id} was lost from frame {lost} (image {results[lost].frame_id}) on, and found again in "
            f"frame {found} (image {results[found].frame_id}) of {len(results)}."
        )
    else:
        told += (
            f", start again there: acp-lab track … --first-frame {results[lost].frame_id}, with --init auto, or with a "
            "pose for that image: a row of a results file, or for a video a POSE.json, which notebook 10 sets with the "
            "mouse."
        )
    searches = [result for result in results[first:found] if result.sought is not None]
    if searches:
        told += f"\nImage {searches[-1].frame_id}: {searches[-1].sought}."
    return told


def _most_telling(run: TrackRun, object_id: int) -> int:
    """Where the first loss began, else where the pose came to be beside the part, else the lowest quality."""
    from acp_lab.diagnosis.diagnosis import first_beside
    from acp_lab.diagnosis.recorded_run import first_loss

    results = run.results[object_id]
    lost = first_loss(results)
    told = first_beside(run, object_id) if lost is None else lost
    return min(range(len(results)), key=lambda number: results[number].quality) if told is None else told


def _results_file(source: Path) -> Path:
    """The results file itself, or the one beside a replay whose run wrote both."""
    from acp_lab.display.replay.file import check_replay

    if not _is_replay(source):
        return source
    check_replay(source)
    written_to: dict[Path, Path] = {}  # replays by the results files of their runs
    for path in sorted(source.resolve().parent.glob("*.run.json")):
        info = _run_info(path)
        options = info.get("options")
        replay = options.get("replay") if isinstance(options, dict) else None
        if replay and Path(str(replay)).name == source.name:
            written_to[_results_of(path)] = Path(str(info.get("folder", "."))) / str(replay)
    # A folder that was moved is elsewhere than its runs say: then the name alone counts.
    here = [results for results, replay in written_to.items() if replay.resolve() == source.resolve()]
    found = here or list(written_to)
    if len(found) == 1:
        return found[0]
    if found:
        names = " and ".join(results.name for results in found)
        raise InputFileError(
            f"{source}: was written by more than one run, {names}, and holds the last of them: give the results file "
            "of that run"
        )
    raise InputFileError(
        f"{source}: no results file beside it names this replay: give the results.csv of the run, or keep both in one "
        f"folder (acp-lab track --out results.csv --replay run.rrd); {_IN_PYTHON}"
    )


def _picture_beside(results: Path, scenes: int, run: TrackRun, diagnosis: Diagnosis) -> Path:
    """Where the picture of a frame goes; of results of several scenes or objects each has its own."""
    from acp_lab.sequences.results_csv import run_info_path

    name = run_info_path(results).name.removesuffix(".run.json")
    if scenes > 1:
        name += f".scene{run.scene_id}"
    if len(run.results) > 1:
        name += f".object{diagnosis.object_id}"
    return results.with_name(f"{name}.frame{diagnosis.frame}.png")


def _results_of(info: Path) -> Path:
    """The results file that the run information stands beside."""
    results = info.with_name(info.name.removesuffix(".run.json"))
    return results if results.is_file() else results.with_name(results.name + ".csv")


def _is_replay(source: Path) -> bool:
    """By what it holds; by its name where that tells nothing, or there is no such file."""
    from acp_lab.sequences.results_csv import HEADER_START

    start = b""
    if source.is_file():  # a pipe would never end
        with suppress(OSError), source.open("rb") as file:
            start = file.read(len(HEADER_START))
    return start.startswith(b"RRF") or (start != HEADER_START and source.suffix.lower() == ".rrd")


def _run(results: Path, rows: tuple[ResultRow, ...], options: ExplainOptions) -> TrackRun:
    from acp_lab.diagnosis.recorded_run import run_from_rows
    from acp_lab.sequences.results_csv import run_info_path
    from acp_lab.tracking.sought import from_rows

    if not rows:
        raise InputFileError(f"{results}: holds no rows: nothing was tracked")
    scene_id = rows[0].scene_id if options.scene is None else options.scene
    ids = {row.obj_id for row in rows if row.scene_id == scene_id}
    if not ids:
        raise InputFileError(f"{results}: no row of scene {scene_id}: there are {sorted({r.scene_id for r in rows})}")
    if options.object_id is not None and options.object_id not in ids:
        raise InputFileError(
            f"{results}: no row of object {options.object_id} in scene {scene_id}: there are {sorted(ids)}"
        )
    info_path = run_info_path(results)
    info = _run_info(info_path) if info_path.is_file() else {}
    sequence, parts = _tracked(results, info, options.dataset, scene_id, ids)
    _check_has_images(sequence, results, {row.im_id for row in rows if row.scene_id == scene_id})
    told = info.get("searches")
    searches = from_rows(told if isinstance(told, list) else (), scene_id)
    return run_from_rows(rows, sequence, parts, str(info.get("method", "unknown")), _states(info, info_path), searches)


def _check_has_images(sequence: Sequence, results: Path, im_ids: set[int]) -> None:
    """SequenceError where results are of images that the sequence lacks: then it is not what was tracked."""
    unknown = im_ids.difference(sequence.frame_ids)
    if sequence.frame_ids and unknown:  # a live camera announces none
        raise SequenceError(
            f"{results}: {sequence.name} has no image {min(unknown)}, of which there are results: put back the images "
            "that were tracked, or name their data set with --dataset DIR"
        )


def _states(info: Mapping[str, Any], path: Path) -> StateConfig:
    """The run's own limits between tracking, weak and lost; those of its method where they are not told."""
    from acp_lab.tracking.method import METHODS
    from acp_lab.tracking.states import StateConfig

    told = _object(_object(info, "configuration", path), "states", path)
    method = str(info.get("method"))
    if not told and method in METHODS:
        return METHODS[method].states
    if told:  # runs of before there was a proof went by one frame
        told = {"proof": 1, **told}
    try:
        return StateConfig(**{item.name: told[item.name] for item in fields(StateConfig) if item.name in told})
    except TypeError:  # a limit that is no number
        raise InputFileError(f"{path}: configuration.states holds what is no number: {_NOT_OURS}") from None
    except TrackingError as error:
        raise InputFileError(f"{path}: configuration.{error}: {_NOT_OURS}") from None


def _tracked(
    results: Path, info: Mapping[str, Any], dataset: Path | None, scene_id: int, ids: set[int]
) -> tuple[Sequence, dict[int, Part]]:
    """The images and the parts that a run saw."""
    from acp_lab.geometry.camera import Camera
    from acp_lab.sequences import open_images
    from acp_lab.sequences.bop import BopDataset
    from acp_lab.sequences.results_csv import run_info_path

    path = run_info_path(results)
    tracked, folder = _object(info, "options", path), Path(str(info.get("folder", ".")))
    if dataset is None and tracked.get("video"):
        missing = [name for name in ("mesh", "camera") if not tracked.get(name)]
        if missing:
            raise InputFileError(f"{path}: names a video, but no {missing[0]} in options: {_NOT_OURS}")
        mesh, camera, video = (folder / str(tracked[name]) for name in ("mesh", "camera", "video"))
        if str(tracked["video"]).isdigit() and not video.exists():
            raise InputFileError(
                f"{results}: live camera {tracked['video']} was tracked, whose images are gone: record a video, and "
                "track that to explain it"
            )
        part = _part_of_video(mesh, folder / str(tracked.get("parts")))
        return open_images(video, Camera.from_json(camera)), {1: part}
    if dataset is None and tracked.get("dataset"):
        dataset = folder / str(tracked["dataset"])
    if dataset is None:
        raise InputFileError(
            f"{results}: nothing beside it says what was tracked: name the data set with --dataset DIR; {_IN_PYTHON}"
        )
    opened = BopDataset(dataset)
    scene = opened.open_scene(scene_id, str(tracked.get("split", "test")), asked=ids)
    return scene, {object_id: opened.part(object_id) for object_id in sorted(ids)}


def _part_of_video(mesh: Path, parts: Path) -> Part:
    """As it was prepared, which knows the unit of the mesh; where that is gone, the mesh in mm."""
    from acp_lab.cad.part import Part
    from acp_lab.errors import PreparationError
    from acp_lab.prepared_part import PreparedPart, part_folder

    try:
        return PreparedPart.load(part_folder(parts, mesh.stem, mesh), mesh).part
    except PreparationError:
        return Part.from_file(mesh)


def _object(values: Mapping[str, Any], name: str, path: Path) -> Mapping[str, Any]:
    """An entry of the run information that holds further ones; empty where there is none."""
    found = values.get(name) or {}
    if not isinstance(found, Mapping):
        raise InputFileError(f"{path}: {name} is no JSON object: {_NOT_OURS}")
    return found


def _run_info(path: Path) -> Mapping[str, Any]:
    from acp_lab.input_file import read_json_object

    return read_json_object(path, "it is written by acp-lab track; name the data set with --dataset DIR instead")
