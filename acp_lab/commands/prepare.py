"""`acp-lab prepare`: CAD models to prepared parts."""

from __future__ import annotations

import re
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from acp_lab.commands import interrupt
from acp_lab.commands.console import Progress, warn
from acp_lab.commands.machine import limit_threads
from acp_lab.errors import InputFileError

if TYPE_CHECKING:
    from acp_lab.cad.part import Part
    from acp_lab.generator.painted.edge_images import Source
    from acp_lab.prepared_part import PreparedPart


@dataclass(frozen=True)
class PrepareOptions:
    """What the command line asked for; lengths mm, regions None for all six.

    One thread is the default: the networks are so small that threads wait for each other longer than they work
    (on a busy machine of two cores, two threads took seven times as long as one), and the numbers are the same
    on every machine. Only the auto-encoder is large enough for two, and it takes them by itself.
    """

    meshes: tuple[Path, ...]
    out: Path
    generator: str = "both"
    fast: bool = False
    regions: tuple[int, ...] | None = None
    edge_break_mm: float | None = None
    edge_source: Source = "analytic"
    seed: int = 0
    threads: int = 1
    resume: bool = True

    def __post_init__(self) -> None:
        if self.edge_break_mm is not None and not 0.0 <= self.edge_break_mm < 1e3:
            raise InputFileError(f"--edge-break {self.edge_break_mm:g}: give millimetres, such as 0.3")
        if self.out.exists() and not self.out.is_dir():
            raise InputFileError(f"{self.out}: is a file: --out needs a folder for the prepared parts")
        by_stem: dict[str, Path] = {}
        for mesh in self.meshes:
            other = by_stem.setdefault(mesh.stem, mesh)
            if other != mesh:
                raise InputFileError(
                    f"{mesh}: {other} has the same name, and a part is named after its file: "
                    "prepare them into two folders, or rename one"
                )


def prepare_parts(options: PrepareOptions) -> tuple[PreparedPart, ...]:
    """Prepare every mesh and print one line for each; the parts.

    All meshes are read before the first is prepared, so that a bad one costs no time.
    """
    limit_threads(options.threads)
    from acp_lab.preparation import prepare

    interrupt.check()
    parts = [read_part(mesh) for mesh in dict.fromkeys(options.meshes)]
    for part in parts:
        if not part.is_closed:
            warn(f"{part.path}: the mesh is not closed: if the file was cut off, export it again")
    prepared = []
    for part in parts:
        start = time.perf_counter()
        with Progress(f"{part.name}: ") as progress:
            model = prepare(
                part,
                generator=options.generator,
                fast=options.fast,
                regions=options.regions,
                edge_break_mm=options.edge_break_mm,
                edge_source=options.edge_source,
                seed=options.seed,
                out=options.out,
                resume=options.resume,
                progress=progress,
            )
        prepared.append(model)
        print(f"{options.out / part.name}: prepared in {time.perf_counter() - start:.1f} s", flush=True)
    return tuple(prepared)


def read_part(mesh: Path) -> Part:
    """The part of a mesh file, with what a data set's models_info.json beside it says about it."""
    from acp_lab.cad.models_info import read_models_info
    from acp_lab.cad.part import Part

    in_data_set = re.fullmatch(r"obj_(\d+)", mesh.stem)
    info_path = mesh.parent / "models_info.json"
    if in_data_set is None or not info_path.is_file():
        return Part.from_file(mesh)
    return Part.from_file(mesh, read_models_info(info_path).get(int(in_data_set[1])))
