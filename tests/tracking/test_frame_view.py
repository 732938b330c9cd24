"""Estimates in a view, where pose and control points follow each other, and the box that is looked at."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from acp_lab.cad.part import Part, box_corners
from acp_lab.control_points.canonical_frame import CANONICAL_SIZE
from acp_lab.errors import GeometryError
from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.homography import apply_homography
from acp_lab.geometry.planar_pnp import solve_planar_pnp
from acp_lab.geometry.pose import transform
from acp_lab.geometry.pose_step import move_pose
from acp_lab.tracking.frame_view import LEAST_PART_PX, View, crop_box
from tests.made_parts import looking_at
from tests.tracking.rendered import CAMERA
from tests.tracking.views import prior_of, view_at


@pytest.fixture
def view(part: Part) -> View:
    return view_at(part, looking_at(part, np.array([0.8, 0.6, 1.0]), 330.0, 0.3))


# ---- estimates -----------------------------------------------------------------------------------------------


def test_a_pose_shows_its_control_points_where_they_project(view: View) -> None:
    estimate = prior_of(view)
    assert estimate.cam_T_obj is view.prior, "a given pose needs no PnP"
    np.testing.assert_array_equal(estimate.control_points, CAMERA.project(transform(view.prior, view.points_obj)))


def test_control_points_have_the_pose_of_planar_pnp(view: View) -> None:
    pose = move_pose(view.prior, view.part.box_centre, np.array([0.03, -0.02, 0.04, 1.0, -0.5, 3.0]))
    points = view.at_pose(pose).control_points
    estimate = view.at_points(points)
    assert estimate.control_points is points
    np.testing.assert_allclose(estimate.cam_T_obj, pose, atol=1e-5)
    # A free I is no projection of W; its pose is PnP's answer to it, not the one it was moved from.
    bent = points + np.array([[1.0, 0.0], [0.0, 0.5], [-0.5, 0.0], [0.0, 0.0]])
    found = solve_planar_pnp(view.points_obj, bent, CAMERA)
    np.testing.assert_array_equal(view.at_points(bent).cam_T_obj, found.nearest(view.prior))


def test_control_points_that_moved_a_little_have_the_pose_next_to_the_one_before(view: View) -> None:
    points = prior_of(view).control_points
    bent = points + np.array([[1.0, 0.0], [0.0, 0.5], [-0.5, 0.0], [0.0, 0.0]])
    poses = solve_planar_pnp(view.points_obj, points, CAMERA).poses
    for pose, goes_over_into in zip(poses, solve_planar_pnp(view.points_obj, bent, CAMERA).poses, strict=True):
        found = view.at_points(bent, near=pose).cam_T_obj
        np.testing.assert_allclose(found, goes_over_into, atol=1e-3)
    # From where no way leads, the answer is that of the search from nothing.
    away = move_pose(view.prior, view.part.box_centre, np.array([0.0, 0, 0, 0, 0, -900.0]))
    np.testing.assert_array_equal(view.at_points(bent, near=away).cam_T_obj, view.at_points(bent).cam_T_obj)
    flat = np.column_stack([points[:, 0], np.full(4, 50.0)])
    with pytest.raises(GeometryError):
        _ = view.at_points(flat, near=view.prior).cam_T_obj


def test_of_two_poses_the_one_nearer_to_the_prior_is_taken(view: View) -> None:
    points = prior_of(view).control_points
    poses = solve_planar_pnp(view.points_obj, points, CAMERA).poses
    assert len(poses) == 2
    for pose in poses:
        found = replace(view, prior=pose).at_points(points).cam_T_obj
        np.testing.assert_allclose(found, pose, atol=1e-4)


def test_degenerate_control_points_have_no_pose(view: View) -> None:
    flat = np.column_stack([prior_of(view).control_points[:, 0], np.full(4, 50.0)])
    with pytest.raises(GeometryError):
        _ = view.at_points(flat).cam_T_obj


def test_what_is_possible(view: View, part: Part) -> None:
    assert prior_of(view).is_possible
    behind = move_pose(view.prior, part.box_centre, np.array([0.0, 0, 0, 0, 0, -900.0]))
    assert behind[2, 3] < view.prior[2, 3] < 1000.0
    assert not view.at_pose(behind).is_possible
    assert not view.at_pose(view.prior * np.nan).is_possible
    assert view.at_points(np.zeros((4, 2))).is_possible
    assert not view.at_points(np.full((4, 2), np.inf)).is_possible


def test_the_canonical_frame_is_that_of_the_prior(view: View) -> None:
    drawn = view.canonical.project(view.points_obj)
    np.testing.assert_allclose(
        apply_homography(view.image_H_canonical, drawn), prior_of(view).control_points, atol=1e-6
    )
    np.testing.assert_allclose(view.canonical_H_image @ view.image_H_canonical, np.eye(3), atol=1e-9)
    assert view.canonical_size == CANONICAL_SIZE
    half = replace(view, canonical_size=CANONICAL_SIZE // 2)
    middle = half.canonical.project(view.part.box_centre[None])[0]
    np.testing.assert_allclose(middle, CANONICAL_SIZE / 4 - 0.5, atol=0.5)


# ---- the box -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "shift",
    [(0.0, 0.0, -330.0), (0.0, 0.0, -900.0), (400.0, 0.0, 0.0), (0.0, -400.0, 0.0), (np.nan, 0.0, 0.0)],
    ids=["in the camera", "behind", "right of the image", "above it", "nowhere"],
)
def test_no_box_where_the_part_is_not_in_view(view: View, part: Part, shift: tuple[float, float, float]) -> None:
    pose = move_pose(view.prior, part.box_centre, np.array([0.0, 0.0, 0.0, *shift]))
    assert crop_box(box_corners(part), pose, CAMERA, 32.0) is None


def test_the_box_holds_the_part_and_a_margin(view: View, part: Part) -> None:
    box = crop_box(box_corners(part), view.prior, CAMERA, 12.0)
    assert box is not None
    shown = CAMERA.project(transform(view.prior, box_corners(part)))
    np.testing.assert_allclose(box[:2], shown.min(0) - 12.0, atol=1.0)
    np.testing.assert_allclose(box[2:], shown.max(0) + 12.0, atol=1.0)
    assert (box_corners(part).min(0) == part.box_min).all()
    assert (box_corners(part).max(0) == part.box_max).all()


def test_a_part_much_larger_than_the_image_still_has_a_box(view: View, part: Part) -> None:
    close = replace(CAMERA, fx=90_000.0, fy=90_000.0)
    box = crop_box(box_corners(part), view.prior, close, 32.0)
    assert box is not None
    assert box[0] < 0 < CAMERA.width < box[2]
    assert max(abs(value) for value in box) <= 10_001


def test_the_box_of_many_points_is_that_of_their_projections(view: View) -> None:
    rng = np.random.default_rng(2)
    for _ in range(20):
        points = view.part.box_centre + rng.normal(0.0, 20.0, (30, 3))
        pose = move_pose(view.prior, view.part.box_centre, rng.normal(0.0, 0.5, 6))
        shown = CAMERA.project(transform(pose, points))
        low, high = shown.min(0) - 7.0, shown.max(0) + 7.0
        expected = (*low.astype(int).tolist(), *(high.astype(int) + 1).tolist())
        assert crop_box(points, pose, CAMERA, 7.0) == expected


@pytest.mark.parametrize("overlap_px", [6.0, 10.0])
def test_a_sliver_of_image_shows_nothing_of_the_part(part: Part, overlap_px: float) -> None:
    def boxed(pose: FloatArray) -> FloatArray:
        return CAMERA.project(transform(pose, box_corners(part)))

    pose = looking_at(part, np.array([0.0, 0.0, 1.0]), 330.0)
    step = np.zeros(6)
    for _ in range(20):  # so far right that the box overlaps the image by so much
        gap_px = (CAMERA.width - overlap_px) - boxed(pose).min(0)[0]
        step[3] = gap_px * 330.0 / CAMERA.fx
        pose = move_pose(pose, part.box_centre, step)
    assert (crop_box(box_corners(part), pose, CAMERA, 0.0) is None) == (overlap_px < 8.0)


def test_no_box_of_a_part_that_is_too_small_to_be_tracked(view: View, part: Part) -> None:
    extent_px = np.ptp(CAMERA.project(transform(view.prior, box_corners(part))), axis=0).max()
    for share, is_seen in ((1.1, True), (0.9, False)):
        camera = replace(
            CAMERA, fx=CAMERA.fx * share * LEAST_PART_PX / extent_px, fy=CAMERA.fy * share * LEAST_PART_PX / extent_px
        )
        assert (crop_box(box_corners(part), view.prior, camera, 32.0) is not None) == is_seen
