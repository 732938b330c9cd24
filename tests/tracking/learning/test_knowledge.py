"""The three memories of one part, each of which may be off, and what they are asked during a frame."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from acp_lab.cad.part import Part
from acp_lab.generator.base import GeneratedEdges
from acp_lab.imaging.edge_search import Candidates, image_patch
from acp_lab.prepared_part import PreparedPart
from acp_lab.tracking.frame_view import Estimate
from acp_lab.tracking.learning.contour_offsets import OffsetConfig
from acp_lab.tracking.learning.edge_memory import MemoryConfig
from acp_lab.tracking.learning.edge_profiles import ProfileConfig, ProfileShifts
from acp_lab.tracking.learning.edge_traits import EdgeTraits
from acp_lab.tracking.learning.knowledge import Matches, Off, SampleKnowledge, SampleLearning
from acp_lab.tracking.learning.reliability import ReliabilityConfig
from acp_lab.tracking.sources.rigid import RigidSource
from tests.made_parts import looking_at
from tests.tracking.rendered import prepared
from tests.tracking.views import prior_of, view_at

ALL = SampleLearning(offsets=OffsetConfig(follow_rate=0.0))


@pytest.fixture(scope="module")
def broken(part: Part) -> PreparedPart:
    """With broken edges, so that outlines are expected inside the CAD's."""
    return prepared(part, edge_break_mm=0.4)


@pytest.fixture
def at(part: Part) -> Estimate:
    return prior_of(view_at(part, looking_at(part, np.array([0.8, 0.6, 1.0]), 330.0, 0.3)))


@pytest.fixture
def edges(broken: PreparedPart, at: Estimate) -> GeneratedEdges:
    return RigidSource(broken.best_generator(), 0.0).generate(at, 200)


def candidates(count: int, gradient: float = 30.0) -> Candidates:
    ones = np.ones((count, 2))
    return Candidates(0.0 * ones, ones, gradient * ones, 80.0 * ones, 160.0 * ones)


def matches(knowledge: SampleKnowledge, edges: GeneratedEdges, at: Estimate, residual_px: float = 0.1) -> Matches:
    n = len(edges)
    residuals = np.full(n, residual_px)
    return Matches(
        at,
        knowledge.edges.points_obj[edges.sample_ids],
        edges,
        edges.normals,
        candidates(n),
        np.zeros(n, np.intp),
        residuals,
        residuals,
        knowledge.expect(edges, edges.normals, at),
        knowledge.edges.normals_obj[edges.sample_ids].sum(1),
        image_patch(np.full((120, 160, 3), 90, np.uint8), (0, 0, 160, 120)),
        edges.points,
    )


def test_each_memory_may_be_off(broken: PreparedPart) -> None:
    for config, kept in (
        (ALL, (True, True, True)),
        (replace(ALL, memory=Off()), (False, True, True)),
        (replace(ALL, offsets=Off()), (True, False, True)),
        (replace(ALL, reliability=Off()), (True, True, False)),
        (Off(), (False, False, False)),
    ):
        knowledge = SampleKnowledge(config, broken)
        parts = (knowledge.memory, knowledge.offsets, knowledge.reliability)
        assert tuple(part is not None for part in parts) == kept
    given = SampleLearning(MemoryConfig(rate=0.1), OffsetConfig(largest=0.3), ReliabilityConfig(rate=0.4))
    knowledge = SampleKnowledge(given, broken)
    assert knowledge.memory is not None
    assert knowledge.offsets is not None
    assert knowledge.reliability is not None
    assert (knowledge.memory.config, knowledge.offsets.config) == (given.memory, given.offsets)
    assert knowledge.reliability.config is given.reliability


def test_outlines_of_broken_edges_are_expected_inside(
    broken: PreparedPart, edges: GeneratedEdges, at: Estimate
) -> None:
    expected = SampleKnowledge(ALL, broken).expect(edges, edges.normals, at)
    assert expected is not None
    assert (expected.offsets_mm[edges.outline] < 0.0).all()
    assert (expected.offsets_mm[~edges.outline] == 0.0).all()
    assert SampleKnowledge(replace(ALL, offsets=Off()), broken).expect(edges, edges.normals, at) is None


