"""Several parts that are alike in one picture, as in a tray: each is found for itself."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import acp_lab as acp
from acp_lab.detection.view_templates import make_views
from acp_lab.errors import AcpLabError
from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.camera import Camera
from acp_lab.prepared_part import PreparedPart
from acp_lab.sequences.frame import Frame
from acp_lab.tracking.find import Finder, are_apart
from tests.made_parts import bracket, looking_at
from tests.tracking.rendered import add_percent, draw, prepared

CAMERA = Camera(width=480, height=360, fx=520.0, fy=520.0, cx=239.5, cy=179.5)
PART = bracket(shift=(0.0, 0.0, 0.0))


def at(x_diameters: float, y_diameters: float, eye: tuple[float, float, float], turn: float) -> FloatArray:
    """A pose (4, 4) so far from the middle of the picture."""
    pose = looking_at(PART, np.array(eye), 380.0, turn)
    pose[:2, 3] += np.array([x_diameters, y_diameters]) * PART.diameter
    return pose


TRAY = (
    at(-0.75, -0.45, (0.8, 0.6, 1.0), 0.3), at(0.05, -0.4, (0.8, 0.6, 1.0), 2.2), at(0.75, -0.3, (-0.7, 0.5, 1.0), 1.0),
    at(-0.5, 0.5, (0.6, -0.8, 0.9), 0.0), at(0.45, 0.5, (0.8, 0.6, 1.0), 4.0),
)  # fmt: skip


@cache
def model() -> PreparedPart:
    plain = prepared(PART)
    return replace(plain, views=make_views(PART, plain.best_generator()))


@cache
def finder() -> Finder:
    return Finder(model())


def picture(*poses: FloatArray) -> Frame:
    return Frame(0, draw([(PART, pose) for pose in poses], 1, CAMERA), CAMERA)


def test_each_is_found_where_it_lies() -> None:
    frame = picture(*TRAY)
    found = finder().find_each(frame)
    accepted = [one for one in found if one.is_accepted]
    nearest = [[add_percent(PART, one.cam_T_obj, truth) for truth in TRAY] for one in accepted]
    assert len(accepted) >= 4
    assert max(min(row) for row in nearest) < 5.0
    assert len({int(np.argmin(row)) for row in nearest}) == len(accepted)
    # Asked for the one that is meant, none is sure.
    assert not finder().find(frame)[0].is_accepted


def test_hypotheses_are_apart_and_the_best_comes_first() -> None:
    found = finder().find_each(picture(*TRAY[:3]))
    scores = [one.score for one in found]
    assert scores == sorted(scores, reverse=True)
    for k, one in enumerate(found):
        for other in found[:k]:
            assert are_apart(PART, CAMERA, other.cam_T_obj, one.cam_T_obj)
            assert are_apart(PART, CAMERA, one.cam_T_obj, other.cam_T_obj)
        centre = np.linalg.inv(one.cam_T_obj)[:3, 3]
        np.testing.assert_allclose(one.view_obj, (centre - PART.box_centre) / np.linalg.norm(centre - PART.box_centre))
    fewer = finder().find_each(picture(*TRAY[:3]), most=2)
    assert [one.score for one in fewer] == scores[:2]


def test_one_part_alone_is_one() -> None:
    found = finder().find_each(picture(TRAY[1]))
    accepted = [one for one in found if one.is_accepted]
    assert len(accepted) == 1
    assert add_percent(PART, accepted[0].cam_T_obj, TRAY[1]) < 5.0


@pytest.mark.parametrize("grey", [0, 128])
def test_where_nothing_is_nothing_is_accepted(grey: int) -> None:
    image = np.full((CAMERA.height, CAMERA.width, 3), grey, np.uint8)
    assert not any(one.is_accepted for one in finder().find_each(Frame(0, image, CAMERA)))


def test_it_is_in_the_package() -> None:
    assert len(acp.detect_each(model(), picture(*TRAY), most=3)) == 3
    with pytest.raises(AcpLabError):
        acp.detect_each(model(), np.zeros((10, 10, 3), np.uint8))  # type: ignore[arg-type]
