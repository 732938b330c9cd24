"""Notebook 13: regions."""

from __future__ import annotations

from typing import Any

import numpy as np

from acp_lab.course.answers import Hint, as_array, as_function, as_number, near
from acp_lab.course.grader import exercise
from acp_lab.geometry.arrays import FloatArray
from acp_lab.tracking.targets.step_posterior import PLACES, SEGMENTS, WINDOW, SmoothStep

STEP = SmoothStep().values
"""(8,) probability of the part along a window around the outline, from inside to outside."""
SCALE = 4


def segments(place: int, certainty: float = 0.9) -> FloatArray:
    """(19,) probabilities of a line whose part ends at one of the twelve places, 0 to 11."""
    ends = place + WINDOW // 2
    return np.where(np.arange(SEGMENTS) < ends, certainty, 1.0 - certainty)


def right_posterior(inside: FloatArray, step: FloatArray) -> FloatArray:
    """(12,) as the notebook asks for it."""
    windows = np.lib.stride_tricks.sliding_window_view(inside, WINDOW)
    product: FloatArray = (step * windows + (1.0 - step) * (1.0 - windows)).prod(1)
    return product / product.sum()


@exercise("13.1")
def posterior_by_hand(answer: Any) -> str:
    """posterior(inside, step) -> (12,) probabilities."""
    posterior = as_function(answer, "a function posterior(inside, step)")
    rng = np.random.default_rng(13)
    lines = [segments(2), segments(8, 0.7), rng.uniform(0.05, 0.95, SEGMENTS)]
    for inside in lines:
        right = right_posterior(inside, STEP)
        found = as_array(posterior(inside.copy(), STEP.copy()), (PLACES,), "twelve probabilities")
        windows = np.lib.stride_tricks.sliding_window_view(inside, WINDOW)
        if np.allclose(found, right, rtol=1e-6, atol=1e-12):
            continue
        share = found / max(found.sum(), 1e-300)
        if np.allclose(share, right, rtol=1e-6, atol=1e-12):
            raise Hint("Right up to a factor: the twelve probabilities must add up to 1.")
        if np.allclose(share, right[::-1], rtol=1e-6, atol=1e-12):
            raise Hint("The order is turned round: the first place is the innermost one.")
        if np.allclose(share, right_posterior(inside, STEP[::-1]), rtol=1e-6, atol=1e-12):
            raise Hint("The step is turned round: its first value belongs to the innermost segment of a window.")
        if _are_logarithms(found, right, (STEP * windows + (1.0 - STEP) * (1.0 - windows)).prod(1)):
            raise Hint("These are logarithms: take exp of their sums, then let the twelve add up to 1.")
        half = (STEP * windows).prod(1)
        if np.allclose(share, half / half.sum(), rtol=1e-6, atol=1e-12):
            raise Hint("A segment is the part's, or it is not: add the second case, (1 - step) times (1 - inside).")
        total = (STEP * windows + (1.0 - STEP) * (1.0 - windows)).sum(1)
        if np.allclose(share, total / total.sum(), rtol=1e-6, atol=1e-12):
            raise Hint("All eight segments of a window must be as they are: multiply them, do not add.")
        raise Hint("For place d look at inside[d : d + 8]: how probable is it, segment by segment, given the step?")
    return "That is all that a line knows. A tracker adds up the logarithms of up to two hundred of them."


def _are_logarithms(found: FloatArray, right: FloatArray, product: FloatArray) -> bool:
    """Whether these are logarithms of the right posterior, up to a constant, or divided by their own sum."""
    odds = np.exp(found - found.max())
    logs, total = np.log(product), found.sum()
    return bool(
        np.allclose(odds / odds.sum(), right, rtol=1e-6, atol=1e-12)
        or (np.allclose(found * logs.sum(), logs * total, rtol=1e-6, atol=1e-12) and total != 0.0)
    )


@exercise("13.2")
def how_far(answer: Any) -> str:
    """How far off, in px, a line of segments of four px can still say where the outline is."""
    found = as_number(answer, "a length in px")
    if near(abs(found), 0.5 * (PLACES - 1) * SCALE, 0.001):
        return "Twelve places, eleven steps, half of these on either side. Coarse lines find, fine lines measure."
    if near(abs(found), 0.5 * SEGMENTS * SCALE, 0.001):
        raise Hint("That is how far the line looks; the outermost places need segments beyond them to be judged.")
    if near(abs(found), 0.5 * PLACES * SCALE, 0.001):
        raise Hint("Nearly: between twelve places there are eleven steps.")
    if near(abs(found), (PLACES - 1) * SCALE, 0.001):
        raise Hint("That is the way from the innermost to the outermost place; the line starts in the middle.")
    if near(abs(found), 0.5 * (PLACES - 1), 0.001) or near(abs(found), PLACES - 1, 0.001):
        raise Hint(f"That is in segments; the question is about px, and a segment has {SCALE} of them.")
    raise Hint("The step is tried at twelve places, one segment apart, evenly about the middle of the line.")
