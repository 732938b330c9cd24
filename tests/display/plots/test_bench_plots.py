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


def test_starts_that_are_off_by_other_mm_stand_side_by_side() -> None:
    """They were drawn above each other, and those that are off by mm alone were called no starts at all."""
    for noises, names in (
        ([(0.0, 0.0), (0.0, 5.0), (0.0, 10.0)], ["truth", "0°\n5 mm", "0°\n10 mm"]),
        ([(5.0, 20.0), (0.0, 0.0), (5.0, 0.0)], ["truth", "5°\n0 mm", "5°\n20 mm"]),
    ):
        (axes,) = axes_of()
        errors = {start: [0.01] * (9 - place) + [0.2] * place for place, start in enumerate(sorted(noises))}
        runs = [made_run(errors[n], variant=Variant(1, *n)) for n in noises] + [made_run([0.9] * 9, variant=Variant(2))]
        draw_against(axes, table(runs), "noise", "how far the start is off", "give --noise to see this")
        assert [label.get_text() for label in axes.get_xticklabels()] == names
        drawn = axes.lines[0].get_xydata()
        assert drawn[:, 0].tolist() == [0.0, 1.0, 2.0]
        assert drawn[:, 1] == pytest.approx([1.0, 8 / 9, 7 / 9])
        assert not axes.texts