def test_a_candidate_that_contradicts_the_past_scores_less(
    broken: PreparedPart, edges: GeneratedEdges, at: Estimate
) -> None:
    scores = np.full((len(edges), 2), 0.8)
    for config, falls in ((ALL, True), (replace(ALL, memory=Off()), False)):
        knowledge = SampleKnowledge(config, broken)
        knowledge.learn(matches(knowledge, edges, at))
        same = knowledge.agreement(edges.sample_ids, candidates(len(edges)), scores)
        turned = knowledge.agreement(edges.sample_ids, candidates(len(edges), -30.0), scores)
        np.testing.assert_allclose(same, scores)
        assert (turned < 0.3 * scores).all() == falls


def test_trust_counts_only_on_fine_levels(broken: PreparedPart, edges: GeneratedEdges, at: Estimate) -> None:
    knowledge = SampleKnowledge(ALL, broken)
    assert knowledge.offsets is not None
    assert knowledge.reliability is not None
    expected = knowledge.expect(edges, edges.normals, at)
    assert expected is not None
    assert knowledge.trust(edges, expected, 2.01) is None
    steady = knowledge.reliability.weights(edges.sample_ids, edges.outline)
    trust = knowledge.trust(edges, expected, 2.0)
    assert trust is not None
    np.testing.assert_allclose(trust, expected.weights * steady)
    only_steady = SampleKnowledge(replace(ALL, offsets=Off()), broken).trust(edges, None, 1.0)
    assert only_steady is not None
    np.testing.assert_allclose(only_steady, steady)
    only_expected = SampleKnowledge(replace(ALL, reliability=Off()), broken).trust(edges, expected, 1.0)
    assert only_expected is expected.weights
    assert SampleKnowledge(Off(), broken).trust(edges, None, 1.0) is None


def test_a_frame_much_worse_than_usual_teaches_nothing(broken: PreparedPart) -> None:
    knowledge = SampleKnowledge(replace(ALL, learn_above=0.7), broken)
    assert knowledge.learns
    assert knowledge.trusts(0.36, 0.5)
    assert not knowledge.trusts(0.35, 0.5)
    assert not SampleKnowledge(Off(), broken).learns
    assert SampleKnowledge(Off(), broken).trusts(0.1, 1.0)


def test_a_trusted_pose_teaches_offsets_and_a_tracked_one_does_not(
    broken: PreparedPart, edges: GeneratedEdges, at: Estimate
) -> None:
    knowledge = SampleKnowledge(ALL, broken)
    before = knowledge.expect(edges, edges.normals, at)
    assert before is not None
    knowledge.learn(matches(knowledge, edges, at, 0.4))
    unchanged = knowledge.expect(edges, edges.normals, at)
    assert unchanged is not None
    np.testing.assert_array_equal(unchanged.offsets_mm, before.offsets_mm)
    knowledge.measure_offsets(matches(knowledge, edges, at, 0.4))
    after = knowledge.expect(edges, edges.normals, at)
    assert after is not None
    assert np.abs(after.offsets_mm - before.offsets_mm).max() > 0.05
    # Nothing to measure where offsets are not learnt.
    off = SampleKnowledge(replace(ALL, offsets=Off()), broken)
    off.measure_offsets(matches(off, edges, at, 0.4))


