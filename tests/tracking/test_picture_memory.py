"""A picture kept from frame to frame corrects a predicted pose by where it is found, and by nothing else."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from acp_lab.geometry.arrays import ByteImage, FloatArray
from acp_lab.geometry.pose import make_pose, transform
from acp_lab.sequences.frame import Frame
from acp_lab.tracking.method import ACP
from acp_lab.tracking.picture import PictureSearch
from acp_lab.tracking.picture_memory import PictureMemory
from tests.made_parts import box
from tests.tracking.rendered import CAMERA

PART = box()
POSE = make_pose(np.eye(3), np.array([0.0, 0.0, 250.0]) - PART.box_centre)


@pytest.fixture
def scene(rng: np.random.Generator) -> ByteImage:
    """Coloured blobs of some px, everywhere."""
    coarse = rng.integers(0, 255, (40, 54, 3)).astype(np.uint8)
    size = CAMERA.width, CAMERA.height
    return np.asarray(cv2.resize(coarse, size, interpolation=cv2.INTER_CUBIC), np.uint8)


def centre_px(pose: FloatArray) -> FloatArray:
    return CAMERA.project(transform(pose, PART.box_centre[None]))[0]


def corrected(memory: PictureMemory, later: Frame, px: float = 1.0) -> FloatArray:
    """(2,) px: by how much the picture moved the prediction of a part that rested."""
    predictor = ACP.prediction.predictor(PART.box_centre)
    predictor.restart(POSE)
    memory.correct(predictor, later, px)
    return centre_px(predictor.predict()) - centre_px(POSE)


def test_the_prediction_goes_where_the_picture_went(scene: ByteImage) -> None:
    memory = PictureMemory(PART, PictureSearch())
    into = np.array([[1.0, 0.0, 16.0], [0.0, 1.0, -9.0]])
    size = CAMERA.width, CAMERA.height
    later = Frame(1, np.asarray(cv2.warpAffine(scene, into, size), np.uint8), CAMERA)
    np.testing.assert_array_equal(corrected(memory, later), 0.0, "there is no picture yet")
    memory.take(Frame(0, scene, CAMERA), POSE)
    went = corrected(memory, later)
    assert went @ (16.0, -9.0) > 0.5 * (16.0**2 + 9.0**2)
    assert abs(went @ (9.0, 16.0)) < 2.0 * np.hypot(9.0, 16.0)
    np.testing.assert_array_equal(corrected(memory, Frame(1, scene, CAMERA)), 0.0, "edges see that better")
    zoomed = Frame(1, later.image, replace(CAMERA, fx=1.1 * CAMERA.fx))
    np.testing.assert_array_equal(corrected(memory, zoomed), 0.0, "another camera")
    memory.forget()
    np.testing.assert_array_equal(corrected(memory, later), 0.0)


def test_where_edges_are_seen_in_larger_px_the_picture_is_less_exact(scene: ByteImage) -> None:
    memory = PictureMemory(PART, PictureSearch())
    into = np.array([[1.0, 0.0, 16.0], [0.0, 1.0, 0.0]])
    size = CAMERA.width, CAMERA.height
    later = Frame(1, np.asarray(cv2.warpAffine(scene, into, size), np.uint8), CAMERA)
    memory.take(Frame(0, scene, CAMERA), POSE)
    went = [corrected(memory, later, px)[0] for px in (1.0, 2.0, 3.0)]
    assert went[0] > 1.1 * went[1] > 0.0
    assert went[2] == 0.0, "edges see that better"
