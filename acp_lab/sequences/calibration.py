"""Camera intrinsics from pictures of a chessboard or a ChArUco board.

Convention: the board lies in its own plane z = 0, mm; pixel (0, 0) is the centre of the top-left pixel, as OpenCV's
corner finders have it. Estimated are fx, fy, cx, cy, k1, k2, p1, p2; k3 stays 0, because the few views that people
take cannot tell it from k2, and a wrong one bends the corners of the picture.
Source: OpenCV's calib3d (Zhang, "A flexible new technique for camera calibration", 2000).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Protocol

import cv2
import numpy as np

from acp_lab.errors import InputFileError
from acp_lab.geometry.arrays import ByteImage, FloatArray
from acp_lab.geometry.camera import Camera
from acp_lab.sequences.frame import Frame
from acp_lab.sequences.image_file import read_rgb
from acp_lab.sequences.images import ImageFolder, VideoFile, first_size
from acp_lab.sequences.pixel_coding import PixelCoding

MIN_VIEWS = 3
GOOD_VIEWS = 10
LARGEST_GOOD_ERROR_PX = 1.0
DICTIONARIES = tuple(
    f"{size}X{size}_{count}" for size in (4, 5, 6, 7) for count in (50, 100, 250, 1000)
)
"""Names of ArUco dictionaries, without OpenCV's `DICT_`."""
_SMALLEST_COVER = 0.4
_UNSURE_FOCAL = 0.01
_FEWEST_INNER = 3
_MIN_CORNERS = 6
_MOST_NAMES = 3


@dataclass(frozen=True, eq=False)
class BoardView:
    """What was found of a board in one picture: points_board (n, 3) mm and their pixels (n, 2)."""

    points_board: FloatArray
    pixels: FloatArray


class Board(Protocol):
    """A board that can be found in a picture."""

    def find(self, image: ByteImage) -> BoardView | None:
        """The board in an (h, w, 3) RGB picture; None when it is not there, or too little of it."""


@dataclass(frozen=True)
class Chessboard:
    """columns x rows of *inner* corners, squares of square_mm. All of the board must be in the picture.

    Raises InputFileError for fewer than 3 corners a side, which OpenCV does not look for.
    """

    columns: int
    rows: int
    square_mm: float

    def __post_init__(self) -> None:
        if min(self.columns, self.rows) < _FEWEST_INNER:
            raise InputFileError(
                f"a chessboard of {self.columns}x{self.rows} inner corners: {_FEWEST_INNER} a side is the least: count "
                "the corners between the squares, or take a larger board"
            )

    def find(self, image: ByteImage) -> BoardView | None:
        grey = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
        found, corners = cv2.findChessboardCornersSB(grey, (self.columns, self.rows), flags=cv2.CALIB_CB_ACCURACY)
        if not found:
            return None
        grid = np.mgrid[: self.columns, : self.rows].T.reshape(-1, 2) * self.square_mm
        points = np.column_stack([grid, np.zeros(len(grid))])
        return BoardView(points, np.asarray(corners, dtype=np.float64).reshape(-1, 2))


class CharucoBoard:
    """columns x rows of *squares* of square_mm with markers of marker_mm; parts of it are enough.

    Boards with an even number of rows exist in two layouts, as OpenCV changed its own with version 4.6; the first
    picture that shows the board tells which it is. dictionary: one of DICTIONARIES. Raises InputFileError for markers
    that do not fit into the squares or the dictionary.
    """

    def __init__(self, columns: int, rows: int, square_mm: float, marker_mm: float, dictionary: str) -> None:
        markers = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, f"DICT_{dictionary}"))
        if not 0.0 < marker_mm < square_mm:
            raise InputFileError(f"markers of {marker_mm:g} mm in squares of {square_mm:g} mm: measure both again")
        if columns < 2 or rows < 2 or columns * rows // 2 > len(markers.bytesList):
            raise InputFileError(
                f"a board of {columns}x{rows} squares does not go with {dictionary}: count its squares, or give "
                "another dictionary"
            )
        self.board = cv2.aruco.CharucoBoard((columns, rows), square_mm, marker_mm, markers)
        layouts = [self.board]
        if rows % 2 == 0:
            layouts.append(cv2.aruco.CharucoBoard((columns, rows), square_mm, marker_mm, markers))
            layouts[1].setLegacyPattern(True)
        self._detectors = [cv2.aruco.CharucoDetector(layout) for layout in layouts]

    def find(self, image: ByteImage) -> BoardView | None:
        """See `Board`."""
        grey = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
        for detector in self._detectors:
            view = self._found(detector, grey)
            if view is not None:
                self._detectors = [detector]
                return view
        return None

    def _found(self, detector: cv2.aruco.CharucoDetector, grey: np.ndarray) -> BoardView | None:
        corners, ids, _, _ = detector.detectBoard(grey)
        if ids is None or len(ids) < _MIN_CORNERS:
            return None
        points, pixels = self.board.matchImagePoints(corners, ids)  # type: ignore[call-overload]
        points = np.asarray(points, dtype=np.float64).reshape(-1, 3)
        # Corners in one line say nothing about the view.
        if np.linalg.matrix_rank(points - points.mean(0), tol=1e-3) < 2:
            return None
        return BoardView(points, np.asarray(pixels, dtype=np.float64).reshape(-1, 2))


