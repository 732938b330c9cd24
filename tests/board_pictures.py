"""Pictures of calibration boards as a known camera would take them, lens distortion included."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from acp_lab.geometry.arrays import ByteImage
from acp_lab.geometry.camera import Camera
from acp_lab.geometry.pose import so3_exp
from acp_lab.sequences.calibration import CharucoBoard

PX_PER_MM = 6
SQUARE_MM = 20.0

# A wide view, so that distortion shows although the picture is small.
CAMERA = Camera(360, 288, 330.0, 334.0, 182.0, 140.5, (-0.2, 0.06, 0.001, -0.0008, 0.0))


def chessboard_print(columns: int, rows: int) -> ByteImage:
    """A board with columns x rows inner corners and a white rim, as it is printed (h, w)."""
    j, i = np.indices((rows + 1, columns + 1))
    squares = np.where((i + j) % 2 == 0, 20, 250).astype(np.uint8)
    squares = np.pad(squares, 1, constant_values=250)
    return np.kron(squares, np.ones((int(SQUARE_MM * PX_PER_MM),) * 2, np.uint8))


def charuco_print(board: CharucoBoard, columns: int, rows: int) -> ByteImage:
    """The board with a white rim, as it is printed (h, w)."""
    size = (int(columns * SQUARE_MM * PX_PER_MM), int(rows * SQUARE_MM * PX_PER_MM))
    return np.pad(board.board.generateImage(size), int(SQUARE_MM * PX_PER_MM), constant_values=250)


@dataclass(frozen=True, eq=False)
class Stand:
    """Where a board stands: cam_R_board (3, 3) and the board's origin in the camera's frame (3,), mm."""

    rotation: np.ndarray
    translation: np.ndarray

    def pixels(self, points_board: np.ndarray, camera: Camera = CAMERA) -> np.ndarray:
        """Where points (n, 3) of the board are seen, lens distortion included: (n, 2)."""
        turn, _ = cv2.Rodrigues(self.rotation)
        seen, _ = cv2.projectPoints(points_board, turn, self.translation, camera.matrix, np.array(camera.dist))
        return np.asarray(seen).reshape(-1, 2)


def stands(size_mm: tuple[float, float], count: int, seed: int = 0) -> list[Stand]:
    """Boards of a size (width, height), tilted to all sides, whole within the picture."""
    rng = np.random.default_rng(seed)
    found = []
    for _ in range(count):
        rotation = so3_exp(np.append(rng.uniform(-0.55, 0.55, 2), rng.uniform(-0.3, 0.3)))
        middle = np.array([rng.uniform(-60, 60), rng.uniform(-45, 45), rng.uniform(240, 300)])
        found.append(Stand(rotation, middle - rotation @ np.array([size_mm[0] / 2, size_mm[1] / 2, 0.0])))
    return found


def pictures(print_: ByteImage, count: int, seed: int = 0) -> list[ByteImage]:
    """RGB pictures (h, w, 3) of a print by CAMERA; the print's corner is the board's origin."""
    height_mm, width_mm = np.array(print_.shape) / PX_PER_MM
    return [picture(print_, stand) for stand in stands((width_mm, height_mm), count, seed)]


def picture(print_: ByteImage, stand: Stand, camera: Camera = CAMERA) -> ByteImage:
    """One picture (h, w, 3) of a print."""
    fine = 2
    u, v = np.meshgrid(np.arange(camera.width * fine), np.arange(camera.height * fine))
    pixels = (np.stack([u, v], -1).reshape(-1, 1, 2) + 0.5) / fine - 0.5
    criteria = (cv2.TERM_CRITERIA_COUNT, 20, 0.0)
    rays = cv2.undistortPoints(pixels, camera.matrix, np.array(camera.dist), criteria=criteria).reshape(-1, 2)
    way = np.column_stack([rays, np.ones(len(rays))]) @ stand.rotation
    eye = -stand.rotation.T @ stand.translation
    on_board = eye[:2] - (eye[2] / way[:, 2])[:, None] * way[:, :2]
    at = (on_board * PX_PER_MM - 0.5).astype(np.float32).reshape(camera.height * fine, camera.width * fine, 2)
    large = cv2.remap(print_, at[..., 0], at[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=128)
    small = cv2.resize(large, (camera.width, camera.height), interpolation=cv2.INTER_AREA)
    return np.repeat(small[..., None], 3, axis=2)
