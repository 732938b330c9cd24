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

import argparse
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
from acp_lab.geometry.pose import disturb_pose, transform  # noqa: E402
from acp_lab.sequences.bop import BopDataset, BopScene  # noqa: E402
from acp_lab.sequences.frame import Frame  # noqa: E402
from acp_lab.tracking.method import Method, method_named  # noqa: E402
from acp_lab.tracking.tracker import Tracker  # noqa: E402
from benchmarks import measured  # noqa: E402
from benchmarks.robustness import SPLITS, is_in_split  # noqa: E402
from benchmarks.runs import LOST, STARTS, part_name, prepared_part_of, visible_frames  # noqa: E402

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
UNIT = {
    "@*": "share of frames with ADD (ADD-S) below 2, 5% of the diameter, to the pose that explains the image best",
    "lost": "runs in which that was ever above 30%",
    "runs": "runs",
    "misfit": "px that no pose explains, root mean square over the frames of all sequences",
    "moved": "ADD (ADD-S) of the pose that explains the image best, to the truth, as a share of the diameter, median",
}


@dataclass(frozen=True)
class Told:
    """A frame as it is with the wrong camera.

    best: the pose that explains it; moved: how far that is from the truth, in diameters; counts: whether enough of the
    part is visible.
    """

    frame: Frame
    best: PointPnP
    moved: float
    counts: bool


@dataclass(frozen=True)
class CameraRun:
    """A run with a wrong camera, the first frame left out.

    errors: of the frames that count; misfit_px, moved: of all of them. ADD(-S) as a share of the diameter.
    """

    camera: str
    start: str
    errors: FloatArray
    misfit_px: FloatArray
    moved: FloatArray


def main() -> None:
    """See the module."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("datasets", nargs="+", type=Path)
    parser.add_argument("--parts", type=Path, required=True)
    parser.add_argument("--method", default="acp")
    parser.add_argument("--split", choices=SPLITS, default="all")
    parser.add_argument("--record", metavar="KEY")
    args = parser.parse_args()
    runs: list[CameraRun] = []
    for root in args.datasets:
        for scene_id in BopDataset(root).scenes():
            scene = BopDataset(root).open_scene(scene_id)
            if is_in_split(part_name(root, scene.object_ids[0]), args.split):
                new = list(_runs(scene, args.parts, method_named(args.method)))
                told = [f"{run.camera}, {run.start}: {100 * np.median(run.errors):.1f}%" for run in new]
                print(root.name, scene_id, *told, sep="  ", flush=True)
                runs += new
    values = {
        f"{camera}, {start}": _row([run for run in runs if (run.camera, run.start) == (camera, start)])
        for camera in CAMERAS
        for start in ("truth", "5")
    }
    for name, row in values.items():
        print(name, row)
    if args.record:
        about = f"a camera that is not calibrated well; tracker {args.method}, forwards, parts for {args.split}"
        names = ", ".join(root.name for root in args.datasets)
        measured.record(f"wrong_camera.{args.record}", about, UNIT, names, values)


def explained(part: Part, cam_T_obj: FloatArray, camera: Camera, wrong: Camera) -> PointPnP:
    """The pose at which a part appears through a wrong camera, its lens taken out, as it does through the true one."""
    chosen = np.random.default_rng(0).permutation(len(part.vertices))[:POINTS]
    pixels = camera.project(transform(cam_T_obj, part.vertices[chosen]))
    if wrong.is_distorted:
        pixels = cv2.undistortPoints(pixels, wrong.matrix, np.asarray(wrong.dist), P=wrong.matrix).reshape(-1, 2)
    return solve_point_pnp(part.vertices[chosen], pixels, wrong.pinhole())


def _runs(scene: BopScene, parts: Path, method: Method) -> Iterator[CameraRun]:
    object_id = scene.object_ids[0]
    model = prepared_part_of(scene, parts)
    metric = PartMetric(model.part)
    frames = [frame for frame in scene.frames() if isinstance(frame, Frame)]
    truths = {f.index: truth for f in frames if (truth := scene.truth(f.index, object_id)) is not None}
    counts = visible_frames(scene.folder, object_id, truths)
    frames = [frame for frame in frames if frame.index in truths]
    frames = frames[next(number for number, frame in enumerate(frames) if counts[frame.index]) :]
    for name, wrong in CAMERAS.items():
        told = list[Told]()
        for frame in frames:
            camera, truth = wrong(frame.camera), truths[frame.index]
            best = explained(model.part, truth, frame.camera, camera)
            seen = replace(frame, image=Undistorter(camera)(frame.image), camera=camera.pinhole())
            told.append(Told(seen, best, metric.share(best.cam_T_obj, truth), counts[frame.index]))
        for start in ("truth", "5"):
            rng = np.random.default_rng([0, scene.scene_id, object_id])
            pose = disturb_pose(told[0].best.cam_T_obj, model.part.box_centre, *STARTS[start], rng)
            yield CameraRun(
                name,
                start,
                _errors(told, pose, Tracker(model, method), metric),
                np.array([one.best.rms_px for one in told[1:]]),
                np.array([one.moved for one in told[1:]]),
            )


def _errors(told: list[Told], start: FloatArray, tracker: Tracker, metric: PartMetric) -> FloatArray:
    errors = list[float]()
    tracker.start(told[0].frame, start)
    for one in told[1:]:
        result = tracker.track(one.frame)
        if one.counts:
            errors.append(metric.share(result.cam_T_obj, one.best.cam_T_obj))
    return np.array(errors)


def _row(runs: list[CameraRun]) -> dict[str, float]:
    return {
        "@2": float(np.mean([(run.errors < 0.02).mean() for run in runs])),
        "@5": float(np.mean([(run.errors < 0.05).mean() for run in runs])),
        "lost": sum(bool((run.errors > LOST).any()) for run in runs),
        "runs": len(runs),
        "misfit": float(np.sqrt(np.mean(np.concatenate([run.misfit_px for run in runs]) ** 2))),
        "moved": float(np.median(np.concatenate([run.moved for run in runs]))),
    }


if __name__ == "__main__":
    main()
