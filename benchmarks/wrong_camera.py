"""How well must a camera be calibrated?

    python -m benchmarks.wrong_camera metal_hard metal_dev own_checking --parts PARTS --split checking --record checking

The tracker is told of a camera that is not the one that took the images (`CAMERAS`): its focal length or its principal
point is wrong, its pixels are not as wide as they are high, or a distortion is taken out that was not there. Forwards,
from truth and from 5 degrees and 5 mm off, with defaults.

Such a camera cannot show the part where it is: the same image means another pose, in another distance. So errors are
measured against the pose that explains each image best through the wrong camera, by least squares over the mesh's
vertices. Misfit: what is left of those squares, root mean square. Moved: how far that pose is from the truth, ADD. A
frame counts when at least 30% of the part is visible. PARTS holds prepared parts, or one folder of them per data set.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from acp_lab.commands.machine import limit_threads

limit_threads(1)  # before NumPy is imported

import cv2  # noqa: E402
import numpy as np  # noqa: E402

from acp_lab.cad.part import Part  # noqa: E402
from acp_lab.evaluation.part_metric import PartMetric  # noqa: E402
from acp_lab.geometry.arrays import FloatArray  # noqa: E402
from acp_lab.geometry.camera import Camera, Undistorter  # noqa: E402
from acp_lab.geometry.point_pnp import PointPnP, solve_point_pnp  # noqa: E402
from acp_lab.geometry.pose import transform  # noqa: E402
from acp_lab.sequences.bop import BopScene  # noqa: E402
from acp_lab.tracking.method import Method, method_named  # noqa: E402
from acp_lab.tracking.tracker import Tracker  # noqa: E402
from benchmarks.runs import prepared_part_of  # noqa: E402
from benchmarks.told_wrong import (  # noqa: E402
    STARTS_TOLD,
    UNIT,
    Told,
    ToldRun,
    arguments,
    follow,
    record,
    row_of,
    rows_of,
    true_frames,
)

POINTS = 200
"""Vertices that say which pose explains an image."""


def _focal(times: float) -> Callable[[Camera], Camera]:
    return lambda camera: replace(camera, fx=times * camera.fx, fy=times * camera.fy)


def _centre(share: float) -> Callable[[Camera], Camera]:
    return lambda camera: replace(camera, cx=camera.cx + share * camera.width, cy=camera.cy - share * camera.width)


def _high(times: float) -> Callable[[Camera], Camera]:
    return lambda camera: replace(camera, fy=times * camera.fy)


def _bent(k1: float) -> Callable[[Camera], Camera]:
    return lambda camera: replace(camera, dist=(k1, 0.0, 0.0, 0.0, 0.0))


CAMERAS: dict[str, Callable[[Camera], Camera]] = {
    "as it is": _focal(1.0),
    "focal length x0.95": _focal(0.95),
    "focal length x1.05": _focal(1.05),
    "focal length x1.15": _focal(1.15),
    "principal point 0.03 off": _centre(0.03),
    "distortion -0.1": _bent(-0.1),
    "distortion 0.1": _bent(0.1),
    "pixels 0.01 too high": _high(1.01),
    "pixels 0.03 too high": _high(1.03),
}
MISFIT = {"misfit": "px that no pose explains, root mean square over the frames of all sequences"}


@dataclass(frozen=True)
class CameraRun(ToldRun):
    """A run with a wrong camera. misfit_px: of all frames but the first."""

    misfit_px: FloatArray


def main() -> None:
    """See the module."""
    args = arguments(__doc__).parse_args()
    rows = rows_of(args, lambda scene: _runs(scene, args.parts, method_named(args.method)), _row)
    record(args, "wrong_camera", "a camera that is not calibrated well", UNIT | MISFIT, rows)


def explained(part: Part, cam_T_obj: FloatArray, camera: Camera, wrong: Camera) -> PointPnP:
    """The pose at which a part appears through a wrong camera, its lens taken out, as it does through the true one."""
    chosen = np.random.default_rng(0).permutation(len(part.vertices))[:POINTS]
    pixels = camera.project(transform(cam_T_obj, part.vertices[chosen]))
    if wrong.is_distorted:
        undistorted = cv2.undistortPoints(pixels, wrong.matrix, np.asarray(wrong.dist), P=wrong.matrix)
        pixels = np.asarray(undistorted, np.float64).reshape(-1, 2)
    return solve_point_pnp(part.vertices[chosen], pixels, wrong.pinhole())


def _runs(scene: BopScene, parts: Path, method: Method) -> Iterator[CameraRun]:
    model, frames = prepared_part_of(scene, parts), true_frames(scene)
    metric = PartMetric(model.part)
    for name, wrong in CAMERAS.items():
        told, misfit_px, moved = list[Told](), list[float](), list[float]()
        for one in frames:
            camera = wrong(one.frame.camera)
            best = explained(model.part, one.truth, one.frame.camera, camera)
            seen = replace(one.frame, image=Undistorter(camera)(one.frame.image), camera=camera.pinhole())
            told.append(Told(seen, best.cam_T_obj, one.counts))
            misfit_px.append(best.rms_px)
            moved.append(metric.share(best.cam_T_obj, one.truth))
        for start in STARTS_TOLD:
            errors = follow(told, Tracker(model, method), metric, start, (0, scene.scene_id, scene.object_ids[0]))
            yield CameraRun(name, start, errors, np.array(moved[1:]), np.array(misfit_px[1:]))


def _row(runs: list[CameraRun]) -> dict[str, float]:
    misfits_px = np.concatenate([run.misfit_px for run in runs])
    return row_of(runs) | {"misfit": float(np.sqrt(np.mean(misfits_px**2)))}


if __name__ == "__main__":
    main()
