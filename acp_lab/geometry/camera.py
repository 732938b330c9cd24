"""The pinhole camera, its file, and the removal of lens distortion.

Convention: OpenCV axes (x right, y down, z forward), pixel (0, 0) is the *centre* of the top-left pixel,
pixels are (x, y), arrays (h, w), lengths mm. `Camera.project` is the pinhole model alone: frames are
undistorted once, when they are read, by an `Undistorter` that keeps the camera matrix. Points projected
into an image that is still distorted are silently off by several pixels near its border.
"""

from __future__ import annotations

import json
import math
import warnings
from dataclasses import dataclass
from functools import cached_property, lru_cache
from operator import index
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from acp_lab.errors import GeometryError, InputFileError
from acp_lab.files import write_whole
from acp_lab.geometry.arrays import ByteImage, FloatArray
from acp_lab.input_file import is_measure, path_of, read_json_object

_NO_DISTORTION = (0.0, 0.0, 0.0, 0.0, 0.0)
_KEYS = ("width", "height", "fx", "fy", "cx", "cy", "dist")
SMALLEST_FOCAL, LARGEST_FOCAL = 0.05, 1000.0
"""In longer sides of the image: fields of view from 169 degrees down to 0.06 degrees."""
FARTHEST_CENTRE = 10.0
"""The principal point, in longer sides of the image: a crop may leave it outside, but not that far."""
_OUTSIDE = -2
"""A pixel (x, y) whose neighbours, which are mixed with it, lie outside the image, too."""
LARGEST_DISTORTION = 1e4
"""A lens of long focal length may have a k3 of some hundreds; no lens has this."""
_VIEW_EXAMPLE = '{"width": 640, "height": 480, "hfov_deg": 60}'
_EXAMPLE = '{"width": 640, "height": 480, "fx": 600, "fy": 600, "cx": 319.5, "cy": 239.5, "dist": [0, 0, 0, 0, 0]}'


