"""Generators side by side: the views, what is between two of them, and scores that mean what they say."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from acp_lab.cad.part import Part
from acp_lab.cad.raycast import RayCaster, make_caster
from acp_lab.control_points.canonical_frame import eye_position
from acp_lab.control_points.view_regions import ALL_REGIONS
from acp_lab.generator.base import VisibleSamples
from acp_lab.generator.painted.edge_images import EdgeImageConfig
from acp_lab.generator.painted.quality import GenerationQuality
from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.pose import transform
from acp_lab.imaging.chamfer import nearest_distances
from acp_lab.studies.generator_study import (
    GeneratorScore,
    StudyView,
    rigid_edges,
    score_painter,
    score_rigid,
    study_views,
    views_between,
)
from acp_lab.studies.true_edges import TrueEdges
from tests.made_parts import bracket

REGION = ALL_REGIONS[4]
SIZE = 128
CONFIG = EdgeImageConfig(size=SIZE, nearest=3.0, farthest=6.0, overlap=0.0)


@pytest.fixture(scope="module")
def part() -> Part:
    return bracket(shift=(10.0, -5.0, 3.0))


@pytest.fixture(scope="module")
def caster(part: Part) -> RayCaster:
    return make_caster(part)


@pytest.fixture(scope="module")
def views(part: Part, caster: RayCaster) -> list[StudyView]:
    return study_views(part, caster, REGION, CONFIG, 4, seed=3)


class Exact:
    """A rigid generator that asks the rays; it may forget every other sample."""

    name = "exact"

    def __init__(self, part: Part, step: int = 1) -> None:
        self._truth, self._step = TrueEdges(part), step
        self.edges = self._truth.edges

    def visible(self, cam_T_obj: FloatArray, region: int, count: int) -> VisibleSamples:
        rows = self._truth.rows(cam_T_obj)[:: self._step]
        return VisibleSamples(rows, np.zeros(len(rows), bool), np.ones(len(rows)))


class Painter:
    """In place of a trained network: paints what the view with these control points truly looks like."""

    def __init__(self, views: list[StudyView], shift_px: int = 0) -> None:
        self._views, self._shift = views, shift_px

    def edge_image(self, points: FloatArray, region: int, point_set: str) -> np.ndarray:
        assert (region, point_set) == (REGION.index, "mid-section")
        (view,) = (view for view in self._views if np.allclose(view.points, points))
        return np.roll(view.image(), self._shift, axis=1)


def test_views_are_seen_by_their_own_camera(part: Part, views: list[StudyView]) -> None:
    for view in views:
        pose = view.edges.frame.canonical_T_obj
        np.testing.assert_allclose(view.camera.project(transform(pose, view.points_obj)), view.points, atol=1e-9)
        assert view.image().shape == (SIZE, SIZE)
        # The brightest pixels are where the true points are.
        x, y = np.round(view.true_points).astype(int).T
        assert np.median(view.image()[y, x]) > 0.8


def test_exact_edges_have_no_error_and_missed_ones_show_in_one_direction(part: Part, views: list[StudyView]) -> None:
    exact, every_fifth = (score_rigid("rigid", Exact(part, step), part, views) for step in (1, 5))
    assert exact.quality.generated_to_true_px < 0.02
    assert exact.quality.true_to_generated_px < 0.02
    assert exact.quality.f_score > 0.999
    assert every_fifth.quality.generated_to_true_px < 0.02
    assert every_fifth.quality.true_to_generated_px > 5.0 * exact.quality.true_to_generated_px
    assert every_fifth.time_ms > 0.0


def test_a_painter_is_read_by_its_ridges(views: list[StudyView]) -> None:
    right, shifted = (score_painter(Painter(views, px), REGION.index, views) for px in (0, 3))  # type: ignore[arg-type]
    assert right.quality.generated_to_true_px < 0.25
    assert right.quality.f_score > 0.97
    assert shifted.quality.generated_to_true_px > 3.0 * right.quality.generated_to_true_px
    assert shifted.quality.f_score < 0.8
    assert "auto-encoder: there" in str(right)


def test_a_black_picture_is_wrong_by_its_side(views: list[StudyView]) -> None:
    class Black:
        def edge_image(self, points: FloatArray, region: int, point_set: str) -> np.ndarray:
            return np.zeros((SIZE, SIZE), np.float32)

    score = score_painter(Black(), REGION.index, views)  # type: ignore[arg-type]
    assert score.quality == GenerationQuality(SIZE, SIZE, 0.0)


def test_pulled_points_still_give_a_rigid_part(part: Part, views: list[StudyView]) -> None:
    view, generator = views[0], Exact(part)
    kept = rigid_edges(generator, part, view, view.points)
    assert nearest_distances(kept.points, view.true_points).max() < 0.5
    pulled = rigid_edges(generator, part, view, view.points + np.outer(np.eye(4)[0], (6.0, 0.0)))
    assert nearest_distances(pulled.points, view.true_points).mean() > 0.3


def test_between_two_views_the_eye_goes_along_an_arc(part: Part, caster: RayCaster, views: list[StudyView]) -> None:
    way = views_between(part, caster, REGION, CONFIG, views[0], views[1], 5)
    assert len(way) == 5
    eyes = [eye_position(view.edges.frame.canonical_T_obj) - part.box_centre for view in way]
    ends = [eye_position(view.edges.frame.canonical_T_obj) - part.box_centre for view in views[:2]]
    np.testing.assert_allclose([eyes[0], eyes[-1]], ends, atol=1e-6)
    far = np.linalg.norm(eyes, axis=1)
    np.testing.assert_allclose(far, np.linspace(far[0], far[-1], 5), atol=1e-6)
    np.testing.assert_allclose(way[0].points, views[0].points, atol=1e-6)
    turned = [np.dot(a, b) / np.linalg.norm(a) / np.linalg.norm(b) for a, b in pairwise(eyes)]
    assert min(turned) > np.dot(eyes[0], eyes[-1]) / far[0] / far[-1]


@pytest.mark.parametrize("inset_mm", [0.0, 2.0])
def test_a_way_begins_and_ends_with_the_views_themselves(part: Part, caster: RayCaster, inset_mm: float) -> None:
    config = replace(CONFIG, outline_inset_mm=inset_mm)
    first, last = study_views(part, caster, REGION, config, 2, seed=3)
    way = views_between(part, caster, REGION, config, first, last, 3)
    for there, view in ((way[0], first), (way[-1], last)):
        np.testing.assert_allclose(there.image(), view.image(), atol=1e-3)


def test_a_score_prints_its_numbers() -> None:
    text = str(GeneratorScore("one", GenerationQuality(0.5, 0.25, 0.9), 1.5))
    assert text.strip() == "one: there 0.500 px, back 0.250 px, F-score 0.900, 1.50 ms"
