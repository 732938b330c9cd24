"""A second look when the fit suddenly gets worse: start also from poses beside the expected one.

On a patterned background the solver can lock on to wrong edges when the part moves further than expected.
The memory of what each edge looked like then says so: the quality drops. Coarse solutions from a ring
of shifted poses are compared by quality, and the best is refined.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from acp_lab.geometry.camera import Camera
from acp_lab.geometry.pose_step import centre_position, move_pose
from acp_lab.tracking.alignment import Aligner, Alignment, Level, Stopwatch
from acp_lab.tracking.targets.image_edges import ImagePatch

COARSE_LEVELS = (Level(14, 4.0), Level(7, 1.5))
FINE_LEVELS = (Level(8, 2.0), Level(5, 1.0))
RING = 8


def shifted_poses(
    cam_T_obj: np.ndarray, centre_obj: np.ndarray, camera: Camera, shift_px: float
) -> tuple[np.ndarray, ...]:
    """Poses (4, 4) whose part appears `shift_px` away from that of `cam_T_obj`, in a ring of eight directions."""
    depth = centre_position(cam_T_obj, centre_obj)[2]
    angles = 2.0 * np.pi * np.arange(RING) / RING
    steps = [
        np.array(
            [0.0, 0.0, 0.0, np.cos(a) * shift_px * depth / camera.fx, np.sin(a) * shift_px * depth / camera.fy, 0.0]
        )
        for a in angles
    ]
    return tuple(move_pose(cam_T_obj, centre_obj, step) for step in steps)


def try_poses(
    aligner: Aligner, patch: ImagePatch, camera: Camera, starts: Iterable[np.ndarray], region: int
) -> Alignment | None:
    """The best alignment from several starts, by quality; None when none sees the part."""
    clock = Stopwatch()
    coarse = [aligner.align(patch, camera, start, region, clock, COARSE_LEVELS) for start in starts]
    found = [alignment for alignment in coarse if alignment is not None]
    if not found:
        return None
    best = max(found, key=lambda alignment: alignment.quality)
    return aligner.align(patch, camera, best.cam_T_obj, region, clock, FINE_LEVELS)
