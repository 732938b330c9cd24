"""e_3d: each step against an independent computation, its gradient against differences, its blindness in the plane."""

from __future__ import annotations

import kornia
import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from scipy.ndimage import map_coordinates

from acp_lab.cad.part import Part
from acp_lab.control_points.coplanar_points import mid_section_points
from acp_lab.control_points.edge_loss import EdgeLoss, homographies_between, look_up, move_points, project
from acp_lab.control_points.motion_pairs import MotionPairs
from acp_lab.control_points.plane_points import Form, PlanePoints
from acp_lab.control_points.view_regions import ALL_REGIONS
from acp_lab.geometry.camera import Camera
from acp_lab.geometry.homography import apply_homography, homography_from_points
from acp_lab.geometry.pose import transform
from tests.geometry.geometry_strategies import convex_quads


@given(src=convex_quads(flattest=0.1), dst=convex_quads(flattest=0.1))
def test_homographies_are_those_of_the_geometry_layer_and_of_kornia(src: np.ndarray, dst: np.ndarray) -> None:
    batch = homographies_between(torch.from_numpy(np.stack([src, dst])), torch.from_numpy(np.stack([dst, src])))
    assert (batch[:, 2, 2] == 1.0).all()
    middle = np.array([src.mean(0), dst.mean(0)])
    moved = move_points(batch, torch.from_numpy(middle)).numpy()
    expected = [
        apply_homography(homography_from_points(*q), m[None])[0]
        for q, m in zip([(src, dst), (dst, src)], middle, strict=True)
    ]
    np.testing.assert_allclose(moved, expected, atol=1e-6)
    twin = kornia.geometry.get_perspective_transform(torch.from_numpy(src[None]), torch.from_numpy(dst[None]))
    np.testing.assert_allclose(apply_homography(twin[0].numpy(), middle[:1]), moved[:1], atol=1e-4)


def test_projection_is_the_cameras(part: Part, pairs: MotionPairs) -> None:
    found = project(
        torch.tensor(part.vertices), torch.from_numpy(pairs.before_T_obj), torch.from_numpy(pairs.camera_matrices)
    )
    for pixels, pose, matrix in zip(found, pairs.before_T_obj, pairs.camera_matrices, strict=True):
        camera = Camera.from_matrix(matrix, 128, 128)
        np.testing.assert_allclose(pixels.numpy(), camera.project(transform(pose, part.vertices)), atol=1e-9)


@given(seed=st.integers(0, 1000))
def test_look_up_is_bilinear(seed: int) -> None:
    rng = np.random.default_rng(seed)
    maps = rng.uniform(0.0, 9.0, (3, 7, 9)).astype(np.float32)
    view = rng.integers(0, 3, 40)
    points = rng.uniform(-2.0, 11.0, (40, 2))
    found = look_up(torch.from_numpy(maps), torch.from_numpy(view), torch.from_numpy(points)).numpy()
    places = np.stack([view, points[:, 1], points[:, 0]]).astype(np.float64)
    expected = map_coordinates(maps.astype(np.float64), places, order=1, mode="nearest")
    np.testing.assert_allclose(found, expected, atol=1e-9)


def test_the_loss_is_eq_10_written_out(part: Part, pairs: MotionPairs) -> None:
    w = mid_section_points(part.box_min, part.box_max, 2)
    total = 0.0
    for view in range(len(pairs)):
        camera = Camera.from_matrix(pairs.camera_matrices[view], 128, 128)
        quads = [camera.project(transform(pose[view], w)) for pose in (pairs.before_T_obj, pairs.after_T_obj)]
        moved = apply_homography(homography_from_points(*quads), pairs.points[pairs.view_of_point == view])
        distances = map_coordinates(pairs.distances[view].astype(np.float64), moved.T[::-1], order=1, mode="nearest")
        total += np.sqrt((distances**2).sum()) / 128**2
    assert EdgeLoss(pairs)(torch.from_numpy(w)).item() == pytest.approx(total / len(pairs), rel=1e-9)


def test_points_moved_as_the_part_moves_are_nearly_free_of_loss(part: Part, pairs: MotionPairs) -> None:
    loss = EdgeLoss(pairs)
    w = torch.from_numpy(mid_section_points(part.box_min, part.box_max, 2))
    assert loss.exact_distances().mean() < 0.5
    assert loss.exact_distances().mean() < loss.distances(w).mean()


def test_the_loss_does_not_depend_on_where_the_points_lie_in_their_plane(part: Part, pairs: MotionPairs) -> None:
    """A rigid motion moves a plane's image by one homography, whichever four of its points tell it."""
    loss, form = EdgeLoss(pairs), PlanePoints.of(part, ALL_REGIONS[4], "printed")
    rng = np.random.default_rng(5)
    plane = torch.tensor([0.2, 0.15, -0.1], dtype=torch.float64)
    values = [
        loss(form.points_obj(torch.cat([plane, torch.from_numpy(rng.uniform(-0.25, 0.25, 8))]))).item()
        for _ in range(4)
    ]
    np.testing.assert_allclose(values, values[0], rtol=1e-8)
    elsewhere = loss(form.points_obj(torch.cat([plane + 0.05, torch.zeros(8, dtype=torch.float64)]))).item()
    assert abs(elsewhere / values[0] - 1.0) > 1e-4


@pytest.mark.parametrize("form", ["plane", "printed"])
def test_its_gradient_is_that_of_finite_differences(form: Form, part: Part, pairs: MotionPairs) -> None:
    loss, points = EdgeLoss(pairs), PlanePoints.of(part, ALL_REGIONS[4], form)
    start = points.zero()
    start[:3] = torch.tensor([0.21, 0.08, -0.13])
    parameters = start.clone().requires_grad_()
    loss(points.points_obj(parameters)).backward()
    assert parameters.grad is not None
    step = 1e-7  # bilinear maps have kinks between pixels: stay on this side of them
    for k in range(len(start)):
        ahead, behind = start.clone(), start.clone()
        ahead[k] += step
        behind[k] -= step
        difference = (loss(points.points_obj(ahead)) - loss(points.points_obj(behind))).item() / (2.0 * step)
        assert parameters.grad[k].item() == pytest.approx(difference, rel=1e-4, abs=1e-8)
    # Along the plane itself there is nothing to gain.
    assert parameters.grad[3:].abs().sum() < 1e-9 < parameters.grad[:3].abs().min()
