"""How well generated edge images agree with true edges: Chamfer distances, F-score, and a picture for comparison.

Convention: canonical px. "There" is from generated to true edges (what was invented), "back" from true to generated
(what was missed). Both sides are lines and not dots: a ridge has one point per pixel, so the nearest of these alone
would lie a quarter of a pixel off, along the line, even where it is exact.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from acp_lab.generator.painted.edge_points import RidgePoints, ridge
from acp_lab.geometry.arrays import ByteImage, Float32Array, FloatArray
from acp_lab.imaging.chamfer import nearest_distances

F_SCORE_WITHIN_PX = 1.0


@dataclass(frozen=True)
class GenerationQuality:
    """Of one image, or the means over several.

    Attributes:
        generated_to_true_px, true_to_generated_px: mean nearest distances.
        f_score: harmonic mean of the shares of generated and true edge points within 1 px of the other kind.
    """

    generated_to_true_px: float
    true_to_generated_px: float
    f_score: float


def generation_quality(images: Float32Array, truth: Sequence[FloatArray]) -> GenerationQuality:
    """Ridge points of edge images (b, size, size) against true edge points, (n, 2) each.

    An image without any ridge counts as wrong by its own side.
    """
    found = [ridge(image) for image in images]
    size = images.shape[1]
    return mean_quality(
        [line_quality(one.points, along_ridge(one), points, size) for one, points in zip(found, truth, strict=True)]
    )


def mean_quality(qualities: Sequence[GenerationQuality]) -> GenerationQuality:
    """The means over images, one or more."""
    rows = [(one.generated_to_true_px, one.true_to_generated_px, one.f_score) for one in qualities]
    return GenerationQuality(*np.mean(rows, axis=0).tolist())


def line_quality(generated: FloatArray, lines: FloatArray, truth: FloatArray, size: int) -> GenerationQuality:
    """One image's edges; without any on one of the two sides it is wrong by the image's side `size`, px.

    Args:
        generated: (n, 2) edge points.
        lines: (m, 2) points so close together along the generated edges that the nearest stands for the line.
        truth: (k, 2) the same along the true edges.
    """
    if len(generated) == 0 or len(truth) == 0:
        return GenerationQuality(float(size), float(size), 0.0)
    there, back = nearest_distances(generated, truth), nearest_distances(truth, lines)
    precision, recall = float((there < F_SCORE_WITHIN_PX).mean()), float((back < F_SCORE_WITHIN_PX).mean())
    score = 2.0 * precision * recall / max(precision + recall, 1e-9)
    return GenerationQuality(float(there.mean()), float(back.mean()), score)


def along_ridge(ridge_points: RidgePoints) -> FloatArray:
    """(3 n, 2): each point of a ridge, and two that lie a third of its pixel before and behind it on the line."""
    through_pixel = ridge_points.tangents / np.abs(ridge_points.tangents).max(1, keepdims=True)
    return np.concatenate([ridge_points.points + share * through_pixel for share in (-1 / 3, 0.0, 1 / 3)])


def comparison_grid(columns: Sequence[Float32Array], gap_px: int = 2) -> ByteImage:
    """One picture (h, w) uint8 of several stacks of images (b, size, size): a column each, a row per image."""
    size = columns[0].shape[1]
    cell = size + gap_px
    canvas = np.full((len(columns[0]) * cell - gap_px, len(columns) * cell - gap_px), 128, np.uint8)
    for x, stack in enumerate(columns):
        for y, image in enumerate(stack):
            canvas[y * cell : y * cell + size, x * cell : x * cell + size] = np.round(255.0 * np.clip(image, 0.0, 1.0))
    return canvas
