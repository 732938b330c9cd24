"""Image edges along the normals: what is seen, once a level or at every step, and what it says of an estimate."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from acp_lab.cad.part import Part, box_corners
from acp_lab.errors import TrackingError
from acp_lab.generator.base import GeneratedEdges
from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.pose import transform
from acp_lab.geometry.pose_step import move_pose
from acp_lab.imaging.edge_search import AS_THEY_ARE
from acp_lab.prepared_part import PreparedPart
from acp_lab.sequences.frame import Frame
from acp_lab.tracking.frame_view import Estimate, FrameView, crop_box
from acp_lab.tracking.learning.knowledge import Off, SampleKnowledge, SampleLearning
from acp_lab.tracking.learning.lens_blur import LensBlur
from acp_lab.tracking.schedule import Level
from acp_lab.tracking.sources.rigid import RigidSource
from acp_lab.tracking.targets import QUALITY_SIGMA_PX
from acp_lab.tracking.targets.normals import (
    NormalMeasure,
    NormalMeasurement,
    NormalSearch,
    NormalTarget,
    RepeatedSearch,
    _best_candidates,
    _distances,
    _mean_nearness,
    _place,
    _residuals,
)
from acp_lab.tracking.targets.soft_assignment import negative_log_likelihood, robust_loss, soft_assignment
from tests.tracking.rendered import CAMERA, MadeSequence, prepared
from tests.tracking.views import prior_of, view_at

LEVEL = Level(8, 2.0, 120)


@pytest.fixture
def at(part: Part, sequence: MadeSequence) -> Estimate:
    (frame,) = sequence.frames(1)
    assert isinstance(frame, Frame)
    plain = view_at(part, sequence.first_pose)
    box = crop_box(box_corners(part), plain.prior, CAMERA, 32.0)
    assert box is not None
    view = FrameView(
        CAMERA, plain.prior, plain.region, plain.points_obj, part, image=frame.image, box=box, edge_box=box
    )
    return prior_of(view)


@pytest.fixture
def source(model: PreparedPart) -> RigidSource:
    return RigidSource(model.best_generator(), 0.0)


@pytest.fixture
def edges(source: RigidSource, at: Estimate) -> GeneratedEdges:
    return source.generate(at, LEVEL.samples)


def target_of(at: Estimate, config: NormalSearch, knowledge: SampleKnowledge) -> NormalTarget:
    assert isinstance(at.view, FrameView)
    return config.see(at.view, knowledge)


@pytest.fixture
def target(at: Estimate, model: PreparedPart) -> NormalTarget:
    return target_of(at, NormalSearch(), SampleKnowledge(Off(), model))


@pytest.fixture
def measure(target: NormalTarget, edges: GeneratedEdges, at: Estimate) -> NormalMeasure:
    found = target.bind(edges, at, LEVEL)
    assert isinstance(found, NormalMeasure)
    return found


def aside(at: Estimate, mm: float) -> Estimate:
    return at.view.at_pose(move_pose(at.cam_T_obj, at.view.part.box_centre, np.array([0.0, 0, 0, mm, 0.5 * mm, 0])))


def moved(edges: GeneratedEdges, shift: FloatArray) -> GeneratedEdges:
    return replace(edges, points=edges.points + shift)


# ---- bound once a level --------------------------------------------------------------------------------------


def test_what_is_seen_has_one_row_per_edge_point(measure: NormalMeasure, edges: GeneratedEdges, at: Estimate) -> None:
    n, m = measure.scores.shape
    assert n == len(edges) == LEVEL.samples
    assert measure.points is edges.points
    np.testing.assert_array_equal(measure.normals, edges.normals)
    assert measure.targets.shape == measure.candidates.offsets.shape == (n, m)
    assert measure.at is at
    np.testing.assert_allclose(CAMERA.project(transform(at.cam_T_obj, measure.points_obj)), edges.points, atol=1e-9)


def test_candidates_stay_where_they_were_found(measure: NormalMeasure, edges: GeneratedEdges) -> None:
    """An edge point that moves by a px along its normal has a px less to go, one that slides has as far as before."""
    np.testing.assert_allclose(measure.distances(edges), measure.candidates.offsets)
    along, across = edges.normals, edges.tangents
    np.testing.assert_allclose(measure.distances(moved(edges, 1.5 * along)), measure.candidates.offsets - 1.5)
    np.testing.assert_allclose(measure.distances(moved(edges, 1.5 * across)), measure.candidates.offsets, atol=1e-9)


def test_residuals_and_weights_are_those_of_the_soft_assignment(measure: NormalMeasure, edges: GeneratedEdges) -> None:
    shifted = moved(edges, np.array([1.0, -0.5]))
    seen = measure(shifted)
    config = NormalSearch()
    expected = soft_assignment(measure.distances(shifted), measure.scores, LEVEL.sigma_px, config.outlier)
    np.testing.assert_array_equal(seen.residuals, expected.residuals)
    np.testing.assert_array_equal(seen.weights, expected.weights)
    assert seen.directions is measure.normals
    likelihood = negative_log_likelihood(expected.mass, np.ones(len(edges)), config.outlier)
    assert seen.loss == pytest.approx(LEVEL.sigma_px**2 * likelihood)
    # What a result reports is of one width on all levels.
    assert measure.reported_loss(shifted) == pytest.approx(
        robust_loss(measure.distances(shifted), measure.scores, QUALITY_SIGMA_PX, config.outlier)
    )


def test_a_levels_loss_falls_along_the_solvers_step(rng: np.random.Generator) -> None:
    """Also of points that are trusted little, and of those that several candidates give a mass above 1."""
    scores, trust, normals = rng.random((30, 4)), rng.random(30), np.zeros((30, 2))
    distances = rng.normal(0.0, 2.0, (30, 4))

    def at(distances: FloatArray) -> NormalMeasurement:
        return NormalMeasurement(soft_assignment(distances, scores, 1.5, 0.5), normals, trust, 1.5, 0.5)

    seen, step = at(distances), 1e-4
    assert (seen.assigned.mass > 1.0).any()
    for i in range(30):
        nudge = step * np.eye(30)[i][:, None]
        slope = (at(distances - nudge).loss - at(distances + nudge).loss) / (2.0 * step)
        assert slope * 30 == pytest.approx(-seen.weights[i] * seen.residuals[i], rel=1e-5, abs=1e-7)


def test_without_points_a_level_has_found_nothing() -> None:
    none = soft_assignment(np.zeros((0, 4)), np.zeros((0, 4)), 2.0, 0.5)
    assert NormalMeasurement(none, np.zeros((0, 2)), np.zeros(0), 2.0, 0.5).loss == pytest.approx(4.0 * np.log(3.0))


def test_the_levels_sigma_and_the_outliers_mass_count(
    target: NormalTarget, edges: GeneratedEdges, at: Estimate, model: PreparedPart
) -> None:
    shifted = moved(edges, np.array([2.0, -1.5]))
    wide, narrow, least = (
        target.search(edges, at, Level(8, sigma))(shifted).weights.mean() for sigma in (6.0, 1.0, 0.1)
    )
    assert wide > 1.3 * narrow
    assert least == narrow, "searches have whole pixels: no narrower than 1 px"
    heavy = target_of(at, NormalSearch(outlier=5.0), SampleKnowledge(Off(), model))
    assert (
        heavy.search(edges, at, LEVEL)(shifted).weights.mean()
        < 0.5 * target.search(edges, at, LEVEL)(shifted).weights.mean()
    )


def test_faint_candidates_are_noise(at: Estimate, edges: GeneratedEdges, model: PreparedPart) -> None:
    knowledge = SampleKnowledge(Off(), model)
    some, few = (
        target_of(at, NormalSearch(min_score=score), knowledge).search(edges, at, LEVEL) for score in (0.02, 0.6)
    )
    assert ((few.scores == 0.0) | (few.scores > 0.6)).all()
    assert (few.scores > 0.0).sum() < (some.scores > 0.0).sum()
    assert len(few.target_view().edge_points) < len(some.target_view().edge_points)


def test_a_generators_belief_counts_in_the_scores(
    target: NormalTarget, edges: GeneratedEdges, at: Estimate, measure: NormalMeasure
) -> None:
    half = target.search(replace(edges, weights=0.5 * edges.weights), at, LEVEL)
    np.testing.assert_allclose(half.scores, 0.5 * measure.scores)


def test_settings_of_the_search_reach_the_image(at: Estimate, edges: GeneratedEdges, model: PreparedPart) -> None:
    knowledge = SampleKnowledge(Off(), model)
    found = {
        name: target_of(at, NormalSearch(search=search), knowledge).search(edges, at, LEVEL)
        for name, search in {
            "usual": AS_THEY_ARE,
            "two": replace(AS_THEY_ARE, max_candidates=2),
            "blurred": replace(AS_THEY_ARE, blur_px=3.0),
            "contrast": replace(AS_THEY_ARE, contrast=60.0),
        }.items()
    }
    assert found["two"].scores.shape[1] == 2 < found["usual"].scores.shape[1]
    for name in ("blurred", "contrast"):
        assert found[name].scores.max(1).mean() < 0.9 * found["usual"].scores.max(1).mean()


# ---- what was learnt -----------------------------------------------------------------------------------------


def test_what_is_known_of_the_lens_says_how_much_is_sharpened(
    at: Estimate, edges: GeneratedEdges, model: PreparedPart, monkeypatch: pytest.MonkeyPatch
) -> None:
    knowledge = SampleKnowledge(SampleLearning(), model)
    first = target_of(at, NormalSearch(), knowledge)
    matches = first.search(edges, at, LEVEL).judge(edges, edges, at).matches
    assert matches is not None
    knowledge.learn(matches)
    assert knowledge.lens is not None
    assert knowledge.lens_blur_px == first.patch.edge_blur_px
    again = target_of(at, NormalSearch(), knowledge)
    np.testing.assert_array_equal(again.patch.channels, first.patch.channels)
    monkeypatch.setattr(LensBlur, "blur_px", 2.5)
    softer = target_of(at, NormalSearch(), knowledge)
    assert np.abs(softer.patch.channels[..., 0]).max() > 1.2 * np.abs(first.patch.channels[..., 0]).max()
    assert SampleKnowledge(SampleLearning(lens=Off()), model).lens_blur_px is None


def test_expected_offsets_move_the_goal(
    at: Estimate, edges: GeneratedEdges, part: Part, measure: NormalMeasure
) -> None:
    """An outline that is seen a little inside is where it belongs."""
    knowledge = SampleKnowledge(SampleLearning(profiles=Off()), prepared(part, edge_break_mm=0.8))
    aware = target_of(at, NormalSearch(), knowledge).search(edges, at, LEVEL)
    assert aware.expected is not None
    np.testing.assert_allclose(aware.targets, aware.candidates.offsets - aware.expected.offsets_px[:, None])
    assert np.abs(aware.targets - measure.targets)[edges.outline].min() > 0.05
    np.testing.assert_array_equal(aware.targets[~edges.outline], measure.targets[~edges.outline])
    # The trust in each sample counts on fine levels.
    fine = target_of(at, NormalSearch(), knowledge).search(edges, at, Level(5, 1.0))(edges)
    trust = knowledge.trust(edges, aware.expected, 1.0)
    assert trust is not None
    np.testing.assert_allclose(fine.weights, fine.assigned.weights * trust)


def test_profiles_move_the_goal_on_fine_levels(at: Estimate, edges: GeneratedEdges, model: PreparedPart) -> None:
    knowledge = SampleKnowledge(SampleLearning(polarity=Off()), model)
    told = target_of(at, NormalSearch(), knowledge).search(edges, at, Level(5, 1.0))
    assert told.shifts is not None
    assert told.expected is not None
    moved = told.candidates.offsets + told.shifts.shifts_px
    np.testing.assert_allclose(told.targets, moved - told.expected.offsets_px[:, None])
    assert np.abs(told.shifts.shifts_px).max() > 0.1
    # How unsure a profile is weighs its sample.
    plain = SampleKnowledge(SampleLearning(polarity=Off(), profiles=Off()), model)
    expected = plain.expect(edges, edges.normals, at)
    assert expected is not None
    assert np.abs(told.expected.weights - expected.weights).max() > 0.1
    coarse = target_of(at, NormalSearch(), knowledge).search(edges, at, Level(20, 6.0))
    assert coarse.shifts is None
    assert plain.read_profiles(
        target_of(at, NormalSearch(), plain).patch, edges.points, edges, edges.normals, told.candidates, at, 1.0, 0.0
    ) is None  # fmt: skip


def test_the_memory_weakens_what_looked_otherwise_but_not_when_poses_are_compared(
    at: Estimate, edges: GeneratedEdges, model: PreparedPart
) -> None:
    knowledge = SampleKnowledge(SampleLearning(offsets=Off(), polarity=Off(), profiles=Off()), model)
    target = target_of(at, NormalSearch(), knowledge)
    before, plain = target.search(edges, at, LEVEL), target.agreement(edges, at, LEVEL, 1.2)
    matches = before.judge(edges, edges, at).matches
    assert matches is not None
    assert knowledge.memory is not None
    knowledge.learn(matches)
    knowledge.memory.means[:, 0] *= -1.0  # as if every edge had been dark where it is bright
    after = target.search(edges, at, LEVEL)
    assert after.scores.sum() < 0.5 * before.scores.sum()
    assert target.agreement(edges, at, LEVEL, 1.2) == pytest.approx(plain)


# ---- judging -------------------------------------------------------------------------------------------------


def test_an_estimate_is_judged_by_its_best_candidates(
    measure: NormalMeasure, source: RigidSource, edges: GeneratedEdges, at: Estimate
) -> None:
    qualities = []
    for mm in (0.0, 1.0, 3.0):
        drawn = source.reproject(aside(at, mm), edges)
        judged = measure.judge(drawn, drawn, aside(at, mm))
        fit = measure.scores * np.exp(-0.5 * (measure.distances(drawn) / QUALITY_SIGMA_PX) ** 2)
        assert judged.quality == pytest.approx(fit.max(1).mean())
        assert judged.loss == pytest.approx(measure.reported_loss(drawn))
        assert judged.edges is drawn
        rows = np.arange(len(fit))
        found = fit.max(1) > 0.02
        np.testing.assert_array_equal(np.isfinite(judged.residuals_px), found)
        np.testing.assert_allclose(judged.residuals_px[found], measure.distances(drawn)[rows, fit.argmax(1)][found])
        qualities.append(judged.quality)
    assert qualities[0] > qualities[1] > qualities[2]


def cropped(at: Estimate, x: int) -> Estimate:
    """The same pose in the picture without its first x columns."""
    assert isinstance(at.view, FrameView)
    camera = CAMERA.cropped(x, 0, CAMERA.width - x, CAMERA.height)
    box = crop_box(box_corners(at.view.part), at.cam_T_obj, camera, 32.0)
    assert box is not None
    image = np.ascontiguousarray(at.view.image[:, x:])
    return prior_of(replace(at.view, camera=camera, image=image, box=box, edge_box=box))


def test_what_lies_beyond_the_image_does_not_count(
    source: RigidSource, edges: GeneratedEdges, at: Estimate, model: PreparedPart
) -> None:
    """A part that is cut by the image's border fits as well as the whole one: the image shows nothing of the rest."""
    whole = target_of(at, NormalSearch(), SampleKnowledge(Off(), model)).search(edges, at, LEVEL)
    judged = whole.judge(edges, edges, at)
    half_out = cropped(at, int(np.median(edges.points[:, 0])))
    drawn = source.reproject(half_out, edges)
    inside = drawn.points[:, 0] >= 0.0
    assert 0.4 < inside.mean() < 0.6
    cut = target_of(half_out, NormalSearch(), SampleKnowledge(Off(), model)).search(drawn, half_out, LEVEL)
    cut_judged = cut.judge(drawn, drawn, half_out)
    assert cut_judged.quality == pytest.approx(cut_judged.found.sum() / inside.sum())
    for name in ("quality", "score", "contrast"):
        assert getattr(cut_judged, name) == pytest.approx(getattr(judged, name), abs=0.1), name
    assert cut.agreement(2.0) == pytest.approx(whole.agreement(2.0), abs=0.1)


