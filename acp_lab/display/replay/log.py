"""One session of a run, written into a rerun recording, frame by frame; docs/replay.md lists what is in it.

With a `root` such as "a/" everything moves below it, so that two runs fit into one recording. The tracking
thread does all this but for the images, so it is kept cheap: what never changes is logged once.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Literal

import cv2
import numpy as np

from acp_lab.display.colours import OBJECT_COLOURS, lighter
from acp_lab.display.replay.clock import Moment, RunningClock
from acp_lab.display.replay.columns import ColumnBuffer
from acp_lab.display.replay.curves import CurveLog
from acp_lab.display.replay.images import ImageWriter
from acp_lab.display.replay.object_log import CORNER_TO_CENTRE, ObjectLog, object_name
from acp_lab.geometry.arrays import ByteImage, FloatArray
from acp_lab.geometry.camera import Camera
from acp_lab.geometry.pose import transform
from acp_lab.sequences.frame import Frame, UnreadableFrame
from acp_lab.tracking.observer import SessionInfo
from acp_lab.tracking.result import TargetView, TrackResult, TrackState

if TYPE_CHECKING:
    from rerun import RecordingStream

Iterations = Literal["off", "failures", "all"]
"""Of which frames the iterations are logged; failures are frames that are weak or lost, or where a state changed."""

BRIGHT_COLOURS = tuple(lighter(colour, 0.3) for colour in OBJECT_COLOURS)
"""The viewer is dark."""
FAR_PX = 20.0
"""Distances from here on have one colour in a distance map."""
MAP_OPACITY = 0.6


class RunLog:
    """Logs one session; `label` stands before the names of its curves, `colours` are one per object, by their ids."""

    def __init__(
        self,
        recording: RecordingStream,
        images: ImageWriter,
        session: SessionInfo,
        iterations: Iterations = "off",
        root: str = "",
        label: str = "",
        colours: tuple[tuple[float, ...], ...] = BRIGHT_COLOURS,
    ) -> None:
        self._log = ColumnBuffer(recording, root)
        self._images = images
        self._session = session
        self._iterations = iterations
        self._shows_images = True
        self._camera: Camera | None = None
        self._objects: dict[int, ObjectLog] = {}
        self._curves: dict[int, CurveLog] = {}
        among_others = len(session.objects) > 1 or bool(label)
        for order, tracked in enumerate(sorted(session.objects, key=lambda tracked: tracked.object_id)):
            colour = colours[order % len(colours)]
            name = " ".join(filter(None, (label, object_name(tracked.object_id))))
            self._objects[tracked.object_id] = ObjectLog(self._log, tracked, colour, session.truth is not None)
            self._curves[tracked.object_id] = CurveLog(self._log, tracked, colour, name, among_others)

    def begin(self, moment: Moment) -> None:
        """Log what does not change, at the moment of the first frame."""
        import rerun as rr

        self._log.at(moment)

        self._log.style("", rr.ViewCoordinates.RDF)
        for of_object in self._objects.values():
            of_object.begin()
        for of_curves in self._curves.values():
            of_curves.begin()

    def frame(self, frame: Frame | UnreadableFrame, results: Mapping[int, TrackResult], clock: RunningClock) -> None:
        """Log a frame and its results, and let the clock go on behind it."""
        import rerun as rr

        start = clock.begin(frame)
        self._log.at(start)
        if isinstance(frame, Frame):
            self._log_camera(frame.camera, results)
        if isinstance(frame, Frame) and self._shows_images:
            path_of = self._session.image_path
            source = path_of(frame.index) if path_of is not None else None
            self._images.put(start, f"{self._log.root}camera/image", frame.image, source)
        steps = {object_id: result.steps for object_id, result in results.items() if self._is_shown(result)}
        for object_id, of_object in steps.items():
            self._objects[object_id].steps(of_object, start.step + 1)
        end = clock.end(max((len(of_object) for of_object in steps.values()), default=0))
        self._log.at(end)
        self._log.row("image_id", rr.Scalars, scalars=np.array([float(frame.index)]))
        truth = self._session.truth
        for object_id, given in results.items():
            result = _with_finite_covariance(given)
            cam_T_true = truth(frame.index, object_id) if truth is not None else None
            self._objects[object_id].result(result, frame.camera, cam_T_true)
            self._curves[object_id].result(frame, result, cam_T_true)
            if not (isinstance(frame, Frame) and self._shows_images):
                continue
            if result.target is not None and result.target.distance_map is not None:
                entity = f"{self._log.root}camera/distance_map/{object_name(object_id)}"
                self._images.put(end, entity, distance_picture(result.target, frame.camera), opacity=MAP_OPACITY)
        self._log.end_frame()

    def end(self) -> None:
        """Send what is left."""
        self._log.flush()
        self._images.flush()

    @property
    def sent(self) -> int:
        """Frames whose data were handed to the recording."""
        return self._log.sent

    def drop_images(self) -> None:
        """Log no image from the next frame on, and leave the last one not standing."""
        import rerun as rr

        self._shows_images = False
        self._log.now("camera/image", rr.Clear(recursive=False))
        self._log.now("camera/distance_map", rr.Clear(recursive=True))

    def note(self, message: str) -> None:
        """Write something into the file's log, at the moment of the last frame."""
        import rerun as rr

        self._log.now("notes", rr.TextLog(message))

    def _is_shown(self, result: TrackResult) -> bool:
        """Whether the iterations of a result are to be logged."""
        if self._iterations == "failures":
            return result.state is not TrackState.TRACKING or bool(result.note)
        return self._iterations == "all"

    def _log_camera(self, camera: Camera, results: Mapping[int, TrackResult]) -> None:
        import rerun as rr

        if camera == self._camera:
            return
        self._camera = camera
        matrix = camera.matrix.copy()
        matrix[:2, 2] += CORNER_TO_CENTRE
        pinhole = rr.Pinhole(
            image_from_camera=matrix,
            resolution=(camera.width, camera.height),
            camera_xyz=rr.ViewCoordinates.RDF,
            image_plane_distance=behind(self._session, results),
        )
        self._log.now("camera", pinhole)


