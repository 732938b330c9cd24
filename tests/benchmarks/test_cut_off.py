"""Which box of a picture is left when its border cuts a part off."""

from __future__ import annotations

import numpy as np
import pytest

from acp_lab.geometry.pose import transform
from acp_lab.sequences.frame import Frame
from benchmarks.cut_off import MEDIAN_BEYOND, MOST_BEYOND, PASSING_BEYOND, SIDES, _beyond, _cut, _passing, _staying
from tests.made_parts import bracket, looking_at
from tests.tracking.rendered import CAMERA, draw

SEEN = [np.clip((np.arange(201.0) - first) / 60.0, 0.0, 1.0) for first in (50, 55, 60, 65, 70)]
"""Of a part 60 px wide that drifts away from a side: the share of its silhouette within so many px from there."""


def test_a_border_that_stays_cuts_off_forty_per_cent_in_the_middle_frame() -> None:
    borders = _staying(np.array(SEEN))
    assert len(set(borders.tolist())) == 1
    assert SEEN[2][borders[0]] == pytest.approx(MEDIAN_BEYOND, abs=0.01)
    # Nearer to the side, where else a frame would lose more than is allowed.
    wide = [*SEEN[1:], np.clip(np.arange(201.0) / 60.0, 0.0, 1.0)]
    assert wide[-1][_staying(np.array(wide))[0]] == pytest.approx(MOST_BEYOND, abs=0.02)


def test_a_border_that_passes_comes_in_and_goes_out_again() -> None:
    shares = [row[at] for row, at in zip(SEEN, _passing(np.array(SEEN)), strict=True)]
    assert shares[0] == shares[-1] == 0.0
    assert shares[2] == pytest.approx(PASSING_BEYOND, abs=0.02)
    assert 0.0 < shares[1] < shares[2]
    assert 0.0 < shares[3] < shares[2]


@pytest.mark.parametrize("side", SIDES)
def test_what_is_left_shows_the_part_where_it_was(side: str) -> None:
    part = bracket()
    pose = looking_at(part, np.array([0.8, 0.6, 1.0]), 330.0, 0.3)
    frame = Frame(0, draw([(part, pose)]), CAMERA)
    beyond = _beyond(part, frame, pose, side)
    assert beyond[0] == 0.0
    assert beyond[-1] == pytest.approx(1.0)
    at = int(np.searchsorted(beyond, 0.4))
    cut = _cut(frame, side, at, 1.0 - beyond[at], in_sight=0.5)
    width, height = cut.frame.camera.width, cut.frame.camera.height
    assert cut.frame.image.shape == (height, width, 3)
    assert (CAMERA.width - width) + (CAMERA.height - height) == at
    assert cut.shown == pytest.approx(0.6, abs=0.05)
    assert cut.counts == (0.5 * cut.shown >= 0.3)
    # A corner of the box that is left has the grey that it had.
    vertices = transform(pose, part.vertices)
    before, after = (np.rint(camera.project(vertices)).astype(int) for camera in (CAMERA, cut.frame.camera))
    left = (after >= 0).all(1) & (after < (width, height)).all(1)
    assert left.any()
    np.testing.assert_array_equal(
        cut.frame.image[after[left, 1], after[left, 0]], frame.image[before[left, 1], before[left, 0]]
    )
