"""The tracker on small drawn sequences, and on everything that can go wrong in one."""

from __future__ import annotations

import time
from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import cv2
import numpy as np
import pytest

from acp_lab.cad.part import Part
from acp_lab.control_points.canonical_frame import eye_position
from acp_lab.control_points.coplanar_points import mid_section_points
from acp_lab.control_points.view_regions import ALL_REGIONS, choose_region
from acp_lab.errors import GeometryError, PreparationError, SequenceError, TrackingError
from acp_lab.generator.visibility import RegionNetwork
from acp_lab.geometry.arrays import ByteImage, FloatArray
from acp_lab.geometry.camera import Camera
from acp_lab.geometry.in_image import in_image
from acp_lab.geometry.planar_pnp import solve_planar_pnp
from acp_lab.geometry.pose import check_rotation, make_pose, rotation_angle_deg, transform
from acp_lab.geometry.pose_step import move_pose
from acp_lab.prepared_part import PreparedPart, Trained
from acp_lab.prepared_part.trained import RegionReport
from acp_lab.sequences.frame import Frame, UnreadableFrame
from acp_lab.tracking import way_back
from acp_lab.tracking.find import Finder
from acp_lab.tracking.first_frame import FirstFrame
from acp_lab.tracking.frame_solver import FrameSolver
from acp_lab.tracking.frame_view import Estimate
from acp_lab.tracking.learning.contour_offsets import ContourOffsets
from acp_lab.tracking.learning.knowledge import Off, SampleLearning
from acp_lab.tracking.method import ACP, ACP_EDGES, DIRECT_6DOF, METHODS, Method
from acp_lab.tracking.motions import ControlPointVariables
from acp_lab.tracking.picture import Picture, PictureSearch
from acp_lab.tracking.prediction import ConstantVelocityPrediction
from acp_lab.tracking.pursuit import Pursuit
from acp_lab.tracking.result import TrackResult, TrackState
from acp_lab.tracking.schedule import Level
from acp_lab.tracking.session import PartTracker, track_sequence
from acp_lab.tracking.solution import SeenFrame, Solution
from acp_lab.tracking.sources.painted import PaintedSamples
from acp_lab.tracking.sources.rigid import CadSamples
from acp_lab.tracking.stopwatch import Stopwatch
from acp_lab.tracking.targets.normals import NormalSearch
from acp_lab.tracking.tracker import Tracker
from tests.made_parts import box, looking_at
from tests.prepared_part.test_model import painted
from tests.tracking.lit_part import lit_part
from tests.tracking.rendered import AS_DRAWN, CAMERA, GAMMA, MadeSequence, add_percent, draw, poses, prepared

BY_MAP = replace(DIRECT_6DOF, name="by-map", source=CadSamples(), control_points="mid-section")


def errors_percent(part: Part, results: tuple[TrackResult, ...], truth: list[FloatArray]) -> list[float]:
    return [add_percent(part, result.cam_T_obj, pose) for result, pose in zip(results, truth, strict=True)]


def truth_of(sequence: MadeSequence) -> list[FloatArray]:
    return [sequence.truth(index, 1) for index in sequence.frame_ids]  # type: ignore[misc]


def images_of(sequence: MadeSequence) -> list[ByteImage]:
    return [frame.image for frame in sequence.frames()]  # type: ignore[union-attr]


def learned(model: PreparedPart, regions: Iterable[int], with_templates: bool = True) -> PreparedPart:
    """The part with visibility networks for some regions that call everything visible."""
    n = len(model.edges)
    zeros = [np.zeros(shape, np.float32) for shape in ((4, 8), (4,), (4, 4), (4,), (n, 4))]
    everything = RegionNetwork(*zeros, np.ones(n, np.float32), np.arange(n, dtype=np.int32))
    networks = Trained[RegionNetwork, RegionReport](dict.fromkeys(regions, everything))
    return replace(model, networks=networks, templates=model.templates if with_templates else None)


def assert_sound(result: TrackResult) -> None:
    """No NaN where a pose or a score is expected, whatever the frame showed."""
    assert np.isfinite(result.cam_T_obj).all()
    check_rotation(result.cam_T_obj[:3, :3], "result")
    np.testing.assert_array_equal(result.cam_T_obj[3], [0.0, 0.0, 0.0, 1.0])
    assert 0.0 <= result.quality <= 1.0
    assert 0 <= result.region <= 5
    assert result.timings.total_s > 0.0
    if result.edges is not None:
        assert np.isfinite(result.edges.points).all()
        assert np.isfinite(result.control_points).all()
        assert np.isfinite(result.loss)


# ---- following a part ----------------------------------------------------------------------------------------


def test_a_short_sequence_stays_below_two_per_cent(part: Part, model: PreparedPart, sequence: MadeSequence) -> None:
    tracker = Tracker(model, AS_DRAWN)
    run = tracker.run(sequence, sequence.first_pose)
    results = run.results[1]
    assert [result.frame_id for result in results] == list(sequence.frame_ids)
    assert max(errors_percent(part, results, truth_of(sequence))) < 2.0
    assert all(result.state is TrackState.TRACKING for result in results)
    assert all(result.quality > 0.6 for result in results)
    assert tracker.generator_name == "templates"
    for result in results:
        assert_sound(result)


def test_a_disturbed_start_is_corrected_on_the_way(part: Part, model: PreparedPart, sequence: MadeSequence) -> None:
    start = move_pose(sequence.first_pose, part.box_centre, np.array([0.03, 0.02, -0.03, 2.0, -1.0, 4.0]))
    results = Tracker(model, AS_DRAWN).run(sequence, start).results[1]
    assert max(errors_percent(part, results, truth_of(sequence))) < 2.0


def test_what_a_result_says_hangs_together(part: Part, model: PreparedPart, sequence: MadeSequence) -> None:
    for result in Tracker(model, AS_DRAWN).run(sequence, sequence.first_pose).results[1][:4]:
        w = mid_section_points(part.box_min, part.box_max, ALL_REGIONS[result.region].axis)
        np.testing.assert_allclose(result.control_points, CAMERA.project(transform(result.cam_T_obj, w)), atol=1e-9)
        # The pose comes back from the control points by planar PnP, as in the paper.
        back = solve_planar_pnp(w, result.control_points, CAMERA).nearest(result.cam_T_obj)
        assert add_percent(part, back, result.cam_T_obj) < 0.01
        assert result.edges is not None
        assert result.residuals_px is not None
        assert len(result.edges) == len(result.residuals_px)
        assert np.nanmedian(np.abs(result.residuals_px)) < 0.6
        points_obj = model.edges.points_obj[result.edges.sample_ids]
        np.testing.assert_allclose(
            result.edges.points, CAMERA.project(transform(result.cam_T_obj, points_obj)), atol=1e-9
        )
        stages = result.timings
        booked = stages.image_s + stages.generate_s + stages.search_s + stages.solve_s + stages.learn_s
        assert 0.0 < booked <= stages.total_s + 1e-3


