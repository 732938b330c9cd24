"""How much of the time between two frames the shutter is open, told by how wide moving edges are smeared.

A moving edge is smeared over what it moves while the shutter is open: a share of what it moves from frame to frame,
which no camera tells. Edges that cross their own motion show it: across them the slope of light is flat over the smear.
With the share and the predicted motion every edge's smear is known before it is searched
(`edge_search.half_widths`), also where it is hard to see.
(Not in the paper; see docs/paper-ledger.md.)
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import ClassVar

import numpy as np

from acp_lab.compiled import kernel
from acp_lab.errors import TrackingError
from acp_lab.geometry.arrays import Float32Array, FloatArray, plain
from acp_lab.imaging.edge_search import ImagePatch
from acp_lab.imaging.edge_search_kernel import read_profile

# Shares that are told apart.
_SHARES = np.linspace(0.0, 1.0, 11)
# How wide an edge at rest is: the search's own filter and a lens.
_REST_SIGMA_PX = 1.2
# A pose is no more exact than this.
_OFF_PX = 3
# Slopes are compared so many px beyond the farthest smear.
_ROOM_PX = 4
_MOST_PX = 40.0
_STEPS_PER_PX = 2
# So many edges of a frame are enough.
_MOST_EDGES = 80
# Slopes weaker than this, grey levels per px as the root of their summed squares, are noise.
_LEAST_SLOPE = 6.0


@dataclass(frozen=True)
class BlurConfig:
    """How the shutter's share is learnt.

    Attributes:
        least_px: edges that move less across themselves from frame to frame show nothing; most_px: those that move
            more, up to 40, are met by too much else on their way.
        evidence: edges that must have been seen before their smear is believed.
        memory: share of the evidence that is kept from frame to frame.
    """

    kind: ClassVar[str] = "on"
    least_px: float = 8.0
    most_px: float = _MOST_PX
    evidence: float = 40.0
    memory: float = 0.9

    def __post_init__(self) -> None:
        if not 1.0 <= self.least_px < self.most_px <= _MOST_PX:
            raise TrackingError(
                f"learning.blur.least_px = {self.least_px:g}, most_px = {self.most_px:g}: "
                f"give 1 to {_MOST_PX:g} px, the first less than the second"
            )
        if not 1.0 <= self.evidence < float("inf"):
            raise TrackingError(f"learning.blur.evidence = {self.evidence:g}: give 1 or more")
        if not 0.0 <= self.memory < 1.0:
            raise TrackingError(f"learning.blur.memory = {self.memory:g}: give 0 to less than 1")


class MotionBlur:
    """The shutter of one camera. share: in [0, 1], 0 until edges showed it."""

    def __init__(self, config: BlurConfig) -> None:
        self.config = config
        self.share = 0.0
        self._fits, self._count = np.zeros(len(_SHARES)), 0.0

    def smear_px(self, motion_px: FloatArray) -> FloatArray | None:
        """(n,) px over which edges are smeared that move across themselves by (n,) px a frame; None where none is."""
        return self.share * np.abs(motion_px) if self.share > 0.0 else None

    def learn(self, patch: ImagePatch, points: FloatArray, normals: FloatArray, motion_px: FloatArray) -> None:
        """Take in a solved frame.

        Args:
            points: (n, 2) px, full image, where edges are; normals: (n, 2) unit.
            motion_px: (n,) that they move along these from frame to frame.
        """
        config, motion_px = self.config, np.abs(motion_px)
        rows = np.flatnonzero((motion_px >= config.least_px) & (motion_px <= config.most_px))
        if not len(rows):
            return
        rows = rows[:: -(-len(rows) // _MOST_EDGES)]
        fits = np.zeros(len(_SHARES))
        seen = _fit_smears(
            patch.channels, plain(points[rows] - patch.origin), plain(normals[rows]), motion_px[rows], _SHARES,
            _slopes_of_smears(), fits,
        )  # fmt: skip
        self._fits = config.memory * self._fits + fits
        self._count = config.memory * self._count + seen
        if self._count >= config.evidence:
            self.share = float(_SHARES[self._fits.argmax()])


@lru_cache(maxsize=1)
def _slopes_of_smears() -> FloatArray:
    """(lengths, 2, taps) slopes px by px across edges smeared over 0, 0.5, 1 ... px, of length one; in the middle, and
    half a px beside it."""
    reach = int(0.5 * _MOST_PX) + _ROOM_PX
    found = np.empty((int(_MOST_PX * _STEPS_PER_PX) + 1, 2, 2 * reach + 1))
    for length in range(len(found)):
        half = max(0.5 * length / _STEPS_PER_PX, 0.01)
        for beside in range(2):
            # A box of that width, smoothed as an edge at rest is.
            ends = (np.arange(-reach, reach + 1) - 0.5 * beside)[:, None] + [half, -half]
            step = np.vectorize(math.erf)(ends / (math.sqrt(2.0) * _REST_SIGMA_PX))
            slopes = step[:, 0] - step[:, 1]
            found[length, beside] = slopes / np.linalg.norm(slopes)
    return found


@kernel("i8(f4[:, :, ::1], f8[:, ::1], f8[:, ::1], f8[::1], f8[::1], f8[:, :, ::1], f8[::1])")
def _fit_smears(
    channels: Float32Array, points: FloatArray, normals: FloatArray, motion_px: FloatArray, shares: FloatArray,
    smears: FloatArray, fits: FloatArray,
) -> int:  # fmt: skip
    """Add to fits (k,), for each of shares (k,), the correlation of the slopes across n edges with what that share
    would make of them (`_slopes_of_smears`), where near the edge it is highest; returns how many edges were seen.
    """
    middle = smears.shape[2] // 2
    far = middle + _OFF_PX
    profile, seen = np.empty((3, 2 * far + 1), np.float32), 0
    slopes = profile[0]
    for i in range(len(points)):
        nx, ny = normals[i, 0], normals[i, 1]
        read_profile(channels, points[i, 0] - far * nx, points[i, 1] - far * ny, nx, ny, profile)
        reach, energy = int(0.5 * motion_px[i]) + _ROOM_PX, 0.0
        for k in range(far - reach, far + reach + 1):
            energy += slopes[k] * slopes[k]
        if energy < _LEAST_SLOPE * _LEAST_SLOPE:
            continue
        seen += 1
        for j in range(len(shares)):
            length, best = int(_STEPS_PER_PX * shares[j] * motion_px[i] + 0.5), 0.0
            for beside in range(2):
                for shift in range(-_OFF_PX, _OFF_PX + 1):
                    total = 0.0
                    for k in range(-reach, reach + 1):
                        total += smears[length, beside, middle + k] * slopes[far + shift + k]
                    best = max(best, abs(total))
            fits[j] += best / np.sqrt(energy)
    return seen
