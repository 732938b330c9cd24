"""The drawing that all widgets share: a picture, overlays, and points to drag over it.

Convention: px of the full image, (x, y), the centre of the top-left pixel at (0, 0). Traits hold values, not
places to write to: `points` is a read-only array, and a change is an assignment. Two of them tell of the hand:
`dragging` is true while a point is held, `settled` is what `points` were when it was last let go. Whoever draws
something light observes `points`, which follows the pointer; whoever computes observes `settled`, which changes only
when all observers of `points` have been told.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import anywidget
import numpy as np
import traitlets
from numpy.typing import ArrayLike

from acp_lab.display.widgets.overlay import Overlay, serialised
from acp_lab.display.widgets.picture import image_size, jpeg_bytes
from acp_lab.geometry.arrays import ByteImage, FloatArray

STATIC = Path(__file__).parent / "static"
MOST_UNDO = 200


def module_text(*names: str) -> str:
    """JavaScript files put one after another; a widget's code must be one module."""
    return "\n".join((STATIC / name).read_text(encoding="utf-8") for name in names)


class Points(traitlets.TraitType[FloatArray, Any]):
    """(n, 2) finite px, kept as a read-only float64 array."""

    info_text = "n rows of finite (x, y)"

    def set(self, obj: Any, value: Any) -> None:
        """As every trait's, but telling of a change only where there is one: arrays do not compare as others do."""
        points: Any = self._validate(obj, value)
        known = obj._trait_values.get(self.name)
        if known is None or not np.array_equal(points, known):
            super().set(obj, points)

    def validate(self, obj: Any, value: Any) -> FloatArray:
        """The array; TraitError for other shapes and numbers that are not finite."""
        try:
            points = np.array(value, dtype=np.float64)
        except (TypeError, ValueError):
            self.error(obj, value)
        if points.size == 0:
            points = points.reshape(0, 2)
        if points.ndim != 2 or points.shape[1] != 2 or not np.isfinite(points).all():
            self.error(obj, value)
        points.flags.writeable = False
        return points


@dataclass(frozen=True)
class Axis:
    """What a picture's width or height means when it is a map: from `low` at its left or upper edge to `high`."""

    label: str
    unit: str
    low: float
    high: float

    def value(self, place_px: float, size_px: int) -> float:
        """At a place in px of a picture that is `size_px` wide or high."""
        return self.low + (place_px + 0.5) / size_px * (self.high - self.low)

    def place(self, value: float, size_px: int) -> float:
        """The other way round: px of a value."""
        return (value - self.low) / (self.high - self.low) * size_px - 0.5


def _axes_to_json(axes: tuple[Axis, ...], _: Any) -> list[dict[str, Any]]:
    return [asdict(axis) for axis in axes]


def _points_to_json(points: FloatArray, _: Any) -> list[list[float]]:
    return np.round(points, 4).tolist()


