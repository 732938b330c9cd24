"""Lines across an outline, read one by one in plain NumPy."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from acp_lab.geometry.arrays import ByteImage, FloatArray
from acp_lab.tracking.learning.region_colours import ColourConfig, RegionColours
from acp_lab.tracking.targets.correspondence_lines import ColourCrop, CorrespondenceLines

SIZE = (60, 80)
FADE_PX = 2.5


@dataclass
class Drawn:
    """An image of random colours, of which something is known, and lines anywhere on it."""

    image: ByteImage
    lines: CorrespondenceLines

    def log_odds(self, point: FloatArray) -> float:
        """Of the pixel of the crop that is nearest to a point of the full image."""
        bins, (x0, y0) = self.lines.crop.bins, self.lines.crop.origin
        column, row = (int(np.floor(value + 0.5)) for value in (point[0] - x0, point[1] - y0))
        if not (0 <= row < bins.shape[0] and 0 <= column < bins.shape[1]):
            return 0.0  # nobody sees whether the part goes on there
        return float(self.lines.crop.colours.log_odds[bins[row, column]])

    def along(self, line: int, ways: FloatArray) -> FloatArray:
        points = self.lines.points[line] + ways[:, None] * self.lines.outward[line]
        return np.array([self.log_odds(point) for point in points])


@pytest.fixture
def drawn(rng: np.random.Generator) -> Drawn:
    image = rng.integers(0, 256, (*SIZE, 3)).astype(np.uint8)
    image[:, 40:] //= 3
    colours = RegionColours(ColourConfig())
    bins = RegionColours.bins(image)
    colours.learn(bins[:, :45].ravel(), bins[:, 35:].ravel())
    count = 30
    angles = rng.uniform(0.0, 2.0 * np.pi, count)
    return Drawn(
        image,
        CorrespondenceLines(
            ColourCrop(image, (5, 3, 70, 55), colours),
            rows=np.arange(count),
            ids=np.arange(count),
            points=rng.uniform([0.0, 0.0], [SIZE[1], SIZE[0]], (count, 2)),
            outward=np.stack([np.cos(angles), np.sin(angles)], 1),
            free=rng.uniform(1.0, 25.0, (2, count)),
            px_per_mm=np.ones(count),
        ),
    )


def test_the_crop_is_cut_to_the_image() -> None:
    image = np.zeros((*SIZE, 3), np.uint8)
    for box, origin, size in (((-5, -5, 20, 10), (0, 0), (10, 20)), ((70, 50, 99, 99), (70, 50), (10, 10))):
        crop = ColourCrop(image, box, RegionColours(ColourConfig()))
        assert crop.origin == origin
        assert crop.bins.shape == size


@pytest.mark.parametrize("scale", [1, 2, 4])
def test_the_posterior_is_that_of_its_slow_twin(drawn: Drawn, scale: int) -> None:
    """Twelve places for a smoothed step of eight segments; its clearest variance is the unit of the weights."""
    step = -0.43 * np.tanh(np.arange(8) - 3.5)
    places = np.arange(12) - 5.5

    def moments(segments: FloatArray) -> tuple[float, float]:
        evidence = np.array([segments[k : k + 8] @ step for k in range(12)])
        probability = np.exp(evidence - evidence.max())
        probability /= probability.sum()
        mean = float(probability @ places)
        return mean, float(probability @ (places - mean) ** 2)

    _, least = moments(np.where(np.arange(19) < 9.5, 3.0, -3.0))
    least = max(0.05, least)
    ways = np.arange(19 * scale) - 0.5 * (19 * scale - 1)
    found_px, weights = drawn.lines.posterior(scale, FADE_PX)
    for line in range(len(drawn.lines)):
        segments = np.clip(drawn.along(line, ways).reshape(19, scale).sum(1), -4.0, 4.0)
        mean, variance = moments(segments)
        expected = least / max(variance, least) * np.clip(1.0 - max(abs(mean) - FADE_PX, 0.0) / 1.5, 0.0, 1.0)
        if drawn.lines.free[:, line].min() < 2.0 * scale:
            mean = expected = 0.0
        assert found_px[line] == pytest.approx(scale * mean, abs=1e-5)
        assert weights[line] == pytest.approx(expected, abs=1e-5)
    assert 3 < np.count_nonzero(weights) < len(weights)


def test_pixels_beyond_the_crop_say_nothing_whatever_is_known_of_white(drawn: Drawn) -> None:
    before = drawn.lines.posterior(4, FADE_PX)
    # White is the last colour of the table, where an index of -1 would lead.
    drawn.lines.crop.colours.log_odds[-1] = 3.0
    np.testing.assert_array_equal(drawn.lines.posterior(4, FADE_PX), before)


def test_pixels_beyond_the_crop_may_be_either(drawn: Drawn) -> None:
    before = drawn.lines.margin()
    drawn.lines.crop.colours.probability[-1] = 0.9
    assert drawn.lines.margin() == before


def test_which_lines_lie_in_the_crop_is_that_of_a_slow_twin(drawn: Drawn) -> None:
    lines, size = drawn.lines, (drawn.lines.crop.pixels.shape[1] - 1, drawn.lines.crop.pixels.shape[0] - 1)
    half = 0.5 * 19 * np.abs(lines.outward)  # of as many segments, a px each
    in_crop = lines.points - lines.crop.origin
    expected = (in_crop - half >= 0.0).all(1) & (in_crop + half <= size).all(1)
    np.testing.assert_array_equal(lines.in_image, expected)
    assert expected.any()
    assert not expected.all()


def test_the_margin_is_that_of_its_slow_twin(drawn: Drawn) -> None:
    margins = []
    for line in range(len(drawn.lines)):
        ways = np.arange(1.0, 9.0)
        ways = ways[ways <= drawn.lines.free[:, line].min()]
        inside, outside = (1.0 / (1.0 + np.exp(-drawn.along(line, sign * ways))) for sign in (-1.0, 1.0))
        margins.append((inside - outside).sum() / max(len(ways), 1))
    assert drawn.lines.margin() == pytest.approx(float(np.mean(margins)), abs=1e-6)
    assert abs(drawn.lines.margin()) > 1e-3


def test_colours_are_taken_beside_the_outline_as_far_as_it_is_free(drawn: Drawn) -> None:
    lines = drawn.lines
    bins = RegionColours.bins(drawn.image)[3:55, 5:70]
    for sign, found, free in zip((-1.0, 1.0), lines.bins_beside(20), lines.free, strict=True):
        expected = []
        for line in range(len(lines)):
            for way in range(1, 20):
                if way < free[line]:
                    x, y = np.floor(lines.points[line] + sign * way * lines.outward[line] - (5, 3) + 0.5).astype(int)
                    if not (0 <= x < 65 and 0 <= y < 52):
                        break
                    expected.append(bins[y, x])
        assert sorted(found) == sorted(expected)
