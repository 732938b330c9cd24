"""How exact was a start pose? What the image shows of its error says how far to believe the rest of it.

Edges lie beside those of the CAD model, all to one side: an image is sure of where a part is and how it is turned, but
far less of how far away it is. A start pose may be better there. How good it is nobody says, but where the image is
sure, the distance between the two is the start's error, and an error of that size is expected in the other directions,
too (empirical Bayes). How well the frame agrees with the start says the same in another way, and without the image's
pose: where edges are found close to the start, its error is small, and a pose that lies much farther away is one that
looks alike. Both poses are fused by their covariances; a good start keeps its depth, a poor one does not.
(Not in the paper, whose starts are the truth with a disturbance of untold size.)
"""

from __future__ import annotations

import numpy as np

from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.pose_step import move_pose, pose_step_between
from acp_lab.tracking.frame_view import View
from acp_lab.tracking.learning.knowledge import Matches

# Sizes of a start's error that are thought of, mm: from nothing to where no start of a usual part is.
_ERRORS_MM = np.geomspace(0.03, 30.0, 25)
# How far away another pose that looks alike lies, in radii of the part, and how probable it is that the image shows it.
_ELSEWHERE, _LOOKS_ALIKE = 0.33, 0.05
# Agreement with a pose whose edges are off by so many px (rms) lies half way between all and least; its scatter.
_HALF_PX, _LEAST_AGREEMENT, _AGREEMENT_SCATTER = 1.3, 0.25, 0.06
# Scatter of a single image edge, px.
_EDGE_PX = 0.3


def weighed_start(
    view: View, found: FloatArray, matches: Matches, bias_mm: float, agreement: float | None = None
) -> FloatArray:
    """(4, 4) between a view's prior, the start pose, and the pose (4, 4) that the image shows.

    matches: of the image's pose. bias_mm: standard deviation of what all outlines, and all inner edges, have in common
    beside where they are expected. agreement: of the frame with the start pose, as a share of that with the image's;
    None where only the distance between the two shall say how large the start's error is.
    """
    part = view.part
    image = image_covariance(matches, bias_mm)
    # Turns count by what they move at the part's rim.
    unit = np.diag(np.repeat([1.0 / part.radius, 1.0], 3) ** 2)
    error = pose_step_between(view.prior, found, part.box_centre)
    _, elsewhere = _explained((_ELSEWHERE * part.radius) ** 2 * unit, image, error)
    taken, total = np.zeros(6), 0.0
    errors_mm = part.times_usual * _ERRORS_MM
    for error_mm, probability in zip(errors_mm, _size_probabilities(matches, unit, errors_mm, agreement), strict=True):
        start = error_mm**2 * unit
        step, likelihood = _explained(start, image, error)
        taken = taken + probability * likelihood * step
        total += probability * likelihood
        if agreement is not None:
            # What the image shows may be another pose that looks alike; it says nothing of the start then.
            total += probability * _LOOKS_ALIKE * elsewhere
    # Where nothing explains the distance, the start is no pose of this image.
    return move_pose(view.prior, part.box_centre, taken / total) if total > 0.0 else found


def _explained(start: FloatArray, image: FloatArray, error: FloatArray) -> tuple[FloatArray, float]:
    """(6,) the start's share of an error (6,) between start and image by their covariances (6, 6); its likelihood."""
    root = np.linalg.cholesky(start + image)
    normalised = np.linalg.solve(root, error)
    likelihood = float(np.exp(-0.5 * normalised @ normalised) / np.diagonal(root).prod())
    return start @ np.linalg.solve(root.T, normalised), likelihood


def _size_probabilities(
    matches: Matches, unit: FloatArray, errors_mm: FloatArray, agreement: float | None
) -> FloatArray:
    """How probable each size of the error is, by how much less the frame agrees with the start than with the best."""
    if agreement is None:
        return np.ones(len(errors_mm))
    rows = matches.jacobian
    px_per_mm = np.sqrt(np.einsum("ni,ij,nj->n", rows, unit, rows).mean())
    expected = _LEAST_AGREEMENT + (1.0 - _LEAST_AGREEMENT) / (1.0 + (px_per_mm * errors_mm / _HALF_PX) ** 2)
    found: FloatArray = np.exp(-0.5 * ((min(agreement, 1.0) - expected) / _AGREEMENT_SCATTER) ** 2)
    return found + 1e-6


def image_covariance(matches: Matches, bias_mm: float) -> FloatArray:
    """(6, 6) of a pose step (rad, mm) about the part's centre, by edges that scatter and that share a bias."""
    rows = matches.at.lines(matches.points_obj, matches.normals).jacobian
    expected, edges = matches.expected, matches.edges
    weights = np.isfinite(matches.residuals_px).astype(np.float64)
    scale = _px_per_mm(matches)
    if expected is not None:
        weights = weights * expected.weights
    weighted = rows * weights[:, None]
    information = weighted.T @ rows
    information += 1e-9 * np.diag(np.diagonal(information) + 1e-9)
    # Pose step per px of each residual.
    gain = np.linalg.solve(information, weighted.T)
    covariance = _EDGE_PX**2 * gain @ gain.T
    for shared in (np.where(edges.outline, scale, 0.0), np.where(edges.outline, 0.0, scale)):
        step = bias_mm * gain @ shared
        covariance += np.outer(step, step)
    return covariance


def _px_per_mm(matches: Matches) -> FloatArray:
    """(n,) scale across the edges, positive where the normal leads away from the middle of what is seen."""
    lines = matches.at.lines(matches.points_obj, matches.normals)
    arms = matches.edges.points - matches.edges.points.mean(0)
    outward = np.sign(np.einsum("nj,nj->n", arms, matches.normals))
    scale: FloatArray = outward * np.linalg.norm(lines.directions, axis=1)
    return scale
