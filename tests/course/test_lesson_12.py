"""The graders of notebook 12."""

from __future__ import annotations

import numpy as np
import pytest

from tests.course.grading import hints, passes


def bins(tangents, count):  # type: ignore[no-untyped-def]
    return np.round(np.arctan2(tangents[:, 1], tangents[:, 0]) / np.pi * count).astype(int) % count


def test_direction_bins() -> None:
    passes("12.1", bins)
    passes("12.1", lambda tangents, count: bins(tangents, count).tolist())


@pytest.mark.parametrize(
    ("wrong", "fragment"),
    [
        (lambda t, n: bins(t, 8), "not for 12"),
        (lambda t, n: np.round(np.arctan2(t[:, 1], t[:, 0]) / np.pi * n), "from 0 to 7"),
        (lambda t, n: np.arctan2(t[:, 1], t[:, 0]) % np.pi / np.pi * n % n, "whole number"),
        (lambda t, n: np.round(np.arctan2(t[:, 1], t[:, 0]) / (2.0 * np.pi) * n) % n, "same edge"),
        (lambda t, n: np.floor(np.arctan2(t[:, 1], t[:, 0]) % np.pi / np.pi * n), "its middle there"),
        (lambda t, n: bins(t[:, ::-1], n), "exchanged"),
        (lambda t, n: bins(np.stack([-t[:, 1], t[:, 0]], 1), n), "gradients"),
        (lambda t, n: np.zeros(len(t)), "by hand"),
        (lambda t, n: 3, "one bin per edge"),
        (3, "the function itself"),
    ],
)
def test_wrong_bins(wrong, fragment: str) -> None:  # type: ignore[no-untyped-def]
    hints("12.1", wrong, fragment)


def directional(distances, px_per_bin):  # type: ignore[no-untyped-def]
    found = distances.copy()
    for _ in range(len(distances) // 2):
        found = np.minimum(found, np.minimum(np.roll(found, 1, 0), np.roll(found, -1, 0)) + px_per_bin)
    return found


def without_the_seam(distances, px_per_bin):  # type: ignore[no-untyped-def]
    apart = np.abs(np.subtract.outer(np.arange(len(distances)), np.arange(len(distances))))
    return (distances[None] + px_per_bin * apart[:, :, None, None]).min(1)


def one_bin(distances, px_per_bin):  # type: ignore[no-untyped-def]
    return np.minimum(distances, np.minimum(np.roll(distances, 1, 0), np.roll(distances, -1, 0)) + px_per_bin)


def test_directional_distance() -> None:
    passes("12.2", directional)


@pytest.mark.parametrize(
    ("wrong", "fragment"),
    [
        (lambda d, px: d, "very direction"),
        (lambda d, px: np.broadcast_to(d.min(0), d.shape), "any edge"),
        (without_the_seam, "next to the first"),
        (one_bin, "one bin to either side"),
        (lambda d, px: one_bin(one_bin(d, px), px), "two bins to either side"),
        (lambda d, px: d + px, "no value can be larger"),
        (lambda d, px: 0.5 * d, "smallest over j"),
        (lambda d, px: d.min(0), "for each direction and pixel"),
    ],
)
def test_wrong_distances(wrong, fragment: str) -> None:  # type: ignore[no-untyped-def]
    hints("12.2", wrong, fragment)


def test_shared_score() -> None:
    for right in (19.0 / 39.0, 0.487, 0.49):
        passes("12.3", right)
    hints("12.3", 0.95, "its score alone")
    hints("12.3", 0.5, "neither")
    hints("12.3", 0.475, "odds")
    hints("12.3", 0.9025, "do not multiply")
    hints("12.3", 0.1, "which share")
