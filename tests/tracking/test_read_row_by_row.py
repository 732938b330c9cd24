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
from acp_lab.tracking.learning.knowledge import Off, SampleKnowledge, SampleLearning
from acp_lab.tracking.method import ACP, ACP_EDGES, Method
from acp_lab.tracking.result import TrackResult
from acp_lab.tracking.tracker import Tracker
from tests.made_parts import bracket, looking_at
from tests.tracking.rendered import AS_DRAWN, CAMERA, add_percent, draw, prepared

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
def test_methods_of_edges_learn_it(row_by_row: list[tuple[Frame, FloatArray]], method: Method) -> None:
    drawn = replace(method, learning=AS_DRAWN.learning, start=AS_DRAWN.start, magnification=Off())
    assert follow(row_by_row, drawn)[0].readout is not None


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


def test_the_first_frame_is_measured_again_once_the_shutter_is_known(
    row_by_row: list[tuple[Frame, FloatArray]], monkeypatch: pytest.MonkeyPatch
) -> None:
    measured, real = list[bool](), SampleKnowledge.measure_offsets

    def spied(knowledge: SampleKnowledge, matches: object) -> None:
        measured.append(knowledge.readout is not None)
        real(knowledge, matches)  # type: ignore[arg-type]

    monkeypatch.setattr(SampleKnowledge, "measure_offsets", spied)
    # Of sharp edges at rest nothing is to be measured again but for the shutter.
    assert isinstance(AS_DRAWN.learning, SampleLearning)
    follow(row_by_row, replace(AS_DRAWN, learning=replace(AS_DRAWN.learning, blur=Off())))
    assert measured[0] is False
    assert any(measured[1:])
    assert len(measured) <= 6
