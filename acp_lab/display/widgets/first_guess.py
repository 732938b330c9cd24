"""Where the part is put before anybody said anything: in the middle of the image, or seen from a face of its box."""

from __future__ import annotations

import numpy as np

from acp_lab.control_points.view_regions import ALL_REGIONS
from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.pose import make_pose
from acp_lab.prepared_part import PreparedPart
from acp_lab.sequences.frame import Frame


def pose_in_the_middle(model: PreparedPart, frame: Frame) -> FloatArray:
    """(4, 4): the part's +z side in the middle of the image, half as large as it."""
    camera, part = frame.camera, model.part
    middle = np.array([[0.5 * (camera.width - 1), 0.5 * (camera.height - 1)]])
    distance = camera.fx * part.radius / (0.25 * min(camera.width, camera.height))
    rotation = rotation_seeing(4)
    return make_pose(rotation, distance * camera.rays(middle)[0] - rotation @ part.box_centre)


def rotation_seeing(region: int) -> FloatArray:
    """(3, 3) object to camera axes: looks at a face 0..5 of the box, 25 degrees from the side and above."""
    view = ALL_REGIONS[region]
    outward = np.zeros(3)
    outward[view.axis] = view.sign
    side = np.cross(view.up_obj, outward)
    to_eye = outward + np.tan(np.radians(25.0)) * 0.7 * (side + view.up_obj)
    z_axis = -to_eye / np.linalg.norm(to_eye)
    x_axis = np.cross(z_axis, view.up_obj)
    x_axis /= np.linalg.norm(x_axis)
    rotation: FloatArray = np.stack([x_axis, np.cross(z_axis, x_axis), z_axis])
    return rotation
