"""View templates against the exact answer by rays."""

from __future__ import annotations

import numpy as np
import pytest

from acp_lab.cad.edges import EdgeSamples, facing, visible_samples
from acp_lab.cad.part import Part
from acp_lab.cad.raycast import RayCaster
from acp_lab.control_points.canonical_frame import eye_position
from acp_lab.control_points.view_regions import sphere_directions
from acp_lab.generator.templates import RAY_OFFSET_IN_DIAMETERS, TemplateGenerator, build_templates, free_samples
from tests.made_parts import looking_at

EVERYTHING = 10**6


@pytest.mark.parametrize("distance_in_diameters", [2.5, 5.0, 10.0])
def test_they_agree_with_rays_between_the_stored_views(
    part: Part, edges: EdgeSamples, caster: RayCaster, templates: TemplateGenerator, distance_in_diameters: float
) -> None:
    called = exact = both = 0
    for direction in sphere_directions(60, turn_rad=0.3):
        pose = looking_at(part, direction, distance_in_diameters * part.diameter)
        ids = templates.visible(pose, 0, EVERYTHING).ids
        truth = visible_samples(edges, caster, eye_position(pose), RAY_OFFSET_IN_DIAMETERS * part.diameter)
        called, exact, both = called + len(ids), exact + int(truth.sum()), both + int(truth[ids].sum())
    assert both / called > 0.95
    assert both / exact > 0.95


def test_at_a_stored_view_the_answer_is_exact(
    part: Part, edges: EdgeSamples, caster: RayCaster, templates: TemplateGenerator
) -> None:
    for direction in templates.views_obj[::300]:
        pose = looking_at(part, direction, 5.0 * part.diameter)
        seen = templates.visible(pose, 0, EVERYTHING)
        eye_obj = eye_position(pose)
        truth = visible_samples(edges, caster, eye_obj, RAY_OFFSET_IN_DIAMETERS * part.diameter)
        np.testing.assert_array_equal(seen.ids, np.flatnonzero(truth))
        np.testing.assert_array_equal(seen.outline, facing(edges, eye_obj).outline[seen.ids])
        assert (seen.weights == 1.0).all()


def test_fewer_samples_are_the_first_of_many(part: Part, templates: TemplateGenerator) -> None:
    pose = looking_at(part, np.array([1.0, 0.5, 0.7]), 300.0)
    many = templates.visible(pose, 0, EVERYTHING)
    few = templates.visible(pose, 3, 40)
    assert len(few.ids) == len(few.outline) == len(few.weights) == 40
    np.testing.assert_array_equal(few.ids, many.ids[:40])
    assert (np.diff(many.ids) > 0).all()
    assert len(templates.visible(pose, 0, 0).ids) == 0


def test_free_samples_say_nothing_of_what_is_far_from_showing(
    part: Part, edges: EdgeSamples, caster: RayCaster
) -> None:
    eye_obj = part.box_centre + np.array([0.0, 0.0, 400.0])
    free = free_samples(part, edges, caster, eye_obj)
    assert free[facing(edges, eye_obj).shows].all()  # from above the L hides nothing of itself
    assert not free.all()


def test_building_tells_its_progress_and_is_repeatable(part: Part, edges: EdgeSamples, caster: RayCaster) -> None:
    told: list[tuple[int, int]] = []
    first = build_templates(part, edges, caster, lambda done, total: told.append((done, total)), subdivisions=2)
    assert told == [(64, 162), (128, 162), (162, 162)]
    assert first.packed.shape == (162, -(-len(edges) // 8))
    assert first.packed.dtype == np.uint8
    np.testing.assert_array_equal(first.packed, build_templates(part, edges, caster, subdivisions=2).packed)


def test_the_default_has_2562_views(templates: TemplateGenerator) -> None:
    assert templates.views_obj.shape == (2562, 3)
    np.testing.assert_allclose(np.linalg.norm(templates.views_obj, axis=1), 1.0, atol=1e-9)
    assert templates.name == "templates"


def test_outlines_alone_are_those_among_all_that_show(part: Part, templates: TemplateGenerator) -> None:
    for direction in sphere_directions(12, turn_rad=0.3):
        pose = looking_at(part, direction, 400.0)
        everything = templates.visible(pose, 0, EVERYTHING)
        found = templates.outlines(pose, EVERYTHING)
        np.testing.assert_array_equal(found.ids, everything.ids[everything.outline])
        assert found.outline.all()
        np.testing.assert_array_equal(templates.outlines(pose, 20).ids, found.ids[:20])