class PointCanvas(anywidget.AnyWidget):
    """A picture with overlays and points.

    points: (n, 2); settled: (n, 2); dragging: bool. view: (x, y, width, height) px of the image to begin with,
    () for all of it. labels: of the points, "1", "2", ... by default. active: the point that is marked, -1 for
    none. closed: whether a polygon joins them. problem: one line that turns the polygon red, "" for none.
    clickable: whether a click, moving no point, is told to `on_click`. orbits: whether a hand that drags the ground
    turns something instead of moving the view; orbit: how far it did so in all, (x, y) px of the image, `dragging`
    meanwhile. height_px: the most it takes of the page.
    axes: two `Axis`, x and y, for a picture that is a map; () for one that is a picture.
    """

    _esm = module_text("common.js", "canvas_axes.js", "canvas_scene.js", "point_canvas.js", "point_canvas_widget.js")
    _css = (STATIC / "widgets.css").read_text(encoding="utf-8")

    image = traitlets.Bytes().tag(sync=True)
    image_size = traitlets.Tuple(traitlets.Int(), traitlets.Int(), default_value=(0, 0)).tag(sync=True)
    overlays = traitlets.Tuple().tag(sync=True, to_json=serialised)
    points = Points(default_value=np.zeros((0, 2))).tag(sync=True, to_json=_points_to_json)
    labels = traitlets.Tuple().tag(sync=True)
    active = traitlets.Int(-1).tag(sync=True)
    closed = traitlets.Bool(False).tag(sync=True)
    editable = traitlets.Bool(False).tag(sync=True)
    clickable = traitlets.Bool(False).tag(sync=True)
    orbits = traitlets.Bool(False).tag(sync=True)
    orbit = traitlets.Tuple(traitlets.Float(), traitlets.Float(), default_value=(0.0, 0.0)).tag(sync=True)
    dragging = traitlets.Bool(False).tag(sync=True)
    problem = traitlets.Unicode("").tag(sync=True)
    title = traitlets.Unicode("").tag(sync=True)
    status = traitlets.Unicode("").tag(sync=True)
    view = traitlets.Tuple(default_value=()).tag(sync=True)
    axes = traitlets.Tuple(default_value=()).tag(sync=True, to_json=_axes_to_json)
    height_px = traitlets.Int(520).tag(sync=True)
    settled = Points(default_value=np.zeros((0, 2)))

    def __init__(self, image: ByteImage | None = None, points: ArrayLike = (), **traits: Any) -> None:
        """image: (h, w[, 3]) uint8, None for an empty one; points: (n, 2) px; traits: those of the class."""
        self._history: list[FloatArray] = []
        self._on_click: list[Callable[[FloatArray], None]] = []
        picture = {"image": jpeg_bytes(image), "image_size": image_size(image)}
        super().__init__(points=points, **{**picture, **traits})
        self._settle()
        self._history = [self.settled]
        self.on_msg(self._hear)

    def show(self, image: ByteImage | None) -> None:
        """Replace the picture (h, w[, 3]) uint8; None takes it away but leaves the frame as large as it was."""
        with self.hold_sync():
            if image is not None:
                self.image_size = image_size(image)
            self.image = jpeg_bytes(image)

    def draw(self, overlays: Iterable[Overlay]) -> None:
        """Replace the overlays."""
        self.overlays = tuple(overlays)

    def on_click(self, action: Callable[[FloatArray], None]) -> None:
        """Call action((2,) px) at each click that moves no point, while `clickable`."""
        self._on_click.append(action)

    def undo(self) -> None:
        """Back to the points before the last change; nothing at the first ones."""
        if len(self._history) > 1:
            self._history.pop()
            self.points = self._history[-1]

    def reset(self) -> None:
        """Back to the first points; a change like any other, so it can be undone."""
        if self._history:
            self.points = self._history[0]

    def restart(self, points: ArrayLike) -> None:
        """Take new points (n, 2) as the first ones: what undo and reset go back to, also while something is dragged."""
        self.points = points
        self.settled = self.points
        self._history = [self.settled]

    def notify_change(self, change: Any) -> None:
        """As of every widget; the points settle afterwards, so that whoever hears of it finds the others up to date."""
        super().notify_change(change)
        if change["name"] in ("points", "dragging"):
            self._settle()

    def _settle(self) -> None:
        if self.dragging or np.array_equal(self.points, self.settled):
            return
        self.settled = self.points
        if not (self._history and np.array_equal(self._history[-1], self.settled)):
            # The first one stays: reset goes there.
            self._history = [*self._history[:1], *self._history[1:][-MOST_UNDO:], self.settled]

    def _hear(self, _: Any, content: dict[str, Any], __: Any) -> None:
        kind = content.get("kind")
        if kind == "undo":
            self.undo()
        elif kind == "reset":
            self.reset()
        elif kind == "click" and self.clickable:
            for action in self._on_click:
                action(np.array([float(content["x"]), float(content["y"])]))
