"""Lamps that flicker, before a camera that reads its rows one after another: is the part followed in bands of light?

    python -m benchmarks.light_bands metal_hard metal_dev own_checking --parts PARTS --split checking --record KEY

Each sequence is tracked forwards, from truth and from 5 degrees and 5 mm off, with defaults: as it is; with bands that
make its grey values up to 10% or 25% brighter and darker, one and a half of them in the height of a picture, elsewhere
in each; and with pictures that flicker by 25% as a whole, as a camera sees them that reads all at once. "as they are"
is a tracker that does not know bands. A frame counts when at least 30% of the part is visible. PARTS holds prepared
parts, or one folder of them per data set.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

from acp_lab.commands.machine import limit_threads

limit_threads(1)  # before NumPy is imported

import numpy as np  # noqa: E402

from acp_lab.evaluation.part_metric import PartMetric  # noqa: E402
from acp_lab.sequences.bop import BopScene  # noqa: E402
from acp_lab.sequences.frame import Frame  # noqa: E402
from acp_lab.tracking.method import Method  # noqa: E402
from acp_lab.tracking.tones import ToneMatching  # noqa: E402
from acp_lab.tracking.tracker import Tracker  # noqa: E402
from benchmarks.runs import prepared_part_of  # noqa: E402
from benchmarks.told_wrong import (  # noqa: E402
    STARTS_TOLD,
    ToldRun,
    TrueFrame,
    as_taken,
    follow,
    main_of_recalls,
    true_frames,
)

LIGHT = {"steady": (0.0, 0.0), "bands of 10%": (0.1, 1.5), "bands of 25%": (0.25, 1.5), "flicker of 25%": (0.25, 0.0)}
"""By how much grey values change, and how many bands there are in the height of a picture."""
TURN = 2.39
"""Rad by which the bands go on from frame to frame: they come to all places."""


def main() -> None:
    """See the module."""
    main_of_recalls(__doc__, "light_bands", "lamps that flicker", _runs)


def banded(frame: Frame, number: int, share: float, bands: float) -> Frame:
    """The frame of that number in a sequence under such a lamp, see `LIGHT`."""
    height = frame.image.shape[0]
    gains = 1.0 + share * np.sin(TURN * number + 2.0 * np.pi * bands * np.arange(height) / height)
    image = np.rint(frame.image * gains[:, None, None]).clip(0, 255).astype(np.uint8)
    return replace(frame, image=image)


def _runs(scene: BopScene, parts: Path, method: Method) -> Iterator[ToldRun]:
    model, frames = prepared_part_of(scene, parts), true_frames(scene)
    metric, seed = PartMetric(model.part), [0, scene.scene_id, scene.object_ids[0]]
    assert isinstance(method.tones, ToneMatching)
    as_they_are = replace(method, tones=replace(method.tones, band_least=100.0))
    for name, (share, bands) in LIGHT.items():
        lit = as_taken(_lit(frames, share, bands))
        for suffix, one in (("", method), (", as they are", as_they_are)):
            if suffix and not bands:
                continue
            for start in STARTS_TOLD:
                yield ToldRun(name + suffix, start, follow(lit, Tracker(model, one), metric, start, seed), np.zeros(0))


def _lit(frames: Sequence[TrueFrame], share: float, bands: float) -> list[TrueFrame]:
    return [replace(one, frame=banded(one.frame, number, share, bands)) for number, one in enumerate(frames)]


if __name__ == "__main__":
    main()
