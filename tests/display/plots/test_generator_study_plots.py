"""Pictures of the edge generator and of its training."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from acp_lab.display.plots.generator_study import (
    draw_edge_points,
    draw_epochs,
    draw_images,
    draw_inverse_psnr,
    draw_training,
    draw_view,
)
from acp_lab.generator.base import GeneratedEdges
from acp_lab.generator.painted.edge_points import ridge
from tests.display.blank_axes import axes_of
from tests.display.made_epochs import TRUTH, epoch


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
