"""Distance maps and nearest edges against brute force."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from acp_lab.errors import GeometryError
from acp_lab.imaging import distance_map, nearest_edges


def brute_force(edges: np.ndarray) -> np.ndarray:
    rows, columns = np.nonzero(edges)
    y, x = np.mgrid[: edges.shape[0], : edges.shape[1]]
    return np.hypot(x[..., None] - columns, y[..., None] - rows).min(axis=2)


@given(st.integers(1, 40), st.integers(1, 40), st.integers(1, 12), st.integers(0, 10_000))
def test_distances_and_nearest_edges_are_exact(height: int, width: int, count: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    edges = np.zeros((height, width), bool)
    edges[rng.integers(0, height, count), rng.integers(0, width, count)] = True
    distances = distance_map(edges)
    expected = brute_force(edges)
    assert distances.dtype == np.float32
    np.testing.assert_allclose(distances, expected, atol=1e-5)

    nearest = nearest_edges(edges)
    assert nearest.shape == (height, width, 2)
    assert edges[nearest[..., 1], nearest[..., 0]].all(), "(x, y), not (row, column)"
    y, x = np.mgrid[:height, :width]
    np.testing.assert_allclose(np.hypot(nearest[..., 0] - x, nearest[..., 1] - y), expected, atol=1e-12)


def test_the_same_edges_give_the_same_bits() -> None:
    """cv2 rounds differently in outputs that lie differently in memory, so arrays of many sizes stay alive here."""
    edges = np.random.default_rng(0).random((237, 301)) < 0.002
    first, others = distance_map(edges), []
    for size in range(60):
        others.append((np.empty(16 * size + 8, np.uint8), distance_map(edges.copy())))
    assert first.ctypes.data % 64 == 0
    assert all(other.ctypes.data % 64 == 0 and other.tobytes() == first.tobytes() for _, other in others)


def test_a_large_frame_is_exact_too() -> None:
    edges = np.zeros((1024, 1224), bool)
    edges[0, 0] = edges[700, 300] = True
    np.testing.assert_allclose(distance_map(edges), brute_force(edges), atol=1e-3)


def test_without_edges_all_is_far_but_finite() -> None:
    assert (distance_map(np.zeros((30, 40), bool)) == 50.0).all()
    with pytest.raises(GeometryError, match="no edge pixel"):
        nearest_edges(np.zeros((30, 40), bool))


def test_edges_of_cv2_and_slices_are_taken_as_they_are() -> None:
    edges = np.zeros((40, 60), np.uint8)
    edges[10, 20] = 255
    assert distance_map(edges)[10, 23] == 3.0  # type: ignore[arg-type]
    assert distance_map(edges[::2, ::2])[5, 13] == 3.0  # type: ignore[arg-type]


@pytest.mark.parametrize("shape", [(5,), (4, 4, 3), (0, 4)])
def test_other_shapes_are_refused(shape: tuple[int, ...]) -> None:
    for function in (distance_map, nearest_edges):
        with pytest.raises(GeometryError, match="edge map of shape"):
            function(np.zeros(shape, bool))
