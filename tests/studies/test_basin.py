"""Basins of convergence of made-up alignments whose reach is known."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from acp_lab.cad.models_info import Symmetries
from acp_lab.errors import SequenceError, TrackingError
from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.camera import Camera
from acp_lab.geometry.pose import make_pose, rotation_angle_deg, so3_exp, transform
from acp_lab.sequences.frame import Frame
from acp_lab.studies.basin import BasinConfig, align_with, basin_of_convergence
from tests.made_parts import bracket, looking_at

PART = bracket(shift=(10.0, 20.0, 0.0))
FRAMES = [Frame(i, np.zeros((8, 8, 3), np.uint8), Camera(8, 8, 9.0, 9.0, 3.5, 3.5)) for i in (3, 4)]
TRUTHS = [looking_at(PART, direction, 300.0) for direction in np.eye(3)[:2]]
CONFIG = BasinConfig(angles_deg=(0.0, 2.0, 5.0), shifts_mm=(0.0, 4.0), trials=3)


def truth_of(frame: Frame) -> FloatArray:
    return TRUTHS[frame.index - 3]


def finds_within_3_deg(frame: Frame, start_T_obj: FloatArray) -> FloatArray:
    """The truth from starts within 3 degrees; where it was from others."""
    truth = truth_of(frame)
    return truth if rotation_angle_deg(start_T_obj[:3, :3], truth[:3, :3]) < 3.0 else start_T_obj


def test_the_share_is_one_inside_the_reach_and_zero_outside() -> None:
    told: list[tuple[int, int]] = []
    basin = basin_of_convergence(
        finds_within_3_deg, PART, FRAMES, TRUTHS, CONFIG, "fake", progress=lambda *at: told.append(at)
    )
    np.testing.assert_array_equal(basin.share, [[1.0, 1.0], [1.0, 1.0], [0.0, 0.0]])
    assert basin.volume == pytest.approx(4.0 / 6.0)
    assert basin.errors.shape == (3, 2, 6)
    assert told[-1] == (36, 36)
    assert "fake: % of 6 trials within 2%" in str(basin)
    assert str(basin).splitlines()[-1].split() == ["5", "0", "0"]


def test_starts_are_as_far_off_as_asked_and_the_same_for_every_method() -> None:
    starts: list[FloatArray] = []

    def stays(frame: Frame, start_T_obj: FloatArray) -> FloatArray:
        truth = truth_of(frame)
        centre = [transform(pose, PART.box_centre) for pose in (start_T_obj, truth)]
        off = rotation_angle_deg(start_T_obj[:3, :3], truth[:3, :3]), float(np.linalg.norm(centre[0] - centre[1]))
        starts.append(np.array(off))
        return start_T_obj

    first = basin_of_convergence(stays, PART, FRAMES, TRUTHS, CONFIG, seed=1)
    asked = [(a, s) for a in CONFIG.angles_deg for s in CONFIG.shifts_mm for _ in range(6)]
    np.testing.assert_allclose(starts, asked, atol=1e-6)
    again = basin_of_convergence(stays, PART, FRAMES, TRUTHS, CONFIG, seed=1)
    other = basin_of_convergence(stays, PART, FRAMES, TRUTHS, CONFIG, seed=2)
    np.testing.assert_array_equal(first.errors, again.errors)
    assert not np.array_equal(first.errors, other.errors)
    np.testing.assert_allclose(first.errors[0, 1] * PART.diameter, 4.0)


def test_a_tracking_error_and_a_pose_that_is_none_are_failures() -> None:
    def breaks(frame: Frame, start_T_obj: FloatArray) -> FloatArray:
        if frame.index == 3:
            raise TrackingError("the part is not seen: start nearer")
        return np.full((4, 4), np.nan)

    basin = basin_of_convergence(breaks, PART, FRAMES, TRUTHS, CONFIG)
    assert (basin.share == 0.0).all()
    assert np.isinf(basin.errors).all()


def test_a_symmetric_part_is_scored_by_the_nearest_points() -> None:
    half_turn = make_pose(so3_exp(np.array([0.0, 0.0, np.pi])), np.zeros(3))
    square = np.array([[20.0, 20, 5], [-20, -20, 5], [20, -20, 0], [-20, 20, 0.0]])
    part = replace(PART, vertices=square, symmetries=Symmetries(half_turn))
    config = BasinConfig(angles_deg=(0.0,), shifts_mm=(0.0,), trials=1)
    basin = basin_of_convergence(lambda frame, _: truth_of(frame) @ half_turn, part, FRAMES, TRUTHS, config)
    assert basin.share[0, 0] == 1.0


def test_frames_and_truths_must_pair_up() -> None:
    for frames, truths in (([], []), (FRAMES, TRUTHS[:1])):
        with pytest.raises(SequenceError, match="one true pose for each"):
            basin_of_convergence(finds_within_3_deg, PART, frames, truths, CONFIG)


def test_a_tracker_becomes_an_alignment_by_starting_anew() -> None:
    class Halves:
        """Halves its distance at each call."""

        def __init__(self) -> None:
            self.calls: list[str] = []
            made.append(self)

        def start(self, frame: Frame, cam_T_obj: FloatArray) -> Any:
            self.calls.append("start")
            self.pose = cam_T_obj
            return SimpleNamespace(cam_T_obj=self.pose)

        def track(self, frame: Frame) -> Any:
            self.calls.append("track")
            self.pose = 0.5 * (self.pose + truth_of(frame))
            return SimpleNamespace(cam_T_obj=self.pose)

    made: list[Halves] = []
    align = align_with(Halves, again=2)  # type: ignore[arg-type]
    start = TRUTHS[0].copy()
    start[0, 3] += 8.0
    assert align(FRAMES[0], start)[0, 3] - TRUTHS[0][0, 3] == pytest.approx(2.0)
    align(FRAMES[1], start)
    assert [tracker.calls for tracker in made] == [["start", "track", "track"]] * 2
