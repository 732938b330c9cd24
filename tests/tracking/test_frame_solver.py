"""Solving one frame: where the solver goes from an estimate, what it says of it, and when it gives up."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from acp_lab.cad.part import Part
from acp_lab.control_points.coplanar_points import mid_section_points
from acp_lab.control_points.view_regions import ALL_REGIONS
from acp_lab.errors import PreparationError
from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.pose import disturb_pose, transform
from acp_lab.geometry.pose_step import centre_position, move_pose
from acp_lab.imaging.edge_search import AS_THEY_ARE
from acp_lab.prepared_part import PreparedPart, Trained
from acp_lab.sequences.frame import Frame
from acp_lab.tracking import frame_solver as frame_solver_module
from acp_lab.tracking.frame_solver import MIN_EDGES, FrameSolver
from acp_lab.tracking.frame_view import Estimate
from acp_lab.tracking.learning.edge_profiles import ProfileConfig
from acp_lab.tracking.learning.knowledge import Off
from acp_lab.tracking.method import ACP, ACP_EDGES, DIRECT_6DOF, Method
from acp_lab.tracking.motions import ControlPointVariables, PoseVariables
from acp_lab.tracking.schedule import Level, PixelSchedule, ShareSchedule
from acp_lab.tracking.solution import SeenFrame
from acp_lab.tracking.solvers import GaussNewton
from acp_lab.tracking.sources.rigid import CadSamples
from acp_lab.tracking.stopwatch import Stopwatch
from acp_lab.tracking.targets.distance_map import DistanceMap
from acp_lab.tracking.targets.normals import NormalSearch, NormalTarget
from tests.made_parts import looking_at
from tests.prepared_sample import sample_model, sample_scene
from tests.tracking.rendered import AS_DRAWN, CAMERA, MadeSequence, add_percent

REGION = 4
BLACK = np.zeros((160, 200, 3), np.uint8)
# The paper's path but for its edges, which need no training; only on a flat part does the homography find the way.
FROM_MAP = replace(DIRECT_6DOF, name="from-map", control_points="mid-section", source=CadSamples("templates"))
RECORDED = replace(FROM_MAP, variables=ControlPointVariables(direction="autograd"), solver=GaussNewton(steps=3))


@pytest.fixture
def solver(model: PreparedPart) -> FrameSolver:
    return FrameSolver(model, AS_DRAWN)


@pytest.fixture
def truth(sequence: MadeSequence) -> FloatArray:
    return sequence.first_pose


@pytest.fixture
def frame(sequence: MadeSequence) -> Frame:
    (found,) = sequence.frames(1)
    assert isinstance(found, Frame)
    return found


def looked_at(solver: FrameSolver, frame: Frame, prior: FloatArray) -> SeenFrame:
    seen = solver.look(frame.image, frame.camera, prior, REGION)
    assert seen is not None
    return seen


@pytest.fixture
def seen(solver: FrameSolver, frame: Frame, truth: FloatArray) -> SeenFrame:
    return looked_at(solver, frame, truth)


# ---- one frame -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("angle_deg", "shift_mm"), [(0.0, 0.0), (2.0, 2.0), (4.0, 4.0)])
def test_the_solver_comes_back_to_the_truth(
    part: Part, solver: FrameSolver, seen: SeenFrame, truth: FloatArray, angle_deg: float, shift_mm: float
) -> None:
    for seed in range(3):
        start = disturb_pose(truth, part.box_centre, angle_deg, shift_mm, np.random.default_rng(seed))
        found = solver.solve(seen, seen.view.at_pose(start), Stopwatch())
        assert found is not None
        assert add_percent(part, found.cam_T_obj, truth) < 1.5
        assert found.quality > 0.7
        assert 0.0 <= found.loss < 0.4
        assert 3 < found.iterations <= 3 * 3  # levels times steps, of which a tiny one is a level's last


def test_a_search_nearby_needs_less_of_the_image_filtered(
    part: Part, model: PreparedPart, frame: Frame, truth: FloatArray
) -> None:
    # As long as the lens is not known, how much a picture is sharpened follows from how much of it is seen.
    solver = FrameSolver(model, replace(AS_DRAWN, targets=(NormalSearch(AS_THEY_ARE), *AS_DRAWN.targets[1:])))
    assert isinstance(solver.method.schedule, PixelSchedule)
    near = solver.method.schedule.near
    prior = disturb_pose(truth, part.box_centre, 0.5, 0.5, np.random.default_rng(0))
    whole, less = (solver.look(frame.image, frame.camera, prior, REGION, levels=levels) for levels in (None, near))
    assert whole is not None
    assert less is not None
    sizes = []
    for seen in (whole, less):
        assert isinstance(seen.targets[0], NormalTarget)
        sizes.append(seen.targets[0].patch.channels.size)
    assert sizes[1] < 0.8 * sizes[0]
    found = [solver.solve(seen, seen.view.at_pose(prior), Stopwatch(), near) for seen in (whole, less)]
    assert found[0] is not None
    assert found[1] is not None
    # Places in the image are single precision, and are counted from the crop's corner.
    np.testing.assert_allclose(found[1].cam_T_obj, found[0].cam_T_obj, atol=1e-4)
    assert found[1].score == pytest.approx(found[0].score, abs=1e-5)


def test_an_estimate_is_judged_worse_away_from_the_truth(
    part: Part, solver: FrameSolver, seen: SeenFrame, truth: FloatArray
) -> None:
    level = Level(8, 1.0, 500)
    there = solver.look_at(seen, seen.view.at_pose(truth), level, Stopwatch())
    away = seen.view.at_pose(move_pose(truth, part.box_centre, np.array([0.0, 0, 0, 3.0, 0, 0])))
    aside = solver.look_at(seen, away, level, Stopwatch())
    assert there is not None
    assert aside is not None
    assert there.quality > 1.4 * aside.quality
    assert there.loss < aside.loss
    residuals = there.judgement.residuals_px
    assert np.nanmedian(np.abs(residuals)) < 0.3
    assert np.isfinite(residuals).mean() > 0.8
    assert solver.agreement(seen, there.estimate, level) > 1.5 * solver.agreement(seen, away, level)
    # Looking moves nothing.
    np.testing.assert_array_equal(aside.cam_T_obj, away.cam_T_obj)


def test_generated_edges_lie_at_the_solved_pose(
    part: Part, model: PreparedPart, solver: FrameSolver, seen: SeenFrame, truth: FloatArray
) -> None:
    start = disturb_pose(truth, part.box_centre, 2.0, 2.0, np.random.default_rng(0))
    found = solver.solve(seen, seen.view.at_pose(start), Stopwatch())
    assert found is not None
    edges = found.judgement.edges
    points_obj = model.edges.points_obj[edges.sample_ids]
    np.testing.assert_allclose(edges.points, CAMERA.project(transform(found.cam_T_obj, points_obj)), atol=1e-9)
    assert len(edges) == len(found.judgement.residuals_px)


def test_time_is_booked_by_stage(solver: FrameSolver, seen: SeenFrame) -> None:
    clock = Stopwatch()
    solver.solve(seen, seen.view.at_pose(seen.view.prior), clock)
    assert min(clock.generate_s, clock.search_s, clock.solve_s) > 0.0
    assert clock.image_s == clock.learn_s == 0.0


def test_the_solver_takes_the_steps_and_the_levels_of_its_method(
    model: PreparedPart, frame: Frame, truth: FloatArray
) -> None:
    method = replace(ACP, solver=GaussNewton(steps=5), schedule=PixelSchedule((Level(10, 3.0), Level(6, 1.5))))
    solver = FrameSolver(model, method)
    seen = looked_at(solver, frame, truth)
    start = seen.view.at_pose(truth)
    found = solver.solve(seen, start, Stopwatch())
    assert found is not None
    assert found.iterations == 2 * 5
    size_px = model.part.diameter * CAMERA.fx / 330.0
    for level, expected in zip(solver.levels_at(start), method.schedule.at(size_px), strict=True):
        assert (level.reach_px, level.sigma_px) == (expected.reach_px, pytest.approx(expected.sigma_px))
    # Others may be asked for, and are shortened on a small part as the method's own are.
    one = (Level(8, 2.0, 100),)
    found = solver.solve(seen, start, Stopwatch(), one)
    assert found is not None
    assert found.iterations == 5
    assert len(found.judgement.edges) == 100
    assert solver.levels_at(start, one)[0].sigma_px == pytest.approx(PixelSchedule(one).at(size_px)[0].sigma_px)


# ---- what a method says decides what is done -----------------------------------------------------------------


def test_alpha_decides_which_edges_draw(model: PreparedPart, frame: Frame, part: Part, truth: FloatArray) -> None:
    """Some edges of the part do not show in the image: a wide alpha lets them draw, a narrow one leaves them out."""
    start = move_pose(truth, part.box_centre, np.array([0.0, 0.0, 0.0, 3.0, 0.0, 0.0]))
    off = {}
    for alpha in (0.02, 0.10):
        method = replace(FROM_MAP, schedule=ShareSchedule(alpha=alpha, shares=(1.0,)), solver=GaussNewton(steps=8))
        solver = FrameSolver(model, method)
        seen = looked_at(solver, frame, truth)
        found = solver.solve(seen, seen.view.at_pose(start), Stopwatch())
        assert found is not None
        off[alpha] = add_percent(part, found.cam_T_obj, truth)
    assert off[0.02] < 1.5
    assert off[0.10] > 4.0


def test_the_form_of_the_loss_decides_where_the_solver_goes_and_what_it_reports(
    model: PreparedPart, frame: Frame, part: Part, truth: FloatArray
) -> None:
    start = disturb_pose(truth, part.box_centre, 2.0, 3.0, np.random.default_rng(0))
    poses, losses = [], []
    for form in ("logistic", "saturating", "geman-mcclure", "tukey"):
        solver = FrameSolver(model, replace(FROM_MAP, targets=(DistanceMap(form),)))  # type: ignore[arg-type]
        seen = looked_at(solver, frame, truth)
        found = solver.solve(seen, seen.view.at_pose(start), Stopwatch())
        assert found is not None
        poses.append(found.cam_T_obj)
        losses.append(found.loss)
    for k in range(4):
        for other in range(k):
            assert np.abs(poses[k] - poses[other]).max() > 1e-4
            assert losses[k] != pytest.approx(losses[other], rel=1e-3)


def test_the_reported_loss_is_the_sum_over_the_targets(model: PreparedPart, frame: Frame, truth: FloatArray) -> None:
    both = replace(FROM_MAP, targets=(NormalSearch(precision=3.0), DistanceMap(precision=0.5)))
    solver = FrameSolver(model, both)
    seen = looked_at(solver, frame, truth)
    found = solver.solve(seen, seen.view.at_pose(truth), Stopwatch())
    assert found is not None
    last = solver.levels_at(found.estimate)[-1]
    edges = found.judgement.edges
    parts = [target.bind(edges, found.estimate, last).reported_loss(edges) for target in seen.targets]
    # Each in its own units, however precise it is. The search of the last level began beside the result, hence about.
    assert found.loss == pytest.approx(sum(parts), rel=0.05)
    assert min(parts) > 0.06 * found.loss


def test_several_measures_move_the_part_otherwise_than_each_alone(
    model: PreparedPart, frame: Frame, part: Part, truth: FloatArray
) -> None:
    start = disturb_pose(truth, part.box_centre, 2.0, 2.0, np.random.default_rng(1))

    def solved(*targets: DistanceMap | NormalSearch) -> FloatArray:
        solver = FrameSolver(model, replace(FROM_MAP, targets=targets))
        seen = looked_at(solver, frame, truth)
        found = solver.solve(seen, seen.view.at_pose(start), Stopwatch())
        assert found is not None
        return found.cam_T_obj

    normals, by_map = solved(NormalSearch()), solved(DistanceMap())
    both = solved(NormalSearch(), DistanceMap())
    assert add_percent(part, both, truth) < 2.0
    assert min(np.abs(both - normals).max(), np.abs(both - by_map).max()) > 1e-4
    # As the precision of one of them vanishes, the other decides.
    mostly = solved(NormalSearch(), DistanceMap(precision=1e-9))
    assert np.abs(mostly - normals).max() < 1e-4 < np.abs(mostly - by_map).max()


def test_the_points_in_use_are_regressed_ones_or_the_middle_section(
    model: PreparedPart, part: Part, truth: FloatArray
) -> None:
    middle = mid_section_points(part.box_min, part.box_max, ALL_REGIONS[REGION].axis)
    regressed = part.box_centre + 0.7 * (middle - part.box_centre)
    values = Trained(dict.fromkeys(range(6), regressed), {})
    trained = replace(model, regressed_points=values)  # type: ignore[arg-type]
    for point_set, expected in (("regressed", regressed), ("mid-section", middle)):
        solver = FrameSolver(trained, replace(FROM_MAP, control_points=point_set))  # type: ignore[arg-type]
        np.testing.assert_array_equal(solver.control_points_obj[REGION], expected)
        view = looked_at(solver, Frame(0, BLACK, CAMERA), truth).view
        np.testing.assert_array_equal(view.points_obj, expected)


# ---- steps ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("method", [FROM_MAP, RECORDED, ACP], ids=["pose", "control points", "acp"])
def test_the_loss_of_a_step_is_that_of_its_own_estimate(
    model: PreparedPart, part: Part, frame: Frame, truth: FloatArray, method: Method
) -> None:
    """On the level's own measure; and no step repeats what was said of the one before."""
    solver = FrameSolver(model, method)
    solver.records_steps = True
    seen = looked_at(solver, frame, truth)
    start = seen.view.at_pose(disturb_pose(truth, part.box_centre, 2.0, 2.0, np.random.default_rng(0)))
    found = solver.solve(seen, start, Stopwatch())
    assert found is not None
    levels = solver.levels_at(start)
    assert len(found.steps) == found.iterations > len(levels)
    assert found.steps[-1].loss == pytest.approx(found.loss, rel=1e-12)
    at: Estimate = start
    for number, level in enumerate(levels):
        edges = solver.source.generate(at, level.samples)
        measures = [target.bind(edges, at, level) for target in seen.targets]
        motion = method.variables.motion(solver.source, edges, at, solver._lifter, level.samples)
        of_level = [step for step in found.steps if step.level == number]
        assert len(of_level) >= 2
        for step in of_level:
            if isinstance(method.variables, PoseVariables):
                estimate = seen.view.at_pose(step.cam_T_obj)
            else:
                estimate = seen.view.at_points(step.control_points)
            expected = sum(measure.reported_loss(motion.edges(estimate)) for measure in measures)
            assert step.loss == pytest.approx(expected, rel=1e-9)
            at = estimate
        losses = [step.loss for step in of_level]
        assert len(set(losses)) == len(losses)
        # What the last step brought shows, too.
        assert losses[-1] != losses[-2]