def test_a_pose_that_leads_out_of_the_image_does_not_fit_by_what_is_left(
    source: RigidSource, edges: GeneratedEdges, at: Estimate, model: PreparedPart
) -> None:
    nearly_out = cropped(at, int(np.quantile(edges.points[:, 0], 0.96)))
    drawn = source.reproject(nearly_out, edges)
    assert 0.0 < (drawn.points[:, 0] >= 0.0).mean() < 0.06
    measure = target_of(nearly_out, NormalSearch(), SampleKnowledge(Off(), model)).search(drawn, nearly_out, LEVEL)
    assert 0.0 < measure.judge(drawn, drawn, nearly_out).quality < 0.25
    assert 0.0 < measure.agreement(2.0) < 0.25


def test_a_share_of_the_score_leaves_out_what_the_memory_says(
    at: Estimate, edges: GeneratedEdges, model: PreparedPart
) -> None:
    assert isinstance(at.view, FrameView)
    knowledge = SampleKnowledge(SampleLearning(), model)
    matches = target_of(at, NormalSearch(), knowledge).search(edges, at, LEVEL).judge(edges, edges, at).matches
    assert matches is not None
    knowledge.learn(matches)
    # The same edges, dark where they were bright.
    negative = replace(at, view=replace(at.view, image=255 - at.view.image))
    judged = {}
    for share in (0.0, 0.3, 1.0):
        measure = target_of(negative, NormalSearch(plain_share=share), knowledge).search(edges, negative, LEVEL)
        judged[share] = measure.judge(edges, edges, negative)
    quality = judged[0.0].quality
    assert judged[0.0].score == quality
    assert judged[1.0].score > 1.5 * quality
    assert judged[0.3].score == pytest.approx(0.7 * quality + 0.3 * judged[1.0].score)
    assert {each.quality for each in judged.values()} == {quality}, "what is reported stays"


