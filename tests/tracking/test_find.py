"""A part in a frame, without a pose to start from."""

from __future__ import annotations

import itertools
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import acp_lab as acp
from acp_lab.errors import PreparationError
from acp_lab.geometry.pose import transform
from acp_lab.sequences.frame import Frame
from acp_lab.tracking.find import ACCEPTED, Finder, detect
from tests.prepared_sample import sample_model, sample_scene


@cache
def sample_finder() -> Finder:
    return Finder(sample_model())


def sample_frame(number: int) -> Frame:
    frame = sample_scene().frame(sample_scene().frame_ids[number])
    assert isinstance(frame, Frame)
    return frame


@pytest.mark.parametrize("number", [0, 12])
def test_found_in_the_sample(number: int) -> None:
    frame = sample_frame(number)
    truth = sample_scene().truth(frame.index, 1)
    assert truth is not None
    part = sample_model().part
    found = sample_finder().find(frame)
    assert 1 <= len(found) <= 3
    assert [one.score for one in found] == sorted((one.score for one in found), reverse=True)
    error = np.linalg.norm(transform(found[0].cam_T_obj, part.vertices) - transform(truth, part.vertices), axis=1)
    assert error.mean() < 0.05 * part.diameter
    assert found[0].is_accepted
    assert found[0].score >= ACCEPTED
    assert found[0].cam_T_obj[:3, :3] @ found[0].view_obj == pytest.approx(
        -found[0].cam_T_obj[:3, 3] / np.linalg.norm(found[0].cam_T_obj[:3, 3]), abs=1e-9
    )
    points = sample_finder()._points_obj
    for first, second in itertools.pairwise(found):
        apart = np.linalg.norm(transform(first.cam_T_obj, points) - transform(second.cam_T_obj, points), axis=1)
        assert apart.mean() > 0.1 * part.diameter


def test_the_same_image_gives_the_same_answer() -> None:
    frame = sample_frame(5)
    first, second = (sample_finder().find(frame, 2) for _ in range(2))
    assert [one.score for one in first] == [one.score for one in second]
    assert all(np.array_equal(a.cam_T_obj, b.cam_T_obj) for a, b in zip(first, second, strict=True))


def test_not_there() -> None:
    frame = sample_frame(0)
    empty = np.full_like(frame.image, 128)
    assert sample_finder().find(replace(frame, image=empty)) == ()
    noise = np.random.default_rng(3).integers(0, 255, frame.image.shape).astype(np.uint8)
    assert not any(one.is_accepted for one in sample_finder().find(replace(frame, image=noise)))


def test_in_the_package() -> None:
    assert acp.detect is detect


def test_a_part_without_generator() -> None:
    with pytest.raises(PreparationError, match="acp-lab prepare"):
        Finder(replace(sample_model(), templates=None))
