"""A run as a rerun recording: what was seen, what was generated, what was believed, frame by frame.

    acp-lab replay run.rrd

Convention: the recording's root is the camera frame (OpenCV axes, mm). rerun counts pixels from the corner
of the top-left pixel, acp_lab from its centre: half a pixel is added here, and only here. Timelines: `frame`,
one running count over all scenes of the file, and `time`. The entities:

    camera                         the pinhole camera
    camera/image                   the frame, as JPEG
    camera/generated_edges/obj_…   t(I) at the final pose, coloured by its distance to the image edge
    camera/control_points/obj_…    I, in the order of W's rows
    camera/truth/obj_…             the part's box at the true pose
    mesh/obj_… , truth/obj_…       the part at the tracked and at the true pose
    curves/{quality, loss, add_percent, ms}/obj_…
    state/obj_…                    state, numbers and notes as text
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise
from pathlib import Path
from types import ModuleType
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from acp_lab.cad.part import Part
from acp_lab.display.accuracy import AddPercent
from acp_lab.display.colours import GREEN, OBJECT_COLOURS, residual_colours, to_bytes
from acp_lab.errors import InputFileError
from acp_lab.geometry.camera import Camera
from acp_lab.geometry.pose import transform
from acp_lab.sequences.frame import Frame, UnreadableFrame
from acp_lab.tracking.observer import SessionInfo, TrackResult

JPEG_QUALITY = 85
STROKE_PX = 3.0  # length of one generated edge point's stroke
MOST_FLAT_FACES = 50_000  # flat shading needs three vertices per face; above this, smooth normals do
GUESSED_FPS = 30.0  # for the time line of sequences that know no times

_CURVES = ("quality", "loss", "add_percent", "ms")
_CORNER_TO_CENTRE = 0.5
# Corners of a box as bits (x, y, z), and the round trips through them that show its twelve edges.
_BOX_CORNERS = np.array([[i & 1, i >> 1 & 1, i >> 2 & 1] for i in range(8)], dtype=np.float64)
_BOX_STRIPS = ((0, 1, 3, 2, 0, 4, 5, 7, 6, 4), (1, 5), (3, 7), (2, 6))


class Replay:
    """Observer that writes an .rrd file for `acp-lab replay` (or `rerun FILE.rrd`).

    path: the file, replaced. sessions: how many sessions (scenes) follow each other in it; the file is
    complete after the last one's end. A run that is killed leaves a file that can still be read.
    Raises InputFileError when the file cannot be written.
    """

    def __init__(self, path: str | Path, sessions: int = 1) -> None:
        self.path = Path(path)
        self._sessions_left = sessions
        self._recording: Any = None
        self._rerun: ModuleType
        self._count = 0
        self._time_s = 0.0
        self._session_start_s = 0.0

    def on_start(self, session: SessionInfo) -> None:
        """Forget the last session's things."""
        self._session = session
        self._add_percent = {o.object_id: AddPercent(o.part) for o in session.objects}
        self._session_start_s = self._time_s
        self._camera: Camera | None = None
        self._fresh = True

    def on_frame(self, frame: Frame | UnreadableFrame, results: Mapping[int, TrackResult]) -> None:
        """Log one frame and its results; the first one opens the file."""
        if self._recording is None:
            self._open(self._session)
        self._set_time(frame)
        if self._fresh:
            self._log_parts()
            self._fresh = False
        if isinstance(frame, Frame):
            self._log_image(frame)
        for order, tracked in enumerate(self._session.objects):
            result = results.get(tracked.object_id)
            if result is not None:
                self._log_object(frame, tracked.object_id, tracked.part, result, OBJECT_COLOURS[order % 6])
        self._count += 1

    def on_end(self) -> None:
        """Close the file after the last session."""
        self._sessions_left -= 1
        if self._sessions_left <= 0:
            self.close()

    def close(self) -> None:
        """Complete the file; on_end does it after the last session."""
        if self._recording is not None:
            self._recording.flush()
            self._recording.disconnect()
            self._recording = None

    def _open(self, session: SessionInfo) -> None:
        import rerun as rr

        self._rerun = rr
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            self.path.open("wb").close()
        except OSError as error:
            raise InputFileError(
                f"{self.path}: the replay cannot be written ({error.strerror}): choose another place"
            ) from None
        self._recording = rr.RecordingStream("acp_lab", recording_id=f"{session.name}:{session.method}")
        self._recording.save(self.path)
        # The wall clock of logging says nothing about the run.
        self._recording.set_log_time_enabled(False)
        self._recording.set_log_tick_enabled(False)
        self._recording.send_recording_name(f"{session.name} ({session.method})")
        self._recording.send_blueprint(_layout(), make_active=True, make_default=True)
        self._recording.log("/", rr.ViewCoordinates.RDF, static=True)

    def _set_time(self, frame: Frame | UnreadableFrame) -> None:
        known = frame.time_s if isinstance(frame, Frame) else None
        if known is not None:
            self._time_s = self._session_start_s + known
        elif self._count:
            self._time_s += 1.0 / GUESSED_FPS
        self._recording.set_time("frame", sequence=self._count)
        self._recording.set_time("time", duration=self._time_s)

    def _log_parts(self) -> None:
        rr = self._rerun
        if self._count:
            self._recording.log("/", rr.Clear(recursive=True))
        for order, tracked in enumerate(self._session.objects):
            name = _name(tracked.object_id)
            colour = OBJECT_COLOURS[order % 6]
            self._recording.log(f"mesh/{name}", _mesh(rr, tracked.part, (*colour, 1.0)))
            if self._session.truth is not None:
                self._recording.log(f"truth/{name}", _mesh(rr, tracked.part, (*GREEN, 0.35)))
            for curve in _CURVES:
                style = rr.SeriesLines(colors=to_bytes(colour), names=name)
                self._recording.log(f"curves/{curve}/{name}", style, static=True)

    def _log_image(self, frame: Frame) -> None:
        rr = self._rerun
        if frame.camera != self._camera:
            camera = self._camera = frame.camera
            matrix = camera.matrix.copy()
            matrix[:2, 2] += _CORNER_TO_CENTRE
            pinhole = rr.Pinhole(
                image_from_camera=matrix,
                resolution=(camera.width, camera.height),
                camera_xyz=rr.ViewCoordinates.RDF,
                image_plane_distance=100.0,
            )
            self._recording.log("camera", pinhole)
        bgr = cv2.cvtColor(frame.image, cv2.COLOR_RGB2BGR)
        done, jpeg = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
        if done:
            image = rr.EncodedImage(contents=jpeg.tobytes(), media_type="image/jpeg")
            self._recording.log("camera/image", image)

    def _log_object(
        self,
        frame: Frame | UnreadableFrame,
        object_id: int,
        part: Part,
        result: TrackResult,
        colour: tuple[float, float, float],
    ) -> None:
        rr, log, name = self._rerun, self._recording.log, _name(object_id)
        truth = self._session.truth(frame.index, object_id) if self._session.truth else None
        self._log_edges(name, result)
        corners = result.control_points + _CORNER_TO_CENTRE
        points = rr.Points2D(corners, radii=4.0, colors=to_bytes(colour), labels=["I1", "I2", "I3", "I4"])
        outline = rr.LineStrips2D([np.vstack([corners, corners[:1]])], radii=0.75, colors=to_bytes(colour))
        log(f"camera/control_points/{name}", points, outline)
        log(f"mesh/{name}", _placed(rr, result.cam_T_obj))
        add_percent = self._add_percent[object_id](result.cam_T_obj, truth)
        if truth is not None:
            log(f"truth/{name}", _placed(rr, truth))
            if isinstance(frame, Frame):
                strips = _box_strips(part, truth, frame.camera)
                log(f"camera/truth/{name}", rr.LineStrips2D(strips, radii=0.5, colors=to_bytes(GREEN)))
        elif self._session.truth is not None:
            log(f"camera/truth/{name}", rr.Clear(recursive=False))
        values = (result.quality, result.loss, add_percent, 1e3 * result.timings.total_s)
        for curve, value in zip(_CURVES, values, strict=True):
            if np.isfinite(value):
                log(f"curves/{curve}/{name}", rr.Scalars(float(value)))
        text = _state_text(frame, result, add_percent)
        log(f"state/{name}", rr.TextDocument(text, media_type="text/markdown"))

    def _log_edges(self, name: str, result: TrackResult) -> None:
        rr, entity = self._rerun, f"camera/generated_edges/{name}"
        edges = result.edges
        if edges is None or len(edges) == 0:
            self._recording.log(entity, rr.Clear(recursive=False))
            return
        half = 0.5 * STROKE_PX * edges.tangents
        strokes = np.stack([edges.points - half, edges.points + half], axis=1) + _CORNER_TO_CENTRE
        residuals = np.full(len(edges), np.nan) if result.residuals_px is None else result.residuals_px
        finite = np.isfinite(strokes).all(axis=(1, 2))
        colours = to_bytes(residual_colours(residuals))[finite]
        self._recording.log(entity, rr.LineStrips2D(strokes[finite], radii=0.75, colors=colours))