def test_matches_are_for_known_samples_only(
    measure: NormalMeasure, edges: GeneratedEdges, at: Estimate, target: NormalTarget
) -> None:
    matches = measure.judge(edges, edges, at).matches
    assert matches is not None
    assert matches.edges is edges
    assert np.isfinite(matches.residuals_px).sum() >= np.isfinite(matches.sure_residuals_px).sum() > 20
    painted = replace(edges, sample_ids=np.full(len(edges), -1))
    assert target.search(painted, at, LEVEL).judge(painted, painted, at).matches is None


def test_edges_painted_anew_are_not_mistaken_for_those_that_were_searched(
    measure: NormalMeasure, edges: GeneratedEdges, at: Estimate
) -> None:
    fewer = edges.take(np.arange(len(edges) - 5))
    assert measure.judge(edges, fewer, at).edges is edges


def test_the_target_view_is_what_was_found_in_the_crop(measure: NormalMeasure, at: Estimate) -> None:
    assert isinstance(at.view, FrameView)
    view = measure.target_view()
    box = at.view.box
    assert view.origin == (max(box[0], 0), max(box[1], 0))
    assert view.distance_map is None
    assert len(view.edge_points) == (measure.candidates.scores > 0.02).sum() > 100


# ---- searched at every step ----------------------------------------------------------------------------------


