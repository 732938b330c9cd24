"""A camera live in the notebook: the part followed while it moves, started by the detector or by hand."""

from __future__ import annotations

import html
import time
import weakref
from collections import deque
from pathlib import Path
from typing import Literal

import ipywidgets
import numpy as np

from acp_lab.display.look import TRUTH
from acp_lab.display.widgets.controls import button, close_with_parts, row, side_by_side, typed_path
from acp_lab.display.widgets.curve_plot import Curve, CurvePlot
from acp_lab.display.widgets.overlay import RESIDUAL_LABEL, Overlay, residual_strokes
from acp_lab.display.widgets.picture import image_size, jpeg_bytes
from acp_lab.display.widgets.point_canvas import PointCanvas
from acp_lab.display.widgets.pose_aligner import PoseAligner
from acp_lab.display.widgets.still import Still
from acp_lab.errors import AcpLabError, ParameterError, check_kind
from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.camera import Camera
from acp_lab.geometry.pose import check_pose
from acp_lab.prepared_part import PreparedPart
from acp_lab.sequences import open_images
from acp_lab.sequences.frame import Frame, UnreadableFrame
from acp_lab.sequences.protocol import Sequence
from acp_lab.sequences.results_csv import ResultsWriter
from acp_lab.tracking.live import LiveLoop
from acp_lab.tracking.method import Method
from acp_lab.tracking.result import TrackResult

SHOWN_S = 1.0 / 20.0
"""Frames that come faster are tracked, but not all of them shown: a browser that falls behind never catches up."""
CURVE_S = 0.5
KEPT = 300
WATCHING = "no pose yet: find it, or align it by hand"
_windows = weakref.WeakValueDictionary[str, "LiveWindow"]()
"""The last one of each source."""


class LiveWindow(Still, ipywidgets.VBox):
    """Frames as they come, with the part's edges, the quality, and what one can do about it.

    loop: the `LiveLoop` behind it. canvas, quality: the picture and its curve. aligner: a `PoseAligner` on the frame at
    which the film was stopped, None otherwise. Buttons are methods: `find`, `align`, `follow_aligned`, `stop`, `save`.
    """

    still = "widget_live.png"

    def __init__(
        self,
        model: PreparedPart,
        sequence: Sequence,
        start: FloatArray | Literal["find"] | None = None,
        method: Method | str = "acp",
    ) -> None:
        """start: a pose (4, 4) in the first frame, or "find"; by default the frames are only shown."""
        self.model = model
        self.canvas = PointCanvas(title=sequence.name, closed=True, height_px=500, status=WATCHING)
        self.quality = CurvePlot((), (), x_label="image id", limits=(0.0, 1.0))
        self.message = ipywidgets.HTML(layout=ipywidgets.Layout(min_height="28px", margin="0"))
        self.path = ipywidgets.Text("results.csv", layout=ipywidgets.Layout(flex="1 1 200px", width="auto"))
        self.aligner: PoseAligner | None = None
        self._room = ipywidgets.VBox()
        self._shown_at_s = self._drawn_at_s = 0.0
        self._qualities: deque[tuple[int, float]] = deque(maxlen=KEPT)
        self._times_s: deque[float] = deque(maxlen=30)
        self.loop = LiveLoop(model, sequence, self._show, self._tell, method)
        buttons = [
            button("find it", "search the image for the part, and follow it", self.find, "primary"),
            button("align by hand", "stop the film at this frame and say where the part is", self.align),
            button("stop", "end, and let the camera go", self.stop),
            self.path,
            button("save", "write the poses since the last start as results.csv", self._save_as_told),
        ]
        pictures = side_by_side((self.canvas, "3 1 420px"), (self.quality, "2 1 320px"))
        super().__init__([row(buttons, gap="4px 8px"), self.message, pictures, self._room])
        if isinstance(start, str):
            self.loop.look()
        elif start is not None:
            self.loop.follow(start)
        self.loop.begin()

    def find(self) -> None:
        """Search for the part from the next frame on, until it is found, and follow it."""
        if self.loop.doing == "ended":
            self._tell(self.loop.end_in_words)
            return
        self._leave_aligner()
        self.loop.look()

    def align(self) -> None:
        """Stop at this frame and show a `PoseAligner` on it; `follow_aligned` goes on."""
        if self.aligner is not None:
            return
        frame = self.loop.hold()
        if frame is None:
            self._tell(self.loop.end_in_words if self.loop.doing == "ended" else "no frame comes: try again")
            return
        self.aligner = PoseAligner(self.model, frame)
        go = button("follow it from here", "the pose is good: go on", self.follow_aligned, "primary")
        self._room.children = (row([go, button("cancel", "go on without a pose", self._cancel)]), self.aligner)
        self._tell("the film waits: align the part below")

    def follow_aligned(self) -> None:
        """Follow the part from the aligner's pose on; nothing without an aligner."""
        if self.aligner is not None:
            pose, is_found = self.aligner.cam_T_obj, self.aligner.origin.is_found
            self._leave_aligner()
            self._tell("")
            self.loop.follow(pose, is_found)

    def stop(self) -> None:
        """End, and let the camera go; what was tracked can still be saved."""
        self._leave_aligner()
        self.loop.stop()
        self._tell(f"stopped; {len(self.loop.rows)} frames were tracked")

    def close(self) -> None:
        """Let the camera go, too."""
        if hasattr(self, "loop"):  # Python closes what was never finished, too
            self.loop.stop()
            self._leave_aligner()
        super().close()

    def save(self, path: str | Path) -> int:
        """Write the poses since the last start as results.csv; their number. InputFileError for a bad place."""
        rows = tuple(self.loop.rows)
        with ResultsWriter(path) as results:
            for one in rows:
                results.append(one)
        return len(rows)

    def _show(self, frame: Frame | UnreadableFrame, result: TrackResult | None) -> None:
        """Called by the loop, in its thread."""
        now_s = time.perf_counter()
        self._times_s.append(now_s)
        if result is not None:
            self._qualities.append((result.frame_id, result.quality))
        if now_s - self._shown_at_s < SHOWN_S and self.loop.doing != "waiting":
            return
        self._shown_at_s = now_s
        with self.canvas.hold_sync():
            if isinstance(frame, Frame):
                self.canvas.image_size, self.canvas.image = image_size(frame.image), jpeg_bytes(frame.image)
            self.canvas.draw(_edges(result))
            points = np.zeros((0, 2)) if result is None else result.control_points
            self.canvas.points = points if np.isfinite(points).all() else ()
            self.canvas.status = self._told(result)
        if now_s - self._drawn_at_s > CURVE_S and self._qualities:
            self._drawn_at_s = now_s
            ids, qualities = zip(*self._qualities, strict=True)
            with self.quality.hold_sync():
                self.quality.x = tuple(map(float, ids))
                self.quality.curves = (Curve(np.array(qualities), TRUTH, "quality [0 to 1]"),)
                self.quality.cursor = len(ids) - 1

    def _told(self, result: TrackResult | None) -> str:
        span_s = self._times_s[-1] - self._times_s[0]
        rate = f"{(len(self._times_s) - 1) / span_s:.0f} frames per second" if span_s > 0.0 else ""
        if result is None:
            return f"{WATCHING}; {rate}"
        words = [str(result.state), result.quality_in_words, f"{1e3 * result.timings.total_s:.0f} ms", rate]
        return ", ".join([*words, result.note] if result.note else words)

    def _leave_aligner(self) -> None:
        before, self.aligner, self._room.children = self._room.children, None, ()
        close_with_parts(*before)

    def _cancel(self) -> None:
        self._leave_aligner()
        self._tell("")
        self.loop.watch()

    def _save_as_told(self) -> None:
        path = typed_path(self.path.value)
        try:
            count = self.save(path)
        except AcpLabError as error:
            self._tell(str(error))
        else:
            self._tell(f"{count} poses are in {path.resolve()}")

    def _tell(self, text: str) -> None:
        self.message.value = html.escape(text)


