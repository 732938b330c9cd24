"""Finding the rotations that map a part to itself.

Some data sets say *that* a part is symmetric but not how, while `models_info.json` lists the transforms. CAD parts
have their axes along those of their box, so the 23 turns of a cube about the box centre are tried, and turns by
any angle about its three axes. A turn counts when the turned surface lies on the surface, within 1% of the diameter.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from acp_lab.cad.part import Part
from acp_lab.cad.symmetry import surface_samples
from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.pose import make_pose, so3_exp, transform

TOLERANCE = 0.01
"""Of the diameter, for the largest distance after the worst 2% of the surface are left out."""
_SAMPLES = 3000
_ODD_ANGLE = 1.0
"""rad; a part that this turn maps to itself has no corners to be found at any other angle."""


@dataclass(frozen=True, eq=False)
class FoundSymmetry:
    """discrete: (k, 4, 4) turns of the object frame, without the identity and what `axes` make of the others.

    axes: unit vectors about which any turn will do; centre (3,) mm: of all turns. best_half_turn (4, 4) and its error
    as a share of the diameter: the half turn about a box axis that comes nearest to a symmetry.
    """

    discrete: FloatArray
    axes: tuple[FloatArray, ...]
    centre: FloatArray
    best_half_turn: FloatArray
    best_error: float

    def __bool__(self) -> bool:
        return len(self.discrete) > 0 or len(self.axes) > 0

    def as_info(self) -> dict[str, object]:
        """Entries of models_info.json."""
        info: dict[str, object] = {}
        if len(self.discrete):
            info["symmetries_discrete"] = [[float(v) for v in turn.ravel()] for turn in self.discrete]
        if self.axes:
            offset = [float(v) for v in self.centre]
            info["symmetries_continuous"] = [{"axis": [float(v) for v in a], "offset": offset} for a in self.axes]
        return info


def find_symmetry(part: Part) -> FoundSymmetry:
    """Try all turns of the module's docstring on a part; the same part gives the same answer."""
    points, normals = surface_samples(part, _SAMPLES)
    reach = 0.1 * part.diameter
    tree = cKDTree(np.hstack([points, reach * normals]))
    beside, _ = tree.query(tree.data, k=2)
    spacing = float(np.quantile(beside[:, 1], 0.9))

    def error(turn: FloatArray) -> float:
        """How far the turned surface is from the surface: off its plane, or beside it by more than the sampling."""
        there, facing = transform(turn, points), normals @ turn[:3, :3].T
        distance, nearest = tree.query(np.hstack([there, reach * facing]))
        off_plane = np.abs(np.einsum("ij,ij->i", there - points[nearest], normals[nearest]))
        return float(np.quantile(np.maximum(off_plane, distance - 2.5 * spacing), 0.98)) / part.diameter

    centre = part.box_centre
    axes = tuple(axis for axis in np.eye(3) if error(_about(centre, so3_exp(_ODD_ANGLE * axis))) < TOLERANCE)
    discrete: list[FloatArray] = []
    best, best_error = np.eye(4), np.inf
    for rotation in np.round(Rotation.create_group("O").as_matrix()):
        turn = _about(centre, rotation)
        left = error(turn)
        known = [np.eye(4), *discrete]
        if left < TOLERANCE and not any(_same_but_for(axes, turn, one) for one in known):
            discrete.append(turn)
        is_half_turn_about_an_axis = np.trace(rotation) == -1.0 and np.count_nonzero(np.diag(rotation)) == 3
        if is_half_turn_about_an_axis and left < best_error:
            best, best_error = turn, left
    return FoundSymmetry(np.array(discrete).reshape(-1, 4, 4), axes, centre, best, best_error)


def _same_but_for(axes: tuple[FloatArray, ...], first: FloatArray, second: FloatArray) -> bool:
    """Whether two turns are equal, or differ by a turn about one of the axes only."""
    if np.allclose(first, second):
        return True
    return any(np.allclose(first[:3, :3].T @ axis, second[:3, :3].T @ axis) for axis in axes)


def _about(centre: FloatArray, rotation: FloatArray) -> FloatArray:
    return make_pose(rotation, centre - rotation @ centre)