def test_the_same_frames_give_the_same_numbers(model: PreparedPart, sequence: MadeSequence) -> None:
    start = move_pose(sequence.first_pose, model.part.box_centre, np.array([0.03, 0.02, -0.03, 2.0, -1.0, 4.0]))
    again = Tracker(model, AS_DRAWN)
    for tracker in (again, again):  # the second time after a session of its own: starting forgets
        first = Tracker(model, AS_DRAWN).run(sequence, start).results[1]
        second = tracker.run(sequence, start).results[1]
        for a, b in zip(first, second, strict=True):
            np.testing.assert_array_equal(a.cam_T_obj, b.cam_T_obj)
            np.testing.assert_array_equal(a.control_points, b.control_points)
            assert (a.quality, a.loss, a.state) == (b.quality, b.loss, b.state)


def test_the_region_follows_the_view(part: Part, model: PreparedPart) -> None:
    """Turning by 7 degrees a frame, the part shows another face of its box half way."""
    camera = Camera(300, 240, 530.0, 530.0, 149.5, 119.5)
    start = looking_at(part, np.array([1.0, 0.1, 0.3]), 330.0, 0.2)
    spin = np.zeros(6)
    spin[:3] = start[:3, :3] @ np.radians([0.0, 0.0, 7.0])
    truth = poses(part, start, 10, spin)
    tracker, results = Tracker(model, AS_DRAWN), []
    for index, pose in enumerate(truth):
        frame = Frame(index, draw([(part, pose)], index, camera), camera)
        results.append(tracker.track(frame) if index else tracker.start(frame, start))
    exact = []
    for pose in truth:
        exact.append(choose_region(eye_position(pose) - part.box_centre, 0.5 * part.box_size))
    regions = [result.region for result in results]
    assert regions[0] == exact[0]
    assert regions[-1] == exact[-1] != exact[0]
    assert sum(a != b for a, b in zip(regions, exact, strict=True)) <= 2  # hysteresis
    assert max(errors_percent(part, tuple(results), truth)) < 2.0


@pytest.mark.parametrize("seed", range(2))
def test_a_part_that_was_hidden_is_found_at_once(part: Part, model: PreparedPart, seed: int) -> None:
    """A patterned board hides it for five frames: what fits nothing there must not draw the tracker away."""
    start = looking_at(part, np.array([0.8, 0.6, 1.0]), 330.0, 0.3)
    truth = poses(part, start, 14, np.array([0.01, -0.012, 0.008, 0.5, -0.3, 0.4]))
    pattern = np.random.default_rng(seed).integers(40, 200, (20, 25)).astype(np.uint8)
    board = cv2.cvtColor(cv2.resize(pattern, (CAMERA.width, CAMERA.height)), cv2.COLOR_GRAY2RGB)
    tracker = Tracker(model, AS_DRAWN)
    results = []
    for index, pose in enumerate(truth):
        image = board.astype(np.uint8) if 6 <= index < 11 else draw([(part, pose)], index)
        frame = Frame(index, image, CAMERA)
        results.append(tracker.track(frame) if index else tracker.start(frame, pose))
    assert results[9].state is TrackState.LOST
    assert max(errors_percent(part, tuple(results[11:]), truth[11:])) < 2.0
    assert results[-1].state is TrackState.TRACKING


