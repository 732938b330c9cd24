"""`acp-lab prepare`: CAD models to prepared parts, one after the other or spread over processes and machines.

Import it after the thread limits are set: it imports NumPy.
"""

from __future__ import annotations

import importlib
import json
import os
import re
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from acp_lab.bench.workers import each
from acp_lab.cad.edges import check_has_edges
from acp_lab.cad.mesh_file import UNITS_MM, says_its_unit
from acp_lab.cad.models_info import Symmetries, read_models_info
from acp_lab.cad.part import Part
from acp_lab.cad.symmetry import in_words
from acp_lab.commands import interrupt
from acp_lab.commands.console import Progress, note, warn, watched
from acp_lab.commands.machine import limit_threads
from acp_lab.errors import InputFileError, PreparationError
from acp_lab.preparation import check_device, check_same_mesh, prepare, usual_edge_break_mm
from acp_lab.prepared_part import PrepareOptions, part_folder, read_header

MAYBE_NOT_MM = 20.0
"""mm. A part that is smaller is a screw, or larger and in centimetres or inches: then it is as large as most parts."""


@dataclass(frozen=True)
class Spread:
    """Who prepares: processes on this machine, of some threads each, or the workers of a dask scheduler's address."""

    workers: int = 1
    scheduler: str | None = None
    threads: int = 1

    def is_alone(self, parts: int) -> bool:
        """Whether this process does it all: also a single part, whose stages it then shows."""
        return self.scheduler is None and min(self.workers, parts) == 1


def prepare_parts(
    meshes: Sequence[Path], out: Path, options: PrepareOptions | None = None, unit: str = "mm",
    spread: Spread = Spread(), symmetries: bool = True,
) -> None:  # fmt: skip
    """Prepare every mesh into a folder of `out` named after its file, and print one line for each.

    All meshes are read, and looked at for edges, before the first is prepared, so that a bad one costs no time. unit:
    of their numbers. symmetries: whether they are looked for, where no models_info.json tells them.

    Raises:
        InputFileError: a mesh that cannot be read, two of the same name, or `out` is a file.
        PartError: a mesh without edges that could be tracked, such as a flat one.
        PreparationError: the part was prepared before in another unit, or there is no GPU where one was asked for.
        ParameterError: `spread` makes no sense, or no scheduler answers.
    """
    _check_places(meshes, out)
    if options is not None and spread.scheduler is None:  # the machines of a cluster know their own devices
        check_device(options)
    interrupt.check()
    parts = [read_part(mesh, unit, symmetries) for mesh in dict.fromkeys(meshes)]
    for part in parts:
        folder, resume = part_folder(out, part.name, part.path), options is None or options.resume
        _check_size_there(part, folder, resume)
        if resume and (folder / "part.json").exists():
            check_same_mesh(part, folder)
        check_has_edges(part)
    for part in parts:
        is_told = unit != "mm" or (part.path is not None and says_its_unit(part.path))
        if part.diameter < MAYBE_NOT_MM and not is_told:
            in_cm, in_inches = (UNITS_MM[other] * part.diameter for other in ("cm", "inch"))
            sizes = f"if the file is in cm it is {in_cm:.0f} mm, in inches {in_inches:.0f} mm"
            warn(f"{part.path}: {part.diameter:.1f} mm large: {sizes}: --unit says it")
        if not part.is_closed:
            warn(f"{part.path}: the mesh is not closed: if the file was cut off, export it again")
    if spread.is_alone(len(parts)):
        for part in parts:
            with Progress(f"{part.name}: ") as progress:
                said = _prepared(part, options, out, progress)
            _tell(out / part.name, said)
    else:
        _prepare_elsewhere(meshes, out, options or PrepareOptions(), unit, spread, symmetries)
    # Its loops are compiled when it is first imported on a machine: now, not before somebody's first frame.
    importlib.import_module("acp_lab.tracking.tracker")


def _prepare_elsewhere(
    meshes: Sequence[Path], out: Path, options: PrepareOptions, unit: str, spread: Spread, symmetries: bool
) -> None:
    job = {"out": os.path.abspath(out), "options": asdict(options), "unit": unit, "threads": spread.threads}
    job["symmetries"] = symmetries
    asked = {str(mesh): json.dumps({**job, "mesh": os.path.abspath(mesh)}) for mesh in dict.fromkeys(meshes)}
    with Progress() as progress:
        done = each(prepare_mesh, asked, workers=spread.workers, scheduler=spread.scheduler)
        for number, (name, said) in enumerate(done, start=1):
            interrupt.check()
            _tell(out / Path(name).stem, said)
            progress("parts", number, len(asked))


