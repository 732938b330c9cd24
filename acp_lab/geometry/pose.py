"""Rotations, rigid poses and their logarithms, in plain NumPy on single 4x4 arrays.

Convention: `a_T_b` (4, 4) float64 takes coordinates in frame b to frame a, so names compose by adjacency:
`a_T_c = a_T_b @ b_T_c`. A twist is six numbers, the rotation first: (w in rad, v in mm). A small change is
applied on the left, `se3_exp(xi) @ cam_T_obj`, so that a point moves by `w x p + v` in the camera's frame.
With the halves of a twist swapped, millimetres silently become radians.
Source of the closed forms: J. Sola et al., "A micro Lie theory for state estimation in robotics" (2018).
"""

from __future__ import annotations

import math

import numpy as np

from acp_lab.errors import GeometryError
from acp_lab.geometry.arrays import FloatArray

ROTATION_TOLERANCE = 1e-3
"""How far R^T R may be from the identity before a matrix is refused: files round to 4-6 digits."""
_ROUNDING = 1e-9
"""A rotation that is off by no more is taken as it is."""

_SMALL_RAD = 0.1
"""Below it, coefficients that cancel are taken from their series, exact to the last bit here."""


def make_pose(rotation: FloatArray, translation: FloatArray) -> FloatArray:
    """Pose (4, 4) of a rotation (3, 3) and a translation (3,) in mm.

    Raises GeometryError for other shapes: a rotation vector (3,) would make three equal rows.

    Example:
        >>> pose = make_pose(np.eye(3), np.array([0.0, 0.0, 400.0]))
        >>> pose[:3, 3]
        array([  0.,   0., 400.])
    """
    if np.shape(rotation) != (3, 3) or np.size(translation) != 3:
        raise GeometryError(
            f"pose: rotation {np.shape(rotation)}, translation {np.shape(translation)}: give (3, 3) and (3,); the "
            "rotation of a rotation vector (3,) is so3_exp(vector)"
        )
    pose = np.zeros((4, 4))
    pose[3, 3] = 1.0
    pose[:3, :3] = rotation
    pose[:3, 3] = np.reshape(translation, 3)
    return pose


def rotation(pose: FloatArray) -> FloatArray:
    """The (3, 3) rotation of a pose, a view of it; of a stack (..., 4, 4), the stack of views."""
    return pose[..., :3, :3]


def translation(pose: FloatArray) -> FloatArray:
    """The (3,) translation of a pose in mm, a view of it; of a stack (..., 4, 4), the stack of views."""
    return pose[..., :3, 3]


def inverse(pose: FloatArray) -> FloatArray:
    """The pose (4, 4) that undoes a pose (4, 4): b_T_a of a_T_b.

    Example:
        >>> cam_T_obj = make_pose(so3_exp(np.array([0.0, 0.0, 0.5])), np.array([1.0, 2.0, 400.0]))
        >>> np.allclose(inverse(cam_T_obj) @ cam_T_obj, np.eye(4))
        True
    """
    back = pose[:3, :3].T
    return make_pose(back, -back @ pose[:3, 3])


def transform(a_T_b: FloatArray, points_b: FloatArray) -> FloatArray:
    """Points (n, 3), or one point (3,), of frame b in frame a; mm.

    Example:
        >>> cam_T_obj = make_pose(np.eye(3), np.array([0.0, 0.0, 400.0]))
        >>> transform(cam_T_obj, np.array([[10.0, 0.0, 0.0]]))
        array([[ 10.,   0., 400.]])
    """
    return points_b @ a_T_b[:3, :3].T + a_T_b[:3, 3]


def so3_exp(w: FloatArray) -> FloatArray:
    """Rotation (3, 3) about the axis of w (3,) by its length in rad (Rodrigues' formula).

    Example:
        >>> so3_exp(np.array([0.0, 0.0, np.pi / 2])).round(6) @ np.array([1.0, 0.0, 0.0])  # x turns to y
        array([0., 1., 0.])
    """
    x, y, z = float(w[0]), float(w[1]), float(w[2])
    angle = math.sqrt(x * x + y * y + z * z)
    a, b = _sine_coefficients(angle)
    return np.array(_rodrigues(x, y, z, a, b)).reshape(3, 3)


def so3_log(rotation_ab: FloatArray) -> FloatArray:
    """The rotation vector (3,) of a rotation (3, 3), of length 0 to pi rad: the inverse of `so3_exp`.

    At exactly half a turn either sign of the axis is right; one of them is returned.
    """
    q0, qx, qy, qz = _quaternion(rotation_ab)
    sine = math.sqrt(qx * qx + qy * qy + qz * qz)
    # atan2 keeps full precision at both ends, where the arc cosine of the trace keeps half of it.
    scale = 2.0 * math.atan2(sine, q0) / sine if sine > 1e-150 else 2.0
    return np.array([scale * qx, scale * qy, scale * qz])