def behind(session: SessionInfo, results: Mapping[int, TrackResult]) -> float:
    """Depth (mm) just behind the parts: there the image hangs like a backdrop."""
    parts = {tracked.object_id: tracked.part for tracked in session.objects}
    depths = [
        float(_centre(parts[object_id].box_centre, result)[2]) + 1.2 * parts[object_id].radius
        for object_id, result in results.items()
    ]
    return max((depth for depth in depths if depth > 0.0), default=100.0)


def _with_finite_covariance(result: TrackResult) -> TrackResult:
    """One that is not finite has no axes and no spread: it says nothing, like none."""
    if result.covariance is None or np.isfinite(result.covariance).all():
        return result
    return replace(result, covariance=None)


def _centre(box_centre: FloatArray, result: TrackResult) -> FloatArray:
    return transform(result.cam_T_obj, box_centre)


def distance_picture(target: TargetView, camera: Camera) -> ByteImage:
    """A distance map as a picture (h, w, 3) of the camera's size: yellow at image edges, dark from 20 px on."""
    picture = np.zeros((camera.height, camera.width, 3), np.uint8)
    distances = np.asarray(target.distance_map)
    near = np.round(255.0 * (1.0 - np.clip(distances / FAR_PX, 0.0, 1.0))).astype(np.uint8)
    coloured = cv2.cvtColor(cv2.applyColorMap(near, cv2.COLORMAP_VIRIDIS), cv2.COLOR_BGR2RGB)
    (x, y), (height, width) = target.origin, near.shape
    x0, y0 = max(x, 0), max(y, 0)
    x1, y1 = min(x + width, camera.width), min(y + height, camera.height)
    picture[y0:y1, x0:x1] = coloured[y0 - y : y1 - y, x0 - x : x1 - x]
    return picture
