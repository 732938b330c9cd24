"""Which frames bring news: those where the part moved in the image, and those that fit worse."""

from __future__ import annotations

import numpy as np
import pytest

from acp_lab.cad.part import Part
from acp_lab.errors import TrackingError
from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.camera import Camera
from acp_lab.geometry.pose import make_pose
from acp_lab.tracking.learning.knowledge import Off, SampleLearning
from acp_lab.tracking.learning.novelty import Novelty
from tests.made_parts import box

CAMERA = Camera(640, 480, 800.0, 800.0, 319.5, 239.5)
PART: Part = box((40.0, 30.0, 20.0))
DEPTH_MM = 400.0
MM_PER_PX = (DEPTH_MM - 10.0) / 800.0
"""At the nearest corners of the box, which move farthest when it is shifted."""


def shifted(px: float, depth_mm: float = DEPTH_MM) -> FloatArray:
    return make_pose(np.eye(3), np.array([px * MM_PER_PX, 0.0, depth_mm]))


def test_a_part_that_stands_still_brings_news_once() -> None:
    novelty = Novelty(PART, 2.0)
    assert novelty.is_new(CAMERA, shifted(0.0), 0.8)
    assert not any(novelty.is_new(CAMERA, shifted(px), 0.8) for px in (0.0, 0.3, -0.3, 0.0))


def test_a_frame_is_compared_with_the_last_that_taught_so_that_slow_parts_teach_too() -> None:
    novelty = Novelty(PART, 2.0)
    taught = [px for px in np.arange(0.0, 8.1, 0.5) if novelty.is_new(CAMERA, shifted(px + 1e-6 * px), 0.8)]
    assert taught == [0.0, 2.0, 4.0, 6.0, 8.0]


def test_a_turn_and_a_way_off_are_moves() -> None:
    for moved in (make_pose(np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]]), shifted(0.0)[:3, 3]), shifted(0.0, 450.0)):
        novelty = Novelty(PART, 2.0)
        assert novelty.is_new(CAMERA, shifted(0.0), 0.8)
        assert novelty.is_new(CAMERA, moved, 0.8)


def test_what_fits_worse_than_the_last_that_taught_is_news() -> None:
    novelty = Novelty(PART, 2.0)
    assert novelty.is_new(CAMERA, shifted(0.0), 0.8)
    assert not novelty.is_new(CAMERA, shifted(0.0), 0.75)
    assert novelty.is_new(CAMERA, shifted(0.0), 0.7)
    assert not novelty.is_new(CAMERA, shifted(0.0), 0.7)
    assert not novelty.is_new(CAMERA, shifted(0.0), 0.9)  # better is nothing new


def test_another_lens_shows_the_part_elsewhere() -> None:
    novelty = Novelty(PART, 2.0)
    assert novelty.is_new(CAMERA, shifted(0.0), 0.8)
    assert novelty.is_new(Camera(640, 480, 900.0, 900.0, 319.5, 239.5), shifted(0.0), 0.8)


def test_corners_without_a_place_count_as_moved() -> None:
    novelty = Novelty(PART, 2.0)
    around_the_camera = shifted(0.0, 5.0)
    assert novelty.is_new(CAMERA, around_the_camera, 0.8)
    assert novelty.is_new(CAMERA, around_the_camera, 0.8)


def test_with_no_limit_every_frame_teaches() -> None:
    novelty = Novelty(PART, 0.0)
    assert all(novelty.is_new(CAMERA, shifted(0.0), 0.8) for _ in range(3))


@pytest.mark.parametrize("px", [-1.0, float("inf"), float("nan")])
def test_impossible_limits(px: float) -> None:
    with pytest.raises(TrackingError, match="learn_from_px"):
        SampleLearning(polarity=Off(), learn_from_px=px)
