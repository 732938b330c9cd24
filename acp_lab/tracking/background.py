"""How did the camera turn since the last frame? What stands around the part tells.

Corners of the picture that do not belong to the part are followed from frame to frame by optical flow (Lucas and
Kanade, IJCAI 1981, in OpenCV's pyramids), in a picture made smaller, and one rotation is fitted to them: hands that
shake turn a camera more than they move it, as far as its picture tells. Corners on whatever else moves are outliers.
Where the corners look as they did, nothing is followed: a camera that stands still costs next to nothing.
(Not in the paper; see docs/paper-ledger.md.)
"""

from __future__ import annotations

import math

import cv2
import numpy as np

from acp_lab.compiled import kernel
from acp_lab.geometry.arrays import ByteImage, FloatArray, IntArray, plain, writable
from acp_lab.geometry.camera import Camera
from acp_lab.geometry.middle import median
from acp_lab.geometry.pose_kernels import eliminate, move, step_between
from acp_lab.sequences.frame import Frame
from acp_lab.tracking.frame_view import Box

LONGEST_PX = 320
"""Of the picture in which corners are followed, every so many-th pixel of the frame."""
CORNERS = 40
"""At most so many are followed."""
_FEWEST, _FEWEST_SHARE = 12, 0.6
"""Fewer say nothing; and with less than this share of those that were found, they are found anew."""
# For `cv2.goodFeaturesToTrack`, in a picture of half that size: share of the best corner's quality, px between them.
_QUALITY, _APART_PX = 0.01, 5
# Side of what is compared around a corner is twice this and one, px; corners keep away from the border.
_HALF_PX, _BORDER_PX = 4, 8
_WINDOW_PX, _LEVELS, _STOP = (9, 9), 3, (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 10, 0.03)
# px of that picture by which corners seem to have moved, in the median, where the camera stands still; and less than
# which is no turn: more than a slow one adds up to until it is seen, lest it seem to come in jerks.
_STILL_PX, _LEAST_TURN_PX = 0.3, 0.65
# Residuals of corners that turned with the camera: px of the frame and, as it is moved, too, share of the turn; and the
# share of the corners that must have.
_WITHIN_PX, _WITHIN_SHARE, _LEAST_SHARE = 3.0, 0.25, 0.5
_ROUNDS, _WIDE_ROUNDS = 6, 3
# Of the fit: steps at most, and rad by which the last one turns.
_STEPS, _LAST_STEP = 8, 1e-10


