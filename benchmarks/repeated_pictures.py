"""A video that shows pictures again: is the part followed as in one that does not?

    python -m benchmarks.repeated_pictures metal_hard metal_dev own_checking --parts PARTS --split checking --record KEY

Each sequence is tracked forwards, from truth and from 5 degrees and 5 mm off, with defaults: as it is; with every
picture twice, to the byte, or as far from it as MPEG-4 leaves it when OpenCV writes the video; and with the last
picture in place of 30% of all, as drivers fill gaps. "taken for new" is a tracker that does not know a picture when it
comes again. Of a row of frames that show the same the last counts, when at least 30% of the part is visible. PARTS
holds prepared parts, or one folder of them per data set.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

from acp_lab.commands.machine import limit_threads

limit_threads(1)  # before NumPy is imported

import cv2  # noqa: E402
import numpy as np  # noqa: E402

from acp_lab.evaluation.part_metric import PartMetric  # noqa: E402
from acp_lab.geometry.arrays import ByteImage  # noqa: E402
from acp_lab.geometry.camera import Camera  # noqa: E402
from acp_lab.geometry.pose import disturb_pose  # noqa: E402
from acp_lab.prepared_part import PreparedPart  # noqa: E402
from acp_lab.sequences.bop import BopScene  # noqa: E402
from acp_lab.sequences.frame import Frame  # noqa: E402
from acp_lab.sequences.images import VideoFile  # noqa: E402
from acp_lab.tracking.method import Method  # noqa: E402
from acp_lab.tracking.repeated_picture import ShownPicture  # noqa: E402
from acp_lab.tracking.tracker import Tracker  # noqa: E402
from benchmarks.robustness import STARTS  # noqa: E402
from benchmarks.runs import prepared_part_of, readable_frames  # noqa: E402
from benchmarks.told_wrong import (  # noqa: E402
    STARTS_TOLD,
    ToldRun,
    TrueFrame,
    main_of_recalls,
    true_frames,
)

HELD = 0.3
"""Share of pictures in whose place the last one comes again."""


class NeverShown(ShownPicture):
    """Knows no picture again."""

    def is_again_in(self, frame: Frame) -> bool:
        """No."""
        return False


class TakesAllForNew(Tracker):
    """Does not know a picture when it comes again."""

    def __init__(self, model: PreparedPart, method: Method) -> None:
        super().__init__(model, method)
        self._shown = NeverShown(model.part, method.margin_px)


def main() -> None:
    """See the module."""
    main_of_recalls(__doc__, "repeated_pictures", "pictures that come again", _runs)


def order_of(name: str, count: int, rng: np.random.Generator) -> list[int]:
    """Which of `count` pictures each frame of a video shows; the first two are always there."""
    if name.startswith("twice"):
        return [number for number in range(count) for _ in range(2)]
    shown: list[int] = []
    for number, is_held in enumerate(rng.random(count) < HELD):
        shown.append(shown[-1] if name == "held" and is_held and number > 1 else number)
    return shown


def compressed(images: Sequence[ByteImage]) -> list[ByteImage]:
    """As a video is read that OpenCV wrote of them, in MPEG-4."""
    height, width = images[0].shape[:2]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "video.mp4"
        writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), 30.0, (width, height))
        for image in images:
            writer.write(cv2.cvtColor(image, cv2.COLOR_RGB2BGR))
        writer.release()
        any_camera = Camera(width, height, width, width, 0.5 * width, 0.5 * height)
        back = [frame.image for frame in readable_frames(VideoFile(path, any_camera))]
    if len(back) != len(images):
        raise SystemExit(f"a video of {len(images)} frames came back with {len(back)}: OpenCV writes no MPEG-4 here")
    return back


def _runs(scene: BopScene, parts: Path, method: Method) -> Iterator[ToldRun]:
    model, frames = prepared_part_of(scene, parts), true_frames(scene)
    seed = [0, scene.scene_id, scene.object_ids[0]]
    for name in ("once", "twice", "once, compressed", "twice, compressed", "held"):
        order = order_of(name, len(frames), np.random.default_rng(seed))
        images = [frames[number].frame.image for number in order]
        if name.endswith("compressed"):
            images = compressed(images)
        trackers = {"": Tracker} if name.startswith("once") else {"": Tracker, ", taken for new": TakesAllForNew}
        for suffix, kind in trackers.items():
            for start in STARTS_TOLD:
                errors = _errors(frames, order, images, kind(model, method), start, np.random.default_rng(seed))
                yield ToldRun(name + suffix, start, errors, np.zeros(0))


def _errors(
    frames: Sequence[TrueFrame], order: Sequence[int], images: Sequence[ByteImage], tracker: Tracker, start: str,
    rng: np.random.Generator,
) -> np.ndarray:  # fmt: skip
    model: PreparedPart = tracker.model
    metric, errors = PartMetric(model.part), list[float]()
    pose = disturb_pose(frames[0].truth, model.part.box_centre, *STARTS[start], rng)
    tracker.start(replace(frames[0].frame, image=images[0]), pose)
    for index in range(1, len(order)):
        one = frames[order[index]]
        result = tracker.track(replace(one.frame, index=index, image=images[index]))
        is_last = index + 1 == len(order) or order[index + 1] != order[index]
        if is_last and order[index] > 0 and one.counts:
            errors.append(metric.share(result.cam_T_obj, one.truth))
    return np.array(errors)


if __name__ == "__main__":
    main()