def _name(object_id: int) -> str:
    return f"obj_{object_id:06d}"


def _layout() -> Any:
    """Image and state on the left, 3D and curves on the right."""
    import rerun.blueprint as rrb

    curves = [rrb.TimeSeriesView(origin=f"curves/{curve}", name=curve) for curve in _CURVES]
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Vertical(
                rrb.Spatial2DView(origin="camera", name="image"),
                rrb.TextDocumentView(origin="state", name="state"),
                row_shares=[4, 1],
            ),
            rrb.Vertical(rrb.Spatial3DView(origin="/", name="3D"), rrb.Grid(*curves, grid_columns=2)),
            column_shares=[3, 2],
        ),
        collapse_panels=True,
    )


def _mesh(rr: ModuleType, part: Part, rgba: tuple[float, ...]) -> Any:
    corners = part.vertices[part.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    colour = to_bytes(rgba)
    if len(part.faces) <= MOST_FLAT_FACES:
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
        return rr.Mesh3D(
            vertex_positions=corners.reshape(-1, 3).astype(np.float32),
            triangle_indices=np.arange(3 * len(part.faces), dtype=np.uint32).reshape(-1, 3),
            vertex_normals=np.repeat(normals, 3, axis=0).astype(np.float32),
            albedo_factor=colour,
        )
    summed = np.zeros_like(part.vertices)
    for corner in range(3):
        np.add.at(summed, part.faces[:, corner], normals)
    summed /= np.maximum(np.linalg.norm(summed, axis=1, keepdims=True), 1e-12)
    return rr.Mesh3D(
        vertex_positions=part.vertices.astype(np.float32),
        triangle_indices=part.faces.astype(np.uint32),
        vertex_normals=summed.astype(np.float32),
        albedo_factor=colour,
    )


def _placed(rr: ModuleType, cam_T_obj: NDArray[np.float64]) -> Any:
    return rr.Transform3D(mat3x3=cam_T_obj[:3, :3], translation=cam_T_obj[:3, 3])


def _box_strips(part: Part, cam_T_obj: NDArray[np.float64], camera: Camera) -> list[NDArray[np.float64]]:
    """The box's edges, each (2, 2) pixels in rerun's convention; without those behind the camera."""
    corners_obj = part.box_min + _BOX_CORNERS * (part.box_max - part.box_min)
    corners_cam = transform(cam_T_obj, corners_obj)
    ahead = corners_cam[:, 2] > 1.0
    pixels = np.full((8, 2), np.nan)
    pixels[ahead] = camera.project(corners_cam[ahead]) + _CORNER_TO_CENTRE
    edges = [(a, b) for strip in _BOX_STRIPS for a, b in pairwise(strip)]
    return [pixels[[a, b]] for a, b in edges if ahead[a] and ahead[b]]


def _state_text(frame: Frame | UnreadableFrame, result: TrackResult, add_percent: float) -> str:
    lines = [f"**{result.state}** in image {frame.index}"]
    if isinstance(frame, UnreadableFrame):
        lines.append(f"unreadable: {frame.reason}")
    elif result.note:
        lines.append(result.note)
    numbers = f"quality {result.quality:.2f}, loss {result.loss:.2f} px², region {result.region}, "
    numbers += f"{result.iterations} iterations, {1e3 * result.timings.total_s:.1f} ms"
    if np.isfinite(add_percent):
        numbers += f", ADD {add_percent:.2f} % of the diameter"
    return "\n\n".join([*lines, numbers])
