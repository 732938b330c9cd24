"""e_3d(W): how far a homography of the control points leaves the edges from where they truly are (eq. 8 to 10).

The chain of paper IV-C in torch, float64, differentiable from W to the loss: I before and after the motion by
projection -> H in closed form (eq. 8) -> moved edge points (eq. 9) -> bilinear look-up in the distance map of the
true edges after the motion -> e_3d (eq. 10).

e_3d depends on the plane of W alone, not on where the four points lie in it: a rigid motion moves the image of a plane
by one homography, and any four of its points tell that same one.
"""

from __future__ import annotations

import torch

from acp_lab.control_points.motion_pairs import MotionPairs


class EdgeLoss:
    """e_3d(W) of eq. 10 on motion pairs, as a differentiable function."""

    def __init__(self, pairs: MotionPairs) -> None:
        self._matrices = torch.from_numpy(pairs.camera_matrices)
        self._before = torch.from_numpy(pairs.before_T_obj)
        self._after = torch.from_numpy(pairs.after_T_obj)
        self._points = torch.from_numpy(pairs.points)
        self._points_after = torch.from_numpy(pairs.points_after)
        self._view = torch.from_numpy(pairs.view_of_point)
        self._maps = torch.from_numpy(pairs.distances)

    def __call__(self, points_obj: torch.Tensor) -> torch.Tensor:
        """Mean over the pairs of  1 / (w h) * sqrt(sum of squared distances), for W (4, 3) mm."""
        squares = torch.zeros(len(self._maps), dtype=torch.float64)
        squares = squares.index_add(0, self._view, self.distances(points_obj) ** 2)
        # Epsilon keeps the square root's gradient finite where every point hits.
        return (squares + 1e-12).sqrt().mean() / self._maps[0].numel()

    def exact_distances(self) -> torch.Tensor:
        """(m,) px: the same for points moved as the part moves; what is left is the maps' own grain."""
        return look_up(self._maps, self._view, self._points_after)

    def distances(self, points_obj: torch.Tensor) -> torch.Tensor:
        """(m,) px: how far each moved edge point is from the edges after the motion."""
        homographies = homographies_between(
            project(points_obj, self._before, self._matrices), project(points_obj, self._after, self._matrices)
        )
        return look_up(self._maps, self._view, move_points(homographies[self._view], self._points))


def project(points_obj: torch.Tensor, cam_T_obj: torch.Tensor, matrices: torch.Tensor) -> torch.Tensor:
    """Points (n, 3) mm at poses (v, 4, 4) through cameras (v, 3, 3): (v, n, 2) px."""
    points_cam = points_obj @ cam_T_obj[:, :3, :3].transpose(1, 2) + cam_T_obj[:, None, :3, 3]
    pixels = points_cam @ matrices.transpose(1, 2)
    return pixels[..., :2] / pixels[..., 2:]


def homographies_between(src: torch.Tensor, dst: torch.Tensor) -> torch.Tensor:
    """H (v, 3, 3), H33 = 1, of quads src to dst, both (v, 4, 2) px: eq. 8 in closed form.

    The paper's 8 x 8 system with the right-hand side that its print lost; see `geometry.homography`, whose twin
    in torch this is. Solved between coordinates of about 1, as raw pixels differ by a factor of 1e6.
    """
    to_src, _ = _normalisation(src)
    to_dst, from_dst = _normalisation(dst)
    x, moved = _move(to_src, src), _move(to_dst, dst)
    system = torch.zeros(*src.shape[:-2], 8, 8, dtype=src.dtype)
    system[..., 0::2, 0:2] = x
    system[..., 0::2, 2] = 1.0
    system[..., 1::2, 3:5] = x
    system[..., 1::2, 5] = 1.0
    system[..., 0::2, 6:] = -moved[..., :1] * x
    system[..., 1::2, 6:] = -moved[..., 1:] * x
    h = torch.linalg.solve(system, moved.flatten(-2))
    unscaled = torch.cat([h, torch.ones_like(h[..., :1])], dim=-1).unflatten(-1, (3, 3))
    homography = from_dst @ unscaled @ to_src
    return homography / homography[..., 2:, 2:]


def move_points(homographies: torch.Tensor, points: torch.Tensor) -> torch.Tensor:
    """Points (m, 2) px, each moved by its own H (m, 3, 3): eq. 9."""
    homogeneous = (homographies[:, :, :2] @ points[:, :, None])[..., 0] + homographies[:, :, 2]
    return homogeneous[:, :2] / homogeneous[:, 2:]


def look_up(maps: torch.Tensor, view: torch.Tensor, points: torch.Tensor) -> torch.Tensor:
    """(m,) bilinear values of maps (v, h, w), each point (m, 2) px in the map of its view (m,).

    A point outside takes the value at the nearest place inside.
    """
    height, width = maps.shape[1:]
    x = points[:, 0].clamp(0.0, width - 1.0)
    y = points[:, 1].clamp(0.0, height - 1.0)
    column = x.detach().floor().clamp(max=width - 2.0)
    row = y.detach().floor().clamp(max=height - 2.0)
    right, down = x - column, y - row
    first = (view * height + row.long()) * width + column.long()
    flat = maps.reshape(-1)
    top = flat[first] * (1.0 - right) + flat[first + 1] * right
    bottom = flat[first + width] * (1.0 - right) + flat[first + width + 1] * right
    return top * (1.0 - down) + bottom * down


def _normalisation(quads: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """The similarities that centre quads (v, 4, 2) and scale them to about 1, and their inverses, (v, 3, 3) each.

    Held fixed in the derivative: H does not depend on them.
    """
    quads = quads.detach()
    middle = quads.mean(-2)
    size = (quads - middle[..., None, :]).abs().amax((-2, -1))
    to = torch.zeros(*quads.shape[:-2], 3, 3, dtype=quads.dtype)
    back = torch.zeros_like(to)
    to[..., 0, 0] = to[..., 1, 1] = 1.0 / size
    to[..., :2, 2] = -middle / size[..., None]
    back[..., 0, 0] = back[..., 1, 1] = size
    back[..., :2, 2] = middle
    to[..., 2, 2] = back[..., 2, 2] = 1.0
    return to, back


def _move(similarities: torch.Tensor, points: torch.Tensor) -> torch.Tensor:
    return points * similarities[..., :1, :1] + similarities[..., None, :2, 2]
