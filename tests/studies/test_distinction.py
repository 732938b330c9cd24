"""What tells two poses apart in a picture."""

from __future__ import annotations

import numpy as np
import pytest

from acp_lab.cad.edges import sample_edges
from acp_lab.cad.raycast import make_caster
from acp_lab.geometry.camera import Camera
from acp_lab.geometry.pose import make_pose, so3_exp
from acp_lab.studies.distinction import Contest, shaded_picture, tells_apart
from tests.made_parts import looking_at
from tests.studies.pocket_block import block_with_a_pocket

PART = block_with_a_pocket()
EDGES, CASTER = sample_edges(PART), make_caster(PART)
CAMERA = Camera(200, 200, 700.0, 700.0, 99.5, 99.5)
RIGHT = looking_at(PART, np.array([0.1, -0.05, 1.0]), 250.0)
# The block turned by half about its long axis: the pocket goes to the far side.
WRONG = RIGHT @ make_pose(so3_exp(np.array([np.pi, 0.0, 0.0])), np.zeros(3))


def test_the_picture_shows_the_part_lit_on_a_dark_ground() -> None:
    picture = shaded_picture(PART, CASTER, CAMERA, RIGHT)
    assert picture.shape == (200, 200)
    assert picture[0, 0] == 20
    assert picture[100, 100] > 100
    assert len(np.unique(picture)) >= 3


def test_a_contour_is_nearly_blind_where_edges_see() -> None:
    picture = shaded_picture(PART, CASTER, CAMERA, RIGHT)
    found = tells_apart(PART, EDGES, CASTER, picture, CAMERA, RIGHT, WRONG)
    # The pocket is a quarter of the edges; the wrong pose does not show it at all, so it must explain the image.
    assert abs(found.outline.margin_px) < 1.0
    assert found.image.margin_px > 3.0 * abs(found.outline.margin_px)
    assert found.image.right_px < 1.0
    assert "right" in str(found)


def test_a_pose_beside_the_part_loses_by_every_measure() -> None:
    picture = shaded_picture(PART, CASTER, CAMERA, RIGHT)
    beside = RIGHT.copy()
    beside[0, 3] += 15.0
    found = tells_apart(PART, EDGES, CASTER, picture, CAMERA, RIGHT, beside)
    assert min(found.outline.margin_px, found.edges.margin_px, found.image.margin_px) > 1.0


def test_an_empty_image_gives_every_pose_the_cap() -> None:
    blank = np.full((200, 200), 90, np.uint8)
    found = tells_apart(PART, EDGES, CASTER, blank, CAMERA, RIGHT, WRONG, cap_share=0.05)
    cap = 0.05 * CAMERA.fx * PART.diameter / RIGHT[2, 3]
    for contest in (found.outline, found.edges, found.image):
        assert contest.right_px == pytest.approx(cap, rel=0.02)
        assert contest.margin_px == pytest.approx(0.0, abs=0.3)


def test_the_margin_is_what_the_wrong_pose_loses_by() -> None:
    assert Contest(1.0, 3.5).margin_px == 2.5
