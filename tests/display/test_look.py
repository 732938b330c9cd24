"""Figures of the course on a light and on a dark page."""

from __future__ import annotations

import io
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

from acp_lab.display import plots
from acp_lab.display.look import INK, use_look

PLOTS = Path(plots.__file__).parent
WHITE, DARK = (1.0, 1.0, 1.0), (0.067, 0.067, 0.067)


def luminance(colour: tuple[float, ...]) -> float:
    """As the WCAG defines it."""
    channels = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in colour]
    return float(np.dot(channels, (0.2126, 0.7152, 0.0722)))


@pytest.mark.parametrize("ground", [WHITE, DARK])
def test_ink_reads_on_either_page(ground: tuple[float, ...]) -> None:
    bright, dark = sorted((luminance(INK), luminance(ground)), reverse=True)
    assert (bright + 0.05) / (dark + 0.05) > 4.0


def test_figures_have_no_ground_and_legends_have_one() -> None:
    with mpl.rc_context():
        use_look()
        figure = Figure()
        FigureCanvasAgg(figure)
        axes = figure.subplots()
        axes.plot([0, 1], [0, 1], label="a line")
        axes.set_title("title")
        legend = axes.legend()
        file = io.BytesIO()
        figure.savefig(file)
        assert axes.title.get_color() == axes.xaxis.label.get_color() == INK
        assert legend.get_frame().get_facecolor()[:3] == WHITE
        assert mpl.colors.same_color(legend.get_texts()[0].get_color(), "black")
    alpha = np.asarray(Image.open(file))[..., 3]
    assert alpha[0, 0] == 0
    assert 0.5 < (alpha == 0).mean() < 1.0


def test_boxes_are_drawn_in_ink() -> None:
    """Matplotlib draws boxes, whiskers and medians in colours of their own, black for most."""
    with mpl.rc_context():
        use_look()
        drawn = Figure().subplots().boxplot([[0.0, 1.0, 2.0, 9.0]])
    lines = [line for name in ("boxes", "whiskers", "caps", "medians") for line in drawn[name]]
    assert len(lines) == 6
    assert all(mpl.colors.same_color(line.get_color(), INK) for line in lines)
    assert mpl.colors.same_color(drawn["fliers"][0].get_markeredgecolor(), INK)


def test_no_legend_goes_without_its_ground() -> None:
    """Its black words would stand on the page's own, which may be dark."""
    assert len(list(PLOTS.glob("*.py"))) > 10
    assert not [path.name for path in PLOTS.glob("*.py") if "frameon=False" in path.read_text(encoding="utf-8")]
