"""One tracked object in a replay: where it is in space, and what was drawn of it over the image.

Convention: 3D entities are in mm below the recording's root, the camera frame; 2D entities hang below `camera`
and are in rerun's pixels, which count from the corner of the top-left pixel: half a pixel is added by `pixels`.
Line widths and radii are in points of the screen, so that they look alike in every zoom.
"""

from __future__ import annotations

from collections import deque
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from acp_lab.display.colours import GREEN, GREY, PURPLE, YELLOW, lighter, residual_colours, to_bytes
from acp_lab.display.replay.columns import ColumnBuffer
from acp_lab.display.replay.parts import box_lines, cad_edges, control_points_of, mesh_of, region_lines
from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.camera import Camera
from acp_lab.geometry.pose import transform
from acp_lab.tracking.observer import TrackedObject
from acp_lab.tracking.result import TargetView, TrackResult, TrackStep

CORNER_TO_CENTRE = 0.5
STROKE_PX = 3.0
"""Length of one generated edge point's stroke."""
TRAIL_FRAMES = 100
GHOST_OPACITY = 0.3
CHI2_95 = 7.815
"""95% of chi-squared with three degrees of freedom."""
LABELS = ("I1", "I2", "I3", "I4")
_NO_STROKES = np.zeros((0, 2, 2), np.float32)
_NO_POINTS = np.zeros((0, 2), np.float32)


def object_name(object_id: int) -> str:
    """Last part of the names of an object's entities."""
    return f"obj_{object_id:06d}"


def pixels(points: FloatArray) -> NDArray[np.float32]:
    """Points (..., 2) px as rerun counts them."""
    return (points + CORNER_TO_CENTRE).astype(np.float32)


