"""The reader's own files in notebook 10: checked before anything is computed, or the stand-ins for all of them.

A mesh goes with its video and a video with its camera, so that nothing of the reader's is measured with what was
made for the stand-ins. The unit of the mesh is the reader's to know; what each would make of it is said.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from acp_lab.cad.mesh_file import read_mesh_file
from acp_lab.cad.part import LARGEST_DIAMETER, SMALLEST_DIAMETER, Part, largest_distance
from acp_lab.course.stand_ins import stand_ins
from acp_lab.course.workshop import files_folder
from acp_lab.errors import InputFileError, PartError
from acp_lab.geometry.camera import Camera

UNITS_MM: Mapping[str, float] = {"mm": 1.0, "inches": 25.4, "metres": 1000.0}
STAND_IN_UNIT_MM = UNITS_MM["metres"]
OWN_UNIT_MM = UNITS_MM["mm"]

_Given = str | Path | None


@dataclass(frozen=True)
class OwnFiles:
    """Files that are there. mesh; mesh_unit_mm of it; video: file or folder; boards: the same, or None with a camera.

    camera: a CAMERA.json, or None with boards. are_yours: not the stand-ins. results: a folder for what is made.
    """

    mesh: Path
    mesh_unit_mm: float
    video: Path
    boards: Path | None
    camera: Path | None
    are_yours: bool
    results: Path

    def __str__(self) -> str:
        camera = f"boards  {self.boards}" if self.camera is None else f"camera  {self.camera}"
        kind = "yours" if self.are_yours else "stand-ins, made from the sample"
        unit = f"{self.mesh_unit_mm:g} mm per unit"
        return f"{kind}:\nmesh    {self.mesh} ({unit})\nvideo   {self.video}\n{camera}\nresults {self.results}"


def own_files(
    mesh: _Given = None,
    video: _Given = None,
    boards: _Given = None,
    camera: _Given = None,
    mesh_unit_mm: float | None = None,
) -> OwnFiles:
    """The reader's files, or the stand-ins when none is given. mesh_unit_mm: by default mm, the stand-in's metres.

    Raises InputFileError for one that is not there, and for some that do not go together.
    """
    given = {"MESH": mesh, "VIDEO": video, "BOARDS": boards, "CAMERA": camera}
    paths = {name: Path(value).expanduser() for name, value in given.items() if value is not None}
    if paths and not {"MESH", "VIDEO"} <= paths.keys():
        missing = " and ".join(name for name in ("MESH", "VIDEO") if name not in paths)
        raise InputFileError(
            f"{', '.join(paths)} without {missing}: give MESH and VIDEO together, or None for all: the stand-ins"
        )
    if paths and not {"BOARDS", "CAMERA"} & paths.keys():
        raise InputFileError(
            "MESH, VIDEO without BOARDS or CAMERA: give pictures of a chessboard by the camera of your video, or its "
            "CAMERA.json; the stand-in's camera is another one"
        )
    for name, path in paths.items():
        if not path.exists():
            raise InputFileError(f"{name}: {path.absolute()} is not there: check the path")
    if not paths:
        made = stand_ins(files_folder() / "stand_ins")
        results = _folder("own_part")
        return OwnFiles(made.mesh, mesh_unit_mm or STAND_IN_UNIT_MM, made.video, made.boards, None, False, results)
    return OwnFiles(
        paths["MESH"],
        mesh_unit_mm or OWN_UNIT_MM,
        paths["VIDEO"],
        None if "CAMERA" in paths else paths["BOARDS"],
        paths.get("CAMERA"),
        True,
        _folder(paths["VIDEO"].absolute().stem),
    )


def keep_camera(files: OwnFiles, camera: Camera) -> Path:
    """The CAMERA.json of these files: the reader's own as it is, else one written into the folder of the results."""
    if files.camera is not None:
        return files.camera
    path = files.results / "CAMERA.json"
    camera.to_json(path)
    return path


def size_by_unit(mesh: Path) -> str:
    """What the size of a mesh would be in each unit, one line."""
    size = largest_distance(read_mesh_file(mesh).vertices)
    if mesh.suffix.lower() in (".step", ".stp"):
        return f"{_short(size)} mm, as the STEP file says itself"
    return ", ".join(f"as {unit} ({mm:g}) {_short(mm * size)} mm" for unit, mm in UNITS_MM.items())


def part_in_mm(files: OwnFiles) -> Part:
    """The part, from a PLY file in mm that is written into the folder of the results.

    Raises PartError for a mesh that is none, or whose unit makes it no part that a camera tracks, and InputFileError
    where the reader's own mesh would be overwritten.
    """
    import trimesh

    raw = read_mesh_file(files.mesh)
    vertices = files.mesh_unit_mm * raw.vertices
    if len(raw.faces) and np.isfinite(vertices).all():
        size = largest_distance(vertices)
        if not SMALLEST_DIAMETER <= size <= LARGEST_DIAMETER:
            raise PartError(
                f"{files.mesh}: MESH_UNIT_MM = {files.mesh_unit_mm:g} makes its diameter {_short(size)} mm; it would "
                f"be {size_by_unit(files.mesh)}: which is yours?"
            )
    Part.from_mesh(vertices, raw.faces, files.mesh.name)  # says what is wrong, by the name of the reader's file
    path = files.results / f"{files.mesh.stem}.ply"
    if path.exists() and path.samefile(files.mesh):
        if files.mesh_unit_mm == 1.0:
            return Part.from_file(path)
        raise InputFileError(f"{files.mesh}: would be overwritten by the part in mm: move it out of {files.results}")
    trimesh.Trimesh(vertices, raw.faces, process=False).export(path)
    return Part.from_file(path)


def _short(number: float) -> str:
    return f"{number:.0f}" if number >= 100.0 else f"{number:.3g}"


def _folder(name: str) -> Path:
    folder = files_folder() / name
    try:
        folder.mkdir(exist_ok=True)
    except OSError as error:
        raise InputFileError(f"{folder}: cannot be made ({error.strerror}): rename the video") from None
    return folder