# ---- where nothing can be seen -------------------------------------------------------------------------------


@pytest.mark.parametrize("shift", [(0.0, 0.0, -900.0), (400.0, 0.0, 0.0)], ids=["behind", "right of the image"])
def test_nothing_is_seen_where_the_part_is_not_in_view(
    part: Part, solver: FrameSolver, truth: FloatArray, shift: tuple[float, float, float]
) -> None:
    pose = move_pose(truth, part.box_centre, np.array([0.0, 0.0, 0.0, *shift]))
    assert solver.look(BLACK, CAMERA, pose, REGION) is None


def test_a_part_much_larger_than_the_image_is_sought_in_the_image(solver: FrameSolver, truth: FloatArray) -> None:
    close = replace(CAMERA, fx=90_000.0, fy=90_000.0)
    seen = solver.look(BLACK, close, truth, REGION)
    assert seen is not None
    assert seen.targets[0].patch.channels.shape == (160, 200, 3)  # type: ignore[attr-defined]


def test_the_margin_is_the_methods_unless_asked_otherwise(model: PreparedPart, truth: FloatArray) -> None:
    solver = FrameSolver(model, replace(ACP, margin_px=5.0))
    boxes = []
    for margin_px in (None, 9.0):
        seen = solver.look(BLACK, CAMERA, truth, REGION, margin_px)
        assert seen is not None
        boxes.append(np.array(seen.view.box))
    assert np.abs(boxes[1] - boxes[0] - [-4, -4, 4, 4]).max() <= 1


