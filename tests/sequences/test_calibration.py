"""Boards seen through a known camera give that camera back, and bad boards say what is wrong."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from acp_lab.errors import InputFileError
from acp_lab.geometry.arrays import ByteImage
from acp_lab.sequences.calibration import (
    Board,
    BoardView,
    Calibration,
    CharucoBoard,
    Chessboard,
    board_images,
    calibrate,
    named_board_images,
)
from tests.board_pictures import (
    CAMERA,
    PX_PER_MM,
    SQUARE_MM,
    Stand,
    charuco_print,
    chessboard_print,
    picture,
    pictures,
    stands,
)

CHESSBOARD = Chessboard(7, 5, SQUARE_MM)
CHARUCO = CharucoBoard(7, 5, SQUARE_MM, 15.0, "4X4_50")
SIZE_MM = (140.0, 100.0)


class PerfectBoard:
    """A board that is found without any error, in the order of its stands; pictures only tell the size."""

    def __init__(self, views: list[Stand], noise_px: float = 0.0) -> None:
        self._views = iter(views)
        self._rng = np.random.default_rng(1)
        self._noise_px = noise_px

    def find(self, image: ByteImage) -> BoardView | None:
        grid = np.mgrid[0.0:141.0:20.0, 0.0:101.0:20.0].T.reshape(-1, 2)
        points = np.column_stack([grid, np.zeros(len(grid))])
        pixels = next(self._views).pixels(points)
        return BoardView(points, pixels + self._noise_px * self._rng.standard_normal(pixels.shape))


@pytest.mark.parametrize(("columns", "rows"), [(2, 5), (5, 2)])
def test_a_chessboard_of_too_few_corners(columns: int, rows: int) -> None:
    with pytest.raises(InputFileError, match=f"{columns}x{rows} inner corners: 3 a side"):
        Chessboard(columns, rows, SQUARE_MM)


@pytest.mark.parametrize("noise_px", [0.0, 0.05])
def test_the_known_camera_comes_back(noise_px: float) -> None:
    blank = np.zeros((CAMERA.height, CAMERA.width, 3), np.uint8)
    found = calibrate(PerfectBoard(stands(SIZE_MM, 12), noise_px), [blank] * 12, "boards")
    assert found.error_px == pytest.approx(noise_px * np.sqrt(2.0), rel=0.1, abs=1e-3)
    camera = found.camera
    numbers = np.array([camera.fx, camera.fy, camera.cx, camera.cy])
    np.testing.assert_allclose(numbers, [CAMERA.fx, CAMERA.fy, CAMERA.cx, CAMERA.cy], atol=1e-2 + 30 * noise_px)
    np.testing.assert_allclose(camera.dist, CAMERA.dist, atol=1e-4 + 0.4 * noise_px)
    assert found.focal_sigma_px < 1e-2 + 30 * noise_px
    assert found.warnings == ()
    assert "12 views, reprojection error 0.0" in str(found)


@pytest.mark.parametrize("kind", ["chessboard", "charuco"])
def test_corners_are_found_where_they_are(kind: str) -> None:
    rim = np.array([SQUARE_MM, SQUARE_MM, 0.0])
    board: Board = CHESSBOARD if kind == "chessboard" else CHARUCO
    print_ = chessboard_print(7, 5) if kind == "chessboard" else charuco_print(CHARUCO, 7, 5)
    # The chessboard's first inner corner lies a square further in than the print's first square.
    start = 2 * rim if kind == "chessboard" else rim
    height_mm, width_mm = np.array(print_.shape) / PX_PER_MM
    for stand in stands((width_mm, height_mm), 3):
        view = board.find(picture(print_, stand))
        assert view is not None
        assert len(view.pixels) == (35 if kind == "chessboard" else 24)
        true = stand.pixels(view.points_board + start)
        if kind == "chessboard" and np.linalg.norm(view.pixels[0] - true[0]) > 5:
            true = true[::-1]  # half a turn of the board is no other board
        # ChArUco corners lie between markers, where there is less to hold on to.
        assert np.median(np.linalg.norm(view.pixels - true, axis=1)) < (0.1 if kind == "chessboard" else 0.25)
    assert board.find(np.full((288, 360, 3), 128, np.uint8)) is None


@pytest.mark.parametrize("is_old", [False, True])
def test_boards_of_both_layouts_are_found(is_old: bool) -> None:
    """Those with an even number of rows that were printed with OpenCV before 4.6 begin with a marker."""
    board = CharucoBoard(7, 6, SQUARE_MM, 15.0, "4X4_50")
    printed = CharucoBoard(7, 6, SQUARE_MM, 15.0, "4X4_50")
    printed.board.setLegacyPattern(is_old)
    print_ = charuco_print(printed, 7, 6)
    height_mm, width_mm = np.array(print_.shape) / PX_PER_MM
    assert board.find(np.full((288, 360, 3), 128, np.uint8)) is None
    for stand in stands((width_mm, height_mm), 3):
        view = board.find(picture(print_, stand))
        assert view is not None
        assert len(view.pixels) > 20
        true = stand.pixels(view.points_board + np.array([SQUARE_MM, SQUARE_MM, 0.0]))
        assert np.median(np.linalg.norm(view.pixels - true, axis=1)) < 0.25


def test_warnings_name_what_speaks_against_a_calibration() -> None:
    bad = Calibration(CAMERA, 1.4, np.array([0.3, 2.5, 0.4, 0.2]), 12.0, 0.2)
    error, views, focal, cover = bad.warnings
    assert "1.40 px is above 1" in error
    assert "view 2 is the worst" in error
    assert "only 4 views" in views
    assert "known to 12 px" in focal
    assert "20% of the picture" in cover


def test_pictures_without_the_board_are_named() -> None:
    class SeenOnlyInSome(PerfectBoard):
        def find(self, image: ByteImage) -> BoardView | None:
            return super().find(image) if image.any() else None

    black = np.zeros((CAMERA.height, CAMERA.width, 3), np.uint8)
    images, names = [black, *[black + 9] * 12, black], [f"{number}.jpg" for number in range(14)]
    found = calibrate(SeenOnlyInSome(stands(SIZE_MM, 12)), images, "boards", names)
    assert found.missed == ("0.jpg", "13.jpg")
    assert found.view_names == tuple(names[1:13])
    assert "12 of 14 views (no board in 0.jpg, 13.jpg), reprojection" in str(found)
    counted = calibrate(SeenOnlyInSome(stands(SIZE_MM, 12)), [black] * 4 + images, "boards")
    assert "(no board in picture 1, picture 2, picture 3 and 3 more)" in str(counted)
    bad = Calibration(CAMERA, 1.4, np.array([0.3, 2.5, 0.4]), 1.0, 0.9, ("a.jpg", "b.jpg", "c.jpg"))
    assert "b.jpg is the worst" in bad.warnings[0]


def test_views_that_are_all_alike_are_noticed() -> None:
    blank = np.zeros((CAMERA.height, CAMERA.width, 3), np.uint8)
    same = calibrate(PerfectBoard(stands(SIZE_MM, 1) * 4, 0.05), [blank] * 4, "boards")
    assert any("tilt the board" in warning for warning in same.warnings)


def test_pictures_without_the_board_are_refused() -> None:
    images = pictures(chessboard_print(7, 5), 2)
    grey = np.full_like(images[0], 128)
    with pytest.raises(InputFileError, match="boards: the board was found in 2 of 3 pictures, 3 is the least"):
        calibrate(CHESSBOARD, [*images, grey], "boards")
    with pytest.raises(InputFileError, match="0 of 0 pictures"):
        calibrate(CHESSBOARD, [], "boards")
    with pytest.raises(InputFileError, match="pictures of 360 x 288 and 64 x 48 px"):
        calibrate(CHESSBOARD, [images[0], grey[:48, :64]], "boards")


@pytest.mark.parametrize(
    ("columns", "rows", "marker_mm", "word"),
    [(7, 5, 25.0, "measure both"), (30, 20, 15.0, "does not go with"), (1, 5, 15.0, "board of 1x5 squares")],
)
def test_boards_that_cannot_be(columns: int, rows: int, marker_mm: float, word: str) -> None:
    with pytest.raises(InputFileError, match=word):
        CharucoBoard(columns, rows, SQUARE_MM, marker_mm, "4X4_50")


def test_pictures_of_a_board_come_from_a_folder_or_a_video(tmp_path: Path) -> None:
    images = pictures(chessboard_print(7, 5), 3)
    folder = tmp_path / "boards"
    folder.mkdir()
    for number, image in enumerate(images, start=9):  # 10 comes after 9, although not as text
        cv2.imwrite(str(folder / f"board{number}.png"), image)
    (folder / "notes.txt").write_text("no picture")
    assert [name for name, _ in named_board_images(folder)] == [f"board{k}.png" for k in (9, 10, 11)]
    for read, image in zip(board_images(folder), images, strict=True):
        np.testing.assert_array_equal(read, image)
    height, width = images[0].shape[:2]
    video = cv2.VideoWriter(str(tmp_path / "boards.avi"), cv2.VideoWriter.fourcc(*"MJPG"), 10.0, (width, height))
    for image in (image for image in images for _ in range(4)):
        video.write(image)
    video.release()
    seen = list(board_images(tmp_path / "boards.avi", every=4))
    assert [name for name, _ in named_board_images(tmp_path / "boards.avi", every=4)][:2] == ["frame 0", "frame 4"]
    assert len(seen) == 3
    for read, image in zip(seen, images, strict=True):
        assert np.abs(read.astype(float) - image).mean() < 3.0
    with pytest.raises(InputFileError, match="no such video"):
        list(board_images(tmp_path / "nothing.mp4"))
