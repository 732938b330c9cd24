"""Ordering: nothing is lost, neighbours are near, and a shuffled turn comes back in order."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from acp_lab.geometry.camera import Camera
from acp_lab.geometry.pose import make_pose, so3_exp
from data_recipes.tracks import Track, View, box_corners, longer_than, motion, ordered, picture_steps

CAMERA = Camera(640, 512, 900.0, 900.0, 320.0, 256.0)
TILT = so3_exp(np.array([0.3, 0.0, 0.0]))
CORNERS = box_corners(np.array([[-30.0, -20.0, -10.0], [30.0, 20.0, 10.0]]))


def _view(number: int, angle: float, x: float = 0.0, z: float = 400.0) -> View:
    rotation = TILT @ so3_exp(np.array([0.0, angle, 0.0]))
    return View(number, Path(f"{number}.png"), CAMERA, make_pose(rotation, np.array([x, 0.0, z])))


def _track(views: list[View]) -> Track:
    return Track("scene 1", 1, tuple(views))


def test_corners_of_the_box() -> None:
    assert len(np.unique(CORNERS, axis=0)) == 8
    np.testing.assert_array_equal(np.abs(CORNERS), np.tile([30.0, 20.0, 10.0], (8, 1)))


def test_a_shuffled_turn_comes_back_in_order(rng: np.random.Generator) -> None:
    views = [_view(i, 0.05 * i) for i in range(20)]
    shuffled = [views[0], *[views[i] for i in 1 + rng.permutation(19)]]
    (found,) = ordered(_track(shuffled), CORNERS, 60.0, 15.0)
    assert [view.image.stem for view in found.views] == [str(i) for i in range(20)]
    assert [view.number for view in found.views] == list(range(20))


def test_a_gap_cuts_the_track() -> None:
    views = [_view(i, 0.05 * i + (1.0 if i >= 6 else 0.0)) for i in range(10)]
    found = ordered(_track(views), CORNERS, 20.0, 180.0)
    assert [len(track.views) for track in found] == [6, 4]
    assert {track.source for track in found} == {"scene 1"}
    kept, left_out = longer_than(found, 5)
    assert ([len(track.views) for track in kept], left_out) == ([6], 4)


def test_a_turn_cuts_where_pixels_would_not() -> None:
    views = [_view(i, 0.1 * i + (0.5 if i >= 3 else 0.0), z=4000.0) for i in range(6)]
    assert [len(track.views) for track in ordered(_track(views), CORNERS, 60.0, 180.0)] == [6]
    assert [len(track.views) for track in ordered(_track(views), CORNERS, 60.0, 15.0)] == [3, 3]


def test_a_view_behind_the_camera_stays_alone() -> None:
    views = [_view(0, 0.0), _view(1, 0.01, z=-400.0), _view(2, 0.02)]
    found = ordered(_track(views), CORNERS, 1000.0, 180.0)
    assert sorted(tuple(view.image.stem for view in track.views) for track in found) == [("0", "2"), ("1",)]


@given(
    st.lists(st.tuples(st.floats(-1.5, 1.5), st.floats(-60.0, 60.0)), min_size=1, max_size=25),
    st.floats(5.0, 200.0),
    st.floats(1.0, 180.0),
)
def test_nothing_is_lost_and_no_step_is_too_long(
    places: list[tuple[float, float]], max_px: float, max_deg: float
) -> None:
    views = [_view(i, angle, x) for i, (angle, x) in enumerate(places)]
    found = ordered(_track(views), CORNERS, max_px, max_deg)
    names = [view.image.stem for track in found for view in track.views]
    assert sorted(names) == sorted(str(i) for i in range(len(places)))
    assert found[0].views[0].image.stem == "0"
    for track in found:
        assert (picture_steps(track.views, CORNERS) <= max_px).all()
        said = motion(track.views, CORNERS)["rot_deg_max"]
        assert isinstance(said, float)
        assert said <= max_deg + 0.01


def test_motion_is_what_a_tracker_must_follow() -> None:
    views = [_view(i, np.deg2rad(2.0 * i)) for i in range(4)]
    said = motion(views, CORNERS)
    assert (said["frames"], said["rot_deg_mean"], said["rot_deg_max"]) == (4, 2.0, 2.0)
    assert said["step_px_mean"] == pytest.approx(picture_steps(views, CORNERS).mean(), abs=0.01)
    assert motion(views[:1], CORNERS)["step_px_max"] == 0.0
    behind = [*views, _view(4, np.deg2rad(8.0), z=-400.0)]
    assert motion(behind, CORNERS)["step_px_mean"] == said["step_px_mean"]  # a number, as JSON knows no other


def test_a_shift_counts_in_pixels_whatever_the_intrinsics_of_each_image() -> None:
    first = _view(0, 0.0)
    moved = replace(first, camera=replace(CAMERA, cx=CAMERA.cx + 12.0))
    np.testing.assert_allclose(picture_steps([first, moved], CORNERS), [12.0])
