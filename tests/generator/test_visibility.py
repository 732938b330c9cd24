"""The visibility network in NumPy: its inputs, its layers, what it answers, and what stands in for it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from acp_lab.cad.edges import EdgeSamples, facing, sample_edges
from acp_lab.cad.part import Part
from acp_lab.control_points.canonical_frame import CANONICAL_SIZE, canonical_frame, eye_position
from acp_lab.control_points.view_regions import ALL_REGIONS, ViewRegion, sphere_directions
from acp_lab.errors import GeometryError
from acp_lab.generator.templates import TemplateGenerator
from acp_lab.generator.visibility import RegionNetwork, VisibilityNetwork, network_inputs
from tests.made_parts import bracket, looking_at

EVERYTHING = 10**6
PART = bracket(shift=(100.0, -50.0, 20.0))


def random_network(rows: np.ndarray, hidden: int = 16, seed: int = 0) -> RegionNetwork:
    rng = np.random.default_rng(seed)
    shapes = ((hidden, 8), (hidden,), (hidden, hidden), (hidden,), (len(rows), hidden), (len(rows),))
    return RegionNetwork(*(rng.standard_normal(shape).astype(np.float32) for shape in shapes), rows.astype(np.int32))


def sigmoid(logits: np.ndarray) -> np.ndarray:
    return 1.0 / (1.0 + np.exp(-logits.astype(np.float64)))


def constant_network(rows: np.ndarray, logit: np.ndarray) -> RegionNetwork:
    """Answers `logit` whatever the view."""
    zero = np.zeros((4, 8), np.float32), np.zeros(4, np.float32), np.zeros((4, 4), np.float32), np.zeros(4, np.float32)
    return RegionNetwork(*zero, np.zeros((len(rows), 4), np.float32), logit.astype(np.float32), rows.astype(np.int32))


def test_logits_are_those_of_the_three_layers_for_samples_that_show() -> None:
    edges, eye_obj = sample_edges(PART), PART.box_centre + np.array([300.0, 200.0, 400.0])
    shows = facing(edges, eye_obj).shows
    showing, hidden = np.flatnonzero(shows), np.flatnonzero(~shows)
    rows = np.array([showing[0], hidden[0], showing[1], hidden[1]])
    network = random_network(rows)
    inputs = np.linspace(-1.0, 1.0, 8).astype(np.float32)
    first = [max(0.0, float(w @ inputs + b)) for w, b in zip(network.weight1, network.bias1, strict=True)]
    second = [max(0.0, float(w @ first + b)) for w, b in zip(network.weight2, network.bias2, strict=True)]
    expected = [float(network.weight3[k] @ second + network.bias3[k]) for k in (0, 2)]
    # Only those called free come back; a bias makes it all of them.
    lift = 1.0 - min(expected)
    found = replace(network, bias3=network.bias3 + np.float32(lift)).free(inputs, edges, eye_obj, 10)
    np.testing.assert_array_equal(found.ids, showing[:2])
    np.testing.assert_array_equal(found.outline, facing(edges, eye_obj).outline[showing[:2]])
    np.testing.assert_allclose(found.weights, sigmoid(np.array(expected) + lift), rtol=1e-4)
    none = random_network(hidden).free(inputs, edges, eye_obj, 10)
    assert len(none.ids) == len(none.outline) == len(none.weights) == 0


def test_the_first_free_samples_are_those_of_all_logits() -> None:
    edges, eye_obj = sample_edges(PART), PART.box_centre + np.array([300.0, 200.0, 400.0])
    rows, shows = np.arange(len(edges)), facing(edges, eye_obj).shows
    network = random_network(rows)
    network = replace(network, bias3=np.random.default_rng(1).normal(0.0, 5.0, len(rows)).astype(np.float32))
    inputs = np.linspace(-1.0, 1.0, 8).astype(np.float32)
    every = network.weight3 @ network.hidden(inputs) + network.bias3
    free = np.flatnonzero(shows & (every > 0.0))
    for count in (0, 1, 7, 60, len(free), 1000):
        found = network.free(inputs, edges, eye_obj, count)
        np.testing.assert_array_equal(found.ids, free[:count])
        np.testing.assert_allclose(found.weights, sigmoid(every[free[:count]]), rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize("region", ALL_REGIONS, ids=lambda region: region.name)
@given(distance_in_diameters=st.floats(1.2, 15.0), number=st.integers(0, 99))
def test_inputs_stay_near_the_unit_square(region, distance_in_diameters: float, number: int) -> None:  # type: ignore[no-untyped-def]
    eye_obj = PART.box_centre + distance_in_diameters * PART.diameter * sphere_directions(100)[number]
    inputs = network_inputs(PART, eye_obj, region.index)
    assert inputs.shape == (8,)
    assert inputs.dtype == np.float32
    assert np.abs(inputs).max() < 1.3


@pytest.mark.parametrize("region", ALL_REGIONS, ids=lambda region: region.name)
def test_inputs_are_the_control_points_in_the_canonical_frame(region: ViewRegion, rng: np.random.Generator) -> None:
    points_obj = PART.box_centre + rng.normal(0.0, 0.2 * PART.radius, (4, 3))
    eye_obj = PART.box_centre + rng.normal(0.0, 1.0, 3) + 3.0 * PART.radius * region.sign * np.eye(3)[region.axis]
    frame = canonical_frame(eye_obj, PART.box_centre, PART.radius, region)
    middle = 0.5 * (CANONICAL_SIZE - 1)
    expected = (frame.project(points_obj) - middle).ravel() / middle
    np.testing.assert_allclose(network_inputs(PART, eye_obj, region.index, points_obj), expected, rtol=1e-6, atol=1e-7)


def test_inputs_refuse_an_eye_inside_the_part() -> None:
    with pytest.raises(GeometryError, match="inside its bounding sphere"):
        network_inputs(PART, PART.box_centre + 1.0, 0)


def test_it_answers_with_free_samples_their_belief_and_a_stable_order(part: Part, edges: EdgeSamples) -> None:
    rows = np.arange(0, len(edges), 3)
    logit = np.where(np.arange(len(rows)) % 2 == 0, 2.0, -2.0)
    generator = VisibilityNetwork(part, edges, {4: constant_network(rows, logit)}, None)
    pose = looking_at(part, np.array([0.3, 0.2, 1.0]), 400.0)
    seen = facing(edges, eye_position(pose))
    expected = rows[(logit > 0.0) & seen.shows[rows]]
    answer = generator.visible(pose, 4, EVERYTHING)
    np.testing.assert_array_equal(answer.ids, expected)
    np.testing.assert_array_equal(answer.outline, seen.outline[expected])
    np.testing.assert_allclose(answer.weights, 1.0 / (1.0 + np.exp(-2.0)))
    few = generator.visible(pose, 4, 7)
    np.testing.assert_array_equal(few.ids, expected[:7])
    assert len(few.outline) == len(few.weights) == 7


def test_a_region_without_network_falls_back(part: Part, edges: EdgeSamples, templates: TemplateGenerator) -> None:
    network = {4: constant_network(np.arange(len(edges)), np.full(len(edges), -1.0))}
    pose = looking_at(part, np.array([1.0, 0.2, 0.1]), 400.0)
    with_fallback = VisibilityNetwork(part, edges, network, templates)
    np.testing.assert_array_equal(with_fallback.visible(pose, 0, 50).ids, templates.visible(pose, 0, 50).ids)
    assert len(with_fallback.visible(pose, 4, 50).ids) == 0
    # Without templates, whatever faces the eye, hidden or not.
    alone = VisibilityNetwork(part, edges, network, None).visible(pose, 0, EVERYTHING)
    seen = facing(edges, eye_position(pose))
    np.testing.assert_array_equal(alone.ids, np.flatnonzero(seen.shows))
    np.testing.assert_array_equal(alone.outline, seen.outline[alone.ids])


def test_very_sure_networks_overflow_nowhere(part: Part, edges: EdgeSamples) -> None:
    network = constant_network(np.arange(len(edges)), np.where(np.arange(len(edges)) % 2, 6e4, -6e4))
    answer = VisibilityNetwork(part, edges, {0: network}, None).visible(
        looking_at(part, np.array([1.0, 0.2, 0.1]), 400.0), 0, EVERYTHING
    )
    assert len(answer.ids) > 0
    assert (answer.weights == 1.0).all()
