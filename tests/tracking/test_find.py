"""A part in a frame, without a pose to start from."""

from __future__ import annotations

import itertools
from dataclasses import replace
from functools import cache

import cv2
import numpy as np
import pytest

import acp_lab as acp
from acp_lab.detection.config import DetectionConfig
from acp_lab.detection.pose_prior import PosePrior
from acp_lab.detection.work import finish
from acp_lab.errors import PreparationError
from acp_lab.geometry.camera import Camera
from acp_lab.geometry.pose import transform
from acp_lab.sequences.frame import Frame
from acp_lab.tracking.find import ACCEPTED, Finder, _most_times, detect
from benchmarks.part_sizes import scaled
from tests.made_parts import looking_at
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
    centre_cam = transform(found[0].cam_T_obj, part.box_centre)
    assert found[0].cam_T_obj[:3, :3] @ found[0].view_obj == pytest.approx(
        -centre_cam / np.linalg.norm(centre_cam), abs=1e-9
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


def test_a_rival_competes_with_what_is_found() -> None:
    """A pose that is no candidate is judged beside them: a good one wins, a poor one takes nothing away."""
    frame = sample_frame(0)
    truth = sample_scene().truth(frame.index, 1)
    assert truth is not None
    finder = sample_finder()
    beside = truth.copy()
    beside[0, 3] += 0.8 * finder.model.part.diameter
    prior = PosePrior(beside, 20.0, 1.05, 20.0)  # nothing of the part is near it
    alone = finish(finder.search(frame, 3, prior))
    with_truth = finish(finder.search(frame, 3, PosePrior(beside, 20.0, 1.05), rival=truth))
    assert not any(finder.is_same(one.cam_T_obj, (truth,)) for one in alone)
    assert finder.is_same(with_truth[0].cam_T_obj, (truth,))
    first = finder.find(frame, 1)[0]
    with_beside = finish(finder.search(frame, 3, rival=beside))
    assert finder.is_same(with_beside[0].cam_T_obj, (truth,))
    assert with_beside[0].score == pytest.approx(first.score, abs=0.01)


def test_not_there() -> None:
    frame = sample_frame(0)
    empty = np.full_like(frame.image, 128)
    assert sample_finder().find(replace(frame, image=empty)) == ()
    noise = np.random.default_rng(3).integers(0, 255, frame.image.shape).astype(np.uint8)
    assert not any(one.is_accepted for one in sample_finder().find(replace(frame, image=noise)))


@pytest.mark.parametrize("kind", ["blurred away", "tiny", "part larger than the image", "one row", "far too near"])
def test_images_in_which_it_cannot_be_found(kind: str) -> None:
    """No traceback, and nothing is accepted."""
    frame, finder = sample_frame(0), sample_finder()
    truth = sample_scene().truth(frame.index, 1)
    assert truth is not None
    x, y = np.rint(frame.camera.project(transform(truth, sample_model().part.box_centre[None]))[0]).astype(int)
    boxes = {"tiny": (8, 6), "part larger than the image": (48, 40), "one row": (90, 1)}
    if kind == "blurred away":
        small = cv2.resize(cv2.GaussianBlur(frame.image, (0, 0), 40.0), (160, 128))
        frame = replace(frame, image=small, camera=frame.camera.halved().halved())
    elif kind == "far too near":
        finder = Finder(sample_model(), DetectionConfig(depth_mm=(1.0, 2.0)))
    else:
        wide, high = boxes[kind]
        image = np.ascontiguousarray(frame.image[y : y + high, x : x + wide])
        frame = replace(frame, image=image, camera=frame.camera.cropped(int(x), int(y), wide, high))
    assert not any(one.is_accepted for one in finder.find(frame, 2))


def test_a_part_prepared_before_views_were_stored() -> None:
    """They are made when they are asked for, and are the same."""
    old = Finder(replace(sample_model(), views=None))
    old.prepare()
    frame = sample_frame(0)
    truth = sample_scene().truth(frame.index, 1)
    assert truth is not None
    prior = PosePrior(truth, 20.0, 1.1, 30.0)
    (first,), (second,) = (finder.find(frame, 1, prior) for finder in (old, sample_finder()))
    assert first.cam_T_obj == pytest.approx(second.cam_T_obj, abs=1e-6)


@pytest.mark.parametrize("size_px", [75.0, 50.0])
def test_a_small_part_is_found(size_px: float) -> None:
    """In the frame as it is, a median takes out half of such a part, and below 60 px nothing is scanned."""
    frame = sample_frame(0)
    truth = sample_scene().truth(frame.index, 1)
    assert truth is not None
    part, finder = sample_model().part, sample_finder()
    now_px = part.diameter * frame.camera.fx / transform(truth, part.box_centre)[2]
    small = scaled(frame, float(size_px / now_px))
    for prior in (None, PosePrior(truth, 20.0, 1.1), PosePrior(truth, 20.0, 1.1, 30.0)):
        found = finder.find(small, 1, prior)[0]
        assert found.is_accepted
        error = np.linalg.norm(transform(found.cam_T_obj, part.vertices) - transform(truth, part.vertices), axis=1)
        assert error.mean() < 0.04 * part.diameter


def test_a_small_part_beside_the_image_does_not_disturb_a_search() -> None:
    """Magnified is what lies in the image of where it may be: nothing, perhaps."""
    frame = sample_frame(0)
    truth = sample_scene().truth(frame.index, 1)
    assert truth is not None
    small, away = scaled(frame, 0.25), truth.copy()
    away[0, 3] += 2000.0
    behind = truth.copy()
    behind[2, 3] -= 2.0 * truth[2, 3]
    for pose in (away, behind):
        assert not any(one.is_accepted for one in sample_finder().find(small, 1, PosePrior(pose, 20.0, 1.1, 30.0)))


def test_a_whole_large_image_is_not_magnified_beyond_measure() -> None:
    frame = Frame(0, np.zeros((3000, 4000, 3), np.uint8), Camera(4000, 3000, 4000.0, 4000.0, 1999.5, 1499.5))
    assert _most_times(frame.camera) == 1
    assert _most_times(frame.camera, 150.0) >= 4
    pose = looking_at(sample_model().part, np.array([0.8, 0.6, 1.0]), 5000.0, 0.3)
    (looked,) = finish(sample_finder()._looks_near(frame, PosePrior(pose, 20.0, 1.1)))
    assert looked.times == 1
    (looked,) = finish(sample_finder()._looks_near(frame, PosePrior(pose, 20.0, 1.1, 30.0)))
    assert looked.times > 1
    # Where nothing is left of the place all of the image is searched, as it is.
    away = pose.copy()
    away[0, 3] += 2200.0 * pose[2, 3] / frame.camera.fx
    (looked,) = finish(sample_finder()._looks_near(frame, PosePrior(away, 20.0, 1.1, 30.0)))
    assert looked.times == 1


def test_a_large_part_is_aligned_in_a_smaller_image() -> None:
    """The frame enlarged: the part appears three times as large, and is found as well near a prior."""
    frame = sample_frame(0)
    truth = sample_scene().truth(frame.index, 1)
    assert truth is not None
    camera, part = frame.camera, sample_model().part
    fx, fy, cx, cy = 3.0 * camera.fx, 3.0 * camera.fy, 3.0 * camera.cx + 1.0, 3.0 * camera.cy + 1.0
    large = Camera(3 * camera.width, 3 * camera.height, fx, fy, cx, cy)
    image = cv2.resize(frame.image, (large.width, large.height), interpolation=cv2.INTER_CUBIC)
    assert part.diameter * fx / transform(truth, part.box_centre)[2] > 500.0
    work = list(sample_finder().search(replace(frame, image=image, camera=large), 1, PosePrior(truth, 20.0, 1.1, 30.0)))
    assert max(work) < 15_000.0
    (found,) = sample_finder().find(replace(frame, image=image, camera=large), 1, PosePrior(truth, 20.0, 1.1, 30.0))
    error = np.linalg.norm(transform(found.cam_T_obj, part.vertices) - transform(truth, part.vertices), axis=1)
    assert error.mean() < 0.05 * part.diameter


def test_in_the_package() -> None:
    assert acp.detect is detect


def test_a_part_without_generator() -> None:
    with pytest.raises(PreparationError, match="acp-lab prepare"):
        Finder(replace(sample_model(), templates=None))
