"""How a track begins: the first frame solved from the given pose, and a second opinion where that is not trusted."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from acp_lab.cad.part import box_corners
from acp_lab.errors import PreparationError, TrackingError
from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.pose import transform
from acp_lab.prepared_part import PreparedPart
from acp_lab.sequences.frame import Frame
from acp_lab.tracking.assessment import Assessment
from acp_lab.tracking.find import LateFinder
from acp_lab.tracking.frame_solver import FrameSolver
from acp_lab.tracking.frame_view import LEAST_PART_PX, crop_box
from acp_lab.tracking.learning.knowledge import Off
from acp_lab.tracking.search import Look
from acp_lab.tracking.second_opinion import Question, second_opinion
from acp_lab.tracking.solution import SeenFrame
from acp_lab.tracking.start import Started, TrustedStart, begin
from acp_lab.tracking.stopwatch import Stopwatch
from acp_lab.tracking.turned import TURNED, TurnChecker


class Beginning:
    """Of one tracked part, by its method's `start`."""

    def __init__(
        self,
        model: PreparedPart,
        solver: FrameSolver,
        assessment: Assessment,
        finder: LateFinder,
        turn_checker: TurnChecker,
    ) -> None:
        self._model, self._solver, self._corners_obj = model, solver, box_corners(model.part)
        self._assessment, self._finder, self._turn_checker = assessment, finder, turn_checker

    def region(self, frame: Frame, cam_T_obj: FloatArray) -> int:
        """0..5, the view region at a start pose (4, 4).

        Raises PreparationError where the generator was not trained for it, TrackingError where it is out of sight.
        """
        if crop_box(self._corners_obj, cam_T_obj, frame.camera, self._solver.method.margin_px) is None:
            raise self.not_seen(frame, cam_T_obj)
        return self.prepared_region(cam_T_obj)

    def prepared_region(self, cam_T_obj: FloatArray) -> int:
        """0..5, the view region at a start pose (4, 4); PreparationError where the generator was not trained for it."""
        solver = self._solver
        region = solver.choose_region(cam_T_obj)
        if not solver.is_prepared_for(cam_T_obj, region):
            natural, source = solver.natural_region(cam_T_obj), solver.source
            # Without its name other generators are prepared.
            option = " --generator autoencoder" if source.name == "autoencoder" else ""
            raise PreparationError(
                f"{self._model.part.name}: the part is seen from view region {natural}, generator {source.name} is "
                f"prepared for {', '.join(map(str, source.regions))} only; {self._model.prepare_command}{option} "
                f"--regions {natural}"
            )
        return region

    def begin(self, frame: Frame, seen: SeenFrame, found: bool, clock: Stopwatch) -> Started | None:
        """The first frame, seen around the start pose, its view's prior; None where the part is not seen there.

        found: whether that pose was found in this frame, see `start`.
        """
        solver, config = self._solver, self._solver.method.start
        if isinstance(config, Off):
            solution = solver.solve(seen, seen.view.at_pose(seen.view.prior), clock)
            return None if solution is None else Started(seen, solution, trusted=False, measures=False)

        def look(pose: FloatArray) -> SeenFrame | None:
            return solver.look(frame.image, frame.camera, pose, solver.choose_region(pose))

        started = begin(solver, look, seen, config, clock, found)
        if started is not None and not started.trusted:
            started = self._asked_again(frame, look, seen.view.prior, started, config, clock)
        if started is None:
            return None
        turned = self._turn_checker.at_start(frame, started.solution, clock)
        if turned is None:
            return started
        return self._begun_anew(frame, look, turned, False, TURNED, config, clock) or started

    def _asked_again(
        self, frame: Frame, look: Look, start: FloatArray, started: Started, config: TrustedStart, clock: Stopwatch
    ) -> Started | None:
        """What was begun with from a start pose (4, 4), or what the frame is begun with where the part is elsewhere."""
        # Without stored views a first frame would have to wait for them.
        if self._model.views is None:
            return started
        solver, question = self._solver, Question(frame, look, start, started.solution.cam_T_obj)
        elsewhere = second_opinion(question, solver, self._finder(), config, self._assessment.quality, clock)
        if elsewhere is None:
            return started
        for pose, found, note in ((elsewhere, True, "the detector finds it elsewhere"), (start, False, "")):
            again = self._begun_anew(frame, look, pose, found, note, config, clock)
            if again is not None:
                return again
        return None

    def _begun_anew(
        self,
        frame: Frame,
        look: Look,
        cam_T_obj: FloatArray,
        found: bool,
        note: str,
        config: TrustedStart,
        clock: Stopwatch,
    ) -> Started | None:
        """The first frame, begun with a pose (4, 4) that nobody gave, or that was doubted: nothing is to be trusted.

        found: whether the pose is one that the detector found, see `start.begin`.
        """
        self._solver.forget()
        self._solver.magnify(frame.camera, cam_T_obj)
        seen = look(cam_T_obj)
        again = None if seen is None else begin(self._solver, look, seen, config, clock, found)
        return None if again is None else replace(again, trusted=False, measures=config.measures, note=note)

    def not_seen(self, frame: Frame, cam_T_obj: FloatArray) -> TrackingError:
        """What is raised where a first frame does not show the part at its start pose (4, 4)."""
        part, camera = self._model.part, frame.camera
        depth_mm = float(transform(cam_T_obj, part.box_centre)[2])
        how = f", or it is smaller than {LEAST_PART_PX} px"
        if depth_mm <= 0.0:
            how = " and lies behind the camera"
        elif depth_mm < part.radius:
            how = f", as its middle is {depth_mm:.0f} mm from the lens, nearer than its own size"
        return TrackingError(
            f"{part.name}: at the start pose t = {np.round(cam_T_obj[:3, 3], 1).tolist()} mm the part is not seen "
            f"in frame {frame.index} ({camera.width}x{camera.height}){how}; check pose, unit and camera"
        )
