"""Pictures of the edge generator and the widget that shows its training, from made-up epochs."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from acp_lab.display.plots.generator_study import (
    draw_edge_points,
    draw_epochs,
    draw_images,
    draw_inverse_psnr,
    draw_training,
    draw_view,
)
from acp_lab.display.widgets import LiveTraining, ProgressBar
from acp_lab.generator.base import GeneratedEdges
from acp_lab.generator.painted.edge_points import ridge
from acp_lab.generator.painted.watch import STAGE_NAMES, WatchedEpoch

TRUTH = np.zeros((3, 16, 16), np.float32)
TRUTH[:, :, 8] = 1.0


def epoch(done: int, stage: int = 0, bright: float = 0.5) -> WatchedEpoch:
    bce = 1.0 / done
    return WatchedEpoch(
        STAGE_NAMES[stage], done, 4, done, 4, 0.3, TRUTH, np.float32(bright) * TRUTH, bce, 0.1, bce + 0.05
    )


def axes_of(count: int) -> list[Axes]:
    figure = Figure()
    return [figure.add_subplot(1, count, number + 1) for number in range(count)]


def test_the_slope_drawn_is_that_of_the_value() -> None:
    value, slope = axes_of(2)
    draw_inverse_psnr(value, slope)
    errors, values = (np.asarray(data, float) for data in value.lines[0].get_data())
    assert np.interp(0.01, errors, values) == pytest.approx(0.05, rel=1e-3)  # 20 dB
    np.testing.assert_allclose(slope.lines[0].get_ydata()[50:350], np.gradient(values, errors)[50:350], rtol=2e-3)


def test_a_column_per_epoch_and_the_truth_last() -> None:
    (axes,) = axes_of(1)
    draw_epochs(axes, [epoch(1, bright=0.2), epoch(2, bright=0.8)], views=2)
    picture = np.asarray(axes.images[0].get_array())
    assert picture.shape == (2 * 18 - 2, 3 * 18 - 2)
    assert [int(picture[5, x]) for x in (8, 26, 44)] == [51, 204, 255]
    assert [text.get_text() for text in axes.texts] == ["auto-encoder\n1 of 4", "auto-encoder\n2 of 4", "the truth"]


def test_the_loss_is_the_sum_of_its_parts() -> None:
    (axes,) = axes_of(1)
    draw_training(axes, [epoch(1), epoch(2), epoch(3, stage=1), epoch(4, stage=1)])
    np.testing.assert_allclose(axes.lines[0].get_ydata(), [1.05, 0.55, 1 / 3 + 0.05, 0.3])
    assert {text.get_text() for text in axes.texts} == {"auto-encoder", "latent regressor"}


def test_images_and_edge_points_are_drawn_where_they_are() -> None:
    first, second, third = axes_of(3)
    draw_images([first], TRUTH, ["one"])
    assert first.get_title() == "one"
    soft = cv2.GaussianBlur(TRUTH[0], (0, 0), 1.0)
    found = ridge(soft / soft.max())
    draw_edge_points(second, soft, found, found.points)
    np.testing.assert_allclose(second.lines[-1].get_xdata(), 8.0, atol=0.05)
    rigid = GeneratedEdges(np.full((1, 2), 5.0), np.array([[1.0, 0.0]]), np.ones(1), np.zeros(1, int))
    draw_view(third, soft, np.array([[2.0, 2.0], [12.0, 2.0], [12.0, 12.0], [2.0, 30.0]]), rigid, "pulled")
    assert third.get_ylim() == (15.5, -0.5), "a point outside must not shrink the image"
    assert len(third.collections) == 1


def test_live_training_follows_and_begins_anew() -> None:
    live = LiveTraining()
    for done in (1, 2, 3, 4):
        live(epoch(done, bright=0.25 * done))
    assert [seen.done for seen in live.epochs] == [1, 2, 3, 4]
    assert (live.progress.bar.value, live.progress.bar.max, live.progress.bar.bar_style) == (4, 4, "success")
    assert live.progress.text.value == (
        "auto-encoder, epoch 4 of 4: held-out loss 0.300 = BCE 0.250 + 0.5 · 1/PSNR 0.100"
    )
    picture = cv2.imdecode(np.frombuffer(live.picture.value, np.uint8), cv2.IMREAD_GRAYSCALE)
    assert picture.shape == (2 * 18 - 2, 3 * 18 - 2)
    assert picture[5, 8] == picture[5 + 18, 8] == 255
    live(epoch(1))
    assert [seen.done for seen in live.epochs] == [1]
    assert live.progress.bar.bar_style == ""


def test_a_plain_bar_counts_epochs() -> None:
    bar = ProgressBar("visibility network")
    assert bar.text.value == "waiting to begin"
    bar(3, 20)
    assert (bar.bar.value, bar.bar.max, bar.text.value) == (3, 20, "epoch 3 of 20")