@dataclass(frozen=True)
class Camera:
    """A pinhole camera with OpenCV's five-coefficient distortion.

    width, height: image size in px; fx, fy, cx, cy: focal lengths and principal point in px;
    dist: (k1, k2, p1, p2, k3). Equal cameras compare and hash equal, so they can be cache keys.
    Raises GeometryError for sizes or focal lengths that are not positive and for numbers that are not finite.

    Example:
        >>> camera = Camera(640, 480, 600.0, 600.0, 319.5, 239.5)
        >>> camera.project(np.array([[0.0, 0.0, 400.0], [10.0, 0.0, 400.0]]))
        array([[319.5, 239.5],
               [334.5, 239.5]])
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    dist: tuple[float, ...] = _NO_DISTORTION

    def __post_init__(self) -> None:
        try:
            width, height = index(self.width), index(self.height)
        except TypeError:
            raise GeometryError(f"camera size {self.width!r} x {self.height!r}: give whole px, as 640, 480") from None
        # Plain numbers, whatever they were read with: JSON takes no others.
        object.__setattr__(self, "width", width)
        object.__setattr__(self, "height", height)
        for name in ("fx", "fy", "cx", "cy"):
            # Whole numbers are typed by hand; compiled loops take no others than float64.
            object.__setattr__(self, name, _in_px(getattr(self, name), name))
        if self.width < 1 or self.height < 1:
            raise GeometryError(f"camera size {self.width} x {self.height}: both must be at least 1 px")
        if not (math.isfinite(self.fx) and math.isfinite(self.fy) and self.fx > 0 and self.fy > 0):
            raise GeometryError(f"camera focal lengths fx={self.fx} fy={self.fy}: both must be above 0 px")
        if not (math.isfinite(self.cx) and math.isfinite(self.cy)):
            raise GeometryError(f"camera principal point cx={self.cx} cy={self.cy}: both must be finite")
        # OpenCV's own calibration returns them as (1, 5) or (5, 1).
        flat = np.ravel(self.dist).tolist() if self.dist is not None else []
        if len(flat) != 5 or not all(isinstance(k, int | float) and math.isfinite(k) for k in flat):
            raise GeometryError(f"camera distortion {flat}: give five finite k1, k2, p1, p2, k3")
        # A plain tuple of floats keeps the camera hashable even when a list or an array was handed in.
        object.__setattr__(self, "dist", tuple(float(k) for k in flat))

    @classmethod
    def from_matrix(
        cls, matrix: FloatArray, width: int, height: int, dist: tuple[float, ...] = _NO_DISTORTION
    ) -> Camera:
        """Camera of a (3, 3) matrix K = [[fx, 0, cx], [0, fy, cy], [0, 0, 1]].

        Raises GeometryError for another shape and for skew, which the rest of the package does not model.
        """
        try:
            k = np.asarray(matrix, dtype=np.float64)
        except (TypeError, ValueError):
            raise GeometryError(f"camera matrix {str(matrix)[:60]!r}: give 3 x 3 numbers, row by row") from None
        if k.shape != (3, 3):
            raise GeometryError(f"camera matrix has shape {k.shape}: give 3 x 3 numbers, row by row")
        # Written as "not all close" so that NaN is refused too.
        if not np.allclose((k[0, 1], k[1, 0], *k[2]), (0.0, 0.0, 0.0, 0.0, 1.0), rtol=0.0, atol=1e-6):
            raise GeometryError(
                f"camera matrix {k.tolist()}: must read [[fx, 0, cx], [0, fy, cy], [0, 0, 1]], without skew"
            )
        fx, fy, cx, cy = float(k[0, 0]), float(k[1, 1]), float(k[0, 2]), float(k[1, 2])
        return cls(width, height, fx, fy, cx, cy, dist)

    @classmethod
    def from_field_of_view(cls, width: int, height: int, hfov_deg: float) -> Camera:
        """Camera of an ideal lens: square pixels, the optical axis in the middle of the image, no distortion.

        hfov_deg: horizontal field of view, from the left border of the image to the right one, in (0, 180).
        Raises GeometryError for other angles.

        Example:
            >>> round(Camera.from_field_of_view(640, 480, hfov_deg=60.0).fx, 2)
            554.26
        """
        try:
            is_angle = 0.0 < hfov_deg < 180.0
        except (TypeError, ValueError):
            is_angle = False
        if not is_angle:
            raise GeometryError(f"camera field of view hfov_deg={hfov_deg!r}: give degrees between 0 and 180")
        focal = 0.5 * width / math.tan(0.5 * math.radians(hfov_deg))
        return cls(width, height, focal, focal, 0.5 * (width - 1), 0.5 * (height - 1))

    @classmethod
    def from_json(cls, path: str | Path) -> Camera:
        """Read CAMERA.json: {"width","height","fx","fy","cx","cy","dist":[k1,k2,p1,p2,k3]}.

        Or {"width","height","hfov_deg"}, see `from_field_of_view`. Further keys are ignored. Raises InputFileError,
        one line, for whatever is wrong with the file.
        """
        path = path_of(path, "a camera file", "CAMERA.json")
        values = read_json_object(path, f"write it as {_EXAMPLE}", "camera file")
        by_view = "hfov_deg" in values and not any(key in values for key in _KEYS[2:])
        keys = (*_KEYS[:2], "hfov_deg") if by_view else _KEYS
        missing = [key for key in keys if key not in values]
        if missing:
            hint = ' (no distortion is "dist": [0, 0, 0, 0, 0])' if missing == ["dist"] else ""
            example = _VIEW_EXAMPLE if by_view else _EXAMPLE
            raise InputFileError(f"{path}: camera lacks {', '.join(missing)}: add it, as in {example}{hint}")
        if "hfov_deg" in values and not by_view:
            raise InputFileError(f"{path}: camera has hfov_deg and focal lengths: keep one of the two")
        width, height, *numbers = (_number(path, key, values[key]) for key in keys if key != "dist")
        for key, size in (("width", width), ("height", height)):
            if size != int(size) or size < 1:
                raise InputFileError(f"{path}: {key} is {values[key]}: give whole pixels, at least 1")
        if by_view:
            try:
                camera = cls.from_field_of_view(int(width), int(height), numbers[0])
            except GeometryError as error:
                raise InputFileError(f"{path}: {error}") from None
        else:
            fx, fy = _focal_lengths(path, values)
            camera = cls(int(width), int(height), fx, fy, numbers[2], numbers[3], _dist(path, values))
        check_plausible(camera, str(path))
        return camera

    def to_json(self, path: str | Path) -> None:
        """Write CAMERA.json whole or not at all; raises InputFileError when the place cannot be written."""
        text = json.dumps({key: getattr(self, key) for key in _KEYS}, indent=2) + "\n"
        write_whole(Path(path), text.encode())

    @cached_property
    def matrix(self) -> FloatArray:
        """K, (3, 3), read-only: shared by all callers."""
        k = np.array([[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])
        k.flags.writeable = False
        return k

    @cached_property
    def numbers(self) -> FloatArray:
        """(4,) fx, fy, cx, cy, px: what compiled loops take, and read alone."""
        return np.array([self.fx, self.fy, self.cx, self.cy])

    @cached_property
    def _projection(self) -> FloatArray:
        # The first two rows of K, transposed: one small product instead of four passes over the points.
        return np.ascontiguousarray(self.matrix[:2].T)

    @property
    def is_distorted(self) -> bool:
        """True when any distortion coefficient differs from zero."""
        return any(self.dist)

    def pinhole(self) -> Camera:
        """The same camera without distortion: the one that undistorted frames carry."""
        if not self.is_distorted:
            return self
        return Camera(self.width, self.height, self.fx, self.fy, self.cx, self.cy)

    def cropped(self, x: int, y: int, width: int, height: int) -> Camera:
        """The camera of image[y : y + height, x : x + width] (whole px): only the principal point moves.

        Raises GeometryError for a distorted camera, whose coefficients belong to the full image, and for parts of px.
        """
        if self.is_distorted:
            raise GeometryError("distorted camera cannot be cropped: undistort the image, use camera.pinhole()")
        try:
            left, top = index(x), index(y)
        except TypeError:
            raise GeometryError(f"camera crop at {x!r}, {y!r}: give whole px, as 100, 80") from None
        return Camera(width, height, self.fx, self.fy, self.cx - left, self.cy - top)

    def shrunk(self, times: int) -> Camera:
        """The camera of the image whose pixels are the means of `times` squared ones, without what is left at its end.

        times: a whole number; its pinhole part only.
        """
        centre = (self.cx + 0.5) / times - 0.5, (self.cy + 0.5) / times - 0.5
        return Camera(self.width // times, self.height // times, self.fx / times, self.fy / times, *centre)

    def halved(self) -> Camera:
        """The same with `times` 2."""
        return self.shrunk(2)

    def resized(self, width: int, height: int) -> Camera:
        """The camera of the image drawn with other numbers of pixels (px); its pinhole part only."""
        across, down = width / self.width, height / self.height
        centre = (self.cx + 0.5) * across - 0.5, (self.cy + 0.5) * down - 0.5
        return Camera(width, height, self.fx * across, self.fy * down, *centre)

    def project(self, points_cam: FloatArray) -> FloatArray:
        """Pixels (n, 2) of points (n, 3), or one (2,) of one point (3,), in mm, camera frame; pinhole part only.

        Points on or behind the camera's plane (z <= 0) have no image and become NaN, never a mirrored pixel.
        """
        points = np.asarray(points_cam, dtype=np.float64)
        z = points[..., 2:]
        # "not above" also catches NaN; the usual case, all in front, pays for one minimum.
        if z.size and not z.min() > 0.0:
            z = np.where(z > 0.0, z, np.nan)
        pixels: FloatArray = (points @ self._projection) / z
        return pixels

    def rays(self, pixels: FloatArray) -> FloatArray:
        """Viewing directions (n, 3), or one (3,), with z = 1, camera frame, of pixels (n, 2) or one (2,).

        Times a depth, points.
        """
        points = np.asarray(pixels, dtype=np.float64)
        rays = np.ones((*points.shape[:-1], 3))
        rays[..., :2] = (points - (self.cx, self.cy)) / (self.fx, self.fy)
        return rays


class Undistorter:
    """Removes a camera's lens distortion from images, keeping its matrix K.

    The result belongs to `camera.pinhole()`. Without distortion the image itself is returned.
    Pixels that the lens never saw become black, also where its distortion formula would lead back into the image;
    that it does so at all is told as a UserWarning.
    """

    def __init__(self, camera: Camera) -> None:
        self.camera = camera
        fold = _fold(camera) if camera.is_distorted else math.inf
        if fold < math.inf:
            told = ", ".join(f"{k:g}" for k in camera.dist)
            warnings.warn(
                f"camera distortion {told}: folds the image, from {camera.fx * math.sqrt(fold):.0f} px round its "
                "middle on, where nothing is seen: check k1, k2, p1, p2, k3, or calibrate with boards at the corners",
                UserWarning,
                stacklevel=2,
            )

    def __call__(self, image: ByteImage) -> ByteImage:
        """Undistorted image of the same shape, (h, w) or (h, w, 3), uint8.

        Raises GeometryError for another size, and for other numbers than uint8, which would wrap round.
        """
        if image.dtype != np.uint8:
            raise GeometryError(f"image is {image.dtype} {image.shape}: give uint8, 0 to 255; of 16 bits, image >> 8")
        if image.shape[:2] != (self.camera.height, self.camera.width):
            raise GeometryError(
                f"image is {image.shape[1]} x {image.shape[0]} px but its camera is "
                f"{self.camera.width} x {self.camera.height}: give the camera of these images"
            )
        if not self.camera.is_distorted:
            return image
        map_x, map_y = _undistortion_maps(self.camera)
        return cv2.remap(image, map_x, map_y, cv2.INTER_LINEAR).astype(np.uint8, copy=False)


@lru_cache(maxsize=4)
def _undistortion_maps(camera: Camera) -> tuple[Any, Any]:
    """cv2's fixed-point remap tables; a few are cached because a sequence may have two or three cameras."""
    size = (camera.width, camera.height)
    pixels, fractions = cv2.initUndistortRectifyMap(
        camera.matrix, np.asarray(camera.dist), np.eye(3), camera.matrix, size, cv2.CV_16SC2
    )
    x, y = (np.arange(camera.width) - camera.cx) / camera.fx, (np.arange(camera.height) - camera.cy) / camera.fy
    unseen = x**2 + y[:, None] ** 2 >= _fold(camera)
    pixels[unseen], fractions[unseen] = _OUTSIDE, 0
    return pixels, fractions


