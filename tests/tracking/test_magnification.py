"""Small parts magnified, large ones made smaller: how much, whose px results are in, and what it gains."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from acp_lab.cad.part import Part
from acp_lab.errors import TrackingError
from acp_lab.evaluation.part_metric import PartMetric
from acp_lab.generator.base import GeneratedEdges
from acp_lab.geometry.pose import transform
from acp_lab.geometry.pose_step import move_pose
from acp_lab.prepared_part import PreparedPart
from acp_lab.sequences.frame import Frame
from acp_lab.tracking.frame_solver import FrameSolver
from acp_lab.tracking.learning.knowledge import Off
from acp_lab.tracking.magnification import Magnification, MagnifyingGlass
from acp_lab.tracking.method import ACP, METHODS
from acp_lab.tracking.result import TargetView, TrackResult, TrackStep
from acp_lab.tracking.tracker import Tracker
from benchmarks.part_sizes import scaled
from tests.made_parts import looking_at
from tests.prepared_sample import sample_model, sample_scene
from tests.tracking.rendered import AS_DRAWN, CAMERA, MadeSequence, draw, poses

CONFIG = Magnification()
MAGNIFIED = replace(AS_DRAWN, magnification=CONFIG)


def glass(times: float) -> MagnifyingGlass:
    found = MagnifyingGlass(CONFIG)
    found.times = times
    return found


def first_glass(size_px: float) -> MagnifyingGlass:
    """The one for a part that is first seen `size_px` long."""
    found = MagnifyingGlass(CONFIG)
    found.choose(size_px)
    return found


@given(st.floats(1.0, 2000.0))
def test_a_small_part_appears_as_long_as_wanted_as_far_as_the_most_allows(size_px: float) -> None:
    times = CONFIG.times(size_px)
    assert 1 <= times <= CONFIG.most
    if size_px >= CONFIG.below_px:
        assert times == 1
    elif times < CONFIG.most:
        assert CONFIG.wanted_px <= times * size_px < CONFIG.wanted_px + size_px
    else:
        assert (times - 1) * size_px < CONFIG.wanted_px


def test_a_glass_is_kept_while_it_serves() -> None:
    """What is remembered of a part's edges is of one size, so a part that comes and goes keeps its glass."""
    used = MagnifyingGlass(CONFIG)
    seen = []
    for size_px in (130.0, 110.0, 95.0, 89.0, 110.0, 130.0, 160.0, 170.0, 130.0):
        used.choose(size_px)
        seen.append(used.times)
    assert seen == [1, 1, 1, 2, 2, 2, 2, 1, 1]
    used.put_away()
    used.choose(110.0)
    assert used.times == 2, "a new track chooses anew"
    without = MagnifyingGlass(None)
    without.choose(10.0)
    assert without.times == 1


@given(st.floats(1.0, 6000.0))
def test_a_large_part_is_made_about_as_long_as_it_should_be(size_px: float) -> None:
    used = first_glass(size_px)
    if size_px <= CONFIG.above_px:
        assert CONFIG.times_smaller(size_px) == 1
    else:
        assert used.times == 1.0 / CONFIG.times_smaller(size_px)
        assert 0.8 * CONFIG.large_px < used.times * size_px < 1.26 * CONFIG.large_px


def test_a_part_all_around_the_camera_is_not_made_smaller_without_end() -> None:
    assert CONFIG.times_smaller(float("inf")) == 32


def test_a_large_part_changes_its_size_only_when_it_fits_no_longer() -> None:
    used, seen = MagnifyingGlass(CONFIG), []
    for size_px in (340.0, 400.0, 470.0, 500.0, 600.0, 300.0, 260.0, 400.0, 1000.0, 500.0, 100.0, 80.0, 1500.0):
        used.choose(size_px)
        seen.append(used.times)
    assert seen == pytest.approx([1, 1, 1, 0.5, 0.5, 0.5, 1, 1, 0.2, 0.5, 2, 2, 1 / 7])


