"""Smooth random motions with a given mean speed.

A dense path is drawn first, without regard to speed, then resampled at the speed asked for. So "2 degrees per frame" is
what the truth has, whatever the path. Between frames the pose follows a cubic spline in
translation and `RotationSpline` in rotation, so an exposure can be integrated about the exact pose of a frame.
Convention: time in frames; frame k has its mid exposure at time k; poses are 4x4, `a_T_b`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation, RotationSpline

from acp_lab.geometry.pose import make_pose, so3_exp

# A hand goes to and fro some seven times a second, in thirty frames of it; and not about the middle of the lens.
_SHAKE_FRAMES, _SHAKE_MM_PER_DEG = 2, 2.5


@dataclass(frozen=True, eq=False)
class PosePath:
    """Poses (k, 4, 4) at times 0..k-1 and a smooth pose at any time between (clamped outside)."""

    poses: np.ndarray

    def at(self, time: float) -> np.ndarray:
        """Pose (4, 4); at whole times exactly the stored one."""
        last = len(self.poses) - 1
        nearest = int(np.clip(round(time), 0, last))
        if last == 0 or time == nearest:
            return np.asarray(self.poses[nearest])
        # A window is enough for a smooth path and keeps the cost independent of the length.
        low = int(np.clip(nearest - 3, 0, max(last - 6, 0)))
        window = np.arange(low, min(low + 7, last + 1))
        s = float(np.clip(time, -0.5, last + 0.5))
        turn = RotationSpline(window, Rotation.from_matrix(self.poses[window, :3, :3]))
        shift = CubicSpline(window, self.poses[window, :3, 3])
        return make_pose(turn(s).as_matrix(), shift(s))


def shake(rng: np.random.Generator, frames: int, turn_deg: float) -> PosePath:
    """now_T_steady of a camera in a hand: its turns' root mean square is turn_deg, and shifts go with them."""
    wave = smooth_numbers(rng, max(4, frames // _SHAKE_FRAMES), 6, frames)
    wave /= max(float(np.sqrt(np.square(wave[:, :3]).sum(1).mean())), 1e-9)
    turns, shifts = np.radians(turn_deg) * wave[:, :3], turn_deg * _SHAKE_MM_PER_DEG * wave[:, 3:]
    return PosePath(np.stack([make_pose(so3_exp(w), t) for w, t in zip(turns, shifts, strict=True)]))


def smooth_numbers(rng: np.random.Generator, knots: int, channels: int, count: int) -> np.ndarray:
    """(count, channels) samples of a cubic spline through `knots` random numbers in [-1, 1]."""
    knots = max(knots, 2)
    values = rng.uniform(-1, 1, (knots, channels))
    if knots == 2:
        return np.linspace(values[0], values[1], count)
    spline = CubicSpline(np.arange(knots), values, bc_type="natural")
    return np.clip(spline(np.linspace(0, knots - 1, count)), -1, 1)


def speed_profile(rng: np.random.Generator, frames: int, mean: float, limit: float) -> np.ndarray:
    """Steps (frames - 1,) with the given mean, varying smoothly by about a third, none above `limit`."""
    if frames < 2:
        return np.zeros(0)
    wave = smooth_numbers(rng, max(3, frames // 7), 1, frames - 1)[:, 0]
    steps = mean * (1 + 0.4 * (wave - wave.mean()))
    return np.minimum(steps * mean / max(steps.mean(), 1e-9), limit)


def walk(rotations: np.ndarray, steps_deg: np.ndarray) -> np.ndarray:
    """Rotations (k+1, 3, 3) along a dense path (m, 3, 3) so that neighbours differ by steps_deg (k,).

    Raises ValueError when the path is too short for the steps.
    """
    between = Rotation.from_matrix(rotations[:-1].transpose(0, 2, 1) @ rotations[1:]).magnitude()
    travelled = np.concatenate([[0.0], np.cumsum(between)])
    want = np.concatenate([[0.0], np.cumsum(np.deg2rad(steps_deg))])
    if want[-1] > travelled[-1]:
        raise ValueError(f"path of {np.rad2deg(travelled[-1]):.0f} deg is shorter than {np.rad2deg(want[-1]):.0f} deg")
    keep = np.concatenate([[True], np.diff(travelled) > 1e-12])
    index = np.interp(want, travelled[keep], np.flatnonzero(keep))
    low = np.minimum(index.astype(int), len(rotations) - 2)
    part = Rotation.from_matrix(rotations[low].transpose(0, 2, 1) @ rotations[low + 1]).as_rotvec()
    return np.stack([rotations[i] @ so3_exp(w * s) for i, w, s in zip(low, part, index - low, strict=True)])


def look_from(azimuth: float, elevation: float, roll: float = 0.0) -> np.ndarray:
    """cam_R_world (3, 3) of a camera that looks at the origin; azimuth, elevation above the table and roll in rad."""
    to_camera = np.array([np.cos(azimuth) * np.cos(elevation), np.sin(azimuth) * np.cos(elevation), np.sin(elevation)])
    z = -to_camera
    x = np.cross(z, [0.0, 0.0, 1.0])
    x /= np.linalg.norm(x)
    y = np.cross(z, x)
    c, s = np.cos(roll), np.sin(roll)
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]]) @ np.stack([x, y, z])


def orbit_rotations(rng: np.random.Generator, total_deg: float, count: int = 1200) -> np.ndarray:
    """Dense cam_R_world path (count, 3, 3) of a camera that wanders round a part on the table."""
    knots = max(3, int(total_deg / 40) + 2)
    wander = smooth_numbers(rng, knots, 2, count)
    way = np.linspace(0, 1, count) * np.deg2rad(1.5 * total_deg + 40)
    sway = 0.25 * smooth_numbers(rng, knots, 1, count)[:, 0]
    azimuth = rng.uniform(0, 2 * np.pi) + rng.choice([-1.0, 1.0]) * way + sway
    elevation = np.deg2rad(50 + 13 * wander[:, 0])
    roll = np.deg2rad(14 * wander[:, 1]) + rng.uniform(-0.3, 0.3)
    return np.stack([look_from(a, e, r) for a, e, r in zip(azimuth, elevation, roll, strict=True)])


def tumble_rotations(rng: np.random.Generator, total_deg: float, steady: bool, count: int = 1200) -> np.ndarray:
    """Dense cam_R_obj path (count, 3, 3): a part turned in the air, about one steady axis or a wandering one."""
    start = look_from(rng.uniform(0, 2 * np.pi), np.deg2rad(rng.uniform(25, 60)), rng.uniform(-0.4, 0.4))
    axis0 = rng.standard_normal(3) * np.array([1.0, 1.0, 0.45])  # more out of the image plane than within it
    if steady:
        axis0 = np.array([0.25 * rng.standard_normal(), 1.0, 0.35 * rng.standard_normal()]) * rng.choice([-1.0, 1.0])
        drift = 0.12
    else:
        drift = 1.1
    axis0 /= np.linalg.norm(axis0)
    axes = axis0 + drift * smooth_numbers(rng, max(3, int(total_deg / 35) + 2), 3, count)
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    step = np.deg2rad(1.15 * total_deg + 5) / (count - 1)
    rotations = [start]
    for axis in axes[:-1]:
        rotations.append(so3_exp(axis * step) @ rotations[-1])
    return np.stack(rotations)


def wander(rng: np.random.Generator, frames: int, mean_mm: float, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Translations (frames, 3) in the box [low, high] whose mean step is mean_mm, or what the box allows."""
    middle, half = (low + high) / 2, (high - low) / 2
    if frames < 2:
        return middle + half * 0.3 * rng.uniform(-1, 1, (frames, 3))
    best = np.zeros((frames, 3))
    for knots in range(3, max(4, frames // 4) + 2):
        best = smooth_numbers(rng, knots, 3, frames)
        step = float(np.linalg.norm(np.diff(best * half, axis=0), axis=1).mean())
        if step >= mean_mm:
            return np.asarray(middle + half * best * mean_mm / step)
    return np.asarray(middle + half * best)