def _fold(camera: Camera) -> float:
    """The square of the radius, at depth 1, from which on the distortion leads back into the image; inf if none.

    The lens shows the radius r at r (1 + k1 r^2 + k2 r^4 + k3 r^6). Where that stops growing the formula ends: the
    image holds nothing of what lies farther out. What counts is within the farthest corner.
    """
    k1, k2, _, _, k3 = camera.dist
    x, y = max(camera.cx, camera.width - 1 - camera.cx), max(camera.cy, camera.height - 1 - camera.cy)
    squares = np.linspace(0.0, (x / camera.fx) ** 2 + (y / camera.fy) ** 2, 4096)
    slopes = 1.0 + squares * (3.0 * k1 + squares * (5.0 * k2 + squares * 7.0 * k3))
    return float(squares[slopes <= 0.0].min(initial=math.inf))


def _in_px(value: object, name: str) -> float:
    try:
        return float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError):
        raise GeometryError(f"camera {name} is {value!r}: give a number of px") from None


def check_plausible(camera: Camera, where: str) -> None:
    """InputFileError, beginning with `where`, for numbers that no lens and sensor have.

    Left alone they overflow much later, or put every pose where nothing is.
    """
    size = max(camera.width, camera.height)
    for key, focal in (("fx", camera.fx), ("fy", camera.fy)):
        if not SMALLEST_FOCAL * size <= focal <= LARGEST_FOCAL * size:
            raise InputFileError(
                f"{where}: {key} is {focal:g} px, which no lens has for an image of {camera.width} x {camera.height} "
                f"px: give the focal length in px, {SMALLEST_FOCAL:g} to {LARGEST_FOCAL:g} times the longer side"
            )
    for key, centre in (("cx", camera.cx), ("cy", camera.cy)):
        if abs(centre) > FARTHEST_CENTRE * size:
            raise InputFileError(
                f"{where}: {key} is {centre:g} px, far outside an image of {camera.width} x {camera.height} px: "
                "give the principal point of this image"
            )
    if max(map(abs, camera.dist)) > LARGEST_DISTORTION:
        raise InputFileError(
            f"{where}: dist holds {max(camera.dist, key=abs):g}: give k1, k2, p1, p2, k3 of OpenCV, below "
            f"{LARGEST_DISTORTION:g}"
        )


def _focal_lengths(path: Path, values: dict[str, Any]) -> tuple[float, float]:
    fx, fy = (_number(path, key, values[key]) for key in ("fx", "fy"))
    for key, focal in (("fx", fx), ("fy", fy)):
        if focal <= 0:
            raise InputFileError(f"{path}: {key} is {values[key]}: give the focal length in px, above 0")
    return fx, fy


def _dist(path: Path, values: dict[str, Any]) -> tuple[float, ...]:
    dist = values["dist"]
    if not isinstance(dist, list) or len(dist) != 5:
        given = repr(dist)[:60]
        raise InputFileError(f"{path}: dist is {given}: give five numbers [k1, k2, p1, p2, k3], zeros if none")
    return tuple(_number(path, f"dist[{i}]", k) for i, k in enumerate(dist))


def _number(path: Path, key: str, value: object) -> float:
    if isinstance(value, int | float) and is_measure(value):
        return float(value)
    raise InputFileError(f"{path}: {key} is {repr(value)[:60]}: give a finite number")