def test_a_repeated_search_begins_wherever_the_points_are(
    at: Estimate, edges: GeneratedEdges, source: RigidSource, model: PreparedPart
) -> None:
    target = target_of(at, NormalSearch(bind="step"), SampleKnowledge(Off(), model))
    bound = target.bind(edges, at, LEVEL)
    assert isinstance(bound, RepeatedSearch)
    there = source.reproject(aside(at, 1.0), edges)
    anew = target.search(there, at, LEVEL)
    np.testing.assert_array_equal(bound(there).residuals, anew(there).residuals)
    assert np.abs(bound(there).residuals - target.search(edges, at, LEVEL)(there).residuals).max() > 1e-3
    assert bound.reported_loss(there) == pytest.approx(anew.reported_loss(there))
    judged = bound.judge(edges, there, aside(at, 1.0))
    assert judged.edges is there
    near = np.abs(judged.residuals_px[np.isfinite(judged.residuals_px)])
    assert near.max() <= 5.5


def test_other_numbers_of_points_are_fine_at_every_step(
    at: Estimate, source: RigidSource, edges: GeneratedEdges, model: PreparedPart
) -> None:
    target = target_of(at, NormalSearch(bind="step"), SampleKnowledge(Off(), model))
    fewer = source.generate(aside(at, 2.0), 50)
    assert len(target.bind(edges, at, LEVEL)(fewer).residuals) == 50