def test_a_black_image_moves_nothing(solver: FrameSolver, truth: FloatArray) -> None:
    seen = solver.look(BLACK, CAMERA, truth, REGION)
    assert seen is not None
    found = solver.solve(seen, seen.view.at_pose(truth), Stopwatch())
    assert found is not None
    np.testing.assert_allclose(found.cam_T_obj, truth, atol=1e-9)
    assert found.quality == 0.0
    assert np.isnan(found.judgement.residuals_px).all()
    assert np.isfinite(found.loss)


@pytest.mark.parametrize("to_centre_mm", [10.0, 3.0, -50.0, np.nan])
def test_a_step_into_the_camera_is_no_pose(
    part: Part,
    solver: FrameSolver,
    seen: SeenFrame,
    truth: FloatArray,
    monkeypatch: pytest.MonkeyPatch,
    to_centre_mm: float,
) -> None:
    """With some samples behind the camera nothing is found; a step of the whole part to there is not made."""
    depth = float(centre_position(truth, part.box_centre)[2])
    into = move_pose(truth, part.box_centre, np.array([0.0, 0.0, 0.0, 0.0, 0.0, to_centre_mm - depth]))

    def jumps(problem: object, start: Estimate, solver: object) -> tuple[Estimate, ...]:
        moved = start.view.at_pose(into)
        return (moved,) if moved.is_possible else ()

    monkeypatch.setattr(frame_solver_module, "minimise", jumps)
    monkeypatch.setattr(frame_solver_module, "pose_level", lambda *_: None)
    found = solver.solve(seen, seen.view.at_pose(truth), Stopwatch(), (Level(8, 1.0),))
    if to_centre_mm > 0.0:
        assert found is None
    else:
        assert found is not None
        np.testing.assert_array_equal(found.cam_T_obj, truth)
        assert found.iterations == 0


