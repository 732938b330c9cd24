"""The report's measures on images whose answer is known."""

from __future__ import annotations

import numpy as np
import pytest

from acp_lab.generator.painted.edge_images import draw_strokes
from acp_lab.generator.painted.quality import comparison_grid, generation_quality
from acp_lab.geometry.arrays import Float32Array, FloatArray


def horizontal(y: float, first: float, last: float) -> FloatArray:
    """(n, 2) points along a line."""
    x = np.arange(first, last, 0.5)
    return np.column_stack([x, np.full(len(x), y)])


def drawn(points: FloatArray) -> Float32Array:
    image: Float32Array = draw_strokes(np.stack([points, points], 1), np.zeros(len(points), int), 1, 64, 0.8)[0]
    return image


def test_a_shifted_line_is_as_far_as_it_was_shifted() -> None:
    truth = horizontal(30.0, 10.0, 54.0)
    for shift in (0.0, 0.4, 2.0):
        quality = generation_quality(drawn(truth + np.array([0.0, shift]))[None], [truth])
        # Half a pixel from point to point of the truth lies in the first, a third of one in the second.
        assert quality.generated_to_true_px == pytest.approx(shift, abs=0.12)
        assert quality.true_to_generated_px == pytest.approx(shift, abs=0.13)
        assert quality.f_score == pytest.approx(1.0 if shift < 1.0 else 0.0, abs=0.03)


def test_slanting_lines_are_lines_too() -> None:
    # Their ridges have fewer points per length: one per row or column.
    along = np.arange(0.0, 40.0, 0.25)[:, None]
    for angle_deg in (30.0, 45.0, 60.0):
        direction = np.array([np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))])
        truth = 12.0 + along * direction
        quality = generation_quality(drawn(truth)[None], [truth])
        assert quality.generated_to_true_px < 0.11
        assert quality.true_to_generated_px < 0.13


def test_what_was_invented_and_what_was_missed_are_told_apart() -> None:
    short, long = horizontal(30.0, 10.0, 32.0), horizontal(30.0, 10.0, 54.0)
    invented = generation_quality(drawn(long)[None], [short])
    missed = generation_quality(drawn(short)[None], [long])
    assert invented.generated_to_true_px > 4.0 > 0.5 > invented.true_to_generated_px
    assert missed.true_to_generated_px > 4.0 > 0.5 > missed.generated_to_true_px
    assert invented.f_score == pytest.approx(2.0 / 3.0, abs=0.05)


def test_an_empty_image_is_as_wrong_as_can_be_and_means_are_taken() -> None:
    truth = horizontal(30.0, 10.0, 54.0)
    quality = generation_quality(np.stack([drawn(truth), np.zeros((64, 64), np.float32)]), [truth, truth])
    assert quality.f_score == pytest.approx(0.5, abs=0.02)
    assert quality.true_to_generated_px == pytest.approx(32.0, abs=0.3)


def test_the_grid_holds_every_image() -> None:
    columns = [np.full((3, 8, 8), value, np.float32) for value in (0.0, 1.0)]
    grid = comparison_grid(columns, gap_px=2)
    assert grid.shape == (28, 18)
    assert grid.dtype == np.uint8
    assert (grid[10:18, :8] == 0).all()
    assert (grid[20:28, 10:] == 255).all()
    assert (grid[8:10] == 128).all()
