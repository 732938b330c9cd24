"""One frame: from the estimate that it starts with to the one that fits (paper IV-B, eqs 5 to 7).

Per level of the schedule: the source generates edges at the present estimate, every target binds them, and the
solver takes a few steps down e on the motion that the method's variables make of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from acp_lab.cad.part import box_corners
from acp_lab.control_points.canonical_frame import eye_position
from acp_lab.control_points.view_regions import REGION_COUNT, choose_region
from acp_lab.errors import GeometryError
from acp_lab.generator.base import GeneratedEdges
from acp_lab.geometry.arrays import ByteImage, FloatArray
from acp_lab.geometry.camera import Camera
from acp_lab.geometry.pose import transform
from acp_lab.prepared_part import PreparedPart
from acp_lab.tracking.edge_breaks import BrokenEdges, into_material
from acp_lab.tracking.frame_view import Box, Estimate, FrameView, crop_box
from acp_lab.tracking.learning.encoding import AS_IT_IS
from acp_lab.tracking.learning.knowledge import Off, SampleKnowledge
from acp_lab.tracking.magnification import MagnifyingGlass, appears_px
from acp_lab.tracking.method import Method, Schedule
from acp_lab.tracking.motions import Motion
from acp_lab.tracking.part_size import for_size
from acp_lab.tracking.pose_descent import pose_level
from acp_lab.tracking.result import TrackStep
from acp_lab.tracking.schedule import EVERY_SAMPLE, Level, PixelSchedule, scaled
from acp_lab.tracking.solution import SeenFrame, Solution
from acp_lab.tracking.solvers import Problem, WeightedMeasure, minimise
from acp_lab.tracking.sources.lift import EdgeLifter
from acp_lab.tracking.stopwatch import Stopwatch
from acp_lab.tracking.targets import QUALITY_SIGMA_PX, Measure
from acp_lab.tracking.targets.normals import NormalSearch

# Fewer edge points than this cannot fix six degrees of freedom with any safety.
MIN_EDGES = 12
# Beyond the farthest edge that is searched: the grey beside it, and what the image's filters need.
_ROOM_PX = 9
# How often the first frame is solved again for what its edges have in common.
_SETTLING = 2


class FrameSolver:
    """Solves frames of one prepared part by one method.

    knowledge: what was learnt of the part's edge samples so far. records_steps: whether solutions carry their steps.
    glass: through which frames are looked at; views, their cameras and all px in them are of the magnified image.
    edge_break_mm: how far the real part's edges are broken. control_points_obj: (4, 3) mm per view region 0..5, the
    method's W; those of regions that the method cannot track in are the box's middle section.
    """

    def __init__(self, model: PreparedPart, method: Method) -> None:
        """PreparationError when the part lacks the generator that the method needs."""
        self.part = model.part
        self.edge_break_mm = model.edge_break_mm
        self.method = for_size(method, model.part.times_usual)
        self.source = method.open_source(model)
        self.control_points_obj = method.control_points_of(model, self.source.regions)
        self.records_steps = False
        magnification = self.method.magnification
        self.glass = MagnifyingGlass(None if isinstance(magnification, Off) else magnification)
        self._model = model
        self._lifter = EdgeLifter(model.part, model.edges)
        self._corners_obj = box_corners(model.part)
        # Whatever the view, its outermost edge points are among these.
        knows_samples = self.source.knows_samples
        self._outermost_obj = model.edges.outermost_obj if knows_samples else self._corners_obj
        self._into_obj = into_material(model.edges)
        self._half_size = 0.5 * model.part.box_size
        self.forget()

    def forget(self) -> None:
        """Nothing is known of the edge samples, nor how large the part appears."""
        self.glass.put_away()
        self.knowledge = SampleKnowledge(self.method.learning, self._model)
        searches = [target.search for target in self.method.targets if isinstance(target, NormalSearch)]
        if all(search.gamma <= AS_IT_IS for search in searches):
            self.knowledge.encoding = None  # who was told need not learn it
        self._memories = tuple(target.memory(self._model) for target in self.method.targets)

    def magnify(self, camera: Camera, cam_T_obj: FloatArray) -> None:
        """Choose the glass for a frame whose part is expected at a pose (4, 4)."""
        if transform(cam_T_obj, self.part.box_centre)[2] > 0.0:
            # A part all around the camera is no reason to look at a picture of a few px.
            largest_px = 4.0 * max(camera.width, camera.height)
            self.glass.choose(min(appears_px(self.part, camera, cam_T_obj), largest_px))
        self.knowledge.is_magnified = self.glass.times > 1

    def natural_region(self, cam_T_obj: FloatArray) -> int:
        """The view region 0..5 that a pose (4, 4) is in, prepared or not."""
        return self._choose(cam_T_obj, None, range(REGION_COUNT))

    def choose_region(self, cam_T_obj: FloatArray, current: int | None = None) -> int:
        """The view region 0..5 to use at a pose (4, 4), among the prepared ones; the current one with hysteresis."""
        return self._choose(cam_T_obj, current, self.source.regions)

    def is_prepared_for(self, cam_T_obj: FloatArray, region: int) -> bool:
        """Whether a view region serves a pose (4, 4): it is the pose's own, or would be kept by hysteresis."""
        return self._choose(cam_T_obj, region, range(REGION_COUNT)) == region

    def look(
        self,
        image: ByteImage,
        camera: Camera,
        prior: FloatArray,
        region: int,
        margin_px: float | None = None,
        information: FloatArray | None = None,
        levels: tuple[Level, ...] | None = None,
        motion: FloatArray | None = None,
        steps: float = 1.0,
    ) -> SeenFrame | None:
        """The frame around the part at a prior pose (4, 4).

        information, motion, steps: (6, 6), (6,) and a number, see `frame_view.View`. levels: those that it will be
        solved with, from the prior, where these are not the method's. None where the part is not in sight, see
        `crop_box`.
        """
        margin_px = self.method.margin_px if margin_px is None else margin_px
        # What is too small in the frame itself, or out of its sight, is so through any glass.
        if self.glass.times > 1 and crop_box(self._corners_obj, prior, camera, margin_px) is None:
            return None
        camera = self.glass.camera(camera)
        box = crop_box(self._corners_obj, prior, camera, margin_px)
        if box is None:
            return None
        image = self.glass.image(image, box)
        edge_box = None
        if levels is not None:
            # The less of the image is filtered the better; colours beside the part are read as they are.
            room_px = max(level.reach_px for level in levels) + _ROOM_PX
            edge_box = crop_box(self._outermost_obj, prior, camera, min(room_px, margin_px))
        return self._seen(self.view(image, camera, prior, region, box, edge_box, information, motion, steps))

    def afresh(self, seen: SeenFrame) -> SeenFrame:
        """The same frame, for a search: what targets keep of poses that they are asked for stays out of the other."""
        return self._seen(seen.view)

    def _seen(self, view: FrameView) -> SeenFrame:
        return SeenFrame(view, tuple(memory.see(view, self.knowledge) for memory in self._memories))

    def view(
        self,
        image: ByteImage,
        camera: Camera,
        prior: FloatArray,
        region: int,
        box: Box,
        edge_box: Box | None = None,
        information: FloatArray | None = None,
        motion: FloatArray | None = None,
        steps: float = 1.0,
    ) -> FrameView:
        """A view of a region, whose image is looked at inside a box (x0, y0, x1, y1), or less of it for edges."""
        return FrameView(
            camera,
            prior,
            region,
            self.control_points_obj[region],
            self.part,
            self.source.canonical_size,
            information,
            motion,
            steps,
            self.knowledge.readout,
            image=image,
            box=box,
            edge_box=edge_box or box,
        )

    def at_pose(self, seen: SeenFrame, cam_T_obj: FloatArray) -> Estimate:
        """The estimate of a pose (4, 4) in the view region that it is in, whatever that of the frame's view."""
        view = seen.view
        region = self.choose_region(cam_T_obj)
        return self.view(view.image, view.camera, view.prior, region, view.box).at_pose(cam_T_obj)

    def solve(
        self, seen: SeenFrame, start: Estimate, clock: Stopwatch, levels: tuple[Level, ...] | None = None
    ) -> Solution | None:
        """argmin e from an estimate; None where too few edges are generated or the estimate is degenerate.

        levels: instead of the method's own, for a part that appears large.
        """
        try:
            return self._solve(seen, start, clock, levels)
        except GeometryError:
            return None

    def settle(
        self, seen: SeenFrame, solution: Solution, clock: Stopwatch, levels: tuple[Level, ...] | None = None
    ) -> Solution:
        """A solution of a first frame, once it is known what the part's edges have in common (`edge_traits`).

        Its edges tell that, which moves where they are told to lie, and so the pose; twice over. levels: of these
        solves, by default those of the schedule that are near.
        """
        schedule = self.method.schedule
        if not self.knowledge.has_traits or not isinstance(schedule, PixelSchedule):
            return solution
        for _ in range(_SETTLING):
            matches = solution.judgement.matches
            if matches is None:
                break
            self.knowledge.learn_traits(matches, afresh=True)
            at = seen.view.at_pose(solution.cam_T_obj)
            solution = self.solve(seen, at, clock, levels or schedule.near) or solution
        return solution

    def look_at(self, seen: SeenFrame, at: Estimate, level: Level, clock: Stopwatch) -> Solution | None:
        """What the frame says of an estimate as it is, without moving it; None where too few edges show."""
        try:
            edges = self._generate(at, level.samples, clock)
            if edges is None:
                return None
            judgements = tuple(target.bind(edges, at, level).judge(edges, edges, at) for target in seen.targets)
            clock.search_s += clock.lap()
            return Solution(at, judgements, sum(judgement.loss for judgement in judgements), None)
        except GeometryError:
            return None

    def weigh(self, seen: SeenFrame, solution: Solution) -> Solution:
        """A solution with the information that a solve's last level has there; as it is where too few edges show."""
        at, method = solution.estimate, self.method
        level = self.levels_at(at)[-1]
        edges = self.edges_at(at, level.samples, Stopwatch())
        if edges is None:
            return solution
        try:
            motion = method.variables.motion(self.source, edges, at, self._lifter, level.samples)
            measures = [target.bind(motion.kept(edges), at, level) for target in seen.targets]
            breaks = BrokenEdges(self._model.edges, self._into_obj, at)
            matrix = self._problem(motion, measures, at, level).information(at, breaks).matrix
            return replace(solution, information=method.variables.pose_information(matrix, at))
        except GeometryError:
            return solution

    def agreement(self, seen: SeenFrame, at: Estimate, level: Level) -> float:
        """In [0, 1]: how well the frame agrees with an estimate, whatever was learnt of how its edges look."""
        edges = self.edges_at(at, level.samples, Stopwatch())
        return 0.0 if edges is None else seen.targets[0].agreement(edges, at, level, level.sigma_px)

    def edges_at(self, at: Estimate, samples: int, clock: Stopwatch) -> GeneratedEdges | None:
        """The edges of an estimate, so many at most; None where too few show, or the part cannot be seen from there."""
        try:
            return self._generate(at, samples, clock)
        except GeometryError:
            return None

    def found(self, seen: SeenFrame, edges: GeneratedEdges, at: Estimate, level: Level) -> float:
        """In [0, 1]: how well the frame agrees with some of an estimate's edges, whatever was learnt of their look."""
        return seen.targets[0].agreement(edges, at, level, QUALITY_SIGMA_PX)

    def explained(self, seen: SeenFrame, at: Estimate) -> int:
        """How many of the image's edge pixels the part's edges at an estimate explain, see `explained_edges`."""
        edges = self.edges_at(at, EVERY_SAMPLE, Stopwatch())
        return 0 if edges is None else seen.image_edges.explained(edges.points)

    def shown_edges(self, solution: Solution) -> GeneratedEdges:
        """The edges of a solution where the picture shows them, also where it was read while the part moved."""
        edges, at = solution.judgement.edges, solution.estimate
        if at.view.readout is None or (edges.sample_ids < 0).any():
            return edges
        return replace(edges, points=at.read_places(edges.points, self._model.edges.points_obj[edges.sample_ids]))

    def levels_at(self, at: Estimate, levels: tuple[Level, ...] | None = None) -> tuple[Level, ...]:
        """The method's levels, or others, for the size that the part has in the image at an estimate."""
        size_px = self.part.diameter * at.view.camera.fx / max(float(at.centre_cam[2]), 1e-6)
        return self.method.schedule.at(size_px) if levels is None else scaled(levels, size_px)

    def _choose(self, cam_T_obj: FloatArray, current: int | None, among: tuple[int, ...] | range) -> int:
        eye = eye_position(cam_T_obj) - self.part.box_centre
        return choose_region(eye, self._half_size, current, among=among)

    def _generate(self, at: Estimate, samples: int, clock: Stopwatch) -> GeneratedEdges | None:
        clock.lap()
        edges = self.source.generate(at, samples)
        clock.generate_s += clock.lap()
        return edges if len(edges) >= MIN_EDGES and np.isfinite(edges.points.sum()) else None

    def _solve(
        self, seen: SeenFrame, start: Estimate, clock: Stopwatch, levels: tuple[Level, ...] | None
    ) -> Solution | None:
        method, at = self.method, start
        iterations, steps = 0, list[TrackStep]()
        solution: Solution | None = None
        all_levels = self.levels_at(start, levels)
        # Steps of a try that leaves the first levels out are numbered like those of a whole one.
        left_out = _left_out(levels, method.schedule)
        for number, level in enumerate(all_levels):
            edges = self._generate(at, level.samples, clock)
            if edges is None:
                return None
            motion = method.variables.motion(self.source, edges, at, self._lifter, level.samples)
            edges = motion.kept(edges)
            if len(edges) < MIN_EDGES:
                return None
            measures = [target.bind(edges, at, level) for target in seen.targets]
            clock.search_s += clock.lap()
            problem = self._problem(motion, measures, at, level)
            arrays = pose_level(problem, at, method.solver)
            began = at
            iterates = minimise(problem, at, method.solver) if arrays is None else arrays.minimise(at)
            at = iterates[-1] if iterates else at
            iterations += len(iterates)
            if self.records_steps:
                steps += [_step(i, left_out + number, self._reported_loss(measures, motion.edges(i))) for i in iterates]
            if number == len(all_levels) - 1:
                drawn = self.source.reproject(at, edges)
                # Levels in arrays are of points that lie where their 3D points project to, and so are the new ones.
                moved = motion.edges(at) if arrays is None else drawn
                judgements = tuple(measure.judge(moved, drawn, at) for measure in measures)
                loss = sum(judgement.loss for judgement in judgements)
                information = None
                if method.prediction.weighs_images:
                    breaks = BrokenEdges(self._model.edges, self._into_obj, began)
                    if arrays is None:
                        matrix = problem.information(at, breaks).matrix
                    else:
                        matrix = arrays.information(at, breaks)
                    information = method.variables.pose_information(matrix, at)
                solution = Solution(at, judgements, loss, information, iterations, tuple(steps))
            clock.solve_s += clock.lap()
        # Not finite where the last step put some edge points behind the camera.
        is_finite = solution is not None and np.isfinite(at.cam_T_obj).all() and np.isfinite(solution.loss)
        return solution if is_finite else None

    def _problem(self, motion: Motion, measures: Sequence[Measure], at: Estimate, level: Level) -> Problem:
        """What is minimised on a level that starts at an estimate."""
        method = self.method
        return Problem(
            motion,
            [WeightedMeasure(m, t.precision_at(level)) for m, t in zip(measures, method.targets, strict=True)],
            [prior for config in method.priors if (prior := config.bind(method.variables, at)) is not None],
            method.variables.scale(at.view),
        )

    def _reported_loss(self, measures: list[Measure], edges: GeneratedEdges) -> float:
        return sum(measure.reported_loss(edges) for measure in measures)


def _left_out(levels: tuple[Level, ...] | None, schedule: Schedule) -> int:
    """How many of the schedule's first levels are not among `levels`; 0 for levels that are not the schedule's."""
    if isinstance(schedule, PixelSchedule) and levels == schedule.near:
        return len(schedule.levels) - len(schedule.near)
    return 0


def _step(at: Estimate, level: int, loss: float) -> TrackStep:
    try:
        pose = at.cam_T_obj
    except GeometryError:
        pose = np.full((4, 4), np.nan)
    return TrackStep(at.control_points, pose, loss, level)
