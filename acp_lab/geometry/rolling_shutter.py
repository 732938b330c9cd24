"""Where a picture that is read row by row shows what moves while it is read.

A rolling shutter reads a picture's rows one after another, in most of the time between two frames. What moves is seen
at another time by each row: sheared, stretched or shortened. A pose is that of the moment at which the part's centre is
read.
(Not in the paper; see docs/paper-ledger.md.)
"""

from __future__ import annotations

import numpy as np

from acp_lab.compiled import kernel
from acp_lab.geometry.arrays import FloatArray, plain
from acp_lab.geometry.camera import Camera


def read_places(
    points: FloatArray,
    points_obj: FloatArray,
    cam_T_obj: FloatArray,
    centre_obj: FloatArray,
    camera: Camera,
    motion: FloatArray,
    readout: FloatArray,
) -> FloatArray:
    """(n, 2) px where points show that are at (n, 2) px while the part's centre is read.

    Those of points behind the camera stay.

    Args:
        points_obj: (n, 3) mm, their places on the part; cam_T_obj: (4, 4) the pose of that moment.
        centre_obj: (3,) mm, the part's centre.
        motion: (6,) the pose step (rad, mm) about it from frame to frame.
        readout: (2,) by what share of the time between two frames the picture's right edge is read later than its left
            one, and its bottom later than its top.
    """
    found = np.empty((len(points), 2))
    late = np.array([readout[0] / camera.width, readout[1] / camera.height])
    _read_places(
        plain(points), plain(points_obj), plain(cam_T_obj), plain(centre_obj), camera.numbers, plain(motion), late,
        found,
    )  # fmt: skip
    return found


@kernel("void(f8[:, ::1], f8[:, ::1], f8[:, ::1], f8[::1], f8[::1], f8[::1], f8[::1], f8[:, ::1])")
def _read_places(
    points: FloatArray, points_obj: FloatArray, pose: FloatArray, centre_obj: FloatArray, camera: FloatArray,
    motion: FloatArray, late: FloatArray, found: FloatArray,
) -> None:  # fmt: skip
    """Fill found (n, 2), see `read_places`; camera: see `Camera.numbers`; late: (2,) frames per px."""
    fx, fy = camera[0], camera[1]
    middle, arm, at = np.empty(3), np.empty(3), np.empty(3)
    for k in range(3):
        middle[k] = pose[k, 3]
        for j in range(3):
            middle[k] += pose[k, j] * centre_obj[j]
    if not middle[2] > 0.0:
        found[:] = points
        return
    u, v = fx * middle[0] / middle[2] + camera[2], fy * middle[1] / middle[2] + camera[3]
    for i in range(len(points)):
        for k in range(3):
            arm[k] = 0.0
            for j in range(3):
                arm[k] += pose[k, j] * (points_obj[i, j] - centre_obj[j])
            at[k] = middle[k] + arm[k]
        # mm per frame. That it is read by another row where it shows is left out: an effect of second order.
        x = motion[3] + motion[1] * arm[2] - motion[2] * arm[1]
        y = motion[4] + motion[2] * arm[0] - motion[0] * arm[2]
        z = motion[5] + motion[0] * arm[1] - motion[1] * arm[0]
        time = late[0] * (points[i, 0] - u) + late[1] * (points[i, 1] - v)
        then = at[2] + time * z
        if not (at[2] > 0.0 and then > 0.0):
            found[i, 0], found[i, 1] = points[i, 0], points[i, 1]
            continue
        found[i, 0] = points[i, 0] + fx * ((at[0] + time * x) / then - at[0] / at[2])
        found[i, 1] = points[i, 1] + fy * ((at[1] + time * y) / then - at[1] / at[2])
