"""The pose that painted edges show: a perfect painter's is the true one; what is painted too large seems nearer."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from acp_lab.errors import PreparationError
from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.pose import transform
from acp_lab.geometry.pose_step import move_pose
from acp_lab.prepared_part import PreparedPart
from acp_lab.studies.painting_bias import PaintingBench
from tests.made_parts import box, looking_at
from tests.tracking.drawn_part import drawn_part
from tests.tracking.rendered import CAMERA, prepared

SIZE = (60.0, 40.0, 20.0)


@pytest.fixture(scope="module")
def block() -> PreparedPart:
    return prepared(box(SIZE))


@pytest.fixture(scope="module")
def pose(block: PreparedPart) -> FloatArray:
    return looking_at(block.part, np.array([0.3, 0.4, 1.0]), 330.0, 0.3)


def test_a_perfect_painter_shows_the_true_pose(block: PreparedPart, pose: FloatArray) -> None:
    found = PaintingBench(drawn_part(block)).bias(CAMERA, pose)
    assert found.add_share < 0.002
    assert found.mean_off_px < 0.1
    assert len(found.edges) == len(found.off_px) > 100


def test_what_is_painted_too_large_seems_nearer(block: PreparedPart, pose: FloatArray) -> None:
    """The errors of its lines are fractions of a pixel, and all in the way of one pose."""
    larger = prepared(box((1.01 * SIZE[0], 1.01 * SIZE[1], 1.01 * SIZE[2])))
    found = PaintingBench(drawn_part(block, shown=larger)).bias(CAMERA, pose)
    nearer = transform(found.fitted, block.part.box_centre)[2] - transform(pose, block.part.box_centre)[2]
    assert nearer == pytest.approx(-3.3, abs=0.5)
    assert found.mean_off_px < 0.5
    assert found.add_share == pytest.approx(3.3 / block.part.diameter, rel=0.2)


def test_a_fit_finds_back_from_a_pose_beside(block: PreparedPart, pose: FloatArray) -> None:
    bench = PaintingBench(drawn_part(block))
    painted = bench.painted(bench.view(CAMERA, pose))
    beside = move_pose(pose, block.part.box_centre, np.array([0.006, -0.005, 0.004, 0.3, -0.2, 0.8]))
    np.testing.assert_allclose(bench.fit(painted, bench.view(CAMERA, beside)), pose, atol=0.4)


def test_a_region_that_was_not_trained_is_told(block: PreparedPart) -> None:
    bench = PaintingBench(drawn_part(block))
    with pytest.raises(PreparationError, match="view region 5 is not trained"):
        bench.view(CAMERA, looking_at(block.part, np.array([0.1, 0.0, -1.0]), 330.0, 0.0))
    with pytest.raises(PreparationError, match="--generator autoencoder"):
        PaintingBench(replace(block))
