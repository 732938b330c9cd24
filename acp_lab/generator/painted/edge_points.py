"""From a generated edge image to edge points, and how these move when the image changes.

A line in a soft edge image is a ridge: across it the brightness has a maximum. At each pixel the second
derivatives give the direction across; a parabola with the first and second derivative along it gives the
ridge's position to a small fraction of a pixel, and the pixel counts when that position lies within it
(C. Steger, "An unbiased detector of curvilinear structures", 1998).

All this happens on the logarithm of the brightness. Across a line the brightness is a Gaussian, whose logarithm is
a parabola: the fit is then exact wherever between two pixels the line runs (0.01 px against 0.05 px).

Convention: canonical px, (0, 0) is the centre of the top-left pixel; points are (x, y); images (h, w) float32.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from acp_lab.geometry.arrays import Float32Array, FloatArray

SMOOTHING_PX = 0.5
RIDGE_THRESHOLD = 0.3
# A ridge belongs to the pixel that it runs through; a little more, or lines on the border of two would be lost.
LARGEST_OFFSET_PX = 0.6
# Flatter than this across (1/px^2; a line of sigma 1 px has 1) a ridge has no meaningful position.
LEAST_CURVATURE = 0.02
# Added to the brightness before the logarithm, so that black has one.
DARKEST = 0.02

# Neighbour k of a pixel, clockwise from the one above, is bit k of its number.
_NEIGHBOUR_BITS = np.array([[128, 1, 2], [64, 0, 4], [32, 16, 8]], np.float32)


def _deletable(corner: tuple[int, int, int], opposite: tuple[int, int, int]) -> np.ndarray:
    """(256,) uint8: 1 where a pixel with these neighbours is on a border and no line's end or link (Zhang, Suen)."""
    bits = (np.arange(256)[:, None] >> np.arange(8)) & 1
    count = bits.sum(1)
    rises = ((bits == 0) & (np.roll(bits, -1, 1) == 1)).sum(1)
    on_border = (bits[:, corner].prod(1) == 0) & (bits[:, opposite].prod(1) == 0)
    return ((count >= 2) & (count <= 6) & (rises == 1) & on_border).astype(np.uint8)


# Its two sub-steps take south-east borders and north-west corners, then the other way round.
_DELETABLE = (_deletable((0, 2, 4), (2, 4, 6)), _deletable((0, 2, 6), (0, 4, 6)))


@dataclass(frozen=True)
class RidgePoints:
    """Edge points of one generated image.

    Attributes:
        points: (n, 2) px.
        tangents: (n, 2) unit direction of the edge; either of the two.
        strengths: (n,) in [0, 1], the image's brightness there.
    """

    points: FloatArray
    tangents: FloatArray
    strengths: FloatArray

    def __len__(self) -> int:
        return len(self.points)

    @property
    def normals(self) -> FloatArray:
        """(n, 2) unit, across the edge: the tangent turned from x towards y."""
        return np.column_stack([-self.tangents[:, 1], self.tangents[:, 0]])


def ridge(edge_image: Float32Array, threshold: float = RIDGE_THRESHOLD) -> RidgePoints:
    """Sub-pixel points where the image (h, w) has a ridge brighter than `threshold`."""
    smooth = _smooth(edge_image)
    # Most of an edge image is black: all else is asked of the bright pixels alone.
    rows, columns = np.nonzero(smooth > 0.5 * threshold)
    dx, dy, dxx, dxy, dyy = _derivatives(np.log(smooth + DARKEST), rows, columns)
    # The eigenvector of the stronger, negative curvature: the direction across.
    middle, spread = 0.5 * (dxx + dyy), np.hypot(0.5 * (dxx - dyy), dxy)
    across = middle - spread
    angle = 0.5 * np.arctan2(2.0 * dxy, dxx - dyy) + 0.5 * np.pi
    nx, ny = np.cos(angle), np.sin(angle)
    step = -(dx * nx + dy * ny) / np.minimum(across, -LEAST_CURVATURE)
    near = (np.abs(step * nx) <= LARGEST_OFFSET_PX) & (np.abs(step * ny) <= LARGEST_OFFSET_PX)
    found = np.flatnonzero(near & (across < -LEAST_CURVATURE))
    step, nx, ny = (a[found].astype(np.float64) for a in (step, nx, ny))
    points = np.column_stack([columns[found] + step * nx, rows[found] + step * ny])
    strengths = sample_bilinear(edge_image, points)
    kept = strengths > threshold
    return RidgePoints(points[kept], np.column_stack([ny, -nx])[kept], np.minimum(strengths[kept], 1.0))


def threshold(edge_image: Float32Array, level: float = RIDGE_THRESHOLD) -> RidgePoints:
    """Whole pixels brighter than `level`, thinned to lines one pixel wide: what a plain threshold gives.

    Thinning after T. Y. Zhang, C. Y. Suen (1984). Their places are exact to half a pixel only.
    """
    lines = (edge_image > level).astype(np.uint8)
    lines[[0, -1]] = 0
    lines[:, [0, -1]] = 0
    while True:
        before = int(lines.sum())
        for deletable in _DELETABLE:
            neighbours = cv2.filter2D(lines, cv2.CV_8U, _NEIGHBOUR_BITS, borderType=cv2.BORDER_CONSTANT)
            lines &= 1 - deletable[neighbours]
        if int(lines.sum()) == before:
            break
    rows, columns = np.nonzero(lines)
    _, _, dxx, dxy, dyy = _derivatives(_smooth(edge_image), rows, columns)
    angle = 0.5 * np.arctan2(2.0 * dxy, dxx - dyy).astype(np.float64)
    points = np.column_stack([columns, rows]).astype(np.float64)
    strengths = np.clip(edge_image[rows, columns].astype(np.float64), 0.0, 1.0)
    return RidgePoints(points, np.column_stack([np.cos(angle), np.sin(angle)]), strengths)