class Background:
    """The corners around one tracked part."""

    def __init__(self) -> None:
        self.forget()

    def forget(self) -> None:
        """Before a new track."""
        self._small: ByteImage | None = None
        self._camera: Camera | None = None
        self._step = 1
        # Of the last picture in which something moved: corners (n, 2) px, to whole ones, and what they look like. Of
        # the corners that were found last there were so many.
        self._corners: np.ndarray = np.empty((0, 2), np.float32)
        self._found = 0
        self._places: IntArray = np.empty((0, 2), np.int64)
        self._looks: ByteImage = np.empty((0, 2 * _HALF_PX + 1, 2 * _HALF_PX + 1), np.uint8)

    def turn(self, frame: Frame, part: Box | None) -> FloatArray | None:
        """(3,) rotation vector from camera axes in the frame that was given last to those in this one.

        Zeros where the picture stands still, or nearly; None where nobody knows, as in the first frame.

        Args:
            part: px of the frame around the part, whose corners say nothing of the camera; None where it is not seen.
        """
        step = max(math.ceil(max(frame.image.shape[:2]) / LONGEST_PX), 1)
        shown = writable(frame.image[::step, ::step, 1])
        before, camera, self._camera = self._small, self._camera, frame.camera
        if before is None or camera is None or before.shape != shown.shape or step != self._step:
            self._small, self._step = shown.copy(), step
            self._find(self._small, part)
            return None
        # Of a camera that stands still nothing is kept: the picture that is there shows the same.
        if camera == frame.camera and len(self._corners) >= _FEWEST and self._is_still(shown):
            return np.zeros(3)
        # A copy: whoever gave the image may write into it.
        small = self._small = shown.copy()
        turn = None
        if len(self._corners) >= _FEWEST:
            corners = self._corners[:, None]
            moved, good, _ = cv2.calcOpticalFlowPyrLK(
                before, small, corners, corners.copy(), winSize=_WINDOW_PX, maxLevel=_LEVELS, criteria=_STOP
            )
            is_good = good.ravel() == 1
            old, new = self._corners[is_good], moved[is_good, 0]
            if len(old) >= _FEWEST:
                turn = rotation_between(camera.rays(step * old), frame.camera.rays(step * new), frame.camera.fx)
            if turn is not None and frame.camera.fx * np.linalg.norm(turn) < _LEAST_TURN_PX * step:
                turn = np.zeros(3)
            self._corners = new
        self._keep(small, part)
        return turn

    def _is_still(self, small: ByteImage) -> bool:
        return median(shifts_px(small, self._places, self._looks)) < _STILL_PX

    def _keep(self, small: ByteImage, part: Box | None) -> None:
        """Corners inside the picture and beside the part; new ones where few are left."""
        (height, width), (x, y) = small.shape, self._corners.T
        border = _BORDER_PX
        kept = (x >= border) & (y >= border) & (x < width - border) & (y < height - border)
        if part is not None:
            x0, y0, x1, y1 = (edge / self._step for edge in part)
            kept &= (x < x0) | (x > x1) | (y < y0) | (y > y1)
        self._corners = self._corners[kept]
        if len(self._corners) < max(_FEWEST, _FEWEST_SHARE * self._found):
            self._find(small, part)
        else:
            self._look_at(small)

    def _find(self, small: ByteImage, part: Box | None) -> None:
        half = np.ascontiguousarray(small[::2, ::2])
        allowed = np.zeros(half.shape, np.uint8)
        border = _BORDER_PX // 2 + 1
        allowed[border:-border, border:-border] = 1
        if part is not None:
            x0, y0, x1, y1 = (max(int(edge / (2 * self._step)), 0) for edge in part)
            allowed[y0 : y1 + 1, x0 : x1 + 1] = 0
        found = cv2.goodFeaturesToTrack(half, CORNERS, _QUALITY, _APART_PX, mask=allowed)
        self._corners = np.empty((0, 2), np.float32) if found is None else 2.0 * found[:, 0]
        self._found = len(self._corners)
        self._look_at(small)

    def _look_at(self, small: ByteImage) -> None:
        around = np.arange(-_HALF_PX, _HALF_PX + 1)
        self._places = np.rint(self._corners).astype(np.int64)
        x, y = self._places.T
        self._looks = small[y[:, None, None] + around[:, None], x[:, None, None] + around]


def rotation_between(before: FloatArray, after: FloatArray, focal_px: float) -> FloatArray | None:
    """(3,) rotation vector that brings rays (n, 3) to others, or to most of them; None where it brings too few there.

    Least squares over unit rays by Gauss-Newton, reweighted by Tukey's biweight.
    focal_px: px per rad, by which outliers are told.
    """
    vector = np.zeros(3)
    within = _fit_turn(plain(before), plain(after), focal_px, vector)
    return vector if within >= max(_LEAST_SHARE * len(before), _FEWEST) else None