def se3_exp(xi: FloatArray) -> FloatArray:
    """Pose (4, 4) of a twist (6,) = (rotation rad, translation mm): the screw motion for one unit of time."""
    x, y, z = float(xi[0]), float(xi[1]), float(xi[2])
    u, v, w = float(xi[3]), float(xi[4]), float(xi[5])
    angle = math.sqrt(x * x + y * y + z * z)
    a, b = _sine_coefficients(angle)
    if angle < _SMALL_RAD:
        s = angle * angle
        c = 1.0 / 6.0 - s / 120.0 * (1.0 - s / 42.0 * (1.0 - s / 72.0))
    else:
        c = (1.0 - a) / (angle * angle)
    # t = V v with V = I + b [w]x + c [w]x^2, written out.
    r = _rodrigues(x, y, z, a, b)
    m = _rodrigues(x, y, z, b, c)
    return np.array(
        [
            [r[0], r[1], r[2], m[0] * u + m[1] * v + m[2] * w],
            [r[3], r[4], r[5], m[3] * u + m[4] * v + m[5] * w],
            [r[6], r[7], r[8], m[6] * u + m[7] * v + m[8] * w],
            [0.0, 0.0, 0.0, 1.0],
        ]
    )


def se3_log(pose: FloatArray) -> FloatArray:
    """The twist (6,) = (rotation rad, translation mm) of a pose (4, 4): the inverse of `se3_exp`."""
    w = so3_log(pose[:3, :3])
    x, y, z = float(w[0]), float(w[1]), float(w[2])
    s = x * x + y * y + z * z
    if s < _SMALL_RAD * _SMALL_RAD:
        c = 1.0 / 12.0 + s / 720.0 * (1.0 + s / 42.0 * (1.0 + s / 40.0))
    else:
        half = 0.5 * math.sqrt(s)
        c = (1.0 - half * math.cos(half) / math.sin(half)) / s
    # V^-1 = I - [w]x / 2 + c [w]x^2
    back = np.array(_rodrigues(x, y, z, -0.5, c)).reshape(3, 3)
    return np.concatenate([w, back @ pose[:3, 3]])


def interpolate(pose_a: FloatArray, pose_b: FloatArray, s: float) -> FloatArray:
    """The pose (4, 4) at share s of the screw motion from pose_a (s = 0) to pose_b (s = 1).

    The path does not depend on the frames in which the poses are given; s outside [0, 1] extrapolates.

    Example:
        >>> near, far = make_pose(np.eye(3), np.zeros(3)), make_pose(np.eye(3), np.array([0.0, 0.0, 8.0]))
        >>> interpolate(near, far, 0.25)[:3, 3]
        array([0., 0., 2.])
    """
    return pose_a @ se3_exp(s * se3_log(inverse(pose_a) @ pose_b))


def rotation_angle_deg(rotation_a: FloatArray, rotation_b: FloatArray) -> float:
    """The angle between two rotations (3, 3), 0 to 180 degrees.

    Example:
        >>> round(rotation_angle_deg(np.eye(3), so3_exp(np.array([0.1, 0.0, 0.0]))), 3)
        5.73
    """
    q0, qx, qy, qz = _quaternion(rotation_a.T @ rotation_b)
    return math.degrees(2.0 * math.atan2(math.sqrt(qx * qx + qy * qy + qz * qz), q0))


def check_rotation(matrix: FloatArray, where: str) -> FloatArray:
    """The rotation (3, 3) nearest to a matrix that is one within 1e-3.

    where: what the message is to name, such as "scene_gt.json: frame 3, object 1".
    Raises GeometryError for another shape, numbers that are not finite, scaled, sheared or mirrored matrices.
    """
    r = np.asarray(matrix, dtype=np.float64)
    if r.shape != (3, 3):
        raise GeometryError(f"{where}: rotation has shape {r.shape}: give 3 x 3 numbers, row by row")
    if not np.isfinite(r).all():
        raise GeometryError(f"{where}: rotation holds a number that is not finite: give nine finite numbers")
    off = float(np.abs(r.T @ r - np.eye(3)).max())
    if off > ROTATION_TOLERANCE:
        raise GeometryError(f"{where}: not a rotation (R^T R off the identity by {off:.2g}): give an orthonormal 3 x 3")
    left, _, right = np.linalg.svd(r)
    nearest: FloatArray = left @ right
    if np.linalg.det(nearest) < 0.0:
        raise GeometryError(f"{where}: a mirrored rotation (determinant -1): flip one axis of the matrix")
    return nearest


