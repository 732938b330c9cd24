"""CAD files of unknown unit, converted to millimetres.

STEP is the only format that states its unit. Numbers that are those of a part in mm, which is between 15 mm and 5 m
large, are taken for mm, which nearly all files are in: a largest distance of 95. One of 0.12 can only be in metres. One
of 4.7 may be in centimetres or in inches, and has to be told. The guess is printed and can be overridden.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from acp_lab.cad.mesh_file import UNITS_MM, read_mesh_file, says_its_unit
from acp_lab.cad.part import SMALLEST_DIAMETER, Part, check_size, largest_distance
from acp_lab.errors import PartError
from data_recipes.bop_writer import Model

_SMALLEST_MM, _LARGEST_MM = 15.0, 5000.0


@dataclass(frozen=True, eq=False)
class UnitMesh:
    """A mesh in mm: vertices (n, 3), faces (m, 3); unit: a key of UNITS_MM, what the file was taken to be in."""

    name: str
    vertices: np.ndarray
    faces: np.ndarray
    unit: str

    @property
    def part(self) -> Part:
        """The cleaned part; PartError when it holds none."""
        return Part.from_mesh(self.vertices, self.faces, self.name)


def guess_unit(size: float, where: str) -> str:
    """The unit in which a largest distance of `size` is that of a part; PartError where none or several are."""
    usual = [unit for unit, mm in UNITS_MM.items() if _SMALLEST_MM <= mm * size <= _LARGEST_MM]
    if not usual:
        units = ", ".join(UNITS_MM)
        raise PartError(f"{where}: its size is {size:.4g}, no usual part in {units}: give --unit, or scale the mesh")
    if len(usual) > 1 and "mm" not in usual:
        possible = {unit: mm * size for unit, mm in UNITS_MM.items() if SMALLEST_DIAMETER <= mm * size <= _LARGEST_MM}
        sizes = ", ".join(f"{mm:.3g} mm in {unit}" for unit, mm in possible.items())
        raise PartError(f"{where}: its size is {size:.4g}, which may be {sizes}: say with --unit which it is")
    return usual[0]


def load_mesh(path: Path, unit: str | None = None) -> UnitMesh:
    """Read a PLY, OBJ, STL or STEP file. unit: a key of UNITS_MM, None to guess it by the size.

    Raises InputFileError when the file cannot be read whole, PartError when it holds no part or no unit fits.
    """
    raw = read_mesh_file(path, unit or "mm")
    if len(raw.faces) == 0:
        raise PartError(f"{path}: has no faces: export the part as a triangle mesh, not as points or curves")
    vertices = raw.vertices
    if not np.isfinite(vertices).all():
        raise PartError(f"{path}: a vertex is no point: export the mesh again")
    if says_its_unit(path):
        unit = "mm"  # the reader converts it
        check_size(largest_distance(vertices), path)
    elif unit is None:
        unit = guess_unit(largest_distance(vertices), str(path))
        vertices = UNITS_MM[unit] * vertices
    mesh = UnitMesh(path.stem, vertices, raw.faces, unit)
    _ = mesh.part  # says in one line what is wrong with it
    return mesh


def model_of(mesh: UnitMesh, **extra: object) -> Model:
    """What a data set stores of a mesh."""
    return Model(mesh.vertices, mesh.faces, mesh.part.diameter, {"name": mesh.name, **extra})
