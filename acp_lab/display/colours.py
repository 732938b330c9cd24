"""Colours that colour-blind readers can tell apart too (Okabe and Ito's palette).

Convention: colours are RGB, float in [0, 1] for pictures and uint8 for replays.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

BLUE = (0.0, 0.447, 0.698)
SKY = (0.337, 0.706, 0.914)
GREEN = (0.0, 0.620, 0.451)
YELLOW = (0.941, 0.894, 0.259)
ORANGE = (0.902, 0.624, 0.0)
VERMILLION = (0.835, 0.369, 0.0)
PURPLE = (0.800, 0.475, 0.655)
GREY = (0.6, 0.6, 0.6)

OBJECT_COLOURS = (BLUE, ORANGE, GREEN, PURPLE, VERMILLION, SKY)
"""One per tracked object, in the order of their ids; they repeat after six."""

LARGEST_RESIDUAL_PX = 3.0
"""Residuals from here on have the colour of the largest one."""

_RAMP = np.array([SKY, YELLOW, VERMILLION])


def residual_colours(residuals_px: NDArray[np.float64]) -> NDArray[np.float64]:
    """RGB (n, 3) in [0, 1] of signed residuals (n,) px: sky blue at 0, yellow, vermillion from 3 px on.

    Grey stands for NaN: no image edge was found there.
    """
    size = np.abs(np.asarray(residuals_px, dtype=np.float64))
    place = np.clip(np.nan_to_num(size, nan=0.0, posinf=LARGEST_RESIDUAL_PX) / LARGEST_RESIDUAL_PX, 0.0, 1.0)
    stops = np.linspace(0.0, 1.0, len(_RAMP))
    colours = np.stack([np.interp(place, stops, channel) for channel in _RAMP.T], axis=1)
    colours[np.isnan(size)] = GREY
    return colours


def lighter(colour: tuple[float, ...], share: float = 0.5) -> tuple[float, ...]:
    """A colour in [0, 1] mixed with white, of which it then holds a share."""
    return tuple((1.0 - share) * channel + share for channel in colour)


def to_bytes(colours: NDArray[np.float64] | tuple[float, ...]) -> NDArray[np.uint8]:
    """Colours in [0, 1] as uint8, same shape."""
    return np.round(255.0 * np.asarray(colours, dtype=np.float64)).astype(np.uint8)
