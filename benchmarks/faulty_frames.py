"""What goes wrong with pictures: part of one is covered, its light changes, its sensor is noisy."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from acp_lab.geometry.arrays import ByteImage
from acp_lab.sequences.frame import Frame
from acp_lab.studies.other_cameras import OtherCamera

Box = tuple[int, int, int, int]
"""(x0, y0, x1, y1) px around the part."""


def covered(frame: Frame, box: Box | None, plain: bool) -> Frame:
    """A frame with a board over a box; plain, or else with the picture of what is beside it."""
    if box is None:
        return frame
    image = frame.image.copy()
    height, width = image.shape[:2]
    x0, y0, x1, y1 = box
    high, wide = y1 - y0, x1 - x0
    # What stands beside the part, where there is room for it.
    places = [(x0 - wide, y0), (x1, y0), (x0, y0 - high), (x0, y1)]
    free = [(x, y) for x, y in places if x >= 0 and y >= 0 and x + wide <= width and y + high <= height]
    if plain or not free:
        image[y0:y1, x0:x1] = (150, 110, 60)
    else:
        x, y = free[0]
        image[y0:y1, x0:x1] = frame.image[y : y + high, x : x + wide]
    return replace(frame, image=image)


def half_covered(frame: Frame, box: Box | None) -> Frame:
    """A plain board over the left half of a box."""
    if box is None:
        return frame
    return covered(frame, (box[0], box[1], (box[0] + box[2]) // 2, box[3]), plain=True)


def in_light(frame: Frame, gain: float) -> Frame:
    """The light times `gain`: grey values are encoded light, and what is too bright is white."""
    return OtherCamera(exposure=gain).take(frame)


def in_grey(frame: Frame, gain: float) -> Frame:
    """The grey values times `gain`; 0.4 leaves an eighth of the light, 2 is four to five times as much."""
    greys: ByteImage = (gain * np.arange(256.0)).round().clip(0, 255).astype(np.uint8)
    return replace(frame, image=greys[frame.image])


def noisy(frame: Frame, scatter: float, rng: np.random.Generator) -> Frame:
    """Gaussian noise on every grey value."""
    grey = frame.image + rng.normal(0.0, scatter, frame.image.shape)
    return replace(frame, image=grey.round().clip(0, 255).astype(np.uint8))


FAULTS: dict[str, Callable[[Frame, Box | None, np.random.Generator], Frame]] = {
    "covered": lambda frame, box, rng: covered(frame, box, plain=True),
    "half covered": lambda frame, box, rng: half_covered(frame, box),
    "light x0.4": lambda frame, box, rng: in_light(frame, 0.4),
    "light x2": lambda frame, box, rng: in_light(frame, 2.0),
    "flicker": lambda frame, box, rng: in_light(frame, rng.uniform(0.7, 1.3)),
    "noise": lambda frame, box, rng: noisy(frame, 15.0, rng),
}
"""By name: a frame with the fault, of a part within a box; the generator is the run's."""
