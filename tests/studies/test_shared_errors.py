"""What two trackers have in common: made tracks in which that is known."""

from __future__ import annotations

import numpy as np
import pytest

from acp_lab.cad.part import Part
from acp_lab.errors import ParameterError
from acp_lab.geometry.arrays import FloatArray
from acp_lab.studies.shared_errors import joined, shared_errors, shifted_in_depth
from tests.made_parts import box

Track = dict[int, FloatArray]
COUNT = 60


@pytest.fixture(scope="module")
def part() -> Part:
    mesh = box((40.0, 30.0, 20.0))
    return Part.from_mesh(mesh.vertices, mesh.faces, "block")


def place(time: float) -> FloatArray:
    """(3,) mm: back and forth on all three axes, each at a pace of its own."""
    return np.array([20.0 * np.sin(time / 5.0), 15.0 * np.cos(time / 7.0), 400.0 + 50.0 * np.sin(time / 6.0)])


def track(depth_lead: float = 0.0, noise_mm: FloatArray | float = 0.0) -> Track:
    """Poses whose depth is that of `depth_lead` frames later."""
    poses = {}
    for number in range(COUNT):
        pose = np.eye(4)
        pose[:3, 3] = place(number)
        pose[2, 3] = place(number + depth_lead)[2]
        pose[:3, 3] += noise_mm if isinstance(noise_mm, float) else noise_mm[number]
        poses[number] = pose
    return poses


def noise(seed: int) -> FloatArray:
    return np.random.default_rng(seed).normal(0.0, 0.4, (COUNT, 3))


def test_a_truth_whose_depth_is_late_is_told_by_both(part: Part) -> None:
    truth, first, second = track(), track(0.4, noise(1)), track(0.4, noise(2))
    found = shared_errors(part, truth, first, second)
    assert found.correlation[2] > 0.9
    assert np.abs(found.correlation[:2]).max() < 0.5
    for lead in (found.first_lead, found.second_lead):
        assert lead[2] == pytest.approx(0.4, abs=0.03)
        assert np.abs(lead[:2]).max() < 0.1
    assert np.median(found.apart) < 0.5 * np.median(found.first)
    to_second = found.depth_shifts[1]
    moved = shared_errors(part, shifted_in_depth(truth, to_second, part), first, second)
    assert np.median(moved.first) < 0.5 * np.median(found.first)


def test_trackers_that_err_on_their_own_say_nothing_of_the_truth(part: Part) -> None:
    truth, first, second = track(), track(noise_mm=noise(1)), track(noise_mm=noise(2) + np.array([0.0, 0.0, 3.0]))
    found = shared_errors(part, truth, first, second)
    assert np.abs(found.correlation).max() < 0.5
    assert found.depth_shifts[1].offset_mm == pytest.approx(3.0, abs=0.2)
    moved = shared_errors(part, shifted_in_depth(truth, found.depth_shifts[1], part), first, second)
    assert np.median(moved.first) > 2.0 * np.median(found.first)


def test_a_part_at_rest_has_no_lead(part: Part) -> None:
    rest = {number: track()[0] for number in range(5)}
    beside = {number: pose.copy() for number, pose in rest.items()}
    beside[3][2, 3] += 1.0
    found = shared_errors(part, rest, beside, beside)
    assert np.isnan(found.first_lead).all()
    assert found.correlation[2] == pytest.approx(1.0)
    assert np.isnan(found.correlation[0])
    assert found.depth_shifts[0].frames == 0.0


def test_only_frames_that_all_three_know_count(part: Part) -> None:
    truth, first, second = track(), track(), track()
    del truth[10], first[20], second[30]
    found = shared_errors(part, truth, first, second)
    assert len(found.apart) == COUNT - 3
    assert np.isnan(found.motion_mm).any(1).sum() == 4  # at the ends, and beside what the truth lacks
    assert len(joined([found, found]).first_mm) == 2 * len(found.first_mm)
    with pytest.raises(ParameterError, match="2 frames"):
        shared_errors(part, truth, {1: first[1], 2: first[2]}, second)
