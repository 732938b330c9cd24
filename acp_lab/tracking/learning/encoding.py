"""How a camera encodes light as greys, told by moving edges.

While the shutter is open a moving edge sweeps over its pixels evenly: in light its smear is a ramp, as straight on its
dark side as on its bright one. A camera that encodes light for displays lifts the dark end, and the ramp is bent; many
industrial cameras store light as it is. Taken for light encoded otherwise, greys are steepest elsewhere than in the
middle of the smear, and outlines all lie to one side. So it is asked with which exponent smears are straight. Edges
that stand still are blurred too little to tell.
(Not in the paper; see docs/paper-ledger.md. Greys as a measure of light, by what mixes on edges: Lin, Gu, Yamazaki and
Shum, Radiometric calibration from a single image, 2004.)
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from acp_lab.compiled import kernel
from acp_lab.errors import TrackingError
from acp_lab.geometry.arrays import Float32Array, FloatArray, plain
from acp_lab.imaging.edge_search import ImagePatch
from acp_lab.imaging.edge_search_kernel import read_profile

# With which smears are straightened; between the two, and somewhat beyond, they are bent in proportion.
_EXPONENTS = np.array([1.0, 1.8])
_LEAST_TOLD, _MOST_TOLD = 0.5, 3.0
# By less on average, and a frame tells nothing.
_LEAST_STRAIGHTENED = 1e-3
# So many edges of a frame are enough, of smears that are not longer, px: on its way a longer one meets other things.
_MOST_EDGES, _MOST_PX = 80, 16.0
# Beside the smear, px: the lens blurs its ends.
_ROOM_PX = 3
# Grey levels: steps that are lower are bent by noise; what is darker or brighter is cut off.
_LEAST_STEP, _BLACK, _WHITE = 25.0, 6.0, 245.0
# Of the step: back by more, or still going on at its ends by more, and something else is on the way.
_BACK, _STILL = 0.06, 0.1
# Of a smear, px of it that half of the step may take at least and at most, but for the lens.
_SHORTEST, _LONGEST = 0.35, 0.75
# By how much brighter, as a logarithm, the one side counts at most.
_MOST_WEIGHT = 1.5
AS_IT_IS = 1.0
"""The exponent of a camera that stores light as it is."""
# A camera that was taken for one is so until its smears tell more than this beyond `EncodingConfig.below`.
_HYSTERESIS = 0.15


@dataclass(frozen=True)
class EncodingConfig:
    """How the camera's encoding is learnt.

    Attributes:
        least_px: edges that motion smears by less say nothing; times_lens: nor do those by less than so many times what
            the lens blurs, as far as that is known, whose ends alone are all there is of them.
        evidence: edges that the last frames must have shown before what they say is believed.
        frames: the last that showed some, of which the median counts: in single frames something else bends them all.
        below: a camera of which a lower exponent is told stores light as it is; others encode it for displays, which
            they all do much alike (`SearchConfig.gamma`).
    """

    kind: ClassVar[str] = "on"
    least_px: float = 3.0
    times_lens: float = 2.5
    evidence: float = 200.0
    frames: int = 60
    below: float = 1.25

    def __post_init__(self) -> None:
        if not 1.0 <= self.least_px <= _MOST_PX:
            raise TrackingError(f"learning.encoding.least_px = {self.least_px:g}: give 1 to {_MOST_PX:g} px")
        if not 0.0 <= self.times_lens <= 100.0:
            raise TrackingError(f"learning.encoding.times_lens = {self.times_lens:g}: give 0 to 100")
        if not 1.0 <= self.evidence < float("inf"):
            raise TrackingError(f"learning.encoding.evidence = {self.evidence:g}: give 1 or more")
        if not self.evidence / _MOST_EDGES <= self.frames <= 10_000:
            raise TrackingError(
                f"learning.encoding.frames = {self.frames}: give evidence / {_MOST_EDGES} to 10000: one shows so many "
                "edges at most"
            )
        if not 1.0 <= self.below <= _MOST_TOLD:
            raise TrackingError(f"learning.encoding.below = {self.below:g}: give 1 to {_MOST_TOLD:g}")


class LightEncoding:
    """The encoding of one camera. gamma: light is the grey level to this power, 1; None for what the search says."""

    def __init__(self, config: EncodingConfig) -> None:
        self.config = config
        self.gamma: float | None = None
        self._told = deque[tuple[float, int]](maxlen=config.frames)

    @property
    def told(self) -> float | None:
        """The exponent with which smears are straight; None where too few were seen."""
        told, edges = np.array(self._told).reshape(-1, 2).T
        if edges.sum() < self.config.evidence:
            return None
        order = told.argsort()
        return float(told[order][np.searchsorted(edges[order].cumsum(), 0.5 * edges.sum())])

    def learn(
        self, patch: ImagePatch, points: FloatArray, normals: FloatArray, smear_px: FloatArray, lens_px: float = 0.0
    ) -> None:
        """Take in a solved frame.

        Args:
            points: (n, 2) px, full image, where edges were found; normals: (n, 2) unit.
            smear_px: (n,) over which motion smears them along these.
            lens_px: standard deviation of the lens's blur, as far as it is known.
        """
        least_px = max(self.config.least_px, self.config.times_lens * lens_px)
        rows = np.flatnonzero((smear_px >= least_px) & (smear_px <= _MOST_PX))
        if not len(rows):
            return
        rows = rows[:: -(-len(rows) // _MOST_EDGES)]
        bent = np.zeros(len(_EXPONENTS))
        seen = _add_up_bends(
            patch.channels, plain(points[rows] - patch.origin), plain(normals[rows]), smear_px[rows], _EXPONENTS, bent
        )
        # The higher the exponent the more the dark end is straightened, and bent the other way in the end.
        straightened = bent[0] - bent[1]
        if not straightened > _LEAST_STRAIGHTENED * seen:
            return
        low, high = _EXPONENTS
        told = low + (high - low) * bent[0] / straightened
        self._told.append((min(max(told, _LEAST_TOLD), _MOST_TOLD), seen))
        if (told := self.told) is not None:
            limit = self.config.below + (0.0 if self.gamma is None else _HYSTERESIS)
            self.gamma = AS_IT_IS if told < limit else None


@kernel("i8(f4[:, :, ::1], f8[:, ::1], f8[:, ::1], f8[::1], f8[::1], f8[::1])")
def _add_up_bends(
    channels: Float32Array, points: FloatArray, normals: FloatArray, smear_px: FloatArray, exponents: FloatArray,
    bent: FloatArray,
) -> int:  # fmt: skip
    """Add to bent (k,), for each of exponents (k,), by how much n smears are bent; returns how many showed it.

    Bent: how much farther three quarters of the step are from its half than that from a quarter, as a share of both.
    channels: see `edge_search_kernel.strongest_peaks`, of which points (n, 2) px count from the first pixel on.
    """
    longest = 0.0
    for i in range(len(points)):
        longest = max(longest, smear_px[i])
    room = int(0.5 * longest + 1.0) + _ROOM_PX
    profile, light = np.empty((3, 2 * room + 1), np.float32), np.empty(2 * room + 1)
    greys, quarters, seen = profile[2], np.empty(3), 0
    for i in range(len(points)):
        nx, ny = normals[i, 0], normals[i, 1]
        reach = int(0.5 * smear_px[i] + 1.0) + _ROOM_PX
        count = 2 * reach + 1
        read_profile(channels, points[i, 0] - room * nx, points[i, 1] - room * ny, nx, ny, profile)
        start, step = room - reach, 1
        if greys[room + reach] < greys[room - reach]:
            start, step = room + reach, -1
        end = start + step * (count - 1)
        low, high = greys[start], greys[end]
        rise = high - low
        if rise < _LEAST_STEP or low < _BLACK or high > _WHITE:
            continue
        still = max(abs(greys[start + step] - low), abs(high - greys[end - step]))
        back = 0.0
        for k in range(count - 1):
            back = max(back, greys[start + k * step] - greys[start + (k + 1) * step])
        if still > _STILL * rise or back > _BACK * rise:
            continue
        # Half of the step takes half of the smear, and a little more as the lens blurs it; else it is another edge's.
        half = 0
        for k in range(count):
            half += 0.25 * rise <= greys[start + k * step] - low < 0.75 * rise
        if not _SHORTEST * smear_px[i] - 1.0 <= half <= _LONGEST * smear_px[i] + 1.0:
            continue
        seen += 1
        # The exponent bends a step the more the brighter one side is than the other.
        weight = min(np.log(high / low), _MOST_WEIGHT)
        for j in range(len(exponents)):
            for k in range(count):
                light[k] = greys[start + k * step] ** exponents[j]
            lowest, whole, place = light[0], light[count - 1] - light[0], 0
            for quarter in range(3):
                level = lowest + 0.25 * (quarter + 1) * whole
                while light[place + 1] < level:
                    place += 1
                quarters[quarter] = place + (level - light[place]) / max(light[place + 1] - light[place], 1e-12)
            both = quarters[2] - quarters[0]
            bent[j] += weight * (quarters[2] + quarters[0] - 2.0 * quarters[1]) / max(both, 0.5)
    return seen
