"""A hand for the widgets, without a browser: the messages that the front end would send."""

from __future__ import annotations

import numpy as np

from acp_lab.display.widgets.point_canvas import PointCanvas
from acp_lab.display.widgets.pose_aligner import PoseAligner
from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.pose import so3_exp
from acp_lab.geometry.pose_step import centre_position, move_pose
from acp_lab.prepared_part import PreparedPart
from acp_lab.sequences.frame import Frame


def drag(canvas: PointCanvas, index: int, target: FloatArray, steps: int = 4) -> None:
    """Drag one point to a pixel (2,) in a few animation frames; the message that lets go tells the last place."""
    start = canvas.points[index]
    for step in range(1, steps + 1):
        points = canvas.points.tolist()
        points[index] = (start + (np.asarray(target) - start) * step / steps).tolist()
        canvas.set_state({"points": points, "dragging": step < steps})


def view_from_beside(
    model: PreparedPart, frame: Frame, truth: FloatArray, turn_deg: float, shift_px: float, rng: np.random.Generator
) -> FloatArray:
    """A pose whose view of the part is turned about a random axis and appears `shift_px` away from the true one."""
    axis = rng.normal(size=3)
    axis *= np.radians(turn_deg) / np.linalg.norm(axis)
    way = rng.uniform(0.0, 2.0 * np.pi)
    centre = centre_position(truth, model.part.box_centre)
    across = shift_px * centre[2] / frame.camera.fx * np.array([np.cos(way), np.sin(way), 0.0])
    moved = move_pose(truth, model.part.box_centre, np.concatenate([axis, across]))
    np.testing.assert_allclose(moved[:3, :3] @ truth[:3, :3].T, so3_exp(axis), atol=1e-9)
    return moved


def drag_onto_the_part(aligner: PoseAligner, truth: FloatArray, error_px: float, rng: np.random.Generator) -> None:
    """Drag each of the four points to within `error_px` of where the true pose has it, each way."""
    for index, target in enumerate(aligner.points_at(truth)):
        drag(aligner.editor, index, target + rng.uniform(-error_px, error_px, 2))
