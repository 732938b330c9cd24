"""Notebook 06: the loss."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

from acp_lab.course.answers import Hint, as_array, as_choice, as_function, as_number, as_numbers, near
from acp_lab.course.grader import exercise
from acp_lab.course.workshop import sample_part, sample_scene
from acp_lab.geometry.arrays import FloatArray
from acp_lab.imaging.canny import canny
from acp_lab.imaging.distance import distance_map
from acp_lab.sequences.frame import Frame
from acp_lab.studies.true_edges import TrueEdges
from acp_lab.tracking.losses import geman_mcclure, tukey

PLACES = ("on the edge", "just below alpha", "just above alpha", "far away")
FAR_PX = 3.0
ASKED_FRAME = 39
_CLOSE = 0.01
_WEIGHTS = "one weight per distance, (n,)"


@exercise("06.1")
def lowest_place(answer: Any) -> str:
    """Where 1 / (1 - exp(D - alpha)) is lowest."""
    place = as_choice(answer, PLACES)
    if place == "just above alpha":
        return "The least value is minus infinity, and it is reached from the wrong side of the threshold."
    if place == "on the edge":
        raise Hint("That is where it ought to be. Which values does the formula take at D = 0, and which beyond alpha?")
    if place == "just below alpha":
        raise Hint("There the denominator is tiny, too; but which sign does it have?")
    raise Hint("Far away the value goes to zero, but from which side does it come?")


@exercise("06.2")
def geman_mcclure_weight(answer: Any) -> str:
    """weight(distances, alpha) with weight * D = ρ'(D)."""
    weight = as_function(answer, "a function weight(distances, alpha)")
    distances = np.array([0.0, 0.3, 1.0, 4.0, 11.0, 40.0])
    for alpha_px in (3.0, 8.0):
        with np.errstate(divide="ignore", invalid="ignore"):
            given = as_numbers(weight(distances.copy(), alpha_px), _WEIGHTS)
        if given.shape == distances.shape and not np.isfinite(given[0]) and np.isfinite(given[1:]).all():
            raise Hint("At D = 0 it divides zero by zero: cancel one D by hand before you write it down.")
        found = as_array(given, (len(distances),), _WEIGHTS)
        share = alpha_px**2 / (distances**2 + alpha_px**2)
        right = share**2
        if np.allclose(found, right, atol=1e-9):
            continue
        loss = geman_mcclure(distances, alpha_px)
        with np.errstate(divide="ignore", invalid="ignore"):
            others = (
                (loss.values, "That is the loss itself; the solver wants its derivative, divided by D."),
                (loss.derivatives, "That is the pull ρ'(D); divide it by D once more."),
                (share, "Nearly: differentiate the fraction with the quotient rule, its square remains."),
                (2.0 * right, "A factor of two: the loss begins with one half."),
                (right / alpha_px**2, "The weight on the edge itself should be one, whatever alpha is."),
                (tukey(distances, alpha_px).derivatives / np.maximum(distances, 1e-12), "That is Tukey's weight."),
            )
        for wrong, hint in others:
            if np.allclose(found[1:], wrong[1:], atol=1e-9):
                raise Hint(hint)
        if not np.isclose(found[0], 1.0):
            raise Hint("Near the edge the loss is D^2 / 2, plain least squares: which weight is that?")
        raise Hint("On the edge it is right. Compare with numerical differences of the loss, divided by D.")
    return "At D = alpha a quarter is left: this is the lower weight that the paper's text asks for."


@exercise("06.3")
def missing_share(answer: Any) -> str:
    """The share of edge points of frame 39 that have no image edge within 3 px."""
    share = as_number(answer, "a share between 0 and 1")
    if 1.0 < share <= 100.0:
        raise Hint("Percent? Give the share itself, between 0 and 1.")
    if not 0.0 <= share <= 1.0:
        raise Hint("A share lies between 0 and 1.")
    right = _missing(ASKED_FRAME)
    if near(share, right, absolute=_CLOSE):
        return "No pose of this part would bring these points to an edge of theirs; the loss has to bear them."
    if near(share, float((_distances(ASKED_FRAME) >= FAR_PX).mean()), absolute=_CLOSE):
        raise Hint("An edge just three pixels away is within three pixels: take those farther away alone.")
    if near(share, 1.0 - right, absolute=_CLOSE):
        raise Hint("That is the share that has an edge.")
    if near(share, _missing(20), absolute=_CLOSE):
        raise Hint("That is frame 20, which the notebook uses; the question is about another one.")
    raise Hint("TrueEdges.at gives points (x, y); a distance map is indexed by row, then column.")


def _missing(frame_id: int) -> float:
    return float((_distances(frame_id) > FAR_PX).mean())


@cache
def _distances(frame_id: int) -> FloatArray:
    """(n,) px from the edge points at the true pose to the nearest image edge."""
    scene = sample_scene()
    frame, pose = scene.frame(frame_id), scene.truth(frame_id, 1)
    assert isinstance(frame, Frame), "the sample's frames can be read"
    assert pose is not None, "the sample has truth for every frame"
    points = TrueEdges(sample_part()).at(pose, frame.camera).points
    column, row = np.round(points).astype(int).T
    return distance_map(canny(frame.image))[row, column]