def test_a_part_that_stands_still_is_learnt_once(
    part: Part, model: PreparedPart, sequence: MadeSequence, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Else the offsets of its edges and its pose give way to each other, and both walk off."""
    image, start = images_of(sequence)[0], truth_of(sequence)[0]
    assert isinstance(ACP.learning, SampleLearning)
    learns_always = replace(ACP, learning=replace(ACP.learning, learn_from_px=0.0))
    follow = ContourOffsets.follow
    count = dict[str, int]()
    for name, method in (("news", ACP), ("all", learns_always)):
        lessons: list[ContourOffsets] = []
        monkeypatch.setattr(ContourOffsets, "follow", lambda *args, to=lessons: (to.append(args[0]), follow(*args)))
        tracker, noise = Tracker(model, method), np.random.default_rng(0)
        tracker.start(Frame(0, image, CAMERA), start)
        for k in range(1, 13):
            noisy = (image + noise.normal(0.0, 2.0, image.shape)).round().clip(0, 255).astype(np.uint8)
            result = tracker.track(Frame(k, noisy, CAMERA))
            assert add_percent(part, result.cam_T_obj, start) < 1.0
        count[name] = len(lessons)
    assert count["all"] >= 12
    assert count["news"] <= 3


def hovering(part: Part, share: float, count: int) -> list[FloatArray]:
    """Poses at the border between regions 4 (+z) and 0 (+x), a share on either side in turn, beginning in 4."""
    half = 0.5 * part.box_size
    leaning = [(1.0, 1.0 + share) if k % 2 == 0 else (1.0 + share, 1.0) for k in range(count)]
    return [looking_at(part, np.array([x, 0.3, z]) * half, 330.0, 0.2) for x, z in leaning]


@pytest.mark.parametrize("method", [ACP_EDGES, BY_MAP], ids=lambda method: method.name)
def test_a_part_that_hovers_at_a_border_keeps_its_region(part: Part, model: PreparedPart, method: Method) -> None:
    """By less than 15% another region leads: swapping W in every frame would gain nothing."""
    truth = hovering(part, 0.04, 6)
    tracker = Tracker(model, method)
    natural, regions = [], []
    for index, pose in enumerate(truth):
        frame = Frame(index, draw([(part, pose)], index), CAMERA)
        result = tracker.track(frame) if index else tracker.start(frame, pose)
        regions.append(result.region)
        natural.append(tracker.solver.natural_region(pose))
        assert add_percent(part, result.cam_T_obj, pose) < 7.0
    assert natural == [4, 0, 4, 0, 4, 0], "the test's own point is gone"
    assert regions == [4] * 6


def test_several_parts_side_by_side(part: Part, model: PreparedPart) -> None:
    other = box()
    camera_part = {3: part, 8: other}
    step = np.array([0.015, -0.02, 0.01, 0.4, -0.3, 0.8])
    left = move_pose(
        looking_at(part, np.array([0.8, 0.6, 1.0]), 400.0), part.box_centre, np.array([0, 0, 0, -45.0, 0, 0])
    )
    right = move_pose(looking_at(other, np.array([1.0, 0.7, 0.5]), 400.0), np.zeros(3), np.array([0, 0, 0, 55.0, 0, 0]))
    truth = {3: poses(part, left, 6, step), 8: poses(other, right, 6, step)}
    images = [draw([(part, truth[3][k]), (other, truth[8][k])], k) for k in range(6)]
    sequence = MadeSequence(list(images), truth)
    trackers = {3: Tracker(model, AS_DRAWN), 8: Tracker(prepared(other), AS_DRAWN)}
    run = track_sequence(trackers, sequence, sequence.first_poses)
    for object_id, found in run.results.items():
        # The box is 43 px wide: 3% of its diameter away is a tenth of a pixel in size.
        assert max(errors_percent(camera_part[object_id], found, truth[object_id])) < 3.0
    # Each is tracked as if it were alone.
    alone = Tracker(model, AS_DRAWN).run(MadeSequence(list(images), {3: truth[3]}), left).results[3]
    for a, b in zip(alone, run.results[3], strict=True):
        np.testing.assert_array_equal(a.cam_T_obj, b.cam_T_obj)


def test_which_of_several_objects_is_tracked_has_to_be_said(model: PreparedPart, sequence: MadeSequence) -> None:
    truth = truth_of(sequence)
    two = MadeSequence(list(images_of(sequence)), {3: truth, 8: truth})
    with pytest.raises(SequenceError, match="shows objects 3, 8: say which is tracked, such as object_id=3"):
        Tracker(model, AS_DRAWN).run(two, truth[0])
    run = Tracker(model, AS_DRAWN).run(two, truth[0], object_id=8, max_frames=2)
    assert list(run.results) == list(run.parts) == list(run.starts) == [8]
    assert len(run.results[8]) == 2


# ---- what goes wrong -----------------------------------------------------------------------------------------


def test_an_unreadable_frame_gets_the_predicted_pose(part: Part, model: PreparedPart, sequence: MadeSequence) -> None:
    truth, images = truth_of(sequence), images_of(sequence)
    damaged = MadeSequence([*images[:5], None, *images[6:]], {1: truth})
    results = Tracker(model, AS_DRAWN).run(damaged, truth[0]).results[1]
    blind = results[5]
    assert_sound(blind)
    assert blind.quality == 0.0
    assert blind.edges is None
    assert blind.residuals_px is None
    assert blind.iterations == 0
    assert "the file is empty" in blind.note
    assert np.isfinite(blind.control_points).all()
    # The part moves steadily, so the prediction is good, and tracking goes on from it.
    assert max(errors_percent(part, results, truth)) < 2.0
    assert results[-1].state is TrackState.TRACKING


def test_frames_that_cannot_be_read_are_not_tracked(model: PreparedPart, sequence: MadeSequence) -> None:
    truth, images = truth_of(sequence), images_of(sequence)
    blind = MadeSequence([images[0], None, None, None, None, images[5], images[6]], {1: truth[:7]})
    results = Tracker(model, AS_DRAWN).run(blind, truth[0]).results[1]
    assert [str(result.state) for result in results[:5]] == ["tracking", "weak", "lost", "lost", "lost"]
    assert "the file is empty; tracking -> weak: quality 0.00" in results[1].note
    assert results[6].state is TrackState.TRACKING  # the next image that is seen says so


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (np.diag([-1.0, 1.0, 1.0, 1.0]), "mirrored"),
        (np.diag([1.1, 1.1, 1.1, 1.0]), "not a rotation"),
        (np.diag([1.0, 1.0, np.nan, 1.0]), "not finite|no pose"),
        (np.diag([1.0, 1.0, 1.0, 2.0]), r"no pose of shape \(4, 4\)"),
    ],
)
def test_a_start_that_is_no_pose_is_refused(
    model: PreparedPart, sequence: MadeSequence, spoil: np.ndarray, message: str
) -> None:
    frame = next(iter(sequence.frames()))
    assert isinstance(frame, Frame)
    tracker = Tracker(model, AS_DRAWN)
    with pytest.raises(GeometryError, match=f"{model.part.name}: the start pose.*{message}"):
        tracker.start(frame, sequence.first_pose @ spoil)
    shifted = sequence.first_pose.copy()
    shifted[0, 3] = np.inf
    with pytest.raises(GeometryError, match="translation is not finite"):
        tracker.start(frame, shifted)
    with pytest.raises(TrackingError, match="before start"):
        tracker.track(frame)


def test_a_start_that_is_refused_leaves_the_earlier_track(model: PreparedPart, sequence: MadeSequence) -> None:
    first, second, third = sequence.frames(3)
    assert isinstance(first, Frame)
    assert isinstance(third, Frame)
    tracker, undisturbed = Tracker(model, AS_DRAWN), Tracker(model, AS_DRAWN)
    for one in (tracker, undisturbed):
        one.start(first, sequence.first_pose)
        one.track(second)
    far, mirrored = sequence.first_pose.copy(), sequence.first_pose.copy()
    far[0, 3] += 1e5
    mirrored[:3, 0] *= -1.0
    for pose, error in ((far, TrackingError), (mirrored, GeometryError)):
        with pytest.raises(error):
            tracker.start(third, pose)
    np.testing.assert_array_equal(tracker.track(third).cam_T_obj, undisturbed.track(third).cam_T_obj)


def test_start_poses_may_lie_in_memory_as_they_like_and_be_rounded(model: PreparedPart, sequence: MadeSequence) -> None:
    first, second = sequence.frames(2)
    assert isinstance(first, Frame)
    exact = Tracker(model, AS_DRAWN).start(first, sequence.first_pose)
    by_columns = Tracker(model, AS_DRAWN).start(first, np.asfortranarray(sequence.first_pose))
    np.testing.assert_array_equal(by_columns.cam_T_obj, exact.cam_T_obj)
    rounded = sequence.first_pose.copy()
    rounded[:3, :3] *= 1.0004
    tracker = Tracker(model, AS_DRAWN)
    for result in (tracker.start(first, rounded), tracker.track(second)):
        rotation = result.cam_T_obj[:3, :3]
        np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-9)


def test_a_start_where_nothing_is_seen_says_so(model: PreparedPart, sequence: MadeSequence) -> None:
    frame = next(iter(sequence.frames()))
    assert isinstance(frame, Frame)
    grey = replace(frame, image=np.full_like(frame.image, 128))
    result = Tracker(model, AS_DRAWN).start(grey, sequence.first_pose)
    assert result.state is TrackState.LOST
    assert "tracking -> lost" in result.note


@pytest.mark.parametrize("method", ["acp", "acp-edges", "region", "region-points", "slet"])
def test_a_read_only_image_is_as_good_as_any(method: str, model: PreparedPart, sequence: MadeSequence) -> None:
    """Such as the view of a camera's buffer, or a broadcast array."""
    poses: list[list[FloatArray]] = []
    for writable in (True, False):
        tracker, found = Tracker(model, method), []
        for number, frame in enumerate(sequence.frames(4)):
            assert isinstance(frame, Frame)
            frame = replace(frame, image=frame.image.copy())
            frame.image.setflags(write=writable)
            found.append((tracker.track(frame) if number else tracker.start(frame, sequence.first_pose)).cam_T_obj)
        poses.append(found)
    np.testing.assert_array_equal(*poses)


def test_an_unreadable_frame_without_a_camera(model: PreparedPart, sequence: MadeSequence) -> None:
    tracker = Tracker(model, AS_DRAWN)
    tracker.start(next(iter(sequence.frames())), sequence.first_pose)  # type: ignore[arg-type]
    result = tracker.track(UnreadableFrame(2, None, "gone"))
    np.testing.assert_array_equal(result.cam_T_obj, sequence.first_pose)
    assert np.isnan(result.control_points).all()
    assert result.quality == 0.0


def test_a_part_that_leaves_the_image_is_lost_and_found(part: Part, model: PreparedPart) -> None:
    start = looking_at(part, np.array([0.8, 0.6, 1.0]), 330.0, 0.3)
    offsets = [0, 10, 20, 35, 55, 80, 110, 150, 200, 200, 200, 200]
    truth = [move_pose(start, part.box_centre, np.array([0, 0, 0, float(x), 0, 0])) for x in offsets]
    tracker = Tracker(model, AS_DRAWN)
    results = [tracker.start(Frame(0, draw([(part, start)]), CAMERA), start)]
    results += [tracker.track(Frame(k, draw([(part, truth[k])], k), CAMERA)) for k in range(1, len(truth))]
    for result in results:
        assert_sound(result)
    assert max(errors_percent(part, tuple(results[:4]), truth[:4])) < 2.0  # whole in view
    assert results[-1].state is TrackState.LOST
    assert results[-1].quality < 0.2


@pytest.mark.parametrize("method", [AS_DRAWN, ACP_EDGES], ids=["acp", "acp-edges"])
def test_a_part_that_goes_half_out_of_the_image_is_kept_and_said_to_be_there(
    part: Part, model: PreparedPart, method: Method
) -> None:
    start = looking_at(part, np.array([0.8, 0.6, 1.0]), 330.0, 0.3)
    offsets = [0, 10, 20, 35, 50, 65, 80, 94, 106, 115, 121, 121]
    truth = [move_pose(start, part.box_centre, np.array([0, 0, 0, float(x), 0, 0])) for x in offsets]
    tracker = Tracker(model, method)
    results = [tracker.start(Frame(0, draw([(part, start)]), CAMERA), start)]
    results += [tracker.track(Frame(k, draw([(part, truth[k])], k), CAMERA)) for k in range(1, len(truth))]
    shown = [in_image(result.edges.points, CAMERA).mean() for result in results if result.edges is not None]
    assert shown[-1] < 0.5
    assert all(result.state is TrackState.TRACKING for result in results)
    assert max(errors_percent(part, tuple(results), truth)) < 5.0
    # Drawn parts fit so well that little more than a third of one would do for "tracking"; less is said of it, though.
    assert min(result.quality for result in results) > 0.97


@pytest.mark.parametrize("kind", ["black", "white", "noise", "another size"])
def test_frames_that_show_nothing_bring_no_nan(
    part: Part, model: PreparedPart, sequence: MadeSequence, kind: str
) -> None:
    truth, images = truth_of(sequence), images_of(sequence)
    rng, shape = np.random.default_rng(0), images[0].shape
    camera = CAMERA
    if kind == "another size":
        camera = Camera(30, 20, 320.0, 325.0, 99.5, 79.5)  # a corner of the image, where the part is not
        useless = images[0][:20, :30]
    else:
        made = {"black": np.zeros(shape), "white": np.full(shape, 255), "noise": rng.integers(0, 256, shape)}
        useless = made[kind].astype(np.uint8)
    tracker = Tracker(model, AS_DRAWN)
    tracker.start(Frame(0, images[0], CAMERA), truth[0])
    tracker.track(Frame(1, images[1], CAMERA))
    blind = [tracker.track(Frame(index, useless, camera)) for index in range(2, 6)]
    for result in blind:
        assert_sound(result)
        assert result.quality < 0.3
    assert blind[-1].state is TrackState.LOST
    # Back in view where it was last: it is found again.
    found = [tracker.track(Frame(index, images[1], CAMERA)) for index in range(6, 12)]
    assert found[-1].state is TrackState.TRACKING
    assert add_percent(part, found[-1].cam_T_obj, truth[1]) < 2.0


def test_a_jump_is_caught_by_a_second_look(part: Part, model: PreparedPart, sequence: MadeSequence) -> None:
    truth, images = truth_of(sequence), images_of(sequence)
    jumped = move_pose(truth[3], part.box_centre, np.array([0.03, 0.0, 0.02, -16.0, 12.0, 0.0]))
    errors_percent = []
    for method in (ACP, replace(ACP, recovery=Off())):
        tracker = Tracker(model, method)
        tracker.start(Frame(0, images[0], CAMERA), truth[0])
        for index in range(1, 4):
            tracker.track(Frame(index, images[index], CAMERA))
        result = tracker.track(Frame(4, draw([(part, jumped)], 4), CAMERA))
        errors_percent.append(add_percent(part, result.cam_T_obj, jumped))
    caught, alone = errors_percent
    assert caught < 2.0
    assert alone > 5.0


def test_a_start_within_the_part_is_refused_as_too_near(model: PreparedPart, sequence: MadeSequence) -> None:
    (frame,) = sequence.frames(1)
    near = make_pose(np.eye(3), np.array([0.0, 0.0, 0.3 * model.part.radius]) - model.part.box_centre)
    with pytest.raises(TrackingError, match=r"mm from the lens, nearer than its own size; check pose, unit"):
        Tracker(model, AS_DRAWN).start(frame, near)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("pose", "is_behind"),
    [
        (make_pose(np.eye(3), np.array([400.0, 300.0, 100.0])), True),
        (make_pose(np.eye(3), np.array([400.0, 300.0, 470.0])), True),
        (make_pose(np.eye(3), np.array([1400.0, 300.0, 900.0])), False),
        (make_pose(np.eye(3), np.array([0.4, 0.3, 0.9])), True),
    ],
    ids=["behind the camera", "in the camera", "outside the image", "in metres"],
)
def test_a_start_that_shows_nothing_is_refused(
    model: PreparedPart, sequence: MadeSequence, pose: FloatArray, is_behind: bool
) -> None:
    (frame,) = sequence.frames(1)
    with pytest.raises(TrackingError, match=r"bracket: at the start pose .* not seen in frame 0 \(200x160\)") as caught:
        Tracker(model, AS_DRAWN).start(frame, pose)  # type: ignore[arg-type]
    assert "\n" not in str(caught.value)
    assert ("lies behind the camera" in str(caught.value)) == is_behind


