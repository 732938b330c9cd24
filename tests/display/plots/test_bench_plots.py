"""What the panels of a bench show, and that names of methods can be read."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations

import pytest
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from acp_lab.bench.protocol import Variant
from acp_lab.bench.record import Run
from acp_lab.bench.report import Report
from acp_lab.bench.tables import table
from acp_lab.display.plots.bench import bench_figure, draw_against, draw_times
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


def panels_of(*runs: Run) -> Figure:
    report = Report.of([replace(run, prepare_s=3.0) for run in runs], "")
    return bench_figure(report.runs, report.rows, report.basins)


def words_in(axes: Axes) -> list[str]:
    """What an empty panel says."""
    return [] if axes.axison else [text.get_text() for text in axes.texts]


@pytest.mark.parametrize("plain", [Variant(), Variant(2), Variant(resets=True)])
def test_panels_show_what_was_run(plain: Variant) -> None:
    """Without runs from truth on every frame, too: times, preparation and starts were empty then."""
    starts = [plain, replace(plain, noise_deg=5.0), replace(plain, noise_deg=5.0, seed=1)]
    figure = panels_of(*(made_run([0.01] * 9, name, variant=how) for how in starts for name in ("one", "other")))
    curves, times, preparing, noises, basin, steps = figure.axes
    assert len(curves.lines) == 2
    assert curves.get_title() == f"accuracy, {plain}"
    assert [text.get_text() for text in times.texts] == ["one", "other"]
    assert len(preparing.patches) == 2
    assert [label.get_text() for label in noises.get_xticklabels()] == ["truth", "5°\n0 mm"]
    assert words_in(steps) == ["give several --steps to see this"]
    assert words_in(basin) == (["basin: give --noise to see this, without --resets"] if plain.resets else [])
    told = figure.get_suptitle()
    assert told == ("" if plain == Variant() else f"{plain}, unless an axis says otherwise")


def test_a_tracker_that_was_not_run_as_most_changes_no_colour() -> None:
    reset = Variant(resets=True)
    figure = panels_of(*(made_run([0.01] * 9, name, variant=how) for name, how in
                         (("theirs", Variant()), ("one", reset), ("other", reset))))  # fmt: skip
    curves, times, *_ = figure.axes
    by_name = {line.get_label(): line.get_color() for line in curves.lines}
    assert by_name == {text.get_text(): text.get_color() for text in times.texts}
    assert set(by_name) == {"one", "other"}


def test_a_tracker_of_another_step_is_named_and_empties_no_panel() -> None:
    starts = [Variant(2), Variant(2, 5.0)]
    runs = [made_run([0.01] * 9, name, variant=how) for how in starts for name in ("one", "other")]
    figure = panels_of(*runs, made_run([0.01] * 9, "theirs"))
    *_, basin, steps = figure.axes
    assert len(basin.get_xticks()) == len(starts)
    assert basin.lines
    assert list(steps.get_xticks()) == [1, 2]
    assert {text.get_text() for text in figure.legends[0].texts} == {"one", "other", "theirs"}


def test_empty_panels_say_what_is_so() -> None:
    run = replace(made_run([0.01] * 9, ms=float("nan")), prepare_s=0.0)
    report = Report.of([run], "")
    _, times, preparing, *_ = bench_figure(report.runs, report.rows, report.basins).axes
    assert words_in(times) == ["time: not known, or all frames are lost"]
    assert words_in(preparing) == ["preparation: nothing to prepare, or not counted"]
