"""One look for all pictures of the course: what each colour means, and figures that read on any page.

Figures have no ground of their own and a grey ink that reads on white and on black: they follow the page's theme.
Colours come from `acp_lab.display.colours`; the names below say what they stand for, here and in the widgets.
"""

from __future__ import annotations

import logging
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

INK: Colour = (0.463, 0.463, 0.463)
"""Text, ticks and frames of figures: as far from white as from JupyterLab's dark ground."""

_CSS = {"right": TRUTH, "hint": GENERATED}


def css_colour(meaning: str) -> str:
    """The colour of "right" or "hint" as CSS writes it."""
    return "#" + "".join(f"{value:02x}" for value in to_bytes(_CSS[meaning]).tolist())


def as_it_is(name: str) -> str:
    """A name that somebody chose, of a file, say, for matplotlib: between two dollar signs it would see a formula."""
    return name.replace("$", r"\$")


def use_look() -> None:
    """Set matplotlib's defaults for a notebook."""
    import matplotlib as mpl
    from cycler import cycler

    # A list of fonts that another installation left behind makes it name every font that it misses; ours is there.
    logging.getLogger("matplotlib.font_manager").setLevel(logging.ERROR)
    settings: Any = {
        "figure.facecolor": "white",
        "savefig.facecolor": "none",
        "axes.facecolor": "none",
        "text.color": INK,
        "axes.edgecolor": INK,
        "axes.labelcolor": INK,
        "axes.titlecolor": INK,
        "xtick.color": INK,
        "ytick.color": INK,
        "grid.color": INK,
        "patch.edgecolor": INK,
        "boxplot.boxprops.color": INK,
        "boxplot.whiskerprops.color": INK,
        "boxplot.capprops.color": INK,
        "boxplot.flierprops.markeredgecolor": INK,
        "boxplot.medianprops.color": INK,
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
        "legend.facecolor": "white",
        "legend.labelcolor": "black",
        "image.interpolation": "nearest",
        "image.cmap": "gray",
    }
    mpl.rcParams.update(settings)
    _show_without_ground()


def _show_without_ground() -> None:
    """Tell the notebook's backend to draw figures without their ground.

    Figures keep their white one as such: where it is transparent, IPython asks the page for a white one below them.
    """
    try:
        from IPython import get_ipython
        from matplotlib_inline.config import InlineBackend
    except ImportError:  # no notebook
        return
    shell = get_ipython()
    if shell is not None:
        InlineBackend.instance(parent=shell).print_figure_kwargs = {"bbox_inches": "tight", "facecolor": "none"}
