"""What the panels of a bench show, and that names of methods can be read."""

from __future__ import annotations

from itertools import combinations

import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg

from acp_lab.bench.protocol import Variant
from acp_lab.bench.tables import table
from acp_lab.display.plots.bench import draw_against, draw_times
from tests.bench.made_runs import made_run
from tests.display.blank_axes import axes_of


@pytest.mark.parametrize("error", [0.01, 0.2])
def test_names_of_equal_methods_do_not_overlap_and_stay_within_the_axes(error: float) -> None:
    names = ["a method", "another one", "a third tracker", "a fourth"]
    (axes,) = axes_of()
    runs = [made_run([error] * 9, name, ms=ms) for name, ms in zip(names, (20.0, 20.0, 19.9, 4.0), strict=True)]
    draw_times(axes, table(runs))
    canvas = FigureCanvasAgg(axes.figure)
    canvas.draw()
    boxes = [text.get_window_extent(canvas.get_renderer()) for text in axes.texts]
    assert [text.get_text() for text in axes.texts] == names
    assert not any(one.overlaps(other) for one, other in combinations(boxes, 2))
    inside = axes.get_window_extent()
    assert all(inside.x0 <= box.x0 and box.x1 <= inside.x1 for box in boxes)


def test_steps_are_whole_numbers() -> None:
    (axes,) = axes_of()
    rows = table([made_run([0.01] * 9, variant=Variant(step)) for step in (1, 2, 4)])
    draw_against(axes, rows, "step", "one of n frames used", "")
    assert list(axes.get_xticks()) == [1, 2, 4]
