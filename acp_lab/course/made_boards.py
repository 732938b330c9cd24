"""Pictures of a chessboard as a known camera would take them, lens distortion included.

Stand-ins for the pictures that whoever calibrates a camera takes. Convention: the print's top-left corner is the
board's origin, mm, its plane z = 0; pixel (0, 0) is the centre of the top-left pixel.
"""

from __future__ import annotations

import cv2
import numpy as np

from acp_lab.geometry.arrays import ByteImage, FloatArray
from acp_lab.geometry.camera import Camera
from acp_lab.geometry.pose import make_pose, so3_exp
from acp_lab.sequences.calibration import Chessboard

PX_PER_MM = 4
_FINE = 2  # rays per pixel, each way
_BLUR_PX, _NOISE = 0.6, 2.0
_MARGIN_PX = 6.0
_MOST_TRIES = 2_000


def chessboard_print(board: Chessboard) -> ByteImage:
    """The board with a white rim of one square, as it is printed: (h, w), `PX_PER_MM`."""
    row, column = np.indices((board.rows + 1, board.columns + 1))
    squares = np.pad(np.where((row + column) % 2 == 0, 25, 245).astype(np.uint8), 1, constant_values=245)
    side = round(board.square_mm * PX_PER_MM)
    return np.kron(squares, np.ones((side, side), np.uint8))


def board_views(
    board: Chessboard, camera: Camera, count: int, tilt_deg: float = 40.0, seed: int = 0
) -> list[ByteImage]:
    """RGB pictures (h, w, 3) of a board, all of its corners in the picture, tilted by up to `tilt_deg` to all sides.

    The same arguments give the same pictures. Raises ValueError for a board that does not fit into the picture.
    """
    rng = np.random.default_rng(seed)
    rays = camera_rays(camera, _FINE)
    print_ = chessboard_print(board)
    views = []
    for _ in range(count):
        seen = _picture(print_, _stand(board, camera, tilt_deg, rng), rays)
        grey = cv2.GaussianBlur(seen, (0, 0), _BLUR_PX).astype(np.float64) + rng.normal(0.0, _NOISE, seen.shape)
        views.append(np.repeat(np.clip(np.round(grey), 0, 255).astype(np.uint8)[..., None], 3, axis=2))
    return views


def camera_rays(camera: Camera, fine: int = 1) -> FloatArray:
    """(h fine, w fine, 3) viewing directions with z = 1 of a camera with distortion, `fine` per pixel, each way."""
    u, v = np.meshgrid(np.arange(camera.width * fine), np.arange(camera.height * fine))
    pixels = (np.stack([u, v], -1).reshape(-1, 1, 2) + 0.5) / fine - 0.5
    criteria = (cv2.TERM_CRITERIA_COUNT, 10, 0.0)
    plain = cv2.undistortPoints(pixels, camera.matrix, np.array(camera.dist), criteria=criteria).reshape(-1, 2)
    rays: FloatArray = np.column_stack([plain, np.ones(len(plain))])
    return rays.reshape((camera.height * fine, camera.width * fine, 3))


def _stand(board: Chessboard, camera: Camera, tilt_deg: float, rng: np.random.Generator) -> FloatArray:
    """cam_T_board (4, 4) of a board that is whole in the picture."""
    size = np.array([board.columns + 3.0, board.rows + 3.0]) * board.square_mm
    middle_board = np.append(0.5 * size, 0.0)
    grid = np.mgrid[1 : board.columns + 3, 1 : board.rows + 3].reshape(2, -1).T * board.square_mm
    corners = np.column_stack([grid, np.zeros(len(grid))])
    near_mm = camera.fx * size[0] / camera.width
    for _ in range(_MOST_TRIES):
        way, tilt = rng.uniform(0.0, 2.0 * np.pi), np.radians(tilt_deg) * np.sqrt(rng.uniform(0.2, 1.0))
        turn = so3_exp(np.array([np.cos(way), np.sin(way), 0.0]) * tilt) @ so3_exp(
            np.array([0.0, 0.0, rng.uniform(-0.3, 0.3)])
        )
        depth_mm = near_mm * rng.uniform(0.9, 1.6)
        across = rng.uniform(-0.35, 0.35, 2) * (camera.width, camera.height) / camera.fx * depth_mm
        pose = make_pose(turn, np.append(across, depth_mm) - turn @ middle_board)
        rotation, _ = cv2.Rodrigues(turn)
        seen, _ = cv2.projectPoints(corners, rotation, pose[:3, 3], camera.matrix, np.array(camera.dist))
        x, y = np.asarray(seen).reshape(-1, 2).T
        inside_x = x.min() > _MARGIN_PX and x.max() < camera.width - 1 - _MARGIN_PX
        if inside_x and y.min() > _MARGIN_PX and y.max() < camera.height - 1 - _MARGIN_PX:
            return pose
    raise ValueError(f"a board of {board.columns}x{board.rows} corners never fits into the picture")


def _picture(print_: ByteImage, cam_T_board: FloatArray, rays: FloatArray) -> ByteImage:
    """(h, w) grey: each ray reads the print where it meets the board, grey beside it."""
    rotation, eye = cam_T_board[:3, :3], -cam_T_board[:3, :3].T @ cam_T_board[:3, 3]
    way = rays @ rotation
    on_board = eye[:2] - (eye[2] / way[..., 2:]) * way[..., :2]
    at = (on_board * PX_PER_MM - 0.5).astype(np.float32)
    large = cv2.remap(print_, at[..., 0], at[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=120)
    height, width = rays.shape[0] // _FINE, rays.shape[1] // _FINE
    return np.asarray(cv2.resize(large, (width, height), interpolation=cv2.INTER_AREA), np.uint8)
