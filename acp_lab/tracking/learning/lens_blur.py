"""How soft the camera's pictures are: how far its lens and its pixels blur edges, whatever moves.

Soft pictures are sharpened more (`imaging.sharpness`). By how much is a matter of the camera, not of a frame: in one
frame edges may be smeared by motion, in another noise or glints look like edges sharper than any. So what a picture
tells of the blur is kept from frame to frame. One that is sharper than what is known is soon believed, one that is
softer slowly, as a picture in motion is softer than its camera.
(Not in the paper, which takes pictures as they are; see docs/paper-ledger.md.)
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from acp_lab.errors import TrackingError
from acp_lab.imaging.edge_search import ImagePatch


@dataclass(frozen=True)
class LensConfig:
    """How the camera's blur is learnt.

    Attributes:
        every: of so many frames one is asked; the focus hardly changes, and asking takes its time.
        fall, rise: share of the way to what a picture tells that is gone where it is sharper, and where it is softer.
    """

    kind: ClassVar[str] = "on"
    every: int = 5
    fall: float = 0.5
    rise: float = 0.1

    def __post_init__(self) -> None:
        if not 1 <= self.every <= 1000:
            raise TrackingError(f"learning.lens.every = {self.every}: give 1 to 1000 frames")
        for name in ("fall", "rise"):
            value = getattr(self, name)
            if not 0.0 < value <= 1.0:
                raise TrackingError(f"learning.lens.{name} = {value:g}: give a share above 0, at most 1")


class LensBlur:
    """The blur of one camera. blur_px: standard deviation of the Gaussian, None until a picture was seen."""

    def __init__(self, config: LensConfig) -> None:
        self.config = config
        self.blur_px: float | None = None
        self._frames = 0

    def learn(self, patch: ImagePatch) -> None:
        """Take in the image of a solved frame."""
        is_due = self._frames % self.config.every == 0
        self._frames += 1
        if not is_due:
            return
        told_px = patch.edge_blur_px
        if self.blur_px is None:
            self.blur_px = told_px
            return
        rate = self.config.fall if told_px < self.blur_px else self.config.rise
        self.blur_px += rate * (told_px - self.blur_px)
