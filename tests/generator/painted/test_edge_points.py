"""Ridges of soft lines: where they are found, and how they are said to move."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from acp_lab.generator.painted.config import AutoencoderConfig
from acp_lab.generator.painted.edge_images import EdgeImageConfig, draw_strokes
from acp_lab.generator.painted.edge_points import (
    RidgePoints,
    _derivatives,
    ridge,
    ridge_motion,
    sample_bilinear,
    threshold,
)
from acp_lab.geometry.arrays import Float32Array, FloatArray

SIZE = 48


def line_image(angle: float, offset: float, sigma: float = 1.0, peak: float = 0.9) -> Float32Array:
    """A soft line whose normal points along `angle`, `offset` px from the middle."""
    y, x = np.mgrid[:SIZE, :SIZE] - 0.5 * (SIZE - 1)
    distance = x * np.cos(angle) + y * np.sin(angle) - offset
    image: Float32Array = (peak * np.exp(-0.5 * (distance / sigma) ** 2)).astype(np.float32)
    return image


def inner(found: RidgePoints) -> np.ndarray:
    """Points away from the border."""
    kept: np.ndarray = ((found.points > 4.0) & (found.points < SIZE - 5.0)).all(1)
    return kept


@given(angle=st.floats(0.0, np.pi), offset=st.floats(-12.0, 12.0), sigma=st.floats(0.7, 1.3), peak=st.floats(0.5, 1.0))
@settings(max_examples=30)
def test_a_line_is_found_to_a_small_part_of_a_pixel(angle: float, offset: float, sigma: float, peak: float) -> None:
    found = ridge(line_image(angle, offset, sigma, peak))
    normal = np.array([np.cos(angle), np.sin(angle)])
    kept = inner(found)
    off = (found.points[kept] - 0.5 * (SIZE - 1)) @ normal - offset
    assert kept.sum() > 15
    assert np.abs(off).max() < 0.15
    assert np.sqrt((off**2).mean()) < 0.05
    np.testing.assert_allclose(np.abs(found.normals[kept] @ normal), 1.0, atol=0.01)
    np.testing.assert_allclose(np.einsum("nj,nj->n", found.normals, found.tangents), 0.0, atol=1e-12)
    assert found.strengths[kept].min() > 0.7 * peak
    assert found.strengths.max() <= 1.0


def test_the_threshold_is_on_the_brightness() -> None:
    image = np.maximum(line_image(0.0, -10.0, peak=0.2), line_image(0.0, 10.0, peak=0.8))
    middle = 0.5 * (SIZE - 1)
    for found in (ridge(image, 0.5), threshold(image, 0.5)):
        assert len(found) > 30
        assert (found.points[:, 0] > middle).all()
    both = ridge(image, 0.1).points[:, 0]
    assert (both < middle).any()
    assert (both > middle).any()


def apart(gap_px: float) -> bool:
    """Whether two lines as they are drawn for training, a gap apart, are read as two."""
    x = 0.5 * (SIZE - 1) + np.array([-0.5, 0.5]) * gap_px
    y = np.arange(SIZE - 1.0)
    strokes = np.array([[(at, row), (at, row + 1.0)] for at in x for row in y])
    owner = np.zeros(len(strokes), np.intp)
    found = ridge(draw_strokes(strokes, owner, 1, SIZE, EdgeImageConfig().line_sigma_px)[0])
    off = np.abs(found.points[inner(found), 0][:, None] - x)
    return bool((off.min(1) < 0.5).all() and ((off < 0.5).sum(0) > 15).all())


def test_a_larger_picture_keeps_lines_apart_that_flow_into_one_on_a_smaller_one() -> None:
    usual = AutoencoderConfig()
    smaller = usual.painting(128)
    gap = 0.0145  # of the picture's side
    assert apart(gap * usual.images.size)
    assert not apart(gap * smaller.images.size)


@pytest.mark.parametrize("config", [AutoencoderConfig(), AutoencoderConfig.fast()], ids=["usual", "fast"])
def test_layers_are_never_wider_for_larger_pictures(config: AutoencoderConfig) -> None:
    assert config.painting(config.images.size) == config
    larger = config.painting(256)
    assert larger.shape.size == larger.images.size == 256
    assert all(wide <= usual for wide, usual in zip(larger.shape.widths, config.shape.widths, strict=True))
    assert larger.shape.widths[-1] <= min(config.shape.widths[-1], 32)
    assert larger.painting(128).shape.widths == (config.shape.widths if config.images.size == 128 else (64, 64, 48))


def test_derivatives_at_some_pixels_are_those_of_the_whole_picture(rng: np.random.Generator) -> None:
    """Also on the border, beyond which the picture goes on as it ends."""
    picture = rng.random((9, 12)).astype(np.float32)
    padded = np.pad(picture, 1, mode="edge").astype(np.float64)
    by_x = 0.5 * (padded[:, 2:] - padded[:, :-2])
    whole = (
        by_x[1:-1],
        0.5 * (padded[2:, 1:-1] - padded[:-2, 1:-1]),
        np.diff(padded, 2, axis=1)[1:-1],
        0.5 * (by_x[2:] - by_x[:-2]),
        np.diff(padded, 2, axis=0)[:, 1:-1],
    )
    rows, columns = np.nonzero(picture > 0.4)
    assert {0, 8} <= set(rows.tolist())
    assert {0, 11} <= set(columns.tolist())
    for found, expected in zip(_derivatives(picture, rows, columns), whole, strict=True):
        np.testing.assert_allclose(found, expected[rows, columns], atol=1e-6)


@pytest.mark.parametrize("find", [ridge, threshold])
@pytest.mark.parametrize("value", [0.0, 0.25])
def test_an_even_image_has_no_edges(find, value: float) -> None:  # type: ignore[no-untyped-def]
    found = find(np.full((SIZE, SIZE), value, np.float32))
    assert len(found) == 0
    assert found.points.shape == found.tangents.shape == found.normals.shape == (0, 2)


@given(angle=st.floats(0.0, np.pi), offset=st.floats(-8.0, 8.0))
def test_a_threshold_leaves_a_connected_line_one_pixel_wide(angle: float, offset: float) -> None:
    found = threshold(line_image(angle, offset, sigma=1.3))
    normal = np.array([np.cos(angle), np.sin(angle)])
    kept = inner(found)
    assert (np.abs((found.points[kept] - 0.5 * (SIZE - 1)) @ normal - offset) < 1.6).all()
    np.testing.assert_array_equal(found.points, np.round(found.points))
    np.testing.assert_allclose(np.abs(found.normals[kept] @ normal), 1.0, atol=0.02)
    # As many pixels as the line is long, along its longer axis, and a few where it steps aside.
    lengths = np.ptp(found.points[kept], axis=0)
    assert max(lengths) <= kept.sum() - 1 <= 1.5 * max(lengths) + 2


def test_bilinear_sampling_is_exact_on_planes(rng: np.random.Generator) -> None:
    y, x = np.mgrid[:20, :30].astype(float)
    points = rng.uniform((0.0, 0.0), (29.0, 19.0), (50, 2))
    np.testing.assert_allclose(
        sample_bilinear(2.0 * x - 3.0 * y + 1.0, points), 2 * points[:, 0] - 3 * points[:, 1] + 1
    )
    stacked = sample_bilinear(np.dstack([x, y]), points)
    np.testing.assert_allclose(stacked, points, atol=1e-12)
    np.testing.assert_allclose(sample_bilinear(x, np.array([[-5.0, 3.0], [99.0, 3.0]])), [0.0, 29.0])


# ---- motion --------------------------------------------------------------------------------------------------


def moving_lines(parameters: FloatArray) -> Float32Array:
    """Two lines that eight numbers move about: offsets, turns, and their brightness."""
    a = line_image(0.4 + 0.01 * parameters[1], -8.0 + parameters[0], peak=0.8 + 0.1 * parameters[6])
    b = line_image(1.3 + 0.01 * parameters[3], 9.0 + parameters[2] - 0.5 * parameters[4], peak=0.7)
    return np.maximum(a, b) * np.float32(1.0 + 0.05 * parameters[7])


def at_pixels(found: RidgePoints) -> dict[tuple[int, int], FloatArray]:
    """Ridge points by the pixel they lie in."""
    return {tuple(np.round(point).astype(int).tolist()): point for point in found.points}


def test_motion_is_that_of_ridges_found_again() -> None:
    step = 0.05
    at = np.zeros(8)
    ahead, behind = ([moving_lines(at + side * step * e) for e in np.eye(8)] for side in (1.0, -1.0))
    derivatives = np.stack([(a - b) / (2.0 * step) for a, b in zip(ahead, behind, strict=True)], -1)
    image = moving_lines(at)
    found = ridge(image)
    motion = ridge_motion(image, derivatives.astype(np.float32), found)
    assert motion.shape == (len(found), 8)
    # Away from the border and from where the lines cross.
    kept = inner(found) & np.isfinite(motion).all(1)
    first, second = (np.array([np.cos(a), np.sin(a)]) for a in (0.4, 1.3))
    centred = found.points - 0.5 * (SIZE - 1)
    to_first, to_second = np.abs(centred @ first + 8.0), np.abs(centred @ second - 9.0)
    kept &= np.maximum(to_first, to_second) > 6.0
    assert kept.sum() > 30
    for k in range(8):
        there, back = (at_pixels(ridge(images[k])) for images in (ahead, behind))
        for row in np.flatnonzero(kept):
            pixel = tuple(np.round(found.points[row]).astype(int).tolist())
            if pixel in there and pixel in back:
                across = float((there[pixel] - back[pixel]) @ found.normals[row]) / (2.0 * step)
                assert motion[row, k] == pytest.approx(across, abs=0.12), (pixel, k)
    assert np.abs(motion[kept][:, 0]).max() > 0.8, "the lines did move"
    assert np.abs(motion[kept][:, 5]).max() < 1e-6, "the sixth number moves nothing"


@given(angle=st.floats(0.0, np.pi), offset=st.floats(-8.0, 8.0))
@settings(max_examples=30)
def test_a_line_that_shifts_by_one_moves_by_one(angle: float, offset: float) -> None:
    image = line_image(angle, offset)
    h = 1e-2
    shift = (line_image(angle, offset + h) - line_image(angle, offset - h)) / (2.0 * h)
    derivatives = np.repeat(shift[:, :, None], 8, axis=2)
    found = ridge(image)
    kept = inner(found)
    towards = found.normals[kept] @ np.array([np.cos(angle), np.sin(angle)])
    motion = ridge_motion(image, derivatives, found)[kept]
    np.testing.assert_allclose(motion * np.sign(towards)[:, None], 1.0, atol=0.1)


def test_no_clear_ridge_no_motion() -> None:
    flat = np.full((SIZE, SIZE), 0.5, np.float32)
    somewhere = RidgePoints(np.array([[20.2, 20.7]]), np.array([[1.0, 0.0]]), np.ones(1))
    assert np.isnan(ridge_motion(flat, np.ones((SIZE, SIZE, 8), np.float32), somewhere)).all()
