"""Slices of e(I): lowest where the edges are, the same numbers as the solver's, steps that go down."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from acp_lab.errors import TrackingError
from acp_lab.geometry.pose import transform
from acp_lab.sequences.frame import Frame
from acp_lab.studies.landscape import CONTROL_COORDINATES, POSE_COORDINATES, LossSurface, Space
from acp_lab.tracking.solvers import GaussNewton, LevenbergMarquardt, Solver
from acp_lab.tracking.targets.distance_map import DistanceMeasure
from tests.prepared_sample import sample_model, sample_scene

U, V = CONTROL_COORDINATES[:2]


@cache
def surface() -> LossSurface:
    frame = sample_scene().frame(0)
    assert isinstance(frame, Frame)
    return LossSurface(sample_model(), frame, sample_scene().first_pose, edges=200)


def test_the_least_loss_is_near_the_true_points() -> None:
    over = surface().slice("control-points", U, V, (16.0, 16.0), 9)
    values = over.values("geman-mcclure", surface().alpha_px)
    assert values.shape == (9, 9)
    row, column = np.unravel_index(values.argmin(), values.shape)
    assert abs(over.offsets_u[column]) <= 4.0
    assert abs(over.offsets_v[row]) <= 4.0
    assert values.max() > 1.5 * values.min()


@pytest.mark.parametrize("space", ["control-points", "pose"])
def test_slices_and_solver_agree(space: Space) -> None:
    """The grid's value is the loss that the solver's own measure gives for the same edges."""
    coordinates = LossSurface.coordinates(space)
    u, v = coordinates[1], coordinates[3]
    over = surface().slice(space, u, v, (3.0, 2.0), 3)
    step = np.zeros(len(coordinates))
    step[u.index], step[v.index] = 3.0 * u.unit_step, -2.0 * v.unit_step
    measured = DistanceMeasure(surface().target, "tukey", 6.0)(surface().edges_at(space, step))
    assert over.values("tukey", 6.0)[0, 2] == pytest.approx(measured.loss, rel=1e-5)


@pytest.mark.parametrize("space", ["control-points", "pose"])
@pytest.mark.parametrize("solver", [GaussNewton(steps=10), LevenbergMarquardt(steps=10)], ids=lambda s: s.kind)
def test_the_way_goes_down_from_its_start(space: Space, solver: Solver) -> None:
    offsets = np.zeros(8 if space == "control-points" else 6)
    offsets[:2] = (6.0, -5.0) if space == "control-points" else (0.05, -0.04)
    way = surface().descend(space, offsets, "geman-mcclure", (surface().alpha_px,), solver)
    np.testing.assert_allclose(way.offsets[0], offsets, atol=1e-9)
    assert len(way.loss) == len(way.offsets) > 3
    measure = DistanceMeasure(surface().target, "geman-mcclure", surface().alpha_px)
    first, last = (measure(surface().edges_at(space, way.offsets[k])).loss for k in (0, -1))
    assert last < 0.9 * first


def test_the_printed_form_is_looked_at_and_breaks_nothing() -> None:
    over = surface().slice("control-points", U, V, (16.0, 16.0), 5)
    assert over.values("printed", 5.0).min() < 0.0  # beyond the pole
    way = surface().descend("control-points", np.full(8, 3.0), "printed", (5.0,), GaussNewton(steps=6))
    assert np.isfinite(way.offsets).all()


def test_images_as_the_reference_code_compares_them_agree_best_where_the_part_is() -> None:
    values = surface().image_values("pose", POSE_COORDINATES[3], POSE_COORDINATES[4], (8.0, 8.0), 5)
    assert np.unravel_index(values.argmin(), values.shape) == (2, 2)


def test_degenerate_points_leave_a_hole_in_the_map() -> None:
    # Far enough for point 1 to cross the line through its neighbours: no homography right there, and NaN.
    across = surface().control_points[[1, 3]].mean(0) - surface().control_points[0]
    over = surface().slice("control-points", U, V, (abs(across[0]), abs(across[1])), 3)
    assert np.isnan(over.values("tukey", 6.0)).sum() == 1


def test_alpha_is_a_share_of_the_projected_diameter() -> None:
    frame, pose, model = sample_scene().frame(0), sample_scene().first_pose, sample_model()
    assert isinstance(frame, Frame)
    depth = float(transform(pose, model.part.box_centre)[2])
    projected_px = model.part.diameter * frame.camera.fx / depth
    assert surface().alpha_px == pytest.approx(0.07 * projected_px)
    wide = LossSurface(model, frame, pose, edges=200, alpha=0.14)
    assert wide.alpha_px == pytest.approx(0.14 * projected_px)
    for alpha in (0.0, -0.1, 1.5, float("nan")):
        with pytest.raises(TrackingError, match="a share of the diameter"):
            LossSurface(model, frame, pose, alpha=alpha)


def test_a_part_outside_the_frame_has_no_landscape() -> None:
    frame = sample_scene().frame(0)
    assert isinstance(frame, Frame)
    away = sample_scene().first_pose.copy()
    away[0, 3] += 600.0
    with pytest.raises(TrackingError, match="fewer than 20 edge points"):
        LossSurface(sample_model(), frame, away)
