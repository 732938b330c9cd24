"""One look for all pictures of the course: what each colour means, and figures that read on any page.

Figures carry their own white ground, so they are as legible in JupyterLab's dark theme as in its light one.
Colours come from `acp_lab.display.colours`; the names below say what they stand for, here and in the widgets.
"""

from __future__ import annotations

from typing import Any

from acp_lab.display.colours import BLUE, GREEN, GREY, ORANGE, PURPLE, SKY, VERMILLION, to_bytes

Colour = tuple[float, float, float]

TRUTH: Colour = GREEN
"""Edges and poses that are known to be right."""
GENERATED: Colour = ORANGE
"""Edges that a model generates: t(I)."""
IMAGE: Colour = PURPLE
"""Edges found in a camera image."""
POINTS: Colour = BLUE
"""Control points, in the object or in the image."""
START: Colour = SKY
"""Where something began."""
WRONG: Colour = VERMILLION
"""What is off, lost or hidden."""
UNKNOWN: Colour = GREY
"""Nothing was found, or nothing is known."""

_CSS = {"right": TRUTH, "hint": GENERATED}


def css_colour(meaning: str) -> str:
    """The colour of "right" or "hint" as CSS writes it."""
    return "#" + "".join(f"{value:02x}" for value in to_bytes(_CSS[meaning]).tolist())


def use_look() -> None:
    """Set matplotlib's defaults for a notebook."""
    import matplotlib as mpl
    from cycler import cycler

    settings: Any = {
        "figure.facecolor": "white",
        "savefig.facecolor": "white",
        "axes.facecolor": "white",
        "figure.dpi": 100.0,
        "figure.constrained_layout.use": True,
        "font.size": 9.0,
        "axes.titlesize": 10.0,
        "axes.grid": False,
        "grid.alpha": 0.3,
        "axes.spines.top": False,
        "axes.spines.right": False,
        "axes.prop_cycle": cycler(color=[POINTS, GENERATED, TRUTH, IMAGE, WRONG, START]),
        "legend.fontsize": 8.0,
        "legend.framealpha": 0.9,
        "image.interpolation": "nearest",
        "image.cmap": "gray",
    }
    mpl.rcParams.update(settings)