def ridge_motion(
    edge_image: Float32Array, edge_image_derivatives: Float32Array, ridge_points: RidgePoints
) -> FloatArray:
    """(n, 8): how far each ridge point moves along its normal, px, per unit of each control coordinate.

    On a ridge the derivative across vanishes, E_n(x, I) = 0, and stays zero when I changes; so dn/dI = -E_nI / E_nn,
    here with E the logarithm of the brightness. Both are taken at the pixel that the point was found in, E_nI with
    its change along the way from there to the point, which makes this the very derivative of what `ridge` computes
    (but for the turning of the normal). NaN where E_nn is not clearly negative: a line that fades, or meets another
    one, has no motion of its own.

    Args:
        edge_image: (h, w) E(I).
        edge_image_derivatives: (h, w, 8) dE/dI, per unit of the control coordinates.
        ridge_points: points of that image, by `ridge`.
    """
    points, normals = ridge_points.points, ridge_points.normals
    height, width = edge_image.shape
    pixels = np.clip(np.round(points).astype(np.int64), 1, (width - 2, height - 2))
    step = np.einsum("nj,nj->n", points - pixels, normals)
    light = _smooth(edge_image)[..., None] + np.float32(DARKEST)
    _, curvature = _across(np.log(light), pixels, normals)
    slope_change, curvature_change = _across(_smooth(edge_image_derivatives) / light, pixels, normals)
    with np.errstate(divide="ignore", invalid="ignore"):
        motion = -(slope_change + step[:, None] * curvature_change) / curvature
    motion[curvature[:, 0] > -LEAST_CURVATURE] = np.nan
    return motion


def _across(images: np.ndarray, pixels: np.ndarray, normals: FloatArray) -> tuple[FloatArray, FloatArray]:
    """First and second difference of images (h, w, k) at inner pixels (n, 2) along normals (n, 2): (n, k) each."""
    x, y = pixels.T
    nx, ny = normals[:, :1], normals[:, 1:]

    def at(dx: int, dy: int) -> np.ndarray:
        return np.asarray(images[y + dy, x + dx], dtype=np.float64)

    middle, left, right, up, down = at(0, 0), at(-1, 0), at(1, 0), at(0, -1), at(0, 1)
    dxy = 0.25 * (at(1, 1) - at(-1, 1) - at(1, -1) + at(-1, -1))
    first = 0.5 * (nx * (right - left) + ny * (down - up))
    dxx, dyy = left - 2.0 * middle + right, up - 2.0 * middle + down
    return first, nx * nx * dxx + 2.0 * nx * ny * dxy + ny * ny * dyy


def sample_bilinear(image: np.ndarray, points: FloatArray) -> FloatArray:
    """(n,) or (n, k): the image (h, w) or (h, w, k) between its pixels; outside it the nearest border."""
    height, width = image.shape[:2]
    x, y = np.clip(points[:, 0], 0.0, width - 1.0), np.clip(points[:, 1], 0.0, height - 1.0)
    column = np.minimum(x.astype(np.int64), width - 2)
    row = np.minimum(y.astype(np.int64), height - 2)
    fx, fy = x - column, y - row
    if image.ndim == 3:
        fx, fy = fx[:, None], fy[:, None]
    top = image[row, column] * (1.0 - fx) + image[row, column + 1] * fx
    bottom = image[row + 1, column] * (1.0 - fx) + image[row + 1, column + 1] * fx
    return np.asarray(top * (1.0 - fy) + bottom * fy, dtype=np.float64)


def _smooth(image: np.ndarray) -> np.ndarray:
    return cv2.GaussianBlur(image, (0, 0), SMOOTHING_PX, borderType=cv2.BORDER_REPLICATE)


def _derivatives(smooth: np.ndarray, rows: np.ndarray, columns: np.ndarray) -> tuple[np.ndarray, ...]:
    """First and second differences at pixels (n,), per px and per px^2: dx, dy, dxx, dxy, dyy, each (n,)."""
    padded = cv2.copyMakeBorder(smooth, 1, 1, 1, 1, cv2.BORDER_REPLICATE)

    def at(dx: int, dy: int) -> np.ndarray:
        return np.asarray(padded[rows + (1 + dy), columns + (1 + dx)])

    middle, left, right, up, down = at(0, 0), at(-1, 0), at(1, 0), at(0, -1), at(0, 1)
    dxy = 0.25 * (at(1, 1) - at(-1, 1) - at(1, -1) + at(-1, -1))
    return (
        0.5 * (right - left),
        0.5 * (down - up),
        left - 2.0 * middle + right,
        dxy,
        up - 2.0 * middle + down,
    )