def _edges(result: TrackResult | None) -> tuple[Overlay, ...]:
    """A result's edges in the colours of their residuals; none where nothing was seen."""
    if result is None or result.edges is None:
        return ()
    return residual_strokes(result.edges, result.residuals_px, RESIDUAL_LABEL)


def live(
    model: PreparedPart,
    camera: Camera | str | Path,
    source: int | str | Path = 0,
    start: FloatArray | Literal["find"] | None = None,
    method: Method | str = "acp",
) -> LiveWindow:
    """Follow a part in front of a camera, in a notebook; the window's buttons find it, align it by hand, stop, save.

    camera: of these images, or its CAMERA.json (notebook 10 makes it). source: the number of a camera; a video file or
    a folder of images is shown in its own time, to rehearse. start: a pose (4, 4) in the first frame, or "find".
    A window on the same source is stopped, as when its cell is run again; what it tracked can still be saved.

    Raises InputFileError and SequenceError as `open_images` does, GeometryError and ParameterError for another start or
    other kinds; a camera that is not there is told in the window.
    """
    check_kind(model, PreparedPart, "model", "acp.PreparedPart.load('parts/bracket'), or what acp.prepare returned")
    if not isinstance(camera, str | Path):
        check_kind(camera, Camera, "camera", "acp.Camera.from_json('CAMERA.json'), or that file's name")
    if isinstance(start, str) and start != "find":
        raise ParameterError(f"start = {start!r}: give 'find', or a pose, such as acp.read_pose({start!r})")
    if start is not None and not isinstance(start, str):
        start = check_pose(start, "start")
    intrinsics = camera if isinstance(camera, Camera) else Camera.from_json(camera)
    sequence = open_images(source, intrinsics)
    before = _windows.get(str(source))
    if before is not None and before.loop.doing != "ended":
        before.stop()
    window = _windows[str(source)] = LiveWindow(model, sequence, start, method)
    return window
