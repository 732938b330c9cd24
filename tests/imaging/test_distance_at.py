"""Distances at a few points against brute force and against maps of all of them."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from acp_lab.errors import GeometryError
from acp_lab.imaging.distance import distance_map
from acp_lab.imaging.distance_at import NO_EDGE, column_distances, distances_at


def some_edges(rng: np.random.Generator, shape: tuple[int, int, int], most: int) -> np.ndarray:
    """Layers (k, h, w) of up to `most` edge pixels each, some layers without any."""
    layers = np.zeros(shape, bool)
    for layer in layers:
        count = int(rng.integers(0, most))
        layer[rng.integers(0, shape[1], count), rng.integers(0, shape[2], count)] = True
    return layers


def read_off_map(maps: np.ndarray, layer: int, point: np.ndarray) -> tuple[float, tuple[float, float]]:
    """What the bilinear surface over a layer's map has at a point inside it: value and gradient."""
    column, row = map(int, point)
    u, v = point - (column, row)
    (a, b), (c, d) = maps[layer, row : row + 2, column : column + 2].astype(np.float64)
    value = (1 - v) * ((1 - u) * a + u * b) + v * ((1 - u) * c + u * d)
    return value, ((1 - v) * (b - a) + v * (d - c), (1 - u) * (c - a) + u * (d - b))


@given(st.integers(2, 60), st.integers(2, 60), st.integers(1, 4), st.integers(1, 30), st.integers(0, 10_000))
def test_what_is_looked_up_is_what_stands_in_the_map_of_all(
    height: int, width: int, count: int, most: int, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    edges = some_edges(rng, (count, height, width), most)
    maps = np.stack([distance_map(layer) for layer in edges])
    points = rng.uniform(0.0, 1.0, (50, 2)) * (width - 1.001, height - 1.001)
    points[:20] = np.floor(points[:20])
    layers = rng.integers(0, count, 50)
    values, gradients = distances_at(column_distances(edges), layers, points)
    for k in range(50):
        value, gradient = read_off_map(maps, layers[k], points[k])
        assert values[k] == pytest.approx(value, rel=1e-6, abs=1e-5)
        np.testing.assert_allclose(gradients[k], gradient, atol=2e-5)


def test_at_pixels_it_is_the_exact_distance_in_single_precision(rng: np.random.Generator) -> None:
    edges = some_edges(rng, (3, 90, 130), 9)
    edges[1, 44, 7] = True
    rows, columns = np.nonzero(edges[1])
    pixels = np.stack([rng.integers(0, 129, 300), rng.integers(0, 89, 300)], 1).astype(np.float64)
    values, _ = distances_at(column_distances(edges), np.ones(300, np.int64), pixels)
    squares = ((pixels[:, None] - np.stack([columns, rows], 1)) ** 2).sum(2).min(1)
    np.testing.assert_array_equal(values, np.sqrt(squares).astype(np.float32))


def test_a_layer_without_edges_is_as_far_as_the_diagonal() -> None:
    edges = np.zeros((2, 30, 40), bool)
    edges[1] = True
    columns = column_distances(edges)
    assert (columns[0] == NO_EDGE).all()
    assert not columns[1].any()
    values, gradients = distances_at(columns, np.array([0, 1]), np.array([[7.3, 8.9], [7.3, 8.9]]))
    np.testing.assert_array_equal(values, [50.0, 0.0])
    np.testing.assert_array_equal(gradients, np.zeros((2, 2)))


def test_a_column_without_edges_is_reached_from_its_neighbours() -> None:
    edges = np.zeros((1, 12, 300), bool)
    edges[0, 5, 290] = True
    values, gradients = distances_at(column_distances(edges), np.zeros(1, np.int64), np.array([[2.0, 5.0]]))
    assert values[0] == 288.0
    assert gradients[0, 0] == -1.0


def test_beyond_the_border_the_way_to_it_is_added() -> None:
    edges = np.zeros((1, 20, 30), bool)
    edges[0, :, 3] = True
    points = np.array([[-4.0, 7.0], [3.0, -6.0], [-3.0, -4.0], [40.0, 7.0], [np.nan, 1.0], [2.0, -np.inf]])
    values, gradients = distances_at(column_distances(edges), np.zeros(6, np.int64), points)
    np.testing.assert_allclose(values[:4], [7.0, 6.0, 8.0, 37.0], atol=1e-2)
    np.testing.assert_allclose(gradients[:4], [[-1.0, 0.0], [0.0, -1.0], [-0.6, -0.8], [1.0, 0.0]], atol=1e-12)
    assert (values[4:] == math.inf).all()


@pytest.mark.parametrize("shape", [(10, 10), (0, 10, 10), (1, 65001, 2), (1, 1, 9), (1, 9, 1)])
def test_other_shapes_are_refused(shape: tuple[int, ...]) -> None:
    with pytest.raises(GeometryError, match="give \\(k, h, w\\)"):
        column_distances(np.zeros(shape, bool))
