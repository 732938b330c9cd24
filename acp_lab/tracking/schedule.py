"""Coarse to fine: how far each level looks, how wide it captures, and how many edge points it takes.

The paper has one alpha, as a share of the part's diameter in the image. Annealing it from wide to narrow is what
lets one method both find the way and fine-tune. (Deviation from the paper; shares of (1.0,) are its one alpha.)
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from acp_lab.errors import TrackingError

# On a part that appears smaller than this, a long search finds the edges of its other side.
FULL_SIZE_PX = 150.0
_LEAST_REACH_PX, _MOST_REACH_PX = 5, 20
# No annealing goes below this: the edges of a distance map lie on whole pixels.
_LEAST_ALPHA_PX = 1.5
_REACH_IN_ALPHA = 1.6
EVERY_SAMPLE = 30_000
"""For all edge points in view, or as many as one search takes."""


@dataclass(frozen=True)
class Level:
    """One level of the coarse-to-fine search.

    Attributes:
        reach_px: of a search along normals.
        sigma_px: width of the capture range.
        samples: edge points used at most; a long search is expensive, a short one over many samples is exact.
        edge_share: how much edges count at this level, beside other targets.
    """

    reach_px: int
    sigma_px: float
    samples: int = 300
    edge_share: float = 1.0

    @property
    def alpha_px(self) -> float:
        """The paper's alpha, the distance beyond which an edge point counts less."""
        return 2.0 * self.sigma_px


@dataclass(frozen=True)
class PixelSchedule:
    """Levels in px, shorter for parts that appear small; for methods that search along normals."""

    kind: ClassVar[str] = "pixels"
    levels: tuple[Level, ...] = (Level(20, 6.0, 250), Level(8, 2.0, 400), Level(5, 1.0, 600))

    def __post_init__(self) -> None:
        if not self.levels:
            raise TrackingError("schedule.levels: is empty: give one level or more")
        for level in self.levels:
            if not (level.reach_px >= 1 and level.sigma_px > 0.0 and level.samples >= 1):
                raise TrackingError(f"schedule.levels: {level}: give reach, sigma and samples above 0")

    @property
    def near(self) -> tuple[Level, ...]:
        """The level from a pose that is surely near: the last, as the others find the way there."""
        return self.levels[-1:]

    def at(self, size_px: float) -> tuple[Level, ...]:
        """The levels for a part whose diameter measures size_px in the image."""
        return scaled(self.levels, size_px)


@dataclass(frozen=True)
class ShareSchedule:
    """Levels in shares of the part's diameter in the image.

    Attributes:
        alpha: as a share of the diameter; the paper says 0.05 to 0.10.
        shares: multiples of alpha, one level each, coarse to fine; (1.0,) is the paper's fixed alpha.
        samples: edge points used at most, on every level.
    """

    kind: ClassVar[str] = "share-of-diameter"
    alpha: float = 0.05
    shares: tuple[float, ...] = (1.0, 0.6, 0.4)
    samples: int = 600

    def __post_init__(self) -> None:
        if not 0.0 < self.alpha <= 1.0:
            raise TrackingError(f"schedule.alpha = {self.alpha:g}: give a share of the diameter, such as 0.07")
        if not self.shares or min(self.shares) <= 0.0:
            raise TrackingError("schedule.shares: give one or more above 0")
        if self.samples < 20:
            raise TrackingError(f"schedule.samples = {self.samples}: give 20 or more")

    def at(self, size_px: float) -> tuple[Level, ...]:
        """The levels for a part whose diameter measures size_px in the image."""
        return tuple(self._level(max(share * self.alpha * size_px, _LEAST_ALPHA_PX)) for share in self.shares)

    def _level(self, alpha_px: float) -> Level:
        reach_px = int(np.clip(round(_REACH_IN_ALPHA * alpha_px), _LEAST_REACH_PX, _MOST_REACH_PX))
        return Level(reach_px, 0.5 * alpha_px, self.samples)


def scaled(levels: tuple[Level, ...], size_px: float) -> tuple[Level, ...]:
    """Levels for a part of size_px in the image: as they are from 150 px on, down to half below; never too fine."""
    scale = min(max(size_px / FULL_SIZE_PX, 0.5), 1.0)
    return tuple(
        replace(
            level,
            reach_px=max(round(level.reach_px * scale), _LEAST_REACH_PX),
            sigma_px=max(level.sigma_px * scale, 1.0),
        )
        for level in levels
    )
