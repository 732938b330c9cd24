"""How soft the camera's pictures are: how far its lens and its pixels blur edges, whatever moves.

Soft pictures are sharpened more (`imaging.sharpness`). By how much is a matter of the camera, not of a frame: in one
frame motion smears edges, in another glints or mere noise look sharper than any edge. So of what the last pictures told
the median counts, and few are asked: the focus hardly changes, and asking takes its time.
(The paper blurs and denoises every picture alike, IV-B; here by how soft it is. See docs/paper-ledger.md.)
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from statistics import median
from typing import ClassVar

from acp_lab.errors import TrackingError
from acp_lab.imaging.edge_search import ImagePatch


@dataclass(frozen=True)
class LensConfig:
    """How the camera's blur is learnt.

    Attributes:
        pictures: the last that told something, of which the median counts.
        every: of the frames that teach one in so many is asked, once there are as many pictures.
    """

    kind: ClassVar[str] = "on"
    pictures: int = 9
    every: int = 10

    def __post_init__(self) -> None:
        for name in ("pictures", "every"):
            value = getattr(self, name)
            if not 1 <= value <= 1000:
                raise TrackingError(f"learning.lens.{name} = {value}: give 1 to 1000")


class LensBlur:
    """The blur of the camera that a part is tracked with."""

    def __init__(self, config: LensConfig) -> None:
        self.config = config
        self._told_px = deque[float](maxlen=config.pictures)
        self._frames = 0

    @property
    def blur_px(self) -> float | None:
        """Standard deviation of the Gaussian; None as long as no picture told."""
        return median(self._told_px) if self._told_px else None

    def learn(self, patch: ImagePatch) -> None:
        """Take in the image of a solved frame."""
        self._frames += 1
        if len(self._told_px) == self.config.pictures and self._frames % self.config.every:
            return
        told_px = patch.edge_blur_px
        if told_px is not None:
            self._told_px.append(told_px)