def prepare_mesh(text: str) -> str:
    """Prepare the mesh of a JSON text; what to say of it. What a worker process is asked for.

    Raises AcpLabError as `preparation.prepare`.
    """
    job = json.loads(text)
    limit_threads(job["threads"])
    part = read_part(Path(job["mesh"]), job["unit"], job["symmetries"])
    return _prepared(part, PrepareOptions.from_json(job["options"]), Path(job["out"]))


def _prepared(
    part: Part, options: PrepareOptions | None, out: Path, progress: Callable[[str, int, int], None] | None = None
) -> str:
    """Prepare a part; in words what was done and its size, which shows a wrong unit; in a second line, symmetries."""
    header, start = part_folder(out, part.name) / "part.json", time.perf_counter()
    before = header.stat().st_mtime_ns if header.exists() else None
    model = prepare(part, options, out=out, progress=progress)
    was_complete = before == header.stat().st_mtime_ns  # what is there already is not written again
    done = "was complete" if was_complete else f"prepared in {time.perf_counter() - start:.1f} s"
    found = "" if part.symmetries.told else in_words(model.part.symmetries)
    is_told = options is not None and options.edge_break_mm is not None
    is_kept = not is_told and model.edge_break_mm != usual_edge_break_mm(part)
    kept = f", edge break {model.edge_break_mm:g} mm as before" if is_kept else ""
    return f"{done}, diameter {part.diameter:.1f} mm{kept}" + (found and f"\nlooks the same after {found}")


def _tell(folder: Path, said: str) -> None:
    done, *found = said.splitlines()
    print(f"{folder}: {done}", flush=True)
    if watched():  # for scripts it stands in part.json
        for line in found:
            note(f"{folder}: {line}; --no-symmetries tells them apart")


def _check_places(meshes: Sequence[Path], out: Path) -> None:
    if out.exists() and not out.is_dir():
        raise InputFileError(f"{out}: is a file: --out needs a folder for the prepared parts")
    by_stem: dict[str, Path] = {}
    for mesh in meshes:
        other = by_stem.setdefault(mesh.stem, mesh)
        if other != mesh:
            raise InputFileError(
                f"{mesh}: {other} has the same name, and a part is named after its file: "
                "prepare them into two folders, or rename one"
            )


def _check_size_there(part: Part, folder: Path, resume: bool) -> None:
    """The file's checksum is the same in every unit, so the sizes are compared; a part made anew has a warning."""
    try:
        header = read_header(folder, "")
        if header["mesh"]["sha256"] != part.sha256:
            return  # of another mesh: `prepare` says so
        known = np.array(header["box_max_mm"], float) - np.array(header["box_min_mm"], float)
        comparable = known.shape == (3,) and known.min() > 0.0
    except (PreparationError, KeyError, TypeError, ValueError):
        return  # nothing there, or nothing to go on with
    if comparable and not np.allclose(known, part.box_size, rtol=1e-6, atol=0.0):
        ratio = float((known / part.box_size).mean())
        was = f"{folder}: was prepared {ratio:.4g} times as large, from the same mesh in another unit"
        if resume:
            raise PreparationError(f"{was}: give that --unit, or --no-resume to prepare it anew")
        warn(f"{was}, and is replaced: if that was the right one, prepare it again with that --unit")


def read_part(mesh: Path, unit: str = "mm", symmetries: bool = True) -> Part:
    """The part of a mesh file, with what a data set's models_info.json beside it says about it; unit: of the file.

    symmetries: whether it may have any where nothing tells.
    """
    in_data_set = re.fullmatch(r"obj_(\d+)", mesh.stem)
    info_path = mesh.parent / "models_info.json"
    if in_data_set is None or not info_path.exists():
        part = Part.from_file(mesh, unit=unit)
        return part if symmetries else replace(part, symmetries=Symmetries.none())
    return Part.from_file(mesh, read_models_info(info_path).get(int(in_data_set[1])), unit)
