"""The sensitivity study: its derivatives against differences, its numbers on cases that are known."""

from __future__ import annotations

import math

import numpy as np
import pytest

from acp_lab.cad.edges import sample_edges
from acp_lab.cad.raycast import make_caster
from acp_lab.control_points.coplanar_points import mid_section_points
from acp_lab.control_points.motion_pairs import stroke_ends, view_frame, visible_rows
from acp_lab.control_points.view_regions import ALL_REGIONS, choose_region
from acp_lab.geometry.camera import Camera
from acp_lab.geometry.homography import apply_homography, homography_from_points
from acp_lab.geometry.pose import transform
from acp_lab.geometry.pose_step import move_pose
from acp_lab.studies.sensitivity import ALONE, Behaviour, SensitivityConfig, SensitivityStudy, sensitivity_study
from tests.made_parts import bracket

PART = bracket(shift=(30.0, -10.0, 5.0))
EDGES, CASTER = sample_edges(PART), make_caster(PART)
CONFIG = SensitivityConfig(views=12, points=150, random_motions=3)


@pytest.fixture(scope="module")
def study() -> SensitivityStudy:
    return sensitivity_study(PART, EDGES, CASTER, CONFIG, seed=1)


def test_shapes_and_names(study: SensitivityStudy) -> None:
    assert [one.name for one in study.sets] == ["pose", "balanced pose", "points, homography", "points, rigid"]
    assert study.motions.shape == (12, ALONE + 3, 6)
    for one in study.sets:
        p = len(one.parameters)
        assert one.sensitivity.shape == (12, p)
        assert one.condition.shape == (12,)
        assert one.truths.shape == one.gradients.shape == one.steps.shape == (12, 9, p)
        assert (np.abs(one.gradient_cosine) <= 1.0 + 1e-9).all()
        assert ((one.step_signs >= 0.0) & (one.step_signs <= 1.0)).all()
    with pytest.raises(KeyError, match="one of pose"):
        study["quaternion"]


def test_motions_have_the_asked_size(study: SensitivityStudy) -> None:
    turns, shifts = (np.linalg.norm(half, axis=-1) for half in np.split(study.motions, 2, axis=-1))
    turn = math.radians(CONFIG.turn_deg)
    np.testing.assert_allclose(turns, np.broadcast_to([turn] * 3 + [0.0] * 3 + [turn] * 3, (12, 9)), atol=1e-12)
    np.testing.assert_allclose(shifts, np.broadcast_to([0.0] * 3 + [1.0] * 6, (12, 9)), atol=1e-12)


def test_sensitivities_are_those_of_finite_differences(study: SensitivityStudy) -> None:
    """Along normals taken from drawn strokes, moving the part or the control points by hand."""
    view = 4
    direction = study.directions_obj[view]
    region = ALL_REGIONS[choose_region(direction, 0.5 * PART.box_size)]
    frame = view_frame(PART, region, direction, CONFIG.distance * PART.diameter, CONFIG.shift_mm, CONFIG.size)
    camera = Camera.from_matrix(frame.matrix, frame.size, frame.size)
    pose = frame.canonical_T_obj
    rows = visible_rows(PART, EDGES, CASTER, pose)[: CONFIG.points]
    ends = stroke_ends(EDGES, rows, camera, pose)
    along = (ends[:, 1] - ends[:, 0]) / np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)[:, None]
    normals = np.stack([-along[:, 1], along[:, 0]], 1)
    here = camera.project(transform(pose, EDGES.points_obj[rows]))

    def by_pose(step: np.ndarray) -> np.ndarray:
        moved = camera.project(transform(move_pose(pose, PART.box_centre, step), EDGES.points_obj[rows]))
        return np.sqrt((((moved - here) * normals).sum(1) ** 2).mean())

    quad = camera.project(transform(pose, mid_section_points(PART.box_min, PART.box_max, region.axis)))

    def by_points(step: np.ndarray) -> np.ndarray:
        moved = apply_homography(homography_from_points(quad, quad + step.reshape(4, 2)), here)
        return np.sqrt((((moved - here) * normals).sum(1) ** 2).mean())

    small = 1e-4
    expected = [by_pose(small * row) / small for row in np.eye(6)]
    np.testing.assert_allclose(study["pose"].sensitivity[view], expected, rtol=5e-3)
    expected = [by_points(small * row) / small for row in np.eye(8)]
    np.testing.assert_allclose(study["points, homography"].sensitivity[view], expected, rtol=5e-3)
    arc = np.array([PART.radius] * 3 + [1.0] * 3)
    np.testing.assert_allclose(study["balanced pose"].sensitivity * arc, study["pose"].sensitivity)


def test_the_exact_jacobians_find_the_motion_in_one_step_and_homographies_miss_tilts(study: SensitivityStudy) -> None:
    for name in ("balanced pose", "points, rigid"):
        assert study[name].step_cosine.min() > 0.98
    tilts = study["points, homography"].step_cosine[:, :2]
    shifts = study["points, homography"].step_cosine[:, 3:5]
    assert np.median(tilts) < 0.9 < shifts.min()


def test_units_decide_over_the_condition(study: SensitivityStudy) -> None:
    assert (study["pose"].condition > 5.0 * study["balanced pose"].condition).all()
    assert (study["points, rigid"].condition >= 1.0).all()


def test_control_points_of_the_caller_are_used(study: SensitivityStudy) -> None:
    wider = {
        region.index: PART.box_centre
        + 2.0 * (mid_section_points(PART.box_min, PART.box_max, region.axis) - PART.box_centre)
        for region in ALL_REGIONS
    }
    other = sensitivity_study(PART, EDGES, CASTER, CONFIG, wider, seed=1)
    np.testing.assert_allclose(other["pose"].sensitivity, study["pose"].sensitivity)
    # Points twice as far out move the edges half as much per px.
    ratio = other["points, rigid"].sensitivity.mean() / study["points, rigid"].sensitivity.mean()
    assert 0.35 < ratio < 0.65


def test_directions_of_a_known_behaviour() -> None:
    truths = np.array([[[1.0, 0.0], [1.0, -1.0], [1.0, 1e-9]]])
    found = np.array([[[2.0, 0.0], [3.0, 3.0], [-1.0, 5.0]]])
    one = Behaviour("made", ("a", "b"), np.array([[1.0, 4.0], [2.0, 2.0]]), np.ones(2), truths, found, truths)
    np.testing.assert_allclose(one.gradient_cosine, [[1.0, 0.0, -1.0 / math.sqrt(26.0)]], atol=1e-6)
    np.testing.assert_allclose(one.gradient_signs, [[1.0, 0.5, 0.0]])
    np.testing.assert_allclose(one.step_cosine, 1.0)
    np.testing.assert_allclose(one.spread, [4.0, 1.0])


def test_it_prints_as_a_table(study: SensitivityStudy) -> None:
    lines = str(study).splitlines()
    assert len(lines) == 7
    assert lines[0].split()[:3] == ["parameters", "condition", "spread"]
    assert "balanced pose" in lines[2]
    assert "12 views" in lines[5]
