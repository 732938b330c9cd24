"""Parts that are followed by cameras that read their pictures row by row."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.pose import transform
from acp_lab.geometry.pose_step import move_pose
from acp_lab.sequences.frame import Frame
from acp_lab.tracking.learning.knowledge import Matches, Off, SampleKnowledge, SampleLearning
from acp_lab.tracking.learning.rolling_shutter import RollingShutter
from acp_lab.tracking.method import ACP, ACP_EDGES, Method
from acp_lab.tracking.result import TrackResult
from acp_lab.tracking.stopwatch import Stopwatch
from acp_lab.tracking.targets.regions import RegionTarget
from acp_lab.tracking.tracker import Tracker
from tests.made_parts import bracket, looking_at
from tests.tracking.rendered import AS_DRAWN, CAMERA, STEP, add_percent, draw, prepared
from tests.tracking.views import view_at

PART = bracket()
MODEL = prepared(PART)
START = looking_at(PART, np.array([1.0, 0.5, 0.4]), 260.0, 0.4)
COUNT = 18
BAND_ROWS = 5
# Up and down the picture with some 10 px a frame, and a spin.
SWING_MM, SWING_FRAMES = np.array([6.0, 16.0, 5.0]), np.array([17.0, 13.0, 19.0])


def at_time(time: float) -> FloatArray:
    """(4, 4) the pose at a time in frames."""
    spin = time * np.array([0.012, -0.015, 0.01])
    shift = SWING_MM * np.sin(2.0 * np.pi * time / SWING_FRAMES)
    return move_pose(START, PART.box_centre, np.concatenate([spin, shift]))


def read(number: int, readout: float) -> tuple[Frame, FloatArray]:
    """A frame that is read from top to bottom, or the other way, and the pose when the part's centre is."""
    middle = 0.5 * (CAMERA.height - 1)
    bands = []
    for top in range(0, CAMERA.height, BAND_ROWS):
        late = readout * (top + 0.5 * (BAND_ROWS - 1) - middle) / CAMERA.height
        band = replace(CAMERA, height=BAND_ROWS, cy=CAMERA.cy - top)
        bands.append(draw([(PART, at_time(number + late))], CAMERA.height * number + top, band))
    time = float(number)
    for _ in range(5):
        row = CAMERA.project(transform(at_time(time), PART.box_centre)[None])[0, 1]
        time = number + readout * (row - middle) / CAMERA.height
    return Frame(number, np.concatenate(bands), CAMERA), at_time(time)


@pytest.fixture(scope="module")
def row_by_row() -> list[tuple[Frame, FloatArray]]:
    return [read(number, 0.9) for number in range(COUNT)]


@pytest.fixture(scope="module")
def at_once() -> list[tuple[Frame, FloatArray]]:
    return [read(number, 0.0) for number in range(COUNT)]


def upside_down(frames: list[tuple[Frame, FloatArray]]) -> list[tuple[Frame, FloatArray]]:
    """As a camera that hangs upside down takes them."""
    turned = replace(CAMERA, cx=CAMERA.width - 1 - CAMERA.cx, cy=CAMERA.height - 1 - CAMERA.cy)
    half_turn = np.diag([-1.0, -1.0, 1.0, 1.0])
    return [
        (replace(frame, image=np.ascontiguousarray(frame.image[::-1, ::-1]), camera=turned), half_turn @ pose)
        for frame, pose in frames
    ]


def unasked(method: Method) -> Method:
    assert isinstance(method.learning, SampleLearning)
    return replace(method, learning=replace(method.learning, shutter=Off()))


def follow(
    frames: list[tuple[Frame, FloatArray]], method: Method = AS_DRAWN
) -> tuple[Tracker, list[TrackResult], FloatArray]:
    """From truth; ADD in per cent of the diameter from the sixth frame on."""
    tracker = Tracker(MODEL, method)
    results = [tracker.start(*frames[0]), *(tracker.track(frame) for frame, _ in frames[1:])]
    off = [add_percent(PART, r.cam_T_obj, truth) for r, (_, truth) in zip(results, frames, strict=True)]
    return tracker, results, np.array(off[5:])


