"""What a replay shows of each frame, gathered from its chunks; for films and for whoever has no viewer."""

from __future__ import annotations

from bisect import bisect_right
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from acp_lab.display.replay.file import ReplayContent, frames_of

if TYPE_CHECKING:
    from rerun.chunk import Chunk

_DEFAULT_FPS = 30.0


@dataclass
class ShownObject:
    """One object in one frame, in rerun's pixels (corner of the top-left pixel at 0).

    Attributes:
        strokes: (n, 2, 2) generated edges; colours: (n, 3) uint8 RGB, theirs.
        quad: (4, 2) the control points, or None.
        state: such as "tracking"; quality in [0, 1]; add_percent of the diameter, NaN without truth.
    """

    strokes: NDArray[np.float32] = field(default_factory=lambda: np.zeros((0, 2, 2), np.float32))
    colours: NDArray[np.uint8] = field(default_factory=lambda: np.zeros((0, 3), np.uint8))
    quad: NDArray[np.float32] | None = None
    state: str = ""
    quality: float = float("nan")
    add_percent: float = float("nan")


@dataclass
class ShownFrame:
    """One frame. jpeg: the image, None where there is none; time_s: on the replay's timeline; scene: its sequence.

    is_left_out: the replay keeps no images from somewhere before on, to stay small; else one that is missing could not
    be read. objects: only those that were tracked in this frame.
    """

    image_id: int = 0
    time_s: float = 0.0
    jpeg: bytes | None = None
    is_left_out: bool = False
    objects: dict[str, ShownObject] = field(default_factory=lambda: defaultdict(ShownObject))
    scene: str = ""


def shown_frames(content: ReplayContent) -> list[ShownFrame]:
    """The frames of a replay in their order."""
    frames = [ShownFrame(image_id, scene=scene) for scene, image_id in images_of(content)]
    changes: dict[str, dict[int, str]] = defaultdict(dict)
    images_end = len(frames)
    for chunk in content.chunks:
        words = str(chunk.entity_path).strip("/").split("/")
        name = words[-1]
        kind = "/".join(words[:-1]) or name
        for number, values in _rows(chunk):
            frame = frames[number]
            frame.time_s = values["time"]
            if kind == "camera" and name == "image":
                frame.jpeg = values.get("blob", frame.jpeg)
                # Together with the last image it is cleared from the viewer.
                images_end = min(images_end, number) if "is_recursive" in values else images_end
            elif kind == "state" and "state" in values:
                changes[name][number] = values["state"]
            else:
                _show(frame.objects, kind, name, values)
    for name, of_object in changes.items():
        _carry_on(frames, name, of_object)
    for frame in frames[images_end + 1 :]:
        frame.is_left_out = frame.jpeg is None
    return frames


def images_of(content: ReplayContent) -> list[tuple[str, int]]:
    """(scene, image id) of each frame: two replays show the same image where these are the same."""
    image_ids = [0] * (content.last_frame + 1)
    scene_starts = {0}
    for chunk in content.chunks:
        if str(chunk.entity_path) == "/image_id":
            for number, values in _rows(chunk):
                image_ids[number] = int(values["scalars"])
        elif str(chunk.entity_path) == "/":
            scene_starts.update(frames_of(chunk))  # all that the scene before it showed is cleared there
    starts, last = sorted(scene_starts), len(content.scenes) - 1  # a torn file may not say any more what began
    scenes = [content.scenes[min(bisect_right(starts, number) - 1, last)] for number in range(len(image_ids))]
    return list(zip(scenes, image_ids, strict=True))


def fps_of(frames: list[ShownFrame]) -> float:
    """Frames per second, from their times."""
    steps = np.diff([frame.time_s for frame in frames])
    steps = steps[steps > 0.0]
    return float(np.clip(1.0 / np.median(steps), 1.0, 120.0)) if len(steps) else _DEFAULT_FPS


def _show(objects: dict[str, ShownObject], kind: str, name: str, values: dict[str, Any]) -> None:
    if kind == "camera/generated_edges":
        objects[name].strokes, objects[name].colours = values["strips"].reshape(-1, 2, 2), values["colors"]
    elif kind == "camera/control_points" and "positions" in values:
        objects[name].quad = values["positions"]
    elif kind == "curves/quality":
        objects[name].quality = values["scalars"]
    elif kind == "curves/add_percent":
        objects[name].add_percent = values["scalars"]


def _carry_on(frames: list[ShownFrame], name: str, changes: dict[int, str]) -> None:
    state = ""
    for number, frame in enumerate(frames):
        state = changes.get(number, state)
        if name in frame.objects:  # another scene may not have it
            frame.objects[name].state = state


def _rows(chunk: Chunk) -> Iterator[tuple[int, dict[str, Any]]]:
    """(frame, component -> value) of the components that are shown; `time` is in seconds."""
    if "frame" not in chunk.timeline_names or not str(chunk.entity_path).startswith(_SHOWN):
        return
    batch = chunk.to_record_batch()
    numbers = batch.column("frame").to_pylist()
    times = batch.column("time").cast("int64").to_numpy(zero_copy_only=False) * 1e-9
    columns = {
        name.split(":")[-1]: batch.column(name) for name in batch.schema.names if name.split(":")[-1] in _READERS
    }
    for row, number in enumerate(numbers):
        values = {name: _READERS[name](column[row].values) for name, column in columns.items() if column[row].is_valid}
        if values:
            yield int(number), {"time": float(times[row]), **values}


def _points(values: Any) -> NDArray[np.float32]:
    return np.asarray(values.flatten(), np.float32).reshape(-1, 2)


def _colours(values: Any) -> NDArray[np.uint8]:
    # 0xRRGGBBAA
    packed = np.asarray(values, np.uint32)
    return np.stack([packed >> shift & 255 for shift in (24, 16, 8)], axis=1).astype(np.uint8)


_SHOWN = (
    "/camera/image",
    "/camera/generated_edges",
    "/camera/control_points",
    "/curves/quality",
    "/curves/add_percent",
    "/image_id",
    "/state",
)
_READERS = {
    "blob": lambda values: np.asarray(values.flatten(), np.uint8).tobytes(),
    "strips": lambda values: _points(values.flatten()),
    "colors": _colours,
    "positions": _points,
    "scalars": lambda values: float(values[0].as_py()),
    "state": lambda values: str(values[0].as_py()),
    "is_recursive": lambda values: bool(values[0].as_py()),
}
