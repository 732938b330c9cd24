"""The edges of a mesh as lines: all of them, or those where faces meet at more than some angle.

Convention: lines are (n, 2, 3) mm in the object frame; angles between face normals, 0 for flat ground.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import trimesh

from acp_lab.cad.part import Part
from acp_lab.display.look import GENERATED, Colour
from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.camera import Camera
from acp_lab.geometry.pose import transform

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@dataclass(frozen=True, eq=False)
class MeshLines:
    """Every edge that two faces share.

    Attributes:
        lines_obj: (n, 2, 3) mm.
        angles_deg: (n,) between the normals of the two faces.
    """

    lines_obj: FloatArray
    angles_deg: FloatArray

    @classmethod
    def of(cls, part: Part) -> MeshLines:
        """The edges of a part's mesh."""
        mesh = trimesh.Trimesh(part.vertices, part.faces, process=False)
        lines_obj = np.asarray(part.vertices)[np.asarray(mesh.face_adjacency_edges)]
        return cls(lines_obj, np.degrees(np.asarray(mesh.face_adjacency_angles)))

    def sharper_than(self, angle_deg: float) -> FloatArray:
        """The lines (k, 2, 3) at which faces meet at more than an angle."""
        return self.lines_obj[self.angles_deg > angle_deg]


def draw_projected(
    axes: Axes,
    lines_obj: FloatArray,
    camera: Camera,
    cam_T_obj: FloatArray,
    colour: Colour = GENERATED,
    width: float = 0.8,
) -> None:
    """Lines (n, 2, 3) mm as the camera would see them through the part, hidden or not."""
    from matplotlib.collections import LineCollection

    pixels = camera.project(transform(cam_T_obj, lines_obj.reshape(-1, 3))).reshape(-1, 2, 2)
    axes.add_collection(LineCollection(list(pixels), colors=[colour], linewidths=width))