@pytest.mark.parametrize("times", [2, 3, 4])
def test_px_of_the_smaller_image_are_px_of_the_frame_again(times: int, rng: np.random.Generator) -> None:
    used, points_cam = glass(1.0 / times), rng.uniform((-40, -30, 250), (40, 30, 350), (50, 3))
    camera = replace(CAMERA, width=CAMERA.width + 3, height=CAMERA.height + 1)  # what is left at the end is left out
    small = used.camera(camera)
    assert (small.width, small.height) == (camera.width // times, camera.height // times)
    seen, smaller = camera.project(points_cam), small.project(points_cam)
    np.testing.assert_allclose(used.points(smaller), seen, atol=1e-9)
    np.testing.assert_allclose(used.lengths(smaller[:, 0] - smaller[0, 0]), seen[:, 0] - seen[0, 0], atol=1e-9)
    target = used.target(TargetView(smaller, (20, 10), (9, 6)))
    assert (target.origin, target.size) == ((20 * times, 10 * times), (9 * times, 6 * times))


@pytest.mark.parametrize("times", [2, 3, 4, 6])
@pytest.mark.parametrize("with_rest", [False, True])
def test_a_pixel_of_the_smaller_image_is_the_mean_of_what_it_covers(
    times: int, with_rest: bool, rng: np.random.Generator
) -> None:
    beside = times - 1 if with_rest else 0
    image = rng.integers(0, 256, (40 * times + beside, 60 * times + beside, 3)).astype(np.uint8)
    blocks = image[: 40 * times, : 60 * times].reshape(40, times, 60, times, 3).mean((1, 3))
    small = glass(1.0 / times).image(image, (10, 5, 30, 25))
    assert small.shape == (40, 60, 3)
    np.testing.assert_allclose(small[5:25, 10:30], blocks[5:25, 10:30], atol=1.01)  # each step rounds
    small[5:25, 10:30] = 0
    assert not small.any(), "elsewhere nothing is drawn"
    np.testing.assert_allclose(glass(1.0 / times).image(image, (-9, -9, 999, 999)), blocks, atol=1.01)
    for outside in ((-90, -90, -50, -50), (60, 0, 90, 40), (0, 90, 60, 99)):
        assert not glass(1.0 / times).image(image, outside).any()


@pytest.mark.parametrize("times", [1, 2, 3])
def test_px_of_the_magnified_image_are_px_of_the_frame_again(times: int, rng: np.random.Generator) -> None:
    used, points_cam = glass(times), rng.uniform((-40, -30, 250), (40, 30, 350), (50, 3))
    seen, large = CAMERA.project(points_cam), used.camera(CAMERA).project(points_cam)
    np.testing.assert_allclose(used.points(large), seen, atol=1e-9)
    np.testing.assert_allclose(
        used.lengths(np.linalg.norm(large - large[0], axis=1)), np.linalg.norm(seen - seen[0], axis=1)
    )
    edges = GeneratedEdges(large, np.zeros_like(large), np.ones(50), np.arange(50))
    np.testing.assert_allclose(used.edges(edges).points, seen, atol=1e-9)
    assert used.edges(edges).sample_ids is edges.sample_ids
    (step,) = used.steps((TrackStep(large[:4], np.eye(4), 0.5, 1),))
    np.testing.assert_allclose(step.control_points, seen[:4], atol=1e-9)
    target = used.target(TargetView(large, (20 * times, 10 * times), (90 * times, 60 * times)))
    np.testing.assert_allclose(target.edge_points, seen, atol=1e-9)
    assert (target.origin, target.size) == ((20, 10), (90, 60))
    # All px of the frame of which any part is in it.
    target = used.target(TargetView(large, (7, 7), (4, 4)))
    assert target.origin == (7 // times, 7 // times)
    assert target.size[0] == 10 // times - 7 // times + 1


@pytest.mark.parametrize("times", [2, 3, 4])
def test_the_magnified_image_shows_what_the_frame_shows_where_the_camera_says(times: int) -> None:
    """A straight slope of grey is what cubic interpolation keeps to the level."""
    slope = np.broadcast_to(20 + np.arange(CAMERA.width), (CAMERA.height, CAMERA.width))
    image = np.repeat(slope[..., None], 3, 2).astype(np.uint8)
    box = (30 * times, 20 * times, 90 * times, 70 * times)
    large = glass(times).image(image, box)
    assert large.shape == (times * CAMERA.height, times * CAMERA.width, 3)
    x0, y0, x1, y1 = box
    columns = glass(times).points(np.column_stack([np.arange(x0, x1), np.zeros(x1 - x0)]))[:, 0]
    np.testing.assert_allclose(large[(y0 + y1) // 2, x0:x1, 0], 20 + columns, atol=0.51)
    assert (large[y0:y1, x0:x1] > 0).all()
    assert not large[: y0 - 4 * times].any(), "elsewhere nothing is drawn"
    # Beyond the image there is nothing to draw.
    assert not glass(times).image(image, (-90, -90, -50, -50)).any()


@pytest.mark.parametrize(
    ("config", "words"),
    [
        ({"below_px": 200.0}, "below_px = 200, "),
        ({"below_px": float("nan")}, "below_px = nan, "),
        ({"wanted_px": 1e5}, "below_px = 120, wanted_px = 100000"),
        ({"most": 0}, "most = 0"),
        ({"most": 100}, "most = 100"),
        ({"most": 2.5}, "most = 2.5"),
        ({"above_px": 300.0}, "large_px = 210, above_px = 300: give px"),
        ({"large_px": 250.0}, "large_px = 250, above_px = 360: give px"),
        ({"large_px": 20.0}, "large_px = 20, above_px = 360: give px"),
        ({"above_px": float("nan")}, "large_px = 210, above_px = nan"),
        ({"above_px": float("inf")}, "large_px = 210, above_px = inf"),
    ],
)
def test_settings_that_magnify_nothing_are_refused(config: dict[str, float], words: str) -> None:
    with pytest.raises(TrackingError, match=f"magnification.{words}"):
        Magnification(**config)  # type: ignore[arg-type]


def test_a_part_is_magnified_or_made_smaller_and_not_both() -> None:
    config = Magnification(below_px=500.0, wanted_px=600.0)
    assert (config.times(400.0), config.times_smaller(400.0)) == (2, 1)
    assert (config.times(700.0), config.times_smaller(700.0)) == (1, 3)


def test_the_papers_path_takes_frames_as_they_are() -> None:
    magnifies = {name for name, method in METHODS.items() if not isinstance(method.magnification, Off)}
    assert magnifies == {"acp", "acp-edges"}


# ---- tracking --------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def small(part: Part) -> MadeSequence:
    """Half as large as the bracket of the other tests, about 60 px."""
    truth = poses(part, looking_at(part, np.array([0.8, 0.6, 1.0]), 480.0, 0.3), 12)
    return MadeSequence([draw([(part, pose)], seed) for seed, pose in enumerate(truth)], {1: truth})


def test_a_small_part_of_metal_is_nearer_through_a_glass() -> None:
    """Its neighbouring edges are within each other's reach, which those of a drawn bracket on plain ground are not."""
    scene, model = sample_scene(), sample_model()
    metric, errors = PartMetric(model.part), {}
    for method in (ACP, replace(ACP, magnification=Off())):
        tracker, found = Tracker(model, method), []
        for number, frame in enumerate(scene.frames(8)):
            assert isinstance(frame, Frame)
            truth = scene.truth(frame.index, 1)
            assert truth is not None
            small = scaled(frame, 0.25)  # about 55 px
            result = tracker.track(small) if number else tracker.start(small, truth)
            found.append(metric.share(result.cam_T_obj, truth))
        errors[tracker.solver.glass.times] = found
    assert sorted(errors) == [1, 3]
    assert max(errors[3]) < 0.01
    assert np.median(errors[3]) < 0.5 * np.median(errors[1])


def test_a_large_part_of_metal_is_nearer_from_farther_away() -> None:
    """It leaves the reach of a search from frame to frame, and its edges are blurred over more px than that expects."""
    scene, model = sample_scene(), sample_model()
    metric, errors = PartMetric(model.part), {}
    for method in (ACP, replace(ACP, magnification=Off())):
        tracker, found = Tracker(model, method), []
        for number in range(0, 24, 4):
            frame, truth = scene.frame(number), scene.truth(number, 1)
            assert isinstance(frame, Frame)
            assert truth is not None
            large = scaled(frame, 4.0)  # about 880 px
            result = tracker.track(large) if number else tracker.start(large, truth)
            found.append(metric.share(result.cam_T_obj, truth))
        errors[tracker.solver.glass.times] = found
    assert sorted(errors) == [0.25, 1]
    assert max(errors[0.25]) < 0.006
    assert np.median(errors[0.25]) < 0.6 * np.median(errors[1])


def test_results_of_a_large_part_are_in_px_of_the_frame() -> None:
    scene, model = sample_scene(), sample_model()
    tracker, truth = Tracker(model), scene.truth(0, 1)
    tracker.records_target = True
    assert truth is not None
    frames = [scaled(frame, 3.0) for frame in scene.frames(2) if isinstance(frame, Frame)]
    tracker.start(frames[0], truth)
    result = tracker.track(frames[1])
    assert tracker.solver.glass.times == pytest.approx(1.0 / 3.0)
    camera, points_obj = frames[1].camera, tracker.control_points_obj[result.region]
    at = camera.project(transform(result.cam_T_obj, points_obj))
    np.testing.assert_allclose(result.control_points, at, atol=1e-6)
    assert result.edges is not None
    assert result.residuals_px is not None
    assert result.target is not None
    samples = model.edges.points_obj[result.edges.sample_ids]
    np.testing.assert_allclose(result.edges.points, camera.project(transform(result.cam_T_obj, samples)), atol=1e-6)
    (x, y), (width, height) = result.target.origin, result.target.size
    inside = (result.edges.points > (x, y)) & (result.edges.points < (x + width, y + height))
    assert inside.all()
    found = np.isfinite(result.residuals_px)
    there = result.edges.points + result.residuals_px[:, None] * result.edges.normals
    nearest = np.linalg.norm(there[found][:, None] - result.target.edge_points[None], axis=2).min(1)
    assert np.median(nearest) < 2.0


def test_results_are_in_px_of_the_frame(model: PreparedPart, small: MadeSequence) -> None:
    tracker = Tracker(model, MAGNIFIED)
    tracker.records_steps = tracker.records_target = True
    results: list[TrackResult] = []
    for number, frame in enumerate(small.frames(3)):
        assert isinstance(frame, Frame)
        results.append(tracker.track(frame) if number else tracker.start(frame, small.first_pose))
    assert tracker.solver.glass.times > 1
    for result in results:
        points_obj = tracker.control_points_obj[result.region]
        np.testing.assert_allclose(
            result.control_points, CAMERA.project(transform(result.cam_T_obj, points_obj)), atol=1e-6
        )
        assert result.edges is not None
        assert result.residuals_px is not None
        assert result.target is not None
        samples = model.edges.points_obj[result.edges.sample_ids]
        np.testing.assert_allclose(result.edges.points, CAMERA.project(transform(result.cam_T_obj, samples)), atol=1e-6)
        # Where the image edge was found, in the frame: near the point, by what is left along its normal.
        found = np.isfinite(result.residuals_px)
        assert found.mean() > 0.5
        there = result.edges.points + result.residuals_px[:, None] * result.edges.normals
        nearest = np.linalg.norm(there[found][:, None] - result.target.edge_points[None], axis=2).min(1)
        assert np.median(nearest) < 0.7
        (x, y), (width, height) = result.target.origin, result.target.size
        inside = (result.target.edge_points >= (x - 1, y - 1)) & (result.target.edge_points <= (x + width, y + height))
        assert inside.all()
    last = results[-1]
    assert last.steps
    np.testing.assert_allclose(last.steps[-1].control_points, last.control_points, atol=0.5)


def test_a_small_part_far_from_the_corner_of_a_large_image_is_seen(model: PreparedPart, small: MadeSequence) -> None:
    """Its enlarged image is more than ten thousand px wide."""
    (frame,) = small.frames(1)
    assert isinstance(frame, Frame)
    height, width = frame.image.shape[:2]
    image = np.full((2900, 3300, 3), 45, np.uint8)
    image[2700 : 2700 + height, 3050 : 3050 + width] = frame.image
    camera = replace(CAMERA, width=3300, height=2900, cx=CAMERA.cx + 3050, cy=CAMERA.cy + 2700)
    tracker = Tracker(model, MAGNIFIED)
    assert tracker.start(Frame(0, image, camera), small.first_pose).quality > 0.9
    assert tracker.solver.glass.times >= 3


def test_a_small_part_is_looked_for_as_far_out_as_without_a_glass(part: Part, model: PreparedPart) -> None:
    """Up to the margin beyond the border: it may come back."""
    start = looking_at(part, np.array([0.8, 0.6, 1.0]), 480.0, 0.3)
    seen = {}
    for method in (AS_DRAWN, MAGNIFIED):
        solver = FrameSolver(model, method)
        solver.magnify(CAMERA, start)
        image = np.full((CAMERA.height, CAMERA.width, 3), 45, np.uint8)
        poses_mm = [
            move_pose(start, part.box_centre, np.array([0, 0, 0, x, 0, 0])) for x in np.arange(100.0, 320.0, 3.0)
        ]
        seen[method.magnification.kind] = [
            solver.look(image, CAMERA, pose, solver.choose_region(pose)) is not None for pose in poses_mm
        ]
    assert 0 < sum(seen["off"]) < len(seen["off"])
    # The margin is one of px of the enlarged image.
    assert sum(seen["cubic"]) >= 0.7 * sum(seen["off"])
    assert not any(there for there, plain in zip(seen["cubic"], seen["off"], strict=True) if not plain)


def test_looking_is_in_px_of_the_frame(model: PreparedPart, small: MadeSequence) -> None:
    tracker = Tracker(model, MAGNIFIED)
    (frame,) = small.frames(1)
    assert isinstance(frame, Frame)
    tracker.start(frame, small.first_pose)
    seen = tracker.look(frame, small.first_pose)
    assert seen is not None
    assert seen.view.camera == CAMERA
    assert tracker.solver.glass.times > 1, "and the tracker keeps its glass"
