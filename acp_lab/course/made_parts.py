"""Small parts made in code, and views of them, for what the sample does not show: curved and symmetric bodies."""

from __future__ import annotations

import numpy as np

from acp_lab.cad.models_info import Symmetries
from acp_lab.cad.part import Part
from acp_lab.control_points.canonical_frame import canonical_frame
from acp_lab.control_points.view_regions import ALL_REGIONS, choose_region
from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.camera import Camera

_TURNED_ABOUT_Z = Symmetries(np.zeros((0, 4, 4)), (((0.0, 0.0, 1.0), (0.0, 0.0, 0.0)),))


def knob() -> Part:
    """A turned knob, 54 mm high: a disc, a neck and a ball; it looks the same at any turn about its z axis."""
    import trimesh

    ball_mm, neck_mm = 15.0, 8.0
    lowest = np.arcsin(neck_mm / ball_mm)
    angles = np.linspace(lowest, np.pi, 25)
    height_mm = 39.0
    ball = np.column_stack([ball_mm * np.sin(angles), height_mm - ball_mm * np.cos(angles)])
    profile = np.vstack([[[0.0, 0.0], [24.0, 0.0], [24.0, 9.0], [neck_mm, 9.0]], ball])
    profile[-1, 0] = 0.0  # the sine of pi is not exactly zero, and the ball has to close
    mesh = trimesh.creation.revolve(profile, sections=96)
    return Part.from_mesh(mesh.vertices, mesh.faces, "knob", _TURNED_ABOUT_Z)


def portrait(
    part: Part, direction_obj: FloatArray, size_px: int = 300, distance: float = 5.0
) -> tuple[Camera, FloatArray]:
    """A camera that looks at a part's middle, and its pose cam_T_obj (4, 4): the view of the canonical frame.

    direction_obj: (3,) from the part to the camera, any length. distance: in diameters.
    """
    direction = np.asarray(direction_obj, dtype=np.float64)
    region = ALL_REGIONS[choose_region(direction, 0.5 * part.box_size)]
    eye_obj = part.box_centre + distance * part.diameter * direction / np.linalg.norm(direction)
    frame = canonical_frame(eye_obj, part.box_centre, part.radius, region, size_px)
    return Camera.from_matrix(frame.matrix, size_px, size_px), frame.canonical_T_obj