def test_measured_offsets_count_less_once_a_frame_is_seen_from_another_side(
    broken: PreparedPart, part: Part, edges: GeneratedEdges, at: Estimate
) -> None:
    beside = prior_of(view_at(part, looking_at(part, np.array([0.1, 0.9, 1.0]), 330.0, 0.3)))
    for config, fades in ((ALL, True), (replace(ALL, offsets=OffsetConfig(view_deg=0.0, follow_rate=0.0)), False)):
        knowledge = SampleKnowledge(config, broken)
        usual = knowledge.expect(edges, edges.normals, at)
        knowledge.measure_offsets(matches(knowledge, edges, at, residual_px=0.6))
        measured = knowledge.expect(edges, edges.normals, at)
        knowledge.learn(matches(knowledge, edges, at))
        same_side = knowledge.expect(edges, edges.normals, at)
        knowledge.learn(matches(knowledge, edges, beside))
        turned = knowledge.expect(edges, edges.normals, at)
        assert usual is not None
        assert measured is not None
        assert same_side is not None
        assert turned is not None
        np.testing.assert_array_equal(same_side.offsets_mm, measured.offsets_mm)
        of_side, of_other = (np.abs(seen.offsets_mm - usual.offsets_mm).mean() for seen in (measured, turned))
        left = of_other / of_side
        assert (left < 0.3) == fades
        assert (left == pytest.approx(1.0)) != fades


def test_a_solved_frame_teaches_look_and_reliability(broken: PreparedPart, edges: GeneratedEdges, at: Estimate) -> None:
    knowledge = SampleKnowledge(ALL, broken)
    assert knowledge.memory is not None
    assert knowledge.reliability is not None
    before = knowledge.reliability.weights(edges.sample_ids, edges.outline)
    knowledge.learn(matches(knowledge, edges, at, 0.05))
    assert knowledge.memory.known[edges.sample_ids].all()
    assert (knowledge.reliability.weights(edges.sample_ids, edges.outline) > before).all()
    # An edge that was not found teaches nothing of its look, and that it is not steady.
    other = SampleKnowledge(ALL, broken)
    assert other.memory is not None
    assert other.reliability is not None
    other.learn(matches(other, edges, at, np.nan))
    assert not other.memory.known.any()
    assert (other.reliability.weights(edges.sample_ids, edges.outline) < before).all()


def test_what_the_chosen_edges_say_is_that_of_their_columns(
    broken: PreparedPart, edges: GeneratedEdges, at: Estimate, rng: np.random.Generator
) -> None:
    shape = (len(edges), 3)
    shifts = ProfileShifts(*rng.normal(size=(2, *shape)), rng.normal(size=(*shape, 2)), np.zeros(2))
    found = Candidates(*rng.normal(size=(5, *shape)))
    best = rng.integers(0, 3, len(edges))
    seen = replace(matches(SampleKnowledge(ALL, broken), edges, at), candidates=found, best=best, shifts=shifts)
    rows, evidence = np.arange(len(edges)), seen.trait_evidence
    assert evidence is not None
    np.testing.assert_array_equal(seen.gradients, found.gradients[rows, best])
    np.testing.assert_array_equal(evidence.spreads_px, shifts.spreads_px[rows, best])
    np.testing.assert_array_equal(evidence.slopes_px, shifts.slopes_px[rows, best])


@pytest.mark.parametrize("offsets", [OffsetConfig(), Off()])
def test_outlines_know_which_way_leads_off_the_part(
    broken: PreparedPart, edges: GeneratedEdges, at: Estimate, offsets: OffsetConfig | Off
) -> None:
    """Whether or not offsets are learnt."""
    found = matches(SampleKnowledge(SampleLearning(offsets=offsets), broken), edges, at)
    outward, across_obj = found.outward, at.lines(found.points_obj, found.normals).directions @ at.cam_T_obj[:3, :3]
    np.testing.assert_array_equal(outward, np.sign((across_obj * found.off_obj).sum(1)) * edges.outline)
    assert (outward[~edges.outline] == 0.0).all()
    centre_px = at.control_points.mean(axis=0)
    away = np.einsum("nj,nj->n", edges.points - centre_px, edges.normals)
    far = edges.outline & (np.abs(away) > 0.8 * np.linalg.norm(edges.points - centre_px, axis=1))
    assert far.sum() > 20
    assert (np.sign(away[far]) == outward[far]).mean() > 0.8