def test_a_long_part_may_come_nearer_than_its_own_length() -> None:
    """Inside its bounding sphere there is no canonical frame; the learned generator hands over."""
    part = box((200.0, 20.0, 20.0))
    model = learned(prepared(part), range(6))
    camera = Camera(360, 120, 160.0, 160.0, 179.5, 59.5)
    start = looking_at(part, np.array([0.0, 0.3, 1.0]), 107.0)
    truth = poses(part, start, 6, np.array([0.01, 0.0, 0.005, 0.0, 0.0, -3.0]))
    tracker = Tracker(model, AS_DRAWN)
    assert tracker.generator_name == "learned"
    tracker.start(Frame(0, draw([(part, truth[0])], 0, camera), camera), truth[0])
    for index in range(1, 6):
        result = tracker.track(Frame(index, draw([(part, truth[index])], index, camera), camera))
        assert_sound(result)
        # Both ends lie outside the picture: it does not show where the bar is along itself.
        off = transform(result.cam_T_obj, part.box_centre) - transform(truth[index], part.box_centre)
        along = truth[index][:3, 0]
        assert np.linalg.norm(off - (off @ along) * along) < 2.0
        assert rotation_angle_deg(result.cam_T_obj[:3, :3], truth[index][:3, :3]) < 1.0