def check_pose(matrix: FloatArray, where: str) -> FloatArray:
    """A pose (4, 4) as its own array, with the rotation nearest to the given one, unless that is one but for rounding.

    GeometryError when a matrix is no pose: see `check_rotation`; or its numbers are not finite.
    """
    try:
        pose = np.array(matrix, dtype=np.float64, order="C")
    except (TypeError, ValueError):  # the name of a file, for example
        raise GeometryError(f"{where}: no pose of shape (4, 4): read one with read_pose('POSE.json')") from None
    if pose.shape != (4, 4) or not np.array_equal(pose[3], (0.0, 0.0, 0.0, 1.0)):
        raise GeometryError(f"{where}: no pose of shape (4, 4) that ends in 0 0 0 1: make one with make_pose")
    nearest = check_rotation(pose[:3, :3], where)
    if not np.isfinite(pose).all():
        raise GeometryError(f"{where}: the translation is not finite: give three numbers in mm")
    if np.abs(nearest - pose[:3, :3]).max() > _ROUNDING:
        pose[:3, :3] = nearest
    return pose


def disturb_pose(
    cam_T_obj: FloatArray, centre_obj: FloatArray, angle_deg: float, shift_mm: float, rng: np.random.Generator
) -> FloatArray:
    """A start pose (4, 4) with exactly known error, for start noise and training.

    Turns the object by exactly angle_deg about a random axis through centre_obj (3,), mm, and moves that
    centre by exactly shift_mm in a random direction. The draws do not depend on the two amounts, so one seed
    gives the same directions at every size of disturbance.

    Example:
        >>> truth = make_pose(np.eye(3), np.array([0.0, 0.0, 400.0]))
        >>> start = disturb_pose(truth, np.zeros(3), angle_deg=5.0, shift_mm=3.0, rng=np.random.default_rng(0))
        >>> round(rotation_angle_deg(truth[:3, :3], start[:3, :3]), 6)
        5.0
        >>> round(float(np.linalg.norm(start[:3, 3] - truth[:3, 3])), 6)
        3.0
    """
    axis, direction = (_random_direction(rng) for _ in range(2))
    turned = so3_exp(math.radians(angle_deg) * axis) @ cam_T_obj[:3, :3]
    centre_cam = transform(cam_T_obj, np.asarray(centre_obj, dtype=np.float64)) + shift_mm * direction
    return make_pose(turned, centre_cam - turned @ centre_obj)


def _random_direction(rng: np.random.Generator) -> FloatArray:
    # Normal draws have no preferred direction; a length near zero has probability ~0 but would lose digits.
    while True:
        v = rng.standard_normal(3)
        length = float(np.linalg.norm(v))
        if length > 1e-3:
            return v / length


def _sine_coefficients(angle: float) -> tuple[float, float]:
    """sin(a) / a and (1 - cos(a)) / a^2, the latter through the half angle: no cancellation."""
    if angle < 1e-100:
        return 1.0, 0.5
    half = math.sin(0.5 * angle) / (0.5 * angle)
    return math.sin(angle) / angle, 0.5 * half * half


def _rodrigues(x: float, y: float, z: float, a: float, b: float) -> tuple[float, ...]:
    """I + a [w]x + b [w]x^2 for w = (x, y, z), nine numbers row by row."""
    return (
        1.0 - b * (y * y + z * z),
        b * x * y - a * z,
        b * x * z + a * y,
        b * x * y + a * z,
        1.0 - b * (x * x + z * z),
        b * y * z - a * x,
        b * x * z - a * y,
        b * y * z + a * x,
        1.0 - b * (x * x + y * y),
    )


def _quaternion(r: FloatArray) -> tuple[float, float, float, float]:
    """Quaternion (w, x, y, z), w >= 0, through its largest component (Shepperd), good at every angle."""
    (a, xy, xz), (yx, b, yz), (zx, zy, c) = r.tolist()
    trace = a + b + c
    if trace >= max(a, b, c):
        q = (1.0 + trace, zy - yz, xz - zx, yx - xy)
    elif a >= b and a >= c:
        q = (zy - yz, 1.0 + a - b - c, yx + xy, xz + zx)
    elif b >= c:
        q = (xz - zx, yx + xy, 1.0 - a + b - c, zy + yz)
    else:
        q = (yx - xy, xz + zx, zy + yz, 1.0 - a - b + c)
    length = math.copysign(math.sqrt(sum(p * p for p in q)), q[0])
    return q[0] / length, q[1] / length, q[2] / length, q[3] / length
