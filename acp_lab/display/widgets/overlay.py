"""What is drawn over a picture: strokes, lines, dots and polygons, each with a colour and a label.

Convention: coordinates are px of the full image, (x, y), the centre of the top-left pixel at (0, 0); widths are
screen px, whatever the zoom. Colours are RGB in [0, 1], from `acp_lab.display.colours`.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from acp_lab.display.colours import GREY, LARGEST_RESIDUAL_PX, residual_colours, to_bytes
from acp_lab.generator.base import GeneratedEdges
from acp_lab.geometry.arrays import FloatArray

STROKE_PX = 3.0
RESIDUAL_SHADES = 6
"""Strokes coloured by their residual are drawn in so many groups, one path each."""
RESIDUAL_LABEL = "generated edges: light blue fits, yellow, vermillion from 3 px off, grey has no image edge"

Colour = tuple[float, float, float]
Kind = Literal["strokes", "line", "polygon", "dots"]


@dataclass(frozen=True, eq=False)
class Overlay:
    """One layer over a picture.

    kind: "strokes" with coordinates (n, 2, 2), each from a point to a point; "line" and "polygon" with
    (n, 2); "dots" with (n, 2). label: shown in the legend, which switches all overlays of one label; "" keeps
    it out of there. width_px: of lines, and the diameter of dots, on the screen.
    """

    kind: Kind
    coordinates: FloatArray
    colour: Colour
    label: str = ""
    width_px: float = 1.5

    @property
    def css_colour(self) -> str:
        """Such as "#56b4e9"."""
        return css_colour(self.colour)


def edge_strokes(
    edges: GeneratedEdges, colour: Colour, label: str = "", width_px: float = 1.5, stroke_px: float = STROKE_PX
) -> Overlay:
    """Generated edge points as short strokes along their tangents."""
    return Overlay("strokes", _strokes(edges, stroke_px), colour, label, width_px)


def residual_strokes(edges: GeneratedEdges, residuals_px: FloatArray | None, label: str) -> tuple[Overlay, ...]:
    """Generated edge points coloured by their residuals (n,) px, as everywhere here: sky blue at 0 to vermillion.

    Grey where no image edge was found (NaN), and everywhere without residuals.
    """
    if residuals_px is None:
        return (edge_strokes(edges, GREY, label),)
    strokes, size = _strokes(edges, STROKE_PX), np.abs(residuals_px)
    shades_px = np.linspace(0.0, LARGEST_RESIDUAL_PX, RESIDUAL_SHADES)
    nearest = np.round(np.clip(np.nan_to_num(size) / shades_px[1], 0.0, RESIDUAL_SHADES - 1.0))
    shade = np.where(np.isnan(size), -1, nearest.astype(int))
    colours = residual_colours(np.append(shades_px, np.nan))
    found = [number for number in range(-1, RESIDUAL_SHADES) if (shade == number).any()]
    # The first of them gives the legend its colour: the best fit, not "nothing found".
    found.sort(key=lambda number: number if number >= 0 else RESIDUAL_SHADES)
    return tuple(Overlay("strokes", strokes[shade == n], _colour(colours[n]), label, 2.0) for n in found)


def serialised(overlays: Iterable[Overlay], _: Any = None) -> list[dict[str, Any]]:
    """As the browser takes them: coordinates in float32 bytes, those that are not finite left out."""
    return [
        {
            "kind": overlay.kind,
            "data": memoryview(_finite(overlay).astype(np.float32).tobytes()),
            "colour": overlay.css_colour,
            "label": overlay.label,
            "width_px": overlay.width_px,
        }
        for overlay in overlays
    ]


def css_colour(colour: Colour) -> str:
    """RGB in [0, 1] as CSS writes it."""
    return "#" + "".join(f"{value:02x}" for value in to_bytes(colour).tolist())


def _strokes(edges: GeneratedEdges, stroke_px: float) -> FloatArray:
    half = 0.5 * stroke_px * edges.tangents
    strokes: FloatArray = np.stack([edges.points - half, edges.points + half], axis=1)
    return strokes


def _finite(overlay: Overlay) -> FloatArray:
    coordinates = np.asarray(overlay.coordinates, dtype=np.float64)
    return coordinates[np.isfinite(coordinates).reshape(len(coordinates), -1).all(axis=1)]


def _colour(row: FloatArray) -> Colour:
    red, green, blue = row.tolist()
    return red, green, blue