def test_the_part_moves_as_these_tests_need_it() -> None:
    centres = CAMERA.project(np.stack([transform(at_time(t), PART.box_centre) for t in range(COUNT)]))
    assert np.median([np.linalg.norm(b - a) for a, b in pairwise(centres)]) > 5.0


def test_the_shutter_is_learnt_and_the_part_followed_as_well_as_without_one(
    row_by_row: list[tuple[Frame, FloatArray]], at_once: list[tuple[Frame, FloatArray]]
) -> None:
    tracker, _, off = follow(row_by_row)
    assert tracker.readout is not None
    assert tracker.readout[0] == 0.0
    assert 0.5 < tracker.readout[1] <= 1.0
    _, _, unaware = follow(row_by_row, unasked(AS_DRAWN))
    _, _, best = follow(at_once)
    assert np.median(unaware) > 2.0 * np.median(best)
    assert np.median(off) < 0.6 * np.median(unaware)


def test_a_camera_that_hangs_upside_down_reads_upwards(row_by_row: list[tuple[Frame, FloatArray]]) -> None:
    tracker, _, off = follow(upside_down(row_by_row))
    assert tracker.readout is not None
    assert -1.0 <= tracker.readout[1] < -0.5
    assert np.median(off) < 0.6 * np.median(follow(upside_down(row_by_row), unasked(AS_DRAWN))[2])


def test_pictures_that_are_read_at_once_are_tracked_as_ever(at_once: list[tuple[Frame, FloatArray]]) -> None:
    tracker, results, _ = follow(at_once)
    assert tracker.readout is None
    for one, other in zip(results, follow(at_once, unasked(AS_DRAWN))[1], strict=True):
        np.testing.assert_array_equal(one.cam_T_obj, other.cam_T_obj)


@pytest.mark.parametrize("method", [ACP, ACP_EDGES], ids=lambda method: method.name)
def test_it_is_learnt_with_colours_and_without(row_by_row: list[tuple[Frame, FloatArray]], method: Method) -> None:
    drawn = replace(method, learning=AS_DRAWN.learning, start=AS_DRAWN.start, magnification=Off())
    assert follow(row_by_row, drawn)[0].readout is not None


def test_a_prior_that_is_no_prediction_makes_no_motion(at_once: list[tuple[Frame, FloatArray]]) -> None:
    # As of poses that are tried because nothing fits, or that the detector proposes.
    frame, truth = at_once[0]
    tracker = Tracker(MODEL, AS_DRAWN)
    tracker.start(frame, truth)
    solver, off = tracker.solver, move_pose(truth, PART.box_centre, np.array([0.0, 0.0, 0.0, 1.0, 5.0, 0.0]))
    seen = solver.look(frame.image, frame.camera, off, solver.choose_region(off), motion=np.zeros(6))
    assert seen is not None
    rolling = replace(seen, view=replace(seen.view, readout=np.array([0.0, 0.9])))
    plain, rolled = (solver.solve(one, one.view.at_pose(off), Stopwatch()) for one in (seen, rolling))
    assert plain is not None
    assert rolled is not None
    assert add_percent(PART, plain.cam_T_obj, truth) < 1.0
    np.testing.assert_allclose(rolled.cam_T_obj, plain.cam_T_obj, atol=1e-9)


def test_what_came_otherwise_than_predicted_came_in_the_time_since_the_last_frame() -> None:
    view = replace(view_at(PART, START), motion=STEP, prior_information=np.eye(6), readout=np.array([0.0, 0.9]))
    off = np.array([0.01, -0.02, 0.03, 1.0, -2.0, 3.0])
    pose = move_pose(START, PART.box_centre, off)
    for steps in (1.0, 3.0):
        np.testing.assert_allclose(replace(view, steps=steps).at_pose(pose).motion, STEP + off / steps, atol=1e-9)
    np.testing.assert_allclose(replace(view, prior_information=None).at_pose(pose).motion, STEP)
    assert replace(view, motion=None).at_pose(pose).motion is None