@kernel("i8(f8[:, ::1], f8[:, ::1], f8, f8[::1])")
def _fit_turn(before: FloatArray, after: FloatArray, focal_px: float, vector: FloatArray) -> int:
    """Fill vector (3,), see `rotation_between`; returns how many rays (n, 3) it brings to the others.

    None of them where one is no ray.
    """
    count = len(before)
    off_px, weights, old, new = np.empty(count), np.empty(count), np.empty((count, 3)), np.empty((count, 3))
    for i in range(count):
        old[i] = before[i] / np.sqrt((before[i] ** 2).sum())
        new[i] = after[i] / np.sqrt((after[i] ** 2).sum())
    # To begin with, those count that go about as far as most.
    usual, way = np.empty(3), new - old
    if not np.isfinite(way.sum()):
        return 0
    for k in range(3):
        usual[k] = median(way[:, k].copy())
    for i in range(count):
        off_px[i] = focal_px * np.sqrt(((way[i] - usual) ** 2).sum())
    limit_px = max(_WITHIN_PX, 2.0 * median(off_px))
    for i in range(count):
        weights[i] = 1.0 if off_px[i] <= limit_px else 0.0
    still, pose, moved, nowhere = np.eye(4), np.eye(4), np.empty((4, 4)), np.zeros(3)
    matrix, pull, step, ray = np.empty((3, 3)), np.empty(3), np.zeros(6), np.empty(3)
    within_px = _WITHIN_PX
    for number in range(_ROUNDS):
        for _ in range(_STEPS):
            matrix[:], pull[:] = 0.0, 0.0
            for i in range(count):
                if weights[i] == 0.0:
                    continue
                for j in range(3):
                    ray[j] = pose[j, 0] * old[i, 0] + pose[j, 1] * old[i, 1] + pose[j, 2] * old[i, 2]
                for j in range(3):
                    # A turn w moves a ray r by w x r, and pulls by r x (where it belongs).
                    one, other = (j + 1) % 3, (j + 2) % 3
                    pull[j] += weights[i] * (ray[one] * new[i, other] - ray[other] * new[i, one])
                    matrix[j, j] += weights[i]
                    for k in range(3):
                        matrix[j, k] -= weights[i] * ray[j] * ray[k]
            if not eliminate(matrix, pull):
                break
            step[:3] = pull
            move(pose, nowhere, step, moved)
            pose[:] = moved
            if np.abs(pull).max() < _LAST_STEP:
                break
        for i in range(count):
            far = 0.0
            for j in range(3):
                far += (new[i, j] - pose[j, 0] * old[i, 0] - pose[j, 1] * old[i, 1] - pose[j, 2] * old[i, 2]) ** 2
            off_px[i] = focal_px * np.sqrt(far)
        step_between(still, pose, nowhere, step)
        vector[:] = step[:3]
        within_px = max(_WITHIN_PX, _WITHIN_SHARE * focal_px * np.sqrt((vector**2).sum()))
        reach = max(within_px, 2.5 * median(off_px)) if number < _WIDE_ROUNDS else within_px
        for i in range(count):
            weights[i] = max(1.0 - (off_px[i] / reach) ** 2, 0.0) ** 2
    return int((off_px < within_px).sum())


@kernel("f8[::1](u1[:, :], i8[:, ::1], u1[:, :, ::1])")
def shifts_px(small: ByteImage, places: IntArray, looks: ByteImage) -> FloatArray:
    """(n,) px by which patches of a picture (h, w) have moved: one step of Lucas and Kanade; infinite for far.

    places: (n, 2) px of their middles, x and y; looks: (n, 2 k + 1, 2 k + 1) what they looked like. How bright a patch
    is does not matter; one that changed by more than half of what it shows has moved far.
    """
    count, side = looks.shape[0], looks.shape[1]
    half, area = side // 2, float((side - 2) * (side - 2))
    shifts = np.empty(count)
    for n in range(count):
        x0, y0 = places[n, 0] - half, places[n, 1] - half
        # Sums of slopes across and down, changes and looks, and of their products.
        x, y, d, look = 0.0, 0.0, 0.0, 0.0
        xx, xy, yy, xd, yd, dd, looks2 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for i in range(1, side - 1):
            for j in range(1, side - 1):
                across = 0.5 * (np.float64(looks[n, i, j + 1]) - np.float64(looks[n, i, j - 1]))
                down = 0.5 * (np.float64(looks[n, i + 1, j]) - np.float64(looks[n, i - 1, j]))
                grey = np.float64(looks[n, i, j])
                change = np.float64(small[y0 + i, x0 + j]) - grey
                x, y, d, look = x + across, y + down, d + change, look + grey
                xx, xy, yy = xx + across * across, xy + across * down, yy + down * down
                xd, yd, dd = xd + across * change, yd + down * change, dd + change * change
                looks2 += grey * grey
        if dd - d * d / area > 0.5 * (looks2 - look * look / area):
            shifts[n] = np.inf
            continue
        # About their means.
        xx, xy, yy = xx - x * x / area, xy - x * y / area, yy - y * y / area
        xd, yd = xd - x * d / area, yd - y * d / area
        determinant = xx * yy - xy * xy + 1e-3
        shifts[n] = np.sqrt((yy * xd - xy * yd) ** 2 + (xx * yd - xy * xd) ** 2) / determinant
    return shifts
