"""Notebook 12: finding the part."""

from __future__ import annotations

from typing import Any

import numpy as np

from acp_lab.course.answers import Hint, as_array, as_function, as_number, near
from acp_lab.course.grader import exercise
from acp_lab.detection.edge_maps import direction_bins
from acp_lab.geometry.arrays import FloatArray

BINS = 8
PX_PER_BIN = 1.5
ALONE = 0.95


@exercise("12.1")
def direction_bin(answer: Any) -> str:
    """bins(tangents, count): the unsigned direction of edges, in bins around k pi / count."""
    bins = as_function(answer, "a function bins(tangents, count)")
    angles = np.radians([2.0, 3.0, 19.5, 47.0, 92.0, 101.0, 137.0, 171.5, 178.0, 183.0, 226.5, -3.0, -47.0])
    tangents = np.stack([np.cos(angles), np.sin(angles)], 1)
    found = as_array(bins(tangents.copy(), BINS), (len(angles),), "one bin per edge, (n,)")
    right = direction_bins(tangents, BINS)
    if np.array_equal(found, right):
        other = as_array(bins(tangents.copy(), 12), (len(angles),), "one bin per edge, (n,)")
        if np.array_equal(other, direction_bins(tangents, 12)):
            return "Half a turn is all there is: an edge has no beginning. LINE-MOD keeps its gradients unsigned, too."
        raise Hint("It is right for 8 bins, not for 12: does it use `count`?")
    if (found < 0).any() or (found >= BINS).any():
        raise Hint(f"Bins go from 0 to {BINS - 1}: what becomes of an angle below zero, or just below half a turn?")
    if not np.array_equal(found, np.floor(found)):
        raise Hint("A bin is a whole number.")
    opposite = as_array(bins(-tangents, BINS), (len(angles),), "one bin per edge, (n,)")
    if not np.array_equal(found, opposite):
        raise Hint("Turn an edge round, by half a turn, and it is the same edge: yours changes its bin.")
    turn = np.arctan2(tangents[:, 1], tangents[:, 0]) % np.pi
    if np.array_equal(found, np.floor(turn / np.pi * BINS)):
        raise Hint(
            "Yours begins a bin at k pi / count; it should have its middle there: 3 and 178 degrees belong together."
        )
    if np.array_equal(found, direction_bins(tangents[:, ::-1], BINS)):
        raise Hint("These are x and y exchanged.")
    if np.array_equal(found, direction_bins(np.stack([-tangents[:, 1], tangents[:, 0]], 1), BINS)):
        raise Hint("These are the directions of the gradients, a right angle from the edges.")
    wrong = int(np.flatnonzero(found != right)[0])
    raise Hint(
        f"An edge at {np.degrees(angles[wrong]):.0f} degrees is in bin {found[wrong]:.0f}: look at that one by hand."
    )


@exercise("12.2")
def directional_distance(answer: Any) -> str:
    """directional(distances, px_per_bin): distance in place and direction together, (bins, h, w)."""
    directional = as_function(answer, "a function directional(distances, px_per_bin)")
    distances = np.random.default_rng(12).uniform(0.0, 9.0, (BINS, 3, 4))
    distances[:, 0, 0] = [0.0, 50.0, 50.0, 50.0, 50.0, 50.0, 50.0, 50.0]
    given = directional(distances.copy(), PX_PER_BIN)
    found = as_array(given, distances.shape, f"a distance for each direction and pixel, {distances.shape}")
    if np.allclose(found, _directional(distances, PX_PER_BIN, is_circular=True)):
        return "The tracker's detector takes two bins to either side only: beyond that, an edge is another one."
    if np.allclose(found, distances):
        raise Hint("These are the distances to edges of the very direction; one bin beside may be nearer.")
    if np.allclose(found, np.broadcast_to(distances.min(0), distances.shape)):
        raise Hint("That is the distance to any edge. A turned one should cost something.")
    if np.allclose(found, _directional(distances, PX_PER_BIN, is_circular=False)):
        raise Hint("The last direction lies next to the first: how far are bins 0 and 7 of 8 from each other?")
    sides = np.minimum(np.roll(distances, 1, 0), np.roll(distances, -1, 0)) + PX_PER_BIN
    if np.allclose(found, np.minimum(distances, sides)):
        raise Hint("That looks one bin to either side; an edge turned further may still be the nearest.")
    two = np.minimum(np.roll(distances, 2, 0), np.roll(distances, -2, 0)) + 2.0 * PX_PER_BIN
    if np.allclose(found, np.minimum(np.minimum(distances, sides), two)):
        raise Hint("That stops two bins to either side, as the detector does; the formula looks at all of them.")
    if (found > distances + 1e-9).any():
        raise Hint("An edge of the very direction costs nothing for its turn, so no value can be larger than before.")
    raise Hint(
        "For bin k of a pixel: the smallest over j of distances[j] plus px_per_bin times the bins between j and k."
    )


@exercise("12.3")
def shared_score(answer: Any) -> str:
    """The score of each of two poses that fit equally well, 0.95 each if it were alone."""
    score = as_number(answer, "a score between 0 and 1")
    odds = ALONE / (1.0 - ALONE)
    if near(score, odds / (1.0 + 2.0 * odds), relative=0.0, absolute=0.005):
        return "Below one half, and so below what is accepted, however well it fits. What is left is for neither."
    if near(score, ALONE):
        raise Hint("That is its score alone. The part is in one place only, and there is a second candidate for it.")
    if near(score, 0.5):
        raise Hint("Nearly: there is a third possibility, that neither is right.")
    if near(score, 0.5 * ALONE):
        raise Hint("Nearly: add up the *odds* of all possibilities, those of 'neither' are 1.")
    if near(score, ALONE**2) or near(score, ALONE * (1.0 - ALONE)):
        raise Hint("They exclude each other: they are not independent, so do not multiply.")
    raise Hint(
        "Odds are p / (1 - p). Each pose has them against 'nothing is right', whose odds are 1: which share is its own?"
    )


def _directional(distances: FloatArray, px_per_bin: float, is_circular: bool) -> FloatArray:
    """(bins, h, w): the smallest over all directions of distance and turn."""
    count = len(distances)
    apart = np.abs(np.subtract.outer(np.arange(count), np.arange(count)))
    if is_circular:
        apart = np.minimum(apart, count - apart)
    best: FloatArray = (distances[None] + px_per_bin * apart[:, :, None, None]).min(1)
    return best