def test_lines_across_the_outline_are_as_free_as_before_any_readout(at_once: list[tuple[Frame, FloatArray]]) -> None:
    # How far the part goes on beside an outline is asked of the CAD model, which no shutter deforms.
    frame, truth = at_once[3]
    tracker = Tracker(MODEL, AS_DRAWN)
    tracker.start(frame, truth)
    solver, motion = tracker.solver, np.array([0.0, 0.0, 0.0, 8.0, 14.0, 0.0])
    edges = solver.source.generate(view_at(PART, truth).at_pose(truth), 200)
    counts, moved = list[int](), list[float]()
    for readout in (None, np.array([0.0, 0.9]), np.array([0.0, -0.9])):
        solver.forget()
        seen = solver.look(frame.image, frame.camera, truth, solver.choose_region(truth), motion=motion)
        assert seen is not None
        at = replace(seen.view, readout=readout).at_pose(truth)
        target = seen.targets[1]
        assert isinstance(target, RegionTarget)
        lines = target.lines(edges, at)
        counts.append(len(lines))
        moved.append(float(np.abs(lines.points - edges.points[lines.rows]).max()))
    assert counts[0] == counts[1] == counts[2] > 20
    assert moved[0] < 1e-9
    assert min(moved[1:]) > 1.0


def test_another_start_forgets_it(row_by_row: list[tuple[Frame, FloatArray]]) -> None:
    tracker = follow(row_by_row)[0]
    assert tracker.readout is not None
    tracker.start(*row_by_row[0])
    assert tracker.readout is None


def test_edges_are_reported_where_the_picture_shows_them(row_by_row: list[tuple[Frame, FloatArray]]) -> None:
    tracker, results, _ = follow(row_by_row)
    last = max((r for r in results if r.edges is not None), key=lambda r: r.frame_id)
    assert last.edges is not None
    pose, points_obj = last.cam_T_obj, MODEL.edges.points_obj[last.edges.sample_ids]
    still = CAMERA.project(transform(pose, points_obj))
    before = results[-2].cam_T_obj
    moves = still - CAMERA.project(transform(before, points_obj))
    late = (still - CAMERA.project(transform(pose, PART.box_centre)[None]))[:, 1] / CAMERA.height
    assert tracker.readout is not None
    expected = (tracker.readout[1] * late)[:, None] * moves
    assert np.abs(expected).max() > 0.5
    np.testing.assert_allclose(last.edges.points - still, expected, atol=0.3)


@pytest.fixture
def measured(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """What the readout was taken for, from top to bottom, each time that offsets were measured."""
    found, real = list[float](), SampleKnowledge.measure_offsets

    def spied(knowledge: SampleKnowledge, matches: Matches) -> None:
        found.append(0.0 if knowledge.readout is None else float(knowledge.readout[1]))
        real(knowledge, matches)

    monkeypatch.setattr(SampleKnowledge, "measure_offsets", spied)
    return found


# Of sharp edges nothing is to be measured again but for the shutter.
assert isinstance(AS_DRAWN.learning, SampleLearning)
UNSMEARED = replace(AS_DRAWN, learning=replace(AS_DRAWN.learning, blur=Off()))


def test_the_first_frame_is_measured_again_once_the_shutter_is_known(
    row_by_row: list[tuple[Frame, FloatArray]], measured: list[float]
) -> None:
    follow(row_by_row, UNSMEARED)
    assert measured[0] == 0.0
    assert len(measured) > 1
    assert min(measured[1:]) > 0.3
    assert len(measured) <= 6


def test_the_first_frame_is_measured_again_when_the_shutter_is_no_longer_believed(
    row_by_row: list[tuple[Frame, FloatArray]], measured: list[float], monkeypatch: pytest.MonkeyPatch
) -> None:
    frames = iter(range(COUNT))

    def told(shutter: RollingShutter, *evidence: object) -> None:
        shutter.readout = np.array([0.0, 0.9]) if 2 <= next(frames) < 5 else None

    monkeypatch.setattr(RollingShutter, "learn", told)
    follow(row_by_row, UNSMEARED)
    assert measured == [0.0, 0.9, 0.0]