def test_a_camera_may_change_from_frame_to_frame(part: Part, model: PreparedPart, sequence: MadeSequence) -> None:
    truth = truth_of(sequence)
    zoomed = Camera(240, 180, 400.0, 390.0, 110.0, 95.0)
    tracker = Tracker(model, AS_DRAWN)
    for index in range(4):
        camera = zoomed if index % 2 else CAMERA
        frame = Frame(index, draw([(part, truth[index])], index, camera), camera)
        result = tracker.start(frame, truth[0]) if index == 0 else tracker.track(frame)
        assert add_percent(part, result.cam_T_obj, truth[index]) < 2.0


def test_undistortion_counts_as_tracking_time(model: PreparedPart, sequence: MadeSequence) -> None:
    image = images_of(sequence)[0]
    result = Tracker(model, AS_DRAWN).start(Frame(0, image, CAMERA, undistort_s=5.0), sequence.first_pose)
    assert result.timings.undistort_s == 5.0
    assert result.timings.total_s > 5.0


def test_time_runs_from_the_undistorted_image_to_the_pose(
    model: PreparedPart, sequence: MadeSequence, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The total is no sum of what the solver booked: looking at the image counts, and undistortion before it."""
    look = FrameSolver.look

    def slowly(*args: Any, **kwargs: Any) -> Any:
        time.sleep(0.03)
        return look(*args, **kwargs)

    monkeypatch.setattr(FrameSolver, "look", slowly)
    for method in (ACP, BY_MAP):
        tracker = Tracker(model, method)
        frames = list(sequence.frames(2))
        started = tracker.start(replace(frames[0], undistort_s=0.5), sequence.first_pose)
        result = tracker.track(replace(frames[1], undistort_s=0.5))
        for stages in (started.timings, result.timings):
            assert stages.image_s >= 0.03
            solving_s = stages.generate_s + stages.search_s + stages.solve_s + stages.learn_s
            assert stages.total_s >= stages.undistort_s + stages.image_s + solving_s - 1e-3
            assert stages.total_s >= 0.53


# ---- what a tracker is ---------------------------------------------------------------------------------------


def test_the_best_method_unless_told_otherwise(model: PreparedPart) -> None:
    assert Tracker(model).method is ACP
    assert Tracker(model, "acp").method is METHODS["acp"]
    assert Tracker(model, replace(ACP, name="mine")).name == "mine"
    with pytest.raises(TrackingError, match="no such method: there are acp, acp-edges, region, region-points"):
        Tracker(model, "acp-papr")


def test_a_tracker_has_what_a_session_asks_for(model: PreparedPart) -> None:
    for method in (ACP, BY_MAP):
        tracker: PartTracker = Tracker(model, method)
        assert tracker.name == method.name
        assert tracker.part is model.part
        assert not tracker.records_steps
        assert not tracker.records_target
        assert [w.shape for w in tracker.control_points_obj] == [(4, 3)] * 6


def test_tracking_needs_a_start(model: PreparedPart, sequence: MadeSequence) -> None:
    for method in (ACP, BY_MAP):
        with pytest.raises(TrackingError, match="track was called before start; give the first frame to start"):
            Tracker(model, method).track(next(sequence.frames()))


def test_looking_changes_nothing(model: PreparedPart, sequence: MadeSequence) -> None:
    frames = [frame for frame in sequence.frames(4) if isinstance(frame, Frame)]
    plain, looking = Tracker(model, AS_DRAWN), Tracker(model, AS_DRAWN)
    for tracker in (plain, looking):
        tracker.start(frames[0], sequence.first_pose)
    for frame in frames[1:]:
        seen = looking.look(frame, looking.predicted)
        assert seen is not None
        np.testing.assert_array_equal(seen.view.prior, looking.predicted)
        np.testing.assert_array_equal(looking.track(frame).cam_T_obj, plain.track(frame).cam_T_obj)
    behind = sequence.first_pose.copy()
    behind[2, 3] -= 2000.0
    assert looking.look(frames[0], behind) is None


# ---- view regions that were not prepared ---------------------------------------------------------------------

TURNS = [
    np.array([x, 0.3, z])
    for x, z in (
        (0.3, 1.0),
        (0.7, 1.0),
        (0.98, 1.0),
        (1.1, 1.0),
        (1.25, 1.0),
        (1.5, 1.0),
        (1.25, 1.0),
        (0.9, 1.0),
        (1.4, 1.0),
    )
]


def turning(part: Part) -> list[FloatArray]:
    """From region 4 (+z) over the border into region 0 (+x), and twice back and forth."""
    return [looking_at(part, 0.5 * way * part.box_size, 330.0, 0.2) for way in TURNS]


def tracked(tracker: Tracker, part: Part, truth: list[FloatArray]) -> list[TrackResult]:
    """Each from its own truth: what is asked here is which regions are used."""
    results = []
    for index, pose in enumerate(truth):
        frame = Frame(index, draw([(part, pose)], index), CAMERA)
        results.append(tracker.track(frame) if index else tracker.start(frame, pose))
    return results


@pytest.mark.parametrize("method", [ACP, BY_MAP], ids=lambda method: method.name)
def test_a_start_from_a_region_that_was_not_prepared_is_refused(
    part: Part, model: PreparedPart, method: Method
) -> None:
    pose = looking_at(part, np.array([0.1, 0.1, 1.0]), 330.0)  # from region 4
    frame = Frame(0, draw([(part, pose)]), CAMERA)
    with pytest.raises(PreparationError) as caught:
        Tracker(learned(model, [5, 0], with_templates=False), method).start(frame, pose)
    message = str(caught.value)
    assert message.startswith(
        "bracket: the part is seen from view region 4, generator learned is prepared for 0, 5 only"
    )
    assert "; run: acp-lab prepare MESH --out PARTS_DIR --regions 4" in message
    assert "\n" not in message


def test_a_start_from_a_region_without_an_auto_encoder_names_the_generator_to_prepare(
    part: Part, model: PreparedPart
) -> None:
    pose = looking_at(part, np.array([0.1, 0.1, 1.0]), 330.0)  # from region 4
    frame = Frame(0, draw([(part, pose)]), CAMERA)
    with pytest.raises(PreparationError, match="autoencoder is prepared for 1, 3 only") as caught:
        Tracker(painted(model), METHODS["acp-paper"]).start(frame, pose)
    assert str(caught.value).endswith("--out PARTS_DIR --generator autoencoder --regions 4")


@pytest.mark.parametrize("method", [ACP, BY_MAP], ids=lambda method: method.name)
def test_a_start_just_beyond_the_border_is_within_what_hysteresis_keeps(
    part: Part, model: PreparedPart, method: Method
) -> None:
    only = learned(model, [4], with_templates=False)
    half = 0.5 * part.box_size
    inside, outside = (looking_at(part, np.array([x, 0.3, 1.0]) * half, 330.0) for x in (1.1, 1.25))
    tracker = Tracker(only, method)
    assert tracker.solver.natural_region(inside) == tracker.solver.natural_region(outside) == 0
    result = tracker.start(Frame(0, draw([(part, inside)]), CAMERA), inside)
    assert (result.region, result.note) == (4, "")
    with pytest.raises(PreparationError, match="view region 0"):
        tracker.start(Frame(0, draw([(part, outside)]), CAMERA), outside)


@pytest.mark.parametrize("method", [ACP, BY_MAP], ids=lambda method: method.name)
def test_a_part_that_turns_to_where_nothing_was_prepared_says_so_once(
    part: Part, model: PreparedPart, method: Method
) -> None:
    tracker = Tracker(learned(model, [4], with_templates=False), method)
    truth = turning(part)
    for _ in range(2):  # a new start says it anew
        results = tracked(tracker, part, truth)
        assert [result.region for result in results] == [4] * len(truth)
        said = [index for index, result in enumerate(results) if "not prepared" in result.note]
        assert len(said) == 1
        assert results[said[0]].note == ("view region 0 is not prepared: that of region 4 is used; accuracy will fall")
        natural = tracker.solver.natural_region(results[said[0]].predicted)
        assert natural == 0
        assert 2 <= said[0] <= 5


@pytest.mark.parametrize("method", [ACP, BY_MAP], ids=lambda method: method.name)
def test_templates_stand_in_where_nothing_was_learned(part: Part, model: PreparedPart, method: Method) -> None:
    tracker = Tracker(learned(model, [4]), method)
    assert tracker.generator_name == "learned"
    results = tracked(tracker, part, turning(part))
    assert {result.region for result in results} == {4, 0}
    assert not any("prepared" in result.note for result in results)
    from_below = looking_at(part, np.array([0.1, 0.2, -1.0]), 330.0)  # region 5 at once
    assert tracker.start(Frame(0, draw([(part, from_below)]), CAMERA), from_below).region == 5


def test_only_regions_that_were_painted_are_used(part: Part, model: PreparedPart) -> None:
    """The auto-encoder knows no other: asked for one, it would raise."""
    lit = lit_part(model, (4,))
    tracker = Tracker(lit, replace(DIRECT_6DOF, source=PaintedSamples(), recovery=ACP.recovery))
    results = tracked(tracker, part, turning(part))
    assert {result.region for result in results} == {4}
    assert {region for region, _ in lit.lit.asked} == {4}


def test_another_region_begins_with_the_projection_of_the_pose(part: Part, model: PreparedPart) -> None:
    """What was carried on is an I of another W. Seen in a black frame, which moves nothing."""
    method = replace(
        BY_MAP,
        variables=ControlPointVariables("autograd", carry="points"),
        targets=(NormalSearch(bind="step"),),
        prediction=ConstantVelocityPrediction(),
    )
    half = 0.5 * part.box_size
    truth = [looking_at(part, np.array([x, 0.3, 1.0]) * half, 330.0, 0.2) for x in (0.88, 0.98, 1.09)]
    tracker = Tracker(model, method)
    assert {result.region for result in tracked(tracker, part, truth)} == {4}
    predicted = tracker.predicted
    blind = tracker.track(Frame(len(truth), np.zeros((CAMERA.height, CAMERA.width, 3), np.uint8), CAMERA))
    assert blind.region == 0, "the test's own point is gone"
    shown = CAMERA.project(transform(predicted, tracker.control_points_obj[0]))
    np.testing.assert_allclose(blind.control_points, shown, atol=1e-6)


# ---- what a method says of frames that fit badly -------------------------------------------------------------


def test_states_are_those_of_the_methods_thresholds(model: PreparedPart, sequence: MadeSequence) -> None:
    black = np.zeros((CAMERA.height, CAMERA.width, 3), np.uint8)
    found = {}
    for patience in (1, 4):
        states = replace(ACP.states, patience=patience, lost_below=0.1, weak_below=0.15)
        tracker = Tracker(model, replace(ACP, states=states))
        tracker.start(next(sequence.frames()), sequence.first_pose)  # type: ignore[arg-type]
        found[patience] = [tracker.track(Frame(k, black, CAMERA)).state for k in range(1, 6)]
    weak, lost = TrackState.WEAK, TrackState.LOST
    assert found == {1: [lost] * 5, 4: [weak] * 3 + [lost] * 2}


@pytest.mark.parametrize("method", [replace(ACP, recovery=Off()), BY_MAP], ids=lambda method: method.name)
def test_a_solution_that_no_part_can_reach_is_none(
    part: Part, model: PreparedPart, sequence: MadeSequence, monkeypatch: pytest.MonkeyPatch, method: Method
) -> None:
    frames = list(sequence.frames(2))
    tracker = Tracker(model, method)
    tracker.start(frames[0], sequence.first_pose)  # type: ignore[arg-type]
    last, solve = tracker.last, FrameSolver.solve

    def diverged(
        solver: FrameSolver,
        seen: SeenFrame,
        start: Estimate,
        clock: Stopwatch,
        levels: tuple[Level, ...] | None = None,
    ) -> Solution | None:
        found = solve(solver, seen, start, clock, levels)
        assert found is not None
        away = move_pose(found.cam_T_obj, part.box_centre, np.array([0.0, 0, 0, 0, 0, 2.5 * part.radius]))
        return replace(found, estimate=seen.view.at_pose(away))

    monkeypatch.setattr(FrameSolver, "solve", diverged)
    result = tracker.track(frames[1])
    assert (result.quality, result.edges) == (0.0, None)
    np.testing.assert_array_equal(result.cam_T_obj, last)
    assert result.note


# ---- how much of the way is looked for -----------------------------------------------------------------------


@pytest.mark.parametrize("method", [AS_DRAWN, replace(AS_DRAWN, recovery=Off())], ids=["acp", "without recovery"])
def test_a_sure_prediction_is_solved_by_the_last_level_and_a_poor_fit_by_all(
    part: Part, model: PreparedPart, sequence: MadeSequence, monkeypatch: pytest.MonkeyPatch, method: Method
) -> None:
    truth, images = truth_of(sequence), images_of(sequence)
    tracker, counts, solve = Tracker(model, method), list[int](), FrameSolver.solve

    def counted(
        solver: FrameSolver,
        seen: SeenFrame,
        start: Estimate,
        clock: Stopwatch,
        levels: tuple[Level, ...] | None = None,
    ) -> Solution | None:
        counts.append(len(solver.levels_at(start, levels)))
        return solve(solver, seen, start, clock, levels)

    tracker.start(Frame(0, images[0], CAMERA), truth[0])
    monkeypatch.setattr(FrameSolver, "solve", counted)
    tracker.track(Frame(1, images[1], CAMERA))
    assert counts[0] == 3, "nothing is known of the motion yet"
    for index in (2, 3):
        tracker.track(Frame(index, images[index], CAMERA))
    counts.clear()
    # Where it is expected, as far as a part that is drawn can be.
    expected = tracker.predicted
    result = tracker.track(Frame(4, draw([(part, expected)], 4), CAMERA))
    assert counts == [1]
    assert add_percent(part, result.cam_T_obj, expected) < 2.0
    counts.clear()
    # A little beside it: a solution is there, but fits worse than usual.
    jumped = move_pose(tracker.predicted, part.box_centre, np.array([0.02, 0.0, 0.01, -6.0, 4.0, 0.0]))
    result = tracker.track(Frame(5, draw([(part, jumped)], 4), CAMERA))
    assert counts[:2] == [1, 3]
    assert add_percent(part, result.cam_T_obj, jumped) < 2.0


@pytest.mark.parametrize(
    ("whole", "near", "tried", "taken"),
    [(0.99, 1.5, 1, 0), (0.97, 0.98, 2, 0), (0.97, 1.01, 2, 1), (0.5, 0.1, 2, 0)],
    ids=["as before", "no better", "clearly better", "worse"],
)
def test_where_all_levels_find_less_than_before_the_last_alone_has_its_try(
    model: PreparedPart, sequence: MadeSequence, monkeypatch: pytest.MonkeyPatch, whole: float, near: float, tried: int,
    taken: int,
) -> None:  # fmt: skip
    """A wide level may leave the place of a part that is seen edge-on for another where its outline fits."""
    truth, images = truth_of(sequence), images_of(sequence)
    tracker = Tracker(model, replace(AS_DRAWN, recovery=Off(), sight=Off()))
    tracker.start(Frame(0, images[0], CAMERA), truth[0])
    usual = tracker._pursuit.usual
    usual.mean_score = usual.last_score = 1.0
    solve, found = FrameSolver.solve, list[Solution]()

    def told(*given: Any) -> Solution | None:
        *_, levels = given
        assert (levels is None) == (not found), "first all levels"
        solution = solve(*given)
        assert solution is not None
        solution.__dict__["score"] = near if found else whole
        found.append(solution)
        return solution

    monkeypatch.setattr(FrameSolver, "solve", told)
    result = tracker.track(Frame(1, images[1], CAMERA))
    assert len(found) == tried
    np.testing.assert_array_equal(result.cam_T_obj, found[taken].cam_T_obj)


@pytest.mark.parametrize("wrong_px", [30.0, -35.0])
def test_a_picture_that_was_found_elsewhere_does_not_lead_the_part_astray(
    part: Part, model: PreparedPart, sequence: MadeSequence, monkeypatch: pytest.MonkeyPatch, wrong_px: float
) -> None:
    """A blurred picture fits something else as well, and near enough that a filter which is unsure believes it."""
    truth, images = truth_of(sequence), images_of(sequence)
    alone = replace(ACP, recovery=Off())
    tracker, unled = Tracker(model, alone), Tracker(model, replace(alone, sight=Off()))
    for each in (tracker, unled):
        each.start(Frame(0, images[0], CAMERA), truth[0])

    def elsewhere(_: Picture, image: ByteImage, expected_px: FloatArray, config: PictureSearch) -> FloatArray:
        return expected_px + np.array([wrong_px, 0.0])

    monkeypatch.setattr(Picture, "shift_in", elsewhere)
    sights = list[bool]()
    sight = Pursuit.sight
    monkeypatch.setattr(Pursuit, "sight", lambda *given: sights.append(sight(*given)) or sights[-1])
    result, expected = (each.track(Frame(1, images[1], CAMERA)) for each in (tracker, unled))
    assert sights == [True, False], "it is believed"
    assert add_percent(part, result.cam_T_obj, truth[1]) < 2.0
    np.testing.assert_allclose(result.cam_T_obj, expected.cam_T_obj, atol=1e-6)
    np.testing.assert_allclose(tracker.predicted, unled.predicted, atol=1e-6)


def test_a_try_that_was_not_taken_leaves_no_view_region_behind(
    model: PreparedPart, sequence: MadeSequence, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What the motion foretold may be seen from another side; where the led try is better, its side is in use."""
    truth, images = truth_of(sequence), images_of(sequence)
    tracker = Tracker(model, replace(ACP, recovery=Off()))
    tracker.start(Frame(0, images[0], CAMERA), truth[0])
    # All levels, the last alone, and all from where the motion alone led.
    solve, regions = Pursuit.try_from, [4, 4, 2]

    def in_turn(self: Pursuit, *given: Any) -> Solution | None:
        found = solve(self, *given)
        self.region = regions.pop(0)
        self.usual.mean_score = self.usual.last_score = 10.0  # nothing is as good as usual
        return found if regions else None

    monkeypatch.setattr(Pursuit, "try_from", in_turn)
    monkeypatch.setattr(Pursuit, "sight", lambda *_: True)
    assert tracker.track(Frame(1, images[1], CAMERA)).region == 4
    assert not regions, "all were tried"


def test_a_picture_is_not_searched_with_another_camera(
    model: PreparedPart, sequence: MadeSequence, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Another zoom or crop shifts the whole image: that is no motion of the part."""
    truth, images = truth_of(sequence), images_of(sequence)
    searched = list[int]()
    monkeypatch.setattr(Picture, "shift_in", lambda *_: searched.append(1))
    tracker = Tracker(model, AS_DRAWN)
    tracker.start(Frame(0, images[0], CAMERA), truth[0])
    tracker.track(Frame(1, images[1], CAMERA))
    assert searched == [1], "nothing is known of the motion yet, so the part is looked for"
    tracker.start(Frame(0, images[0], CAMERA), truth[0])
    tracker.track(Frame(1, images[1], replace(CAMERA, cx=CAMERA.cx + 1.0)))
    assert searched == [1]


def smeared_images(part: Part, at: list[FloatArray], step: FloatArray, share: float) -> list[ByteImage]:
    """Of a part that makes the same pose step (6,) about its centre from each of poses to the next."""
    moments = share * ((np.arange(9) + 0.5) / 9 - 0.5)
    found = []
    for i, pose in enumerate(at):
        views = [draw([(part, move_pose(pose, part.box_centre, when * step))], k) for k, when in enumerate(moments)]
        light = np.mean([(view / 255.0) ** GAMMA for view in views], axis=0)
        noise = np.random.default_rng(i).normal(0.0, 2.0, light.shape[:2])[..., None]
        found.append(np.clip(255.0 * light ** (1.0 / GAMMA) + noise, 0, 255).astype(np.uint8))
    return found


def test_edges_smeared_by_motion_are_found_in_their_middle() -> None:
    """At 14 px a frame with the shutter open for 0.7 of it, an edge may seem to be anywhere within 10 px."""
    part = box()
    model, step = prepared(part), np.array([0.004, 0.006, 0.0, 8.0, 1.5, 0.0])
    middle = looking_at(part, np.array([0.8, 0.6, 1.0]), 190.0, 0.3)
    at = [move_pose(middle, part.box_centre, k * step) for k in range(-3, 4)]
    images = smeared_images(part, at, step, 0.7)
    unaware = replace(AS_DRAWN, learning=SampleLearning(profiles=Off(), blur=Off()))
    errors, shares = [], []
    for method in (AS_DRAWN, unaware):
        tracker = Tracker(model, method)
        tracker.start(Frame(0, images[0], CAMERA), at[0])
        results = tuple(tracker.track(Frame(k, image, CAMERA)) for k, image in enumerate(images[1:], 1))
        # The first motion is unknown, and so is the shutter.
        errors.append(float(np.mean(errors_percent(part, results[1:], at[2:]))))
        shares.append(tracker.solver.knowledge.blur and tracker.solver.knowledge.blur.share)
    assert shares == [pytest.approx(0.7, abs=0.15), None]
    assert errors[0] < 0.6 * errors[1]


def test_a_smeared_first_frame_is_measured_again() -> None:
    """What was taken for offsets there was the place in the smear that happened to be steepest."""
    part = box()
    model, step = prepared(part), np.array([0.004, 0.006, 0.0, 8.0, 1.5, 0.0])
    first = looking_at(part, np.array([0.8, 0.6, 1.0]), 190.0, 0.3)
    at = [first, move_pose(first, part.box_centre, step)]
    images = smeared_images(part, at, step, 0.7)

    def spread(tracker: Tracker) -> float:
        """Of the expected offsets of outlines, mm; the part has none that differ."""
        estimate = tracker.look(Frame(0, images[0], CAMERA), first).view.at_pose(first)  # type: ignore[union-attr]
        edges = tracker.solver.source.generate(estimate, 600)
        expected = tracker.solver.knowledge.expect(edges, edges.normals, estimate)
        assert expected is not None
        return float(expected.offsets_mm[edges.outline].std())

    tracker = Tracker(model, AS_DRAWN)
    tracker.start(Frame(0, images[0], CAMERA), first)
    before = spread(tracker)
    tracker.track(Frame(1, images[1], CAMERA))
    assert spread(tracker) < 0.7 * before


def test_a_sharp_first_frame_is_measured_once(monkeypatch: pytest.MonkeyPatch) -> None:
    part = box()
    model, step = prepared(part), np.array([0.0, 0.0, 0.0, 9.0, 0.0, 0.0])
    first = looking_at(part, np.array([0.8, 0.6, 1.0]), 250.0, 0.3)
    at = [move_pose(first, part.box_centre, k * step) for k in range(4)]
    tracker = Tracker(model, AS_DRAWN)
    measured = []
    monkeypatch.setattr(ContourOffsets, "learn", lambda *given: measured.append(given))
    tracker.start(Frame(0, draw([(part, first)]), CAMERA), first)
    for k, pose in enumerate(at[1:], 1):
        tracker.track(Frame(k, draw([(part, pose)], k), CAMERA))
    assert len(measured) == 1


# ---- what others do with frames and results --------------------------------------------------------------------


def test_whoever_changes_a_result_does_not_change_the_tracker(model: PreparedPart, sequence: MadeSequence) -> None:
    """To metres, for a robot."""

    def poses_of(change: bool) -> list[FloatArray]:
        tracker, found = Tracker(model, AS_DRAWN), []
        frames = [*sequence.frames(), UnreadableFrame(99, None, "is damaged"), next(iter(sequence.frames()))]
        for frame in frames:
            result = tracker.track(frame) if found else tracker.start(frame, sequence.first_pose)  # type: ignore[arg-type]
            found.append(result.cam_T_obj.copy())
            if change:
                for values in (result.cam_T_obj, result.predicted, result.control_points):
                    values[:] = values / 1000.0
        return found

    np.testing.assert_array_equal(poses_of(change=True), poses_of(change=False))


def test_what_is_read_again_later_is_a_copy_of_the_image(model: PreparedPart, sequence: MadeSequence) -> None:
    """Whoever gives frames may write each into the same array."""
    frame = next(iter(sequence.frames()))
    assert isinstance(frame, Frame)
    image = frame.image.copy()
    first = FirstFrame(replace(frame, image=image), sequence.first_pose, 0)
    search = way_back.Search(Finder(model), replace(frame, image=image), 1, None)
    image[:] = 0
    np.testing.assert_array_equal(first._frame.image, frame.image)
    np.testing.assert_array_equal(search.frame.image, frame.image)