def test_too_few_visible_samples_are_not_enough(solver: FrameSolver, seen: SeenFrame) -> None:
    few, at = Level(8, 1.0, MIN_EDGES - 1), seen.view.at_pose(seen.view.prior)
    assert solver.look_at(seen, at, few, Stopwatch()) is None
    assert solver.solve(seen, at, Stopwatch(), (few,)) is None
    assert solver.agreement(seen, at, few) == 0.0
    assert solver.look_at(seen, at, Level(8, 1.0, MIN_EDGES), Stopwatch()) is not None


def test_degenerate_control_points_solve_nothing(model: PreparedPart, frame: Frame, truth: FloatArray) -> None:
    solver = FrameSolver(model, RECORDED)
    seen = looked_at(solver, frame, truth)
    flat = seen.view.at_points(np.column_stack([np.linspace(60.0, 120.0, 4), np.full(4, 50.0)]))
    assert solver.solve(seen, flat, Stopwatch()) is None
    assert solver.look_at(seen, flat, Level(8, 1.0), Stopwatch()) is None
    assert solver.agreement(seen, flat, Level(8, 1.0)) == 0.0


# ---- view regions --------------------------------------------------------------------------------------------


class Prepared:
    """A generator for some regions only."""

    def __init__(self, *regions: int) -> None:
        self.regions = regions


