"""What the BOP layout says about a part beside its mesh: `models_info.json`.

One entry per object id: the diameter (largest distance between two vertices, mm), the axis-aligned box (mm,
object frame) and the symmetries. A symmetry is a 4x4 transform S in the object frame that leaves the part
looking the same, so that `cam_T_obj` and `cam_T_obj @ S` cannot be told apart in an image.

Source of the format: BOP toolkit, `docs/bop_datasets_format.md`; the discretisation of continuous symmetries
follows `bop_toolkit_lib.misc.get_symmetry_transformations`.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from acp_lab.errors import InputFileError
from acp_lab.geometry.arrays import FloatArray
from acp_lab.input_file import LARGEST_NUMBER, is_measure, read_json_object

_MEND = 'a data set keeps it beside its meshes, with one entry per object: {"1": {"diameter": 92.5, …}, …}'

Vector = tuple[float, float, float]


@dataclass(frozen=True, eq=False)
class Symmetries:
    """Transforms of the object frame after which the part looks the same.

    discrete: (k, 4, 4) rigid transforms, translation in mm, read-only; the identity need not be listed.
    continuous: (axis, offset) pairs: the part may turn by any angle about the line through `offset` (mm)
    along `axis` (any length).
    told: whether somebody said so; of a mesh alone nobody has, and `prepare` looks for them.
    """

    discrete: FloatArray
    continuous: tuple[tuple[Vector, Vector], ...] = ()
    told: bool = True

    def __post_init__(self) -> None:
        discrete = np.array(self.discrete, dtype=np.float64).reshape(-1, 4, 4)
        discrete.flags.writeable = False
        object.__setattr__(self, "discrete", discrete)

    @classmethod
    def none(cls) -> Symmetries:
        """A part that looks different from everywhere."""
        return cls(np.zeros((0, 4, 4)))

    @classmethod
    def untold(cls) -> Symmetries:
        """None as far as is known."""
        return cls(np.zeros((0, 4, 4)), told=False)

    @property
    def any(self) -> bool:
        """True when the part has any symmetry; `bool(symmetries)` says the same."""
        return len(self.discrete) > 0 or len(self.continuous) > 0

    def __bool__(self) -> bool:
        return self.any

    def transforms(self, steps: int = 36) -> FloatArray:
        """All symmetry transforms (m, 4, 4), the identity first.

        Each continuous axis is cut into `steps` equal turns (36: every 10 degrees). Raises ValueError for
        steps < 1.
        """
        if steps < 1:
            raise ValueError(f"steps must be at least 1, not {steps}")
        discrete = [np.eye(4)]
        for transform in self.discrete:
            if not any(np.allclose(transform, known, atol=1e-6) for known in discrete):
                discrete.append(transform)
        turns = [np.eye(4)]
        for axis, offset in self.continuous:
            turns += [_turn(axis, offset, 2.0 * np.pi * k / steps) for k in range(1, steps)]
        # The continuous turn acts after the discrete transform, as in the BOP toolkit.
        return np.array([turn @ transform for transform in discrete for turn in turns])


def _turn(axis: Vector, offset: Vector, angle: float) -> FloatArray:
    """Rotation (4, 4) by `angle` (rad) about the line through `offset` (mm) along `axis` (Rodrigues)."""
    x, y, z = np.asarray(axis, dtype=np.float64) / np.linalg.norm(axis)
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    turn = np.eye(4)
    turn[:3, :3] += np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross
    turn[:3, 3] = offset - turn[:3, :3] @ offset
    return turn


@dataclass(frozen=True, eq=False)
class PartInfo:
    """One entry of models_info.json: diameter in mm; box_min and box_max (3,), mm, object frame.

    source: the file, to be named in error messages; None when the numbers were made in memory.
    """

    diameter: float
    box_min: FloatArray
    box_max: FloatArray
    symmetries: Symmetries
    source: Path | None = None


def read_models_info(path: str | Path) -> dict[int, PartInfo]:
    """Read models_info.json: object id -> PartInfo.

    Raises InputFileError, naming file and object, when the file is missing, is no JSON or lacks a number.
    """
    path = Path(path)
    entries = read_json_object(path, _MEND)
    if not entries:
        raise InputFileError(f"{path}: holds no object: {_MEND}")
    infos: dict[int, PartInfo] = {}
    for key, entry in entries.items():
        if not (key.isascii() and key.isdecimal() and len(key) < 19):
            raise InputFileError(f"{path}: key '{key[:60]}' is no object id: use whole numbers, as in \"1\"")
        where = f"{path}: object {int(key)}"
        if not isinstance(entry, dict):
            raise InputFileError(f"{where}: must be a JSON object with diameter, min_x … size_z")
        infos[int(key)] = _part_info(entry, where, path)
    return infos


def _part_info(entry: dict[str, Any], where: str, source: Path) -> PartInfo:
    diameter = _number(entry, "diameter", where)
    if diameter <= 0.0:
        raise InputFileError(f"{where}: diameter is {diameter:g}: it must be above 0 mm")
    box_min = np.array([_number(entry, f"min_{axis}", where) for axis in "xyz"])
    size = np.array([_number(entry, f"size_{axis}", where) for axis in "xyz"])
    if (size < 0.0).any():
        raise InputFileError(f"{where}: size_x, size_y, size_z are {size.tolist()}: they cannot be negative")
    symmetries = Symmetries(_discrete(entry, where), _continuous(entry, where))
    return PartInfo(diameter, box_min, box_min + size, symmetries, source)


def _discrete(entry: dict[str, Any], where: str) -> FloatArray:
    try:
        transforms = np.array(entry.get("symmetries_discrete", []), dtype=np.float64).reshape(-1, 4, 4)
    except (TypeError, ValueError, OverflowError):
        message = f"{where}: symmetries_discrete must be a list of 16 numbers each (4x4, row by row)"
        raise InputFileError(message) from None
    rotations = transforms[:, :3, :3]
    off = np.abs(rotations @ rotations.transpose(0, 2, 1) - np.eye(3)).max(initial=0.0)
    # Column by column, the shift would stand in the last row.
    off_below = np.abs(transforms[:, 3] - np.array([0.0, 0.0, 0.0, 1.0])).max(initial=0.0)
    is_finite = (np.abs(transforms) <= LARGEST_NUMBER).all()
    # Written as "not small" so that NaN is refused too.
    if not (off < 1e-2 and off_below < 1e-6 and is_finite and (np.linalg.det(rotations) > 0.0).all()):
        raise InputFileError(
            f"{where}: symmetries_discrete holds no rigid transform: give 4x4, row by row, the last one 0, 0, 0, 1"
        )
    return transforms


def _continuous(entry: dict[str, Any], where: str) -> tuple[tuple[Vector, Vector], ...]:
    wanted = f'{where}: symmetries_continuous must be [{{"axis": [x, y, z], "offset": [x, y, z]}}, …]'
    items = entry.get("symmetries_continuous", [])
    if not isinstance(items, list):
        raise InputFileError(wanted)
    axes: list[tuple[Vector, Vector]] = []
    for item in items:
        try:
            ax, ay, az = (float(value) for value in item["axis"])
            ox, oy, oz = (float(value) for value in item["offset"])
        except (KeyError, TypeError, ValueError, OverflowError):
            raise InputFileError(wanted) from None
        largest, length = np.abs([ax, ay, az, ox, oy, oz]).max(), np.linalg.norm([ax, ay, az])
        if not (largest <= LARGEST_NUMBER and length > 1.0 / LARGEST_NUMBER):
            raise InputFileError(f"{wanted} with finite numbers and an axis that is not 0")
        axes.append(((ax, ay, az), (ox, oy, oz)))
    return tuple(axes)


def _number(entry: dict[str, Any], key: str, where: str) -> float:
    if key not in entry:
        raise InputFileError(f"{where}: {key} is missing: add it, in mm")
    value = entry[key]
    if not is_measure(value):
        raise InputFileError(f"{where}: {key} is {str(value)[:60]}: give a finite number in mm")
    return float(value)
