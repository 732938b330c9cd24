"""Find it for me: the detector's hypotheses of where the part is, as small pictures to choose from."""

from __future__ import annotations

import threading
from collections.abc import Callable

import ipywidgets
import numpy as np

from acp_lab.control_points.canonical_frame import eye_position
from acp_lab.control_points.view_regions import choose_region
from acp_lab.detection.config import DetectionConfig, usual_depths_mm
from acp_lab.display.look import GENERATED
from acp_lab.display.widgets.controls import button, close_with_parts, row
from acp_lab.display.widgets.overlay import Overlay, edge_strokes
from acp_lab.display.widgets.point_canvas import PointCanvas
from acp_lab.errors import AcpLabError
from acp_lab.generator.base import GeneratedEdges, project_samples
from acp_lab.geometry.arrays import FloatArray
from acp_lab.prepared_part import PreparedPart
from acp_lab.sequences.frame import Frame
from acp_lab.tracking.find import Detection, Finder

LOOKING = "looking for the part: some seconds, more at the first time …"
HYPOTHESES = 5
THUMB_SAMPLES = 700
UNLIKELY = 0.1
HEIGHT_PX = 150
_MARGIN = 0.15
_SMALLEST_PX = 40.0


class FindPanel(ipywidgets.Box):
    """A picture per hypothesis, the best first: the image around it, its edges, its score; a click takes it.

    controls: the button and the two distances, to be put elsewhere on the page. detections: of the last search.
    is_searching: whether one runs.
    """

    def __init__(
        self,
        model: PreparedPart,
        frame: Frame,
        take: Callable[[Detection], object],
        tell: Callable[[str, str, str], object],
    ) -> None:
        """take: what a click on a hypothesis does; tell: shows plain, bold and plain words."""
        self._model, self._frame, self._take, self._tell = model, frame, take, tell
        self._generator = model.best_generator()
        self._finder: Finder | None = None
        self.detections: tuple[Detection, ...] = ()
        self.is_searching = False
        self._pictures: list[ipywidgets.VBox] = []
        self._button = button("find it for me", "search the image for the part", self._find_aside)
        near, far = map(round, usual_depths_mm(model.part.diameter, frame.camera))
        self.nearest_mm, self.farthest_mm = _distance_field("between", near), _distance_field("and", far)
        self.controls = row([self._button, self.nearest_mm, self.farthest_mm, ipywidgets.Label("mm away")])
        super().__init__(layout=ipywidgets.Layout(display="flex", flex_flow="row wrap", grid_gap="4px 10px"))

    def find(self, top: int = HYPOTHESES) -> tuple[Detection, ...]:
        """Search the whole frame, some seconds; () with a message when nothing resembles the part.

        While another search runs, what the one before it found.
        """
        return self._search(top) if self._begin() else self.detections

    def _begin(self) -> bool:
        """Say that a search runs; False, and nothing, when one does already."""
        if self.is_searching:
            return False
        self.is_searching = self._button.disabled = True
        self._tell(LOOKING, "", "")
        return True

    def _search(self, top: int = HYPOTHESES) -> tuple[Detection, ...]:
        told = ("the search was interrupted", "", "")
        try:
            config = DetectionConfig((self.nearest_mm.value, self.farthest_mm.value))
            if self._finder is None or self._finder.detector.config != config:
                self._finder = Finder(self._model, config)
            self.detections = self._finder.find(self._frame, top)
        except AcpLabError as error:
            self.detections = ()
            told = (str(error), "", "")
        else:
            told = _told_of(self.detections)
        finally:
            self.is_searching = self._button.disabled = False
            self._tell(*told)
        if self.comm is None:  # closed meanwhile: nobody would close the pictures
            return self.detections
        before = self._pictures
        self._pictures = [self._picture(n, one) for n, one in enumerate(self.detections, start=1)]
        self.children = tuple(self._pictures)
        close_with_parts(*before)
        return self.detections

    def _find_aside(self) -> None:
        """Search in a thread, so that the page can be used meanwhile."""
        if self._begin():  # here, not in the thread: a second click finds it begun
            threading.Thread(target=self._search, name="find it for me", daemon=True).start()

    def _picture(self, number: int, detection: Detection) -> ipywidgets.VBox:
        edges = self._edges_at(detection.cam_T_obj)
        left, top, right, bottom = _around(edges.points, self._frame)
        canvas = PointCanvas(self._frame.image[top:bottom, left:right], height_px=HEIGHT_PX, clickable=True)
        strokes = edge_strokes(edges, GENERATED).coordinates - np.array([left, top], np.float64)
        canvas.draw([Overlay("strokes", strokes, GENERATED)])

        def take() -> None:
            self._take(detection)

        canvas.on_click(lambda _: take())
        word = "found" if detection.is_accepted else "perhaps" if detection.score > UNLIKELY else "unlikely"
        choose = button(f"{number}: score {detection.score:.2f}, {word}", "take this pose", take)
        return ipywidgets.VBox([canvas, choose], layout=ipywidgets.Layout(width="210px"))

    def _edges_at(self, pose: FloatArray) -> GeneratedEdges:
        part = self._model.part
        region = choose_region(eye_position(pose) - part.box_centre, 0.5 * part.box_size)
        visible = self._generator.visible(pose, region, THUMB_SAMPLES)
        return project_samples(self._generator.edges, visible, pose, self._frame.camera)


def _told_of(detections: tuple[Detection, ...]) -> tuple[str, str, str]:
    """Plain, bold and plain words on what was found."""
    if not detections:
        return "nothing here resembles the part: ", "click corners", ", or change the distances"
    verdict = "found" if detections[0].is_accepted else "not sure"
    return "", verdict, ": click the picture whose edges sit, if one does, then snap"


def _around(points: FloatArray, frame: Frame) -> tuple[int, int, int, int]:
    """The box of the points with some room, within the image; all of it where there are none in it."""
    size = (frame.camera.width, frame.camera.height)
    points = points[np.isfinite(points).all(1)]
    if len(points) == 0:
        return 0, 0, *size
    low, high = points.min(0), points.max(0)
    room = _MARGIN * np.maximum(high - low, _SMALLEST_PX)
    left, top = np.clip(np.floor(low - room), 0, np.subtract(size, 1)).astype(int).tolist()
    right, bottom = np.clip(np.ceil(high + room), (left + 1, top + 1), size).astype(int).tolist()
    return left, top, right, bottom


def _distance_field(name: str, value_mm: float) -> ipywidgets.BoundedFloatText:
    field = ipywidgets.BoundedFloatText(value_mm, min=1.0, max=100_000.0, description=name)
    field.style.description_width, field.layout.width = "initial", "130px"
    return field
