"""CAD files of unknown unit, converted to millimetres.

STEP is the only format that states its unit. A part that a camera can track measures between 15 mm and 5 m, which
leaves little doubt about the rest: a file whose largest distance is 0.12 is in metres, one of 4.7 in inches, one of 95
in mm. The guess is printed and can be overridden.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from acp_lab.cad.mesh_file import UNITS_MM, read_mesh_file
from acp_lab.cad.part import Part, largest_distance
from acp_lab.errors import PartError
from data_recipes.bop_writer import Model

_SMALLEST_MM, _LARGEST_MM = 15.0, 5000.0
_LARGEST_IN_METRES = 0.6
"""Above it a number below 15 is taken for inches: 1.2 is rather a part of 30 mm than one of 1.2 m."""


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
    """The unit in which a largest distance of `size` is that of a part; PartError when there is none."""
    if _SMALLEST_MM <= size <= _LARGEST_MM:
        return "mm"
    if _SMALLEST_MM / 1000.0 <= size <= _LARGEST_IN_METRES:
        return "m"
    if _LARGEST_IN_METRES < size < _SMALLEST_MM:
        return "inch"
    raise PartError(f"{where}: its size is {size:.4g}, no part in mm, m or inches: give --unit, or scale the mesh")


def load_mesh(path: Path, unit: str | None = None) -> UnitMesh:
    """Read a PLY, OBJ, STL or STEP file. unit: a key of UNITS_MM, None to guess it by the size.

    Raises InputFileError when the file cannot be read whole, PartError when it holds no part or no unit fits.
    """
    raw = read_mesh_file(path)
    if len(raw.faces) == 0:
        raise PartError(f"{path}: has no faces: export the part as a triangle mesh, not as points or curves")
    if unit is None and path.suffix.lower() in (".step", ".stp"):
        unit = "mm"  # the format states its unit, and the reader converts it
    if unit is None:
        if not np.isfinite(raw.vertices).all():
            raise PartError(f"{path}: a vertex is no point: export the mesh again")
        unit = guess_unit(largest_distance(raw.vertices), str(path))
    mesh = UnitMesh(path.stem, UNITS_MM[unit] * raw.vertices, raw.faces, unit)
    _ = mesh.part  # says in one line what is wrong with it
    return mesh


def model_of(mesh: UnitMesh, **extra: object) -> Model:
    """What a data set stores of a mesh."""
    return Model(mesh.vertices, mesh.faces, mesh.part.diameter, {"name": mesh.name, **extra})