@dataclass(frozen=True, eq=False)
class Calibration:
    """camera; error_px: root mean square of all reprojection errors, and view_errors_px (n,) of each view.

    focal_sigma_px: standard deviation of the focal length; cover: share of the picture that corners were seen in.
    view_names: (n,) of the pictures behind the views; missed: names of the pictures without the board.
    """

    camera: Camera
    error_px: float
    view_errors_px: FloatArray
    focal_sigma_px: float
    cover: float
    view_names: tuple[str, ...] = ()
    missed: tuple[str, ...] = ()

    def __str__(self) -> str:
        c, views = self.camera, f"{len(self.view_errors_px)} views"
        if self.missed:
            more = f" and {len(self.missed) - _MOST_NAMES} more" if len(self.missed) > _MOST_NAMES else ""
            views = f"{len(self.view_errors_px)} of {len(self.view_errors_px) + len(self.missed)} views "
            views += f"(no board in {', '.join(self.missed[:_MOST_NAMES])}{more})"
        return (
            f"camera {c.width} x {c.height} px: fx {c.fx:.1f}, fy {c.fy:.1f} (± {self.focal_sigma_px:.1f}), "
            f"cx {c.cx:.1f}, cy {c.cy:.1f}; {views}, reprojection error "
            f"{self.error_px:.2f} px (worst view {self.view_errors_px.max():.2f})"
        )

    @property
    def warnings(self) -> tuple[str, ...]:
        """What speaks against trusting it."""
        found = []
        if self.error_px > LARGEST_GOOD_ERROR_PX:
            number = int(self.view_errors_px.argmax())
            worst = self.view_names[number] if self.view_names else f"view {number + 1}"
            found.append(
                f"reprojection error {self.error_px:.2f} px is above {LARGEST_GOOD_ERROR_PX:g}: check the board's "
                f"numbers, and leave out blurred views ({worst} is the worst)"
            )
        if len(self.view_errors_px) < GOOD_VIEWS:
            found.append(f"only {len(self.view_errors_px)} views: take {GOOD_VIEWS} or more, tilted to all sides")
        if self.focal_sigma_px > _UNSURE_FOCAL * self.camera.fx:
            found.append(
                f"the focal length is only known to {self.focal_sigma_px:.0f} px: tilt the board more, by 30 to 45 "
                "degrees to all sides"
            )
        if self.cover < _SMALLEST_COVER:
            found.append(
                f"the board was seen in {100 * self.cover:.0f}% of the picture only: move it to the edges too, where "
                "lenses distort most"
            )
        return tuple(found)


def calibrate(board: Board, images: Iterable[ByteImage], source: str, names: Iterable[str] = ()) -> Calibration:
    """Find the board in pictures of one size, and the camera that explains them best.

    names: of the pictures, to speak of single ones; by default they are counted from 1.
    Raises InputFileError, beginning with `source`, for pictures of several sizes and for fewer than MIN_VIEWS in
    which the board is found.
    """
    views: list[BoardView] = []
    view_names: list[str] = []
    missed: list[str] = []
    names = iter(names)
    size: tuple[int, int] | None = None
    seen = 0
    for image in images:
        seen += 1
        name = next(names, f"picture {seen}")
        here = (image.shape[1], image.shape[0])
        size = here if size is None else size
        if here != size:
            raise InputFileError(f"{source}: pictures of {size[0]} x {size[1]} and {here[0]} x {here[1]} px: keep one")
        view = board.find(image)
        if view is None:
            missed.append(name)
        else:
            views.append(view)
            view_names.append(name)
    if size is None or len(views) < MIN_VIEWS:
        raise InputFileError(
            f"{source}: the board was found in {len(views)} of {seen} pictures, {MIN_VIEWS} is the least: check the "
            "board's numbers (a chessboard counts inner corners, ChArUco squares) and take sharper pictures"
        )
    return replace(_solve(views, size), view_names=tuple(view_names), missed=tuple(missed))


def board_images(path: str | Path, every: int = 15) -> Iterator[ByteImage]:
    """The pictures of a board: every image of a folder, or every so many frames of a video, (h, w, 3) RGB.

    Raises InputFileError for what cannot be read, SequenceError for a folder without images.
    """
    return (image for _, image in named_board_images(path, every))


def named_board_images(path: str | Path, every: int = 15) -> Iterator[tuple[str, ByteImage]]:
    """As `board_images`, each with its name: that of the file, or "frame 30" of a video."""
    path = Path(path)
    # What lens it was is still to be found: frames as they are.
    plain = Camera(*first_size(path), 1.0, 1.0, 0.0, 0.0)
    if path.is_dir():
        coding = PixelCoding.beside(path)
        yield from ((file.name, read_rgb(file, coding)) for file in ImageFolder(path, plain).image_paths)
        return
    for frame in VideoFile(path, plain).frames():
        if isinstance(frame, Frame) and frame.index % every == 0:
            yield f"frame {frame.index}", frame.image


def _solve(views: Sequence[BoardView], size: tuple[int, int]) -> Calibration:
    rms, matrix, dist, _, _, sigmas, _, errors = cv2.calibrateCameraExtended(
        [view.points_board.astype(np.float32) for view in views],
        [view.pixels.astype(np.float32) for view in views],
        size,
        np.eye(3),
        np.zeros(5),
        flags=cv2.CALIB_FIX_K3,
    )
    k = np.asarray(matrix)
    coefficients = tuple(float(value) for value in np.asarray(dist).ravel()[:5])
    camera = Camera(size[0], size[1], float(k[0, 0]), float(k[1, 1]), float(k[0, 2]), float(k[1, 2]), coefficients)
    pixels = np.concatenate([view.pixels for view in views])
    return Calibration(
        camera, float(rms), np.asarray(errors, dtype=np.float64).ravel(), float(np.asarray(sigmas).ravel()[0]),
        _cover(pixels, size),
    )  # fmt: skip


def _cover(pixels: FloatArray, size: tuple[int, int]) -> float:
    """Share of the cells of an 8 x 8 grid over the picture that hold a corner."""
    cells = np.clip((pixels / np.array(size) * 8).astype(int), 0, 7)
    return len({(x, y) for x, y in cells.tolist()}) / 64.0
