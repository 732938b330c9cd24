"""A camera that reads its picture row by row: is the part followed while it moves, and how exactly?

    python -m benchmarks.rolling_shutter metal_hard metal_dev own_checking --parts PARTS --split checking --record KEY

Each sequence is tracked forwards, from truth and from 5 degrees and 5 mm off, with defaults: as it is; with rows that
are read one after another within half and within 0.9 of the time between two frames; and with columns read one after
another, as where a phone is held upright. Every pixel of the part, and what lies beside it, goes where it is when its
row is read, by the depth of the CAD model at the true pose and the true motion. The truth is the pose when the part's
centre is read. "not asked" is a tracker that takes pictures to be read all at once. A frame counts when at least 30% of
the part is visible. PARTS holds prepared parts, or one folder of them per data set.

Sequences that are rendered row by row are made by `python -m data_recipes.metal_sequences --rolling-shutter SHARE`; for
these there is `--as-they-are`.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

from acp_lab.commands.machine import limit_threads

limit_threads(1)  # before NumPy is imported

import cv2  # noqa: E402
import numpy as np  # noqa: E402

from acp_lab.cad.raycast import RayCaster, make_caster  # noqa: E402
from acp_lab.evaluation.part_metric import PartMetric  # noqa: E402
from acp_lab.geometry.arrays import ByteImage, Float32Array, FloatArray  # noqa: E402
from acp_lab.geometry.camera import Camera  # noqa: E402
from acp_lab.geometry.pose import inverse, transform  # noqa: E402
from acp_lab.geometry.pose_step import pose_step_between  # noqa: E402
from acp_lab.sequences.bop import BopScene  # noqa: E402
from acp_lab.tracking.learning.knowledge import Off, SampleLearning  # noqa: E402
from acp_lab.tracking.method import Method, method_named  # noqa: E402
from acp_lab.tracking.tracker import Tracker  # noqa: E402
from benchmarks.runs import prepared_part_of  # noqa: E402
from benchmarks.told_wrong import (  # noqa: E402
    RECALLS,
    STARTS_TOLD,
    ToldRun,
    TrueFrame,
    arguments,
    as_taken,
    follow,
    recalls,
    record,
    rows_of,
    true_frames,
)

READOUTS = {
    "at once": (0.0, 0.0),
    "rows in 0.5": (0.0, 0.5),
    "rows in 0.9": (0.0, 0.9),
    "columns in 0.9": (0.9, 0.0),
}
"""Share of the time between two frames in which the picture is read, from left to right and from top to bottom."""
_STEP_PX = 4


def main() -> None:
    """See the module."""
    parser = arguments(__doc__)
    parser.add_argument("--as-they-are", action="store_true", help="these data sets were read row by row themselves")
    args = parser.parse_args()
    readouts = {"as it is": (0.0, 0.0)} if args.as_they_are else READOUTS
    runs_of = partial(_runs, parts=args.parts, method=method_named(args.method), readouts=readouts)
    rows = rows_of(args, runs_of, lambda runs: recalls(run.errors for run in runs))
    record(args, "rolling_shutter", "pictures read row by row", RECALLS, rows)


def read_row_by_row(
    frames: Sequence[TrueFrame], readout: tuple[float, float], caster: RayCaster, centre_obj: FloatArray
) -> list[TrueFrame]:
    """Frames as a rolling shutter would have read them."""
    if not any(readout):
        return list(frames)
    found = []
    for k, one in enumerate(frames):
        before, after = max(k - 1, 0), min(k + 1, len(frames) - 1)
        step = pose_step_between(frames[before].truth, frames[after].truth, centre_obj)
        motion = step / max(after - before, 1)
        image = _read(one.frame.image, one.frame.camera, one.truth, motion, readout, caster, centre_obj)
        found.append(replace(one, frame=replace(one.frame, image=image)))
    return found


def _read(
    image: ByteImage, camera: Camera, pose: FloatArray, motion: FloatArray, readout: tuple[float, float],
    caster: RayCaster, centre_obj: FloatArray,
) -> ByteImage:  # fmt: skip
    flow = _flow(camera, pose, motion, caster, centre_obj)
    centre = camera.project(transform(pose, centre_obj)[None])[0]
    u, v = np.meshgrid(np.arange(camera.width, dtype=np.float32), np.arange(camera.height, dtype=np.float32))
    time = readout[0] * (u - centre[0]) / camera.width + readout[1] * (v - centre[1]) / camera.height
    x, y = u, v
    for _ in range(4):  # what shows here comes from where it is while the centre is read
        moves = cv2.remap(flow, _maps(x), _maps(y), cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        x, y = u - time * moves[..., 0], v - time * moves[..., 1]
    read = cv2.remap(image, _maps(x), _maps(y), cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT_101)
    return np.asarray(read, np.uint8)


def _flow(
    camera: Camera, pose: FloatArray, motion: FloatArray, caster: RayCaster, centre_obj: FloatArray
) -> Float32Array:
    """(h, w, 2) px per frame: how what is seen of the part moves, and beside it as the next of it does."""
    u, v = np.meshgrid(np.arange(0.0, camera.width, _STEP_PX), np.arange(0.0, camera.height, _STEP_PX))
    rays = camera.rays(np.stack([u.ravel(), v.ravel()], 1))
    eyes = np.broadcast_to(inverse(pose)[:3, 3], rays.shape)
    distance, face = caster.first_hit(eyes, rays @ pose[:3, :3])
    seen = face >= 0
    flow = np.zeros((len(rays), 2))
    if seen.any():
        points = distance[seen, None] * rays[seen]
        moved = points + motion[3:] + np.cross(motion[:3], points - transform(pose, centre_obj))
        flow[seen] = camera.project(moved) - camera.project(points)
        _, nearest = cv2.distanceTransformWithLabels(
            (~seen).reshape(u.shape).astype(np.uint8), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
        )
        of_label = np.zeros((nearest.max() + 1, 2))
        of_label[nearest.ravel()[seen]] = flow[seen]
        flow = of_label[nearest.ravel()]
    coarse = flow.reshape(*u.shape, 2).astype(np.float32)
    x, y = np.meshgrid(np.arange(camera.width) / _STEP_PX, np.arange(camera.height) / _STEP_PX)
    return _maps(cv2.remap(coarse, _maps(x), _maps(y), cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE))


def _maps(values: np.ndarray) -> Float32Array:
    return np.ascontiguousarray(values, np.float32)


def _runs(scene: BopScene, parts: Path, method: Method, readouts: dict[str, tuple[float, float]]) -> Iterator[ToldRun]:
    model, frames = prepared_part_of(scene, parts), true_frames(scene)
    metric, seed, caster = PartMetric(model.part), [0, scene.scene_id, scene.object_ids[0]], make_caster(model.part)
    assert isinstance(method.learning, SampleLearning)
    unasked = replace(method, learning=replace(method.learning, shutter=Off()))
    for name, readout in readouts.items():
        told = as_taken(read_row_by_row(frames, readout, caster, model.part.box_centre))
        for suffix, one in (("", method), (", not asked", unasked)):
            for start in STARTS_TOLD:
                yield ToldRun(name + suffix, start, follow(told, Tracker(model, one), metric, start, seed), np.zeros(0))


if __name__ == "__main__":
    main()