def told(matches: Matches, residual_px: float, slope_px: float) -> Matches:
    """With profiles whose one trait moves every other edge one way, and the others the other."""
    n = len(matches.best)
    slopes = np.zeros((*matches.candidates.scores.shape, 1))
    slopes[:, 0, 0] = np.where(np.arange(n) % 2, slope_px, -slope_px)
    residuals = residual_px * np.sign(slopes[:, 0, 0])
    spreads = np.full(matches.candidates.scores.shape, 0.2)
    shifts = ProfileShifts(np.zeros_like(spreads), spreads, slopes, np.zeros(1))
    return replace(matches, residuals_px=residuals, sure_residuals_px=residuals, shifts=shifts)


def knows_one_trait(broken: PreparedPart) -> SampleKnowledge:
    knowledge = SampleKnowledge(replace(ALL, polarity=Off()), broken)
    assert knowledge.profiles is not None
    knowledge.profiles.traits = EdgeTraits(1, 0.2, 0.7, 20.0)
    return knowledge


def test_what_lies_beside_the_image_is_not_unreliable(
    broken: PreparedPart, edges: GeneratedEdges, at: Estimate
) -> None:
    knowledge = SampleKnowledge(ALL, broken)
    assert knowledge.reliability is not None
    before = knowledge.reliability.weights(edges.sample_ids, edges.outline)
    shifted = replace(edges, points=edges.points - [np.median(edges.points[:, 0]), 0.0])
    seen = matches(knowledge, shifted, at)
    beside = shifted.points[:, 0] < 0.0
    missing = replace(seen, residuals_px=np.full(len(edges), np.nan))
    knowledge.learn(missing)
    after = knowledge.reliability.weights(edges.sample_ids, edges.outline)
    np.testing.assert_array_equal(after[beside], before[beside])
    assert (after[~beside] < before[~beside]).all()
    assert 0.3 < beside.mean() < 0.7


def test_traits_are_told_by_edges_as_if_no_offsets_were_measured(
    broken: PreparedPart, edges: GeneratedEdges, at: Estimate
) -> None:
    """Edges are told 0.2 px beyond where they are, as far as half a trait less brings them back."""
    knowledge = knows_one_trait(broken)
    seen = told(matches(knowledge, edges, at), 0.2, -0.4)
    expected = seen.expected
    assert expected is not None
    beside = replace(seen, sure_residuals_px=seen.sure_residuals_px - expected.offsets_px)
    moved_px = knowledge.learn_traits(beside)
    assert knowledge.profiles is not None
    assert knowledge.profiles.traits.values == pytest.approx([-0.5], abs=0.1)
    slopes = seen.shifts.slopes_px[:, 0] if seen.shifts is not None else np.zeros((len(edges), 1))
    np.testing.assert_allclose(moved_px, slopes @ knowledge.profiles.traits.values)


def test_offsets_are_what_traits_leave(broken: PreparedPart, edges: GeneratedEdges, at: Estimate) -> None:
    knowledge = knows_one_trait(broken)
    seen = told(matches(knowledge, edges, at), 0.2, -0.4)
    expected = seen.expected
    assert expected is not None
    seen = replace(seen, sure_residuals_px=seen.sure_residuals_px - expected.offsets_px)
    knowledge.measure_offsets(seen)
    assert knowledge.profiles is not None
    found = knowledge.expect(edges, edges.normals, at)
    assert found is not None
    # As far as the trait explains them, there is nothing left to measure.
    unexplained = np.abs(seen.sure_residuals_px + expected.offsets_px)
    assert np.median(np.abs(found.offsets_px)) < 0.5 * np.median(unexplained)


def test_without_profiles_there_are_no_traits(broken: PreparedPart, edges: GeneratedEdges, at: Estimate) -> None:
    for config in (replace(ALL, profiles=Off()), replace(ALL, profiles=ProfileConfig(evidence_share=0.0))):
        knowledge = SampleKnowledge(config, broken)
        assert not knowledge.has_traits
        assert not np.any(knowledge.learn_traits(matches(knowledge, edges, at), afresh=True))