class ObjectLog:
    """Logs one object of a session."""

    def __init__(self, log: ColumnBuffer, tracked: TrackedObject, colour: tuple[float, ...], has_truth: bool) -> None:
        self._log = log
        self._tracked = tracked
        self._rgb = colour
        self._colour = to_bytes(colour)
        self._has_truth = has_truth
        self._name = object_name(tracked.object_id)
        self._trails: dict[str, deque[FloatArray]] = {}
        self._region: int | None = None

    def begin(self) -> None:
        """Log what does not change: shapes, colours and labels."""
        import rerun as rr

        part, name, own = self._tracked.part, self._name, self._colour
        now, style = self._log.now, self._log.style
        thin, thick = rr.Radius.ui_points([0.6]), rr.Radius.ui_points([1.2])
        creases = [line.astype(np.float32) for line in cad_edges(part)]
        now(f"mesh/{name}", mesh_of(part, own))
        now(f"mesh/{name}/cad_edges", rr.LineStrips3D(creases, colors=to_bytes(lighter(self._rgb)), radii=thin))
        now(f"mesh/{name}/regions", rr.LineStrips3D(box_lines(part), colors=to_bytes(GREY), radii=thin))
        style(f"trajectory/{name}", rr.LineStrips3D.from_fields(colors=own, radii=thick))
        style(f"uncertainty/{name}", rr.Ellipsoids3D.from_fields(colors=to_bytes(YELLOW), line_radii=thin))
        if self._has_truth:
            green = to_bytes(GREEN)
            now(f"truth/{name}", mesh_of(part, green, GHOST_OPACITY))
            now(f"truth/{name}/cad_edges", rr.LineStrips3D(creases, colors=green, radii=thin))
            style(f"trajectory/truth/{name}", rr.LineStrips3D.from_fields(colors=green, radii=thin))
            style(f"camera/truth/{name}", rr.LineStrips2D.from_fields(colors=green, radii=thick))
        style(f"camera/generated_edges/{name}", rr.LineStrips2D.from_fields(radii=rr.Radius.ui_points([1.4])))
        dots = rr.Points2D.from_fields(colors=to_bytes(PURPLE), radii=rr.Radius.ui_points([1.3]))
        style(f"camera/target_edges/{name}", dots)
        style(f"camera/crop/{name}", rr.Boxes2D.from_fields(colors=to_bytes(GREY), radii=thin))
        style(
            f"camera/control_points/{name}",
            rr.Points2D.from_fields(colors=own, radii=rr.Radius.ui_points([4.0]), labels=LABELS),
            rr.LineStrips2D.from_fields(colors=own, radii=thick),
        )
        yellow = rr.LineStrips2D.from_fields(colors=to_bytes(YELLOW), radii=rr.Radius.ui_points([0.8]))
        style(f"camera/control_points/{name}/path", yellow)

    def result(self, result: TrackResult, camera: Camera | None, cam_T_true: FloatArray | None) -> None:
        """Log where the object is, and what was drawn and found, in a frame seen by `camera`."""
        import rerun as rr

        name, row = self._name, self._log.row
        self._log_region(result.region)
        self._log_pose(f"mesh/{name}", result.cam_T_obj)
        self._log_trail(f"trajectory/{name}", result.cam_T_obj)
        self._log_uncertainty(result)
        self._log_edges(result)
        self._log_target(result.target)
        quad = pixels(result.control_points)
        row(f"camera/control_points/{name}", rr.Points2D, positions=quad)
        row(f"camera/control_points/{name}", rr.LineStrips2D, strips=_closed(quad)[None])
        if result.steps:
            paths = np.stack([pixels(step.control_points) for step in result.steps], axis=1)
            row(f"camera/control_points/{name}/path", rr.LineStrips2D, strips=list(paths))
        if self._has_truth:
            self._log_truth(result.region, camera, cam_T_true)

    def steps(self, steps: tuple[TrackStep, ...], first_step: int) -> None:
        """Log the iterations of a frame, the first of them at `first_step`."""
        import rerun as rr

        if not steps:
            return
        count, name, send = len(steps), self._name, self._log.on_steps
        when = range(first_step, first_step + count)
        poses = np.stack([step.cam_T_obj for step in steps])
        quads = np.stack([pixels(step.control_points) for step in steps])
        moved = rr.Transform3D.columns(translation=poses[:, :3, 3], mat3x3=poses[:, :3, :3])
        send(f"mesh/{name}", when, moved)
        corners = rr.Points2D.columns(positions=quads.reshape(-1, 2)).partition([4] * count)
        send(f"camera/control_points/{name}", when, corners)
        outlines = rr.LineStrips2D.columns(strips=np.concatenate([quads, quads[:, :1]], axis=1))
        send(f"camera/control_points/{name}", when, outlines)
        send(f"curves/step_loss/{name}", when, rr.Scalars.columns(scalars=[step.loss for step in steps]))

    def _log_region(self, region: int) -> None:
        import rerun as rr

        if region == self._region:
            return
        self._region = region
        part, name, own = self._tracked.part, self._name, self._colour
        lit = rr.LineStrips3D(region_lines(part, region), colors=to_bytes(YELLOW), radii=rr.Radius.ui_points([1.8]))
        self._log.now(f"mesh/{name}/regions/active", lit)
        points = control_points_of(part, self._tracked.control_points_obj, region)
        self._log.now(
            f"mesh/{name}/control_points",
            rr.Points3D(points, colors=own, radii=rr.Radius.ui_points([4.0])),
            rr.LineStrips3D([_closed(points)], colors=own, radii=rr.Radius.ui_points([1.2])),
        )

    def _log_pose(self, entity: str, cam_T_obj: FloatArray) -> None:
        import rerun as rr

        self._log.row(entity, rr.Transform3D, translation=cam_T_obj[None, :3, 3], mat3x3=cam_T_obj[None, :3, :3])

    def _log_trail(self, entity: str, cam_T_obj: FloatArray) -> None:
        import rerun as rr

        trail = self._trails.setdefault(entity, deque(maxlen=TRAIL_FRAMES))
        trail.append(transform(cam_T_obj, self._tracked.part.box_centre))
        if len(trail) > 1:
            self._log.row(entity, rr.LineStrips3D, strips=[np.array(trail, np.float32)])

    def _log_uncertainty(self, result: TrackResult) -> None:
        """The ellipsoid that holds the part's centre with a probability of 95%, given that the part is there."""
        import rerun as rr

        nothing = np.zeros((0, 3))
        half_sizes, centres, turns = nothing, nothing, np.zeros((0, 4))
        if result.covariance is not None:
            variances, axes = np.linalg.eigh(result.covariance[3:, 3:])
            # A rotation, not a reflection.
            axes[:, 0] *= np.sign(np.linalg.det(axes))
            half_sizes = np.sqrt(CHI2_95 * np.maximum(variances, 0.0))[None]
            centres = transform(result.cam_T_obj, self._tracked.part.box_centre)[None]
            turns = Rotation.from_matrix(axes).as_quat()[None]
        self._log.row(
            f"uncertainty/{self._name}", rr.Ellipsoids3D, half_sizes=half_sizes, centers=centres, quaternions=turns
        )

    def _log_edges(self, result: TrackResult) -> None:
        import rerun as rr

        strokes, colours, edges = _NO_STROKES, np.zeros((0, 3), np.uint8), result.edges
        if edges is not None and len(edges) > 0:
            half = 0.5 * STROKE_PX * edges.tangents
            strokes = pixels(np.stack([edges.points - half, edges.points + half], axis=1))
            residuals = np.full(len(edges), np.nan) if result.residuals_px is None else result.residuals_px
            finite = np.isfinite(strokes).all(axis=(1, 2))
            strokes, colours = strokes[finite], to_bytes(residual_colours(residuals))[finite]
        self._log.row(f"camera/generated_edges/{self._name}", rr.LineStrips2D, strips=strokes, colors=colours)

    def _log_target(self, target: TargetView | None) -> None:
        import rerun as rr

        points, half, centre = _NO_POINTS, _NO_POINTS, _NO_POINTS
        if target is not None:
            points = pixels(target.edge_points)
            half = np.array([target.size], np.float32) / 2.0
            centre = np.array([target.origin], np.float32) + half
        self._log.row(f"camera/target_edges/{self._name}", rr.Points2D, positions=points)
        self._log.row(f"camera/crop/{self._name}", rr.Boxes2D, half_sizes=half, centers=centre)

    def _log_truth(self, region: int, camera: Camera | None, cam_T_true: FloatArray | None) -> None:
        import rerun as rr

        outline: Any = []
        if cam_T_true is not None:
            self._log_pose(f"truth/{self._name}", cam_T_true)
            self._log_trail(f"trajectory/truth/{self._name}", cam_T_true)
            if camera is not None:
                points_obj = control_points_of(self._tracked.part, self._tracked.control_points_obj, region)
                outline = [_closed(pixels(camera.project(transform(cam_T_true, points_obj))))]
        self._log.row(f"camera/truth/{self._name}", rr.LineStrips2D, strips=outline)


def _closed(quad: NDArray[Any]) -> NDArray[Any]:
    return np.vstack([quad, quad[:1]])
