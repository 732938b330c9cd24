"""A camera that is held in the hand: is the part followed while all that is seen goes to and fro?

    python -m benchmarks.camera_shake metal_hard metal_dev own_checking --parts PARTS --split checking --record KEY

Each sequence is tracked forwards, from truth and from 5 degrees and 5 mm off, with defaults: as it is; with a camera
that jerks, turned in every frame by 3 or 6 px (standard deviation, about each axis of the image, and by a tenth of a
degree per px about the line of sight); and with one that sways, by 30 px with periods of 9 and 7 frames. A camera that
turns sees the same in other pixels, so the frames are those that it would have taken, but for the smear of its exposure
and a border that is mirrored. "not asked" is a tracker that does not ask the background how the camera turned. A
frame counts when at least 30% of the part is visible. PARTS holds prepared parts, or one folder of them per data set.

Sequences whose camera shakes as it takes them, smear and all, are made by
`python -m data_recipes.metal_sequences --shake-deg DEG`; for these there is `--as-they-are`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

from acp_lab.commands.machine import limit_threads

limit_threads(1)  # before NumPy is imported

import cv2  # noqa: E402
import numpy as np  # noqa: E402

from acp_lab.evaluation.part_metric import PartMetric  # noqa: E402
from acp_lab.geometry.arrays import ByteImage, FloatArray  # noqa: E402
from acp_lab.sequences.bop import BopScene  # noqa: E402
from acp_lab.tracking.learning.knowledge import Off  # noqa: E402
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

Turns = Callable[[int, float, np.random.Generator], FloatArray]
"""(n, 3) rotation vectors of a camera in n frames, for a focal length in px."""


def main() -> None:
    """See the module."""
    parser = arguments(__doc__)
    parser.add_argument("--as-they-are", action="store_true", help="the cameras of these data sets shake themselves")
    args = parser.parse_args()
    cameras: dict[str, Turns] = {"as it is": still} if args.as_they_are else CAMERAS
    runs_of = partial(_runs, parts=args.parts, method=method_named(args.method), cameras=cameras)
    rows = rows_of(args, runs_of, lambda runs: recalls(run.errors for run in runs))
    record(args, "camera_shake", "cameras in a hand", RECALLS, rows)


def still(count: int, focal_px: float, rng: np.random.Generator) -> FloatArray:
    """A camera that is as it is."""
    return np.zeros((count, 3))


def jerking(count: int, focal_px: float, rng: np.random.Generator, size_px: float) -> FloatArray:
    """Another direction in every frame but the first."""
    turns = rng.normal(size=(count, 3)) * np.array([size_px / focal_px, size_px / focal_px, np.radians(0.1 * size_px)])
    turns[0] = 0.0
    return turns


def swaying(count: int, focal_px: float, rng: np.random.Generator) -> FloatArray:
    """To and fro, and up and down."""
    time = 2.0 * np.pi * np.arange(count)[:, None]
    turns: FloatArray = 30.0 / focal_px * np.sin(time / np.array([9.0, 7.0, np.inf]))
    return turns


CAMERAS: dict[str, Turns] = {
    "on a stand": still,
    "jerks of 3 px": partial(jerking, size_px=3.0),
    "jerks of 6 px": partial(jerking, size_px=6.0),
    "swaying by 30 px": swaying,
}


def turned(one: TrueFrame, turn: FloatArray) -> TrueFrame:
    """A frame as a camera would have taken it that was turned by a rotation vector (3,)."""
    if not turn.any():
        return one
    frame, rotation = one.frame, np.asarray(cv2.Rodrigues(turn)[0])
    moved = frame.camera.matrix @ rotation @ np.linalg.inv(frame.camera.matrix)
    size = frame.image.shape[1::-1]
    taken: ByteImage = np.asarray(
        cv2.warpPerspective(frame.image, moved, size, flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT_101),
        np.uint8,
    )
    truth = one.truth.copy()
    truth[:3] = rotation @ truth[:3]
    return replace(one, frame=replace(frame, image=taken), truth=truth)


def _runs(scene: BopScene, parts: Path, method: Method, cameras: dict[str, Turns]) -> Iterator[ToldRun]:
    model, frames = prepared_part_of(scene, parts), true_frames(scene)
    metric, seed = PartMetric(model.part), [0, scene.scene_id, scene.object_ids[0]]
    for name, turns in cameras.items():
        told = as_taken(_shaken(frames, turns, seed))
        for suffix, one in (("", method), (", not asked", replace(method, camera=Off()))):
            for start in STARTS_TOLD:
                yield ToldRun(name + suffix, start, follow(told, Tracker(model, one), metric, start, seed), np.zeros(0))


def _shaken(frames: Sequence[TrueFrame], turns: Turns, seed: list[int]) -> list[TrueFrame]:
    found = turns(len(frames), frames[0].frame.camera.fx, np.random.default_rng(seed))
    return [turned(one, turn) for one, turn in zip(frames, found, strict=True)]


if __name__ == "__main__":
    main()
