"""The two redundant degrees of freedom: eight image coordinates, of which a rigid part moves along six directions.

The paper relies on the other two for "a flexible iterative path" (section IV-B). Here they are computed, and it is
measured how far a tracker moved along them: the misfit between its I and the points reprojected from the PnP pose.

Convention: I is (4, 2) px or flat (8,) in the order x1, y1, ..., y4; poses cam_T_obj, mm.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from acp_lab.cad.part import Part
from acp_lab.evaluation import PartMetric
from acp_lab.geometry.arrays import FloatArray, IntArray
from acp_lab.geometry.camera import Camera
from acp_lab.geometry.pose import transform
from acp_lab.geometry.pose_step import control_point_jacobian
from acp_lab.sequences.bop import BopScene
from acp_lab.tracking.session import TrackRun

_MOST_VERTICES = 1000


def redundant_directions(
    points_obj: FloatArray, cam_T_obj: FloatArray, centre_obj: FloatArray, camera: Camera
) -> FloatArray:
    """(2, 8) unit directions of I, orthogonal to each other and to every change of I by a rigid motion.

    points_obj: (4, 3) W, mm; centre_obj: (3,) mm, the part's centre. To first order, at the pose.
    """
    points_cam, centre_cam = transform(cam_T_obj, points_obj), transform(cam_T_obj, centre_obj)
    basis, _ = np.linalg.qr(control_point_jacobian(points_cam, centre_cam, camera), mode="complete")
    return np.asarray(basis[:, 6:].T, dtype=np.float64)


def rigid_share(step: FloatArray, redundant: FloatArray) -> float:
    """The share of a step's squared length (8,) px that a rigid motion explains; redundant: (2, 8)."""
    flat = np.asarray(step, dtype=np.float64).reshape(8)
    return 1.0 - float(((redundant @ flat) ** 2).sum() / (flat @ flat))


def misfit_px(control_points: FloatArray, points_obj: FloatArray, cam_T_obj: FloatArray, camera: Camera) -> float:
    """Rms distance in px from I (4, 2) to the reprojection of W (4, 3) mm at a pose (4, 4)."""
    off = camera.project(transform(cam_T_obj, points_obj)) - control_points
    return float(np.sqrt((off**2).sum() / 4.0))


@dataclass(frozen=True, eq=False)
class Drift:
    """How far a run moved from what a rigid part can show. frame_ids, misfits_px, errors (ADD(-S) as
    share of the diameter): (n,)."""

    frame_ids: IntArray
    misfits_px: FloatArray
    errors: FloatArray


def drift(run: TrackRun, scene: BopScene, part: Part, points_of_region: Callable[[int], FloatArray]) -> Drift:
    """Misfit and error of each frame of a run over a scene with one object and a truth for every frame.

    points_of_region: W (4, 3) mm of a view region, as the tracker used it.
    """
    metric = PartMetric(part, _MOST_VERTICES)
    ((object_id, results),) = run.results.items()
    rows = []
    for result in results:
        truth = scene.truth(result.frame_id, object_id)
        assert truth is not None, "drift is measured on scenes with truth"
        points_obj = points_of_region(result.region)
        off = misfit_px(result.control_points, points_obj, result.cam_T_obj, scene.camera(result.frame_id))
        rows.append((result.frame_id, off, metric.share(result.cam_T_obj, truth)))
    frame_ids, misfits, errors = np.array(rows).T
    return Drift(frame_ids.astype(int), misfits, errors)