def test_only_prepared_regions_are_chosen_and_the_present_one_is_kept_for_a_while(
    part: Part, solver: FrameSolver
) -> None:
    half = 0.5 * part.box_size

    def towards(first: float, second: float) -> FloatArray:
        """From between +x (region 0) and +z (region 4), as far into each."""
        return looking_at(part, np.array([first, 0.1, second]) * half, 330.0)

    assert solver.choose_region(towards(1.0, 0.9)) == solver.natural_region(towards(1.0, 0.9)) == 0
    # By less than 15% ahead: the present region stays; beyond, it does not.
    assert solver.choose_region(towards(1.0, 0.9), current=4) == 4
    assert solver.choose_region(towards(1.0, 0.8), current=4) == 0
    assert solver.is_prepared_for(towards(1.0, 0.9), 4)
    assert not solver.is_prepared_for(towards(1.0, 0.8), 4)
    solver.source = Prepared(4, 5)  # type: ignore[assignment]
    assert solver.natural_region(towards(1.0, 0.5)) == 0
    assert solver.choose_region(towards(1.0, 0.5)) == 4
    assert not solver.is_prepared_for(towards(1.0, 0.5), solver.choose_region(towards(1.0, 0.5)))


def test_a_pose_elsewhere_is_estimated_in_its_own_region(part: Part, solver: FrameSolver, seen: SeenFrame) -> None:
    aside = looking_at(part, np.array([1.0, 0.1, 0.2]), 330.0)
    estimate = solver.at_pose(seen, aside)
    assert (seen.view.region, estimate.view.region) == (REGION, 0)
    np.testing.assert_array_equal(estimate.view.points_obj, solver.control_points_obj[0])
    assert estimate.cam_T_obj is aside


