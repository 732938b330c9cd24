"""Snap: from a pose set by hand to the pose that the image shows, in one frame and with nothing learnt yet.

What a hand leaves open is several degrees and, as perspective is weak, a good deal of depth: four points that are
each within 5 px of their places leave depth off by 6% and more. So a cloud of poses around the given one is
looked at, quickly and with few samples; the solver runs from those that agree best, coarse to fine; and the
best of these is refined on every visible sample. From a start that is farther off, the search of a tracker's first
frame goes on from the rim of its cloud (`search.search_on`); where that ends counts if it is better. What is better
is asked both ways (`search.both_ways`): of the part's edges in the image, and of the image's edges in the part.
And the detector is asked whether the part is elsewhere (`second_opinion`), if the part's views are stored. What the
part's edges have in common, as broken ones do, is taken in at the end (`FrameSolver.settle`): it moves the distance.
The same start gives the same result.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from acp_lab.errors import TrackingError, check_kind
from acp_lab.generator.base import GeneratedEdges
from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.camera import Camera
from acp_lab.geometry.pose import check_pose, transform
from acp_lab.geometry.pose_step import move_pose
from acp_lab.prepared_part import PreparedPart
from acp_lab.sequences.frame import Frame, check_frame
from acp_lab.tracking.confidence import Confidence
from acp_lab.tracking.find import Finder
from acp_lab.tracking.frame_solver import FrameSolver
from acp_lab.tracking.method import ACP
from acp_lab.tracking.schedule import Level
from acp_lab.tracking.search import AGREEMENT_LEVEL, LOOK_AROUND, WIDE_LEVELS, Look, SearchPlan, search_among, search_on
from acp_lab.tracking.second_opinion import Question, second_opinion
from acp_lab.tracking.solution import SeenFrame, Solution
from acp_lab.tracking.start import TrustedStart
from acp_lab.tracking.stopwatch import Stopwatch

FIRST_FRAME = TrustedStart()
LAST_LEVELS = (Level(8, 2.0, 4000), Level(5, 1.0, 4000), Level(5, 1.0, 4000))


@dataclass(frozen=True)
class SnapConfig:
    """Settings of the snap; standard deviations are those of the cloud around the given pose.

    Attributes:
        poses: in the cloud; solved: from how many of them the solver runs; refined: how many of its results.
        turn_deg: standard deviation about each axis.
        shift_px: across the image, each way.
        depth_share: of the distance.
        margin_px: image searched around the part.
        look: how the cloud is judged: wide and with few samples.
        search_levels: of the solver.
        judge: how its results are compared.
        last_levels: of the refinement; every visible sample counts.
        good_quality: from which on the part counts as found.
        seed: of the cloud.
    """

    poses: int = 600
    solved: int = 40
    refined: int = 4
    turn_deg: float = 8.0
    shift_px: float = 10.0
    depth_share: float = 0.06
    margin_px: float = 60.0
    look: Level = LOOK_AROUND
    search_levels: tuple[Level, ...] = WIDE_LEVELS
    judge: Level = AGREEMENT_LEVEL
    last_levels: tuple[Level, ...] = LAST_LEVELS
    good_quality: float = 0.8
    seed: int = 0


@dataclass(frozen=True)
class SnapResult:
    """Where a pose snapped to.

    Attributes:
        cam_T_obj: (4, 4) mm.
        quality: in [0, 1], as the tracker's: how likely the part is there, see `confidence`.
        agreement_before, agreement: in [0, 1], how well the frame agrees with the given and with the new pose.
        loss: e(I) at the new pose, see `targets.soft_assignment.robust_loss`.
        edges: the generated edge points at the new pose.
        residuals_px: (n,) px along their normals to the image edge, NaN where none was found.
        is_good: whether the quality says that the part is there; if not, look closely, or start nearer.
    """

    cam_T_obj: FloatArray
    quality: float
    agreement_before: float
    agreement: float
    loss: float
    edges: GeneratedEdges
    residuals_px: FloatArray
    is_good: bool


def snap(model: PreparedPart, frame: Frame, cam_T_obj: FloatArray, config: SnapConfig | None = None) -> SnapResult:
    """The pose near a hand-set one (4, 4) that the frame agrees with best; takes a few seconds.

    A tracker that starts there is told so, `tracker.start(frame, result.cam_T_obj, found=True)`.

    Raises:
        ParameterError: model or frame is of another kind.
        GeometryError: it is no pose: mirrored, scaled, not finite.
        TrackingError: at the given pose the part is behind the camera, outside the image or shows too few edges.
        PreparationError: the part has no generator.

    Example:
        >>> import acp_lab as acp
        >>> from acp_lab.sample import sample_dataset
        >>> scene = acp.open_sequence(sample_dataset())
        >>> model = acp.prepare(scene.dataset.part(1), out="parts")  # doctest: +SKIP
        >>> near = scene.first_pose.copy()
        >>> near[0, 3] += 5.0  # mm to the right
        >>> found = acp.snap(model, scene.frame(0), near)
        >>> bool(abs(found.cam_T_obj[0, 3] - scene.first_pose[0, 3]) < 2.0)
        True
    """
    config = config or SnapConfig()
    check_kind(model, PreparedPart, "model", "acp.PreparedPart.load('parts/bracket'), or what acp.prepare returned")
    check_frame(frame)
    start = check_pose(cam_T_obj, f"{model.part.name}: the pose to start from")
    # Nothing is learnt yet: in the first frame there is nothing to remember.
    solver = FrameSolver(model, ACP)
    solver.magnify(frame.camera, start)
    margin_px = solver.glass.times * config.margin_px

    def look(pose: FloatArray) -> SeenFrame | None:
        return solver.look(frame.image, frame.camera, pose, solver.choose_region(pose), margin_px)

    seen = look(start)
    found = None if seen is None else _search(solver, look, seen, frame.camera, config)
    if seen is None or found is None:
        raise TrackingError(
            f"{model.part.name}: at t = {np.round(start[:3, 3], 1).tolist()} mm the part is not seen in frame "
            f"{frame.index} ({frame.camera.width}x{frame.camera.height}); move the start onto it"
        )
    there, best = _asked_again(model, solver, look, frame, start, found[1], config) or found
    # What the part's edges have in common, once more is known of the pose, moves where they lie, and so its distance.
    best = solver.settle(there, best, Stopwatch(), config.last_levels)
    quality = Confidence().of(best)
    before, after = (
        _agreement(solver, at, pose, config.judge) for at, pose in ((seen, start), (there, best.cam_T_obj))
    )
    return SnapResult(
        cam_T_obj=best.cam_T_obj,
        quality=quality,
        agreement_before=before,
        agreement=after,
        loss=best.loss,
        edges=solver.glass.edges(best.judgement.edges),
        residuals_px=solver.glass.lengths(best.judgement.residuals_px),
        is_good=quality >= config.good_quality,
    )


def _search(
    solver: FrameSolver, look: Look, seen: SeenFrame, camera: Camera, config: SnapConfig
) -> tuple[SeenFrame, Solution] | None:
    """The best solution from poses around the prior of a frame's view, or on from there, and the frame around it.

    camera: of the frame, whose px a hand errs by, however small the part. None when none of the poses sees the part.
    """
    start = seen.view.prior
    cloud = _cloud(start, solver.part.box_centre, camera, config)
    plan = SearchPlan(config.search_levels, config.refined, config.last_levels)
    near = search_among(
        solver, seen, cloud, lambda pose: solver.at_pose(seen, pose), config.solved, plan, FIRST_FRAME.ranking,
        config.look, config.judge,
    )  # fmt: skip
    found = [] if near is None else [(seen, near)]
    gone_on = search_on(solver, look, seen, FIRST_FRAME.cloud, FIRST_FRAME.clouds, FIRST_FRAME.ranking)
    if gone_on is not None:
        there, solution = gone_on
        refined = solver.solve(there, there.view.at_pose(solution.cam_T_obj), Stopwatch(), config.last_levels)
        found += [] if refined is None else [(there, refined)]
    # The first of equals: around the start.
    return max(found, key=lambda one: _rank(solver, one[0], one[1], config.judge), default=None)


def _asked_again(
    model: PreparedPart,
    solver: FrameSolver,
    look: Look,
    frame: Frame,
    start: FloatArray,
    best: Solution,
    config: SnapConfig,
) -> tuple[SeenFrame, Solution] | None:
    """The best solution where the detector finds the part elsewhere; None where it does not, or was not prepared."""
    if model.views is None:
        return None
    question = Question(frame, look, start, best.cam_T_obj)
    elsewhere = second_opinion(question, solver, Finder(model), FIRST_FRAME, Confidence().of, Stopwatch())
    seen = None if elsewhere is None else look(elsewhere)
    if elsewhere is None or seen is None:
        return None
    refined = solver.solve(seen, seen.view.at_pose(elsewhere), Stopwatch(), config.last_levels)
    return None if refined is None else (seen, refined)


def _cloud(start: FloatArray, centre_obj: FloatArray, camera: Camera, config: SnapConfig) -> list[FloatArray]:
    """The start and poses (4, 4) scattered around it."""
    rng = np.random.default_rng(config.seed)
    centre_cam = transform(start, centre_obj)
    turns = rng.normal(0.0, np.radians(config.turn_deg), (config.poses, 3))
    across = rng.normal(0.0, config.shift_px, (config.poses, 2)) * centre_cam[2] / (camera.fx, camera.fy)
    away = rng.normal(0.0, config.depth_share, (config.poses, 1)) * centre_cam
    away[:, :2] += across
    return [start, *(move_pose(start, centre_obj, step) for step in np.concatenate([turns, away], 1))]


def _rank(solver: FrameSolver, seen: SeenFrame, solution: Solution, level: Level) -> float:
    return FIRST_FRAME.ranking(solver, seen, solver.at_pose(seen, solution.cam_T_obj), level)


def _agreement(solver: FrameSolver, seen: SeenFrame, cam_T_obj: FloatArray, level: Level) -> float:
    return solver.agreement(seen, solver.at_pose(seen, cam_T_obj), level)
