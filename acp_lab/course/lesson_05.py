"""Notebook 05: from image to edges."""

from __future__ import annotations

from typing import Any

import numpy as np

from acp_lab.course.answers import Hint, as_array, as_function, as_number
from acp_lab.course.grader import exercise
from acp_lab.imaging.distance import distance_map

_ROUNDED = 0.05
"""Distances that were worked out by hand count with one digit after the point."""
TINY = np.array([[0, 0, 0, 0, 0], [1, 0, 0, 0, 0], [0, 0, 0, 0, 1]], dtype=bool)


@exercise("05.1")
def tiny_distance_map(answer: Any) -> str:
    """The exact distance map (3, 5) of an image with two edge pixels."""
    found = as_array(answer, TINY.shape, "a distance for each of the 3 x 5 pixels, row by row")
    truth = distance_map(TINY).astype(np.float64)
    off = np.abs(found - truth) > _ROUNDED
    if not off.any():
        return "Along the middle of the map the nearest edge changes, and the map has a ridge there."
    if (found < 0.0).any():
        raise Hint("A distance is never negative.")
    if (found[TINY] != 0.0).any():
        raise Hint("An edge pixel is its own nearest edge: how far is that?")
    apart = np.abs(np.argwhere(np.ones_like(TINY))[:, None] - np.argwhere(TINY)[None]).reshape(*TINY.shape, -1, 2)
    if np.allclose(found, apart.sum(-1).min(-1)):
        raise Hint("These are steps along rows and columns; the straight line, across the diagonal, is shorter.")
    if np.allclose(found, apart.max(-1).min(-1)):
        raise Hint("A diagonal step is longer than a straight one.")
    if np.allclose(found, truth**2, atol=0.02):
        raise Hint("These are squared distances.")
    row, column = np.argwhere(off)[0]
    raise Hint(
        f"{off.sum()} of the 15 are off, the first in row {row}, column {column} (counted from 0): "
        "which of the two edge pixels is nearer to it, and how far is it by Pythagoras?"
    )


@exercise("05.2")
def parabola(answer: Any) -> str:
    """top(before, peak, after) -> the place of the parabola's top, in steps from the middle."""
    top = as_function(answer, "a function top(before, peak, after)")
    for place, height, curvature in ((0.3, 9.0, 2.0), (-0.45, 20.0, 0.7), (0.0, 5.0, 1.0), (0.12, 130.0, 25.0)):
        before, peak, after = (height - curvature * (step - place) ** 2 for step in (-1.0, 0.0, 1.0))
        found = as_number(top(before, peak, after), "one number, the place of the top")
        if abs(found - place) < 1e-6:
            continue
        if abs(found + place) < 1e-6:
            raise Hint("The right distance to the wrong side: the top leans towards the larger neighbour.")
        if abs(found - 2.0 * place) < 1e-6 or abs(found - 0.5 * place) < 1e-6:
            raise Hint("Off by a factor of two: where is the derivative of a x² + b x + c zero?")
        if abs(found - (after - before) / (before + peak + after)) < 1e-6:
            raise Hint("That is the centre of mass of the three; it depends on how bright the whole image is.")
        if place == 0.0:
            raise Hint("With equal neighbours the top is in the middle.")
        raise Hint(
            "Set a x² + b x + c equal to the three values at -1, 0 and 1; that gives a and b, and they give the top."
        )
    return "This is what the tracker does at each peak: a tenth of a pixel for three numbers."