def test_forgetting_leaves_nothing_known(solver: FrameSolver) -> None:
    before = solver.knowledge
    solver.forget()
    assert solver.knowledge is not before
    assert FrameSolver(solver._model, replace(ACP_EDGES, learning=Off())).knowledge.memory is None


def test_a_method_that_needs_regressed_points_says_so(model: PreparedPart) -> None:
    with pytest.raises(PreparationError, match="are not regressed; run: acp-lab prepare"):
        FrameSolver(model, replace(FROM_MAP, control_points="regressed"))


def test_a_first_frame_is_solved_again_for_what_its_edges_have_in_common() -> None:
    scene, model = sample_scene(), sample_model()
    frame, truth = next(iter(scene.frames())), scene.truth(0, 1)
    assert isinstance(frame, Frame)
    assert truth is not None
    off = disturb_pose(truth, model.part.box_centre, 1.0, 2.0, np.random.default_rng(2))
    no_traits = replace(ACP.learning, profiles=ProfileConfig(evidence_share=0.0))  # type: ignore[type-var]
    for method, settles in ((ACP, True), (replace(ACP, learning=no_traits), False)):
        solver = FrameSolver(model, method)
        seen = solver.look(frame.image, frame.camera, off, solver.choose_region(off))
        assert seen is not None
        solved = solver.solve(seen, seen.view.at_pose(off), Stopwatch())
        assert solved is not None
        settled = solver.settle(seen, solved, Stopwatch())
        assert (settled is not solved) == settles
        profiles = solver.knowledge.profiles
        assert profiles is not None
        assert bool(np.any(profiles.traits.values)) == settles
        again = solver.settle(seen, settled, Stopwatch())
        np.testing.assert_allclose(again.cam_T_obj, settled.cam_T_obj, atol=0.3)