def test_edges_count_by_the_levels_share() -> None:
    config = NormalSearch(precision=3.0)
    assert config.precision_at(Level(8, 2.0)) == 3.0
    assert config.precision_at(Level(8, 2.0, edge_share=0.01)) == pytest.approx(0.03)


# ---- settings ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"outlier": 0.0}, "targets.outlier = 0: give a mass above 0"),
        ({"outlier": float("nan")}, "targets.outlier = nan"),
        ({"min_score": -0.1}, "targets.min_score = -0.1: give a score from 0 to 1"),
        ({"min_score": 1.0}, "targets.min_score = 1"),
        ({"precision": 0.0}, "targets.precision = 0: give a number above 0"),
    ],
)
def test_settings_that_make_no_search_are_refused(settings: dict[str, float], words: str) -> None:
    with pytest.raises(TrackingError) as caught:
        NormalSearch(**settings)  # type: ignore[arg-type]
    assert words in str(caught.value)


def test_judging_is_what_its_slow_twin_says(rng: np.random.Generator) -> None:
    scores = rng.random((30, 4)) * (rng.random((30, 4)) < 0.7)
    distances, weights = rng.normal(0.0, 2.0, (30, 4)), rng.random(30)
    fit = scores * np.exp(-0.5 * (distances / 1.5) ** 2)
    best, found, mass = np.empty(30, np.int64), np.empty(30), np.empty(30)
    _best_candidates(scores, distances, 1.5, best, found, mass)
    np.testing.assert_array_equal(best, fit.argmax(1))
    np.testing.assert_allclose(found, fit.max(1), rtol=1e-12)
    np.testing.assert_allclose(mass, fit.sum(1), rtol=1e-12)
    for shift in (0.0, 2.5, -2.5):
        near = (weights[:, None] * scores * np.exp(-0.5 * ((distances - shift) / 1.5) ** 2)).max(1).mean()
        assert _mean_nearness(scores, weights, distances, shift, 1.5) == pytest.approx(near, rel=1e-12)
    assert _mean_nearness(np.zeros((0, 4)), np.zeros(0), np.zeros((0, 4)), 0.0, 1.5) == 0.0


