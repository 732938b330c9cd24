"""Pictures of a sensitivity study: they draw the study's own numbers."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from acp_lab.display.look import INK
from acp_lab.display.plots.sensitivity import draw_change_table, draw_conditions, draw_cosines, sensitivity_figure
from acp_lab.studies.sensitivity import POINT_NAMES, POSE_NAMES, Behaviour, SensitivityStudy


def made_study(views: int = 5, motions: int = 8) -> SensitivityStudy:
    rng = np.random.default_rng(0)
    sets = []
    for name, parameters in (
        ("pose", POSE_NAMES),
        ("balanced pose", POSE_NAMES),
        ("points, homography", POINT_NAMES),
        ("points, rigid", POINT_NAMES),
    ):
        p = len(parameters)
        changes = (rng.normal(size=(views, motions, p)) for _ in range(3))
        sets.append(
            Behaviour(name, parameters, rng.uniform(0.1, 2.0, (views, p)), rng.uniform(1.0, 99.0, views), *changes)
        )
    return SensitivityStudy(rng.normal(size=(views, 3)), rng.normal(size=(views, motions, 6)), tuple(sets))


def test_the_colour_table_holds_each_row_scaled_to_its_largest_entry() -> None:
    study = made_study()
    axes = Figure().subplots()
    draw_change_table(axes, study["pose"], 2, "gradients", "gradient")
    shown = np.asarray(axes.images[0].get_array())
    expected = study["pose"].gradients[2, :6]
    np.testing.assert_allclose(shown, expected / np.abs(expected).max(1, keepdims=True))
    assert [tick.get_text() for tick in axes.get_xticklabels()] == list(POSE_NAMES)
    assert axes.texts[0].get_text() == f"{shown[0, 0]:.1f}".replace("-0.0", "0.0")


def test_boxes_sit_at_the_medians() -> None:
    study = made_study()
    conditions, cosines = Figure().subplots(1, 2)
    draw_conditions(conditions, study)
    draw_cosines(cosines, study, "gradient_cosine", "gradient")
    # Of a box plot's lines the medians are those in the figure's ink.
    shown = [
        line.get_ydata()[0] for line in conditions.lines if line.get_color() == INK and len(line.get_ydata()) == 2
    ]
    assert all(any(np.isclose(np.median(one.condition), y) for y in shown) for one in study.sets)
    assert cosines.get_ylim() == (-1.05, 1.05)


def test_the_whole_figure_draws() -> None:
    figure = sensitivity_figure(made_study(), view=1)
    figure.canvas.draw()
    assert len(figure.axes) == 8