def test_placing_candidates_is_what_its_slow_twin_says(rng: np.random.Generator) -> None:
    (offsets, gradients), (expected, weights) = rng.normal(size=(2, 30, 4)), rng.random((2, 30))
    scores = rng.random((30, 4))
    gradients[::3, 1] = 0.0
    outline, weighed, targets = rng.random(30) < 0.5, np.empty((30, 4)), np.empty((30, 4))
    _place(offsets, gradients, scores, weights, outline, expected, 0.4, 0.3, weighed, targets)
    np.testing.assert_array_equal(weighed, np.where(scores > 0.3, scores, 0.0) * weights[:, None])
    belongs = offsets - 0.4 * np.sign(gradients) * outline[:, None] - expected[:, None]
    np.testing.assert_allclose(targets, belongs, rtol=1e-12, atol=1e-15)


def test_distances_and_residuals_are_what_their_slow_twins_say(rng: np.random.Generator) -> None:
    targets, (start, normals, points) = rng.normal(size=(30, 4)), rng.normal(size=(3, 30, 2))
    distances, residuals, best, found = np.empty((30, 4)), np.empty(30), rng.integers(0, 4, 30), rng.random(30)
    _distances(targets, start, normals, points, distances)
    moved_px = ((points - start) * normals).sum(1)
    np.testing.assert_allclose(distances, targets - moved_px[:, None], rtol=1e-12, atol=1e-15)
    _residuals(distances, best, found, 0.3, residuals)
    np.testing.assert_array_equal(residuals, np.where(found > 0.3, distances[np.arange(30), best], np.nan))


def test_image_edges_are_shared_out_once_samples_are_known(
    model: PreparedPart, edges: GeneratedEdges, at: Estimate
) -> None:
    knowledge = SampleKnowledge(SampleLearning(), model)
    sharing = target_of(at, NormalSearch(), knowledge)
    alone = target_of(at, NormalSearch(sharing=Off()), knowledge)

    def scores(target: NormalTarget, use_memory: bool = True) -> FloatArray:
        return target.search(edges, at, LEVEL, use_memory).scores

    np.testing.assert_array_equal(scores(sharing), scores(alone), "in a first frame nothing is known")
    assert knowledge.memory is not None
    candidates = target_of(at, NormalSearch(), knowledge).search(edges, at, LEVEL).candidates
    every_second = np.where(np.arange(len(edges)) % 2 == 0, 0.0, np.nan)
    knowledge.memory.learn(edges.sample_ids, candidates, candidates.scores.argmax(1), every_second)
    assert (scores(sharing) <= scores(alone)).all()
    assert (scores(sharing) < 0.9 * scores(alone)).any()
    np.testing.assert_array_equal(scores(sharing, use_memory=False), scores(alone, use_memory=False))
