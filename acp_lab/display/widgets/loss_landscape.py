"""Walk on e(I): a map of the loss over two of its variables, and the optimiser's way down from where one starts it."""

from __future__ import annotations

import math
from typing import Any

import cv2
import ipywidgets
import numpy as np
from numpy.typing import ArrayLike
from traitlets import Bunch

from acp_lab.display.look import GENERATED, POINTS, START
from acp_lab.display.widgets.controls import row, side_by_side
from acp_lab.display.widgets.curve_plot import Curve, CurvePlot
from acp_lab.display.widgets.overlay import Colour, Overlay, edge_strokes
from acp_lab.display.widgets.point_canvas import Axis, PointCanvas
from acp_lab.display.widgets.still import Still
from acp_lab.errors import GeometryError
from acp_lab.geometry.arrays import ByteImage, FloatArray
from acp_lab.prepared_part import PreparedPart
from acp_lab.sequences.frame import Frame
from acp_lab.studies.landscape import Coordinate, Descent, LossSlice, LossSurface, Space
from acp_lab.tracking.losses import LOSS_FORMS
from acp_lab.tracking.solvers import Adam, GaussNewton, LevenbergMarquardt, Solver

WHITE = (1.0, 1.0, 1.0)
MAP_PX = 360
HEIGHT_PX = 430
STROKE_PX = 5.0
BANDS = 28
"""The map is drawn in so many shades, whose borders are lines of equal loss."""
GRID = 33
BCE = "reference code: BCE of images"
STEPS = 12
SOLVERS: dict[str, Solver] = {
    solver.kind: solver for solver in (GaussNewton(STEPS), LevenbergMarquardt(STEPS), Adam(STEPS, rate=2.0))
}
ANNEALING = (1.0, 0.5, 0.25)
CONTROL_REACH_PX = 24.0
TURN_REACH_DEG = 8.0
SHIFT_REACH_IN_DIAMETERS = 0.1


class LossLandscape(Still, ipywidgets.VBox):
    """A map of e around the pose in the middle, a start to drag on it, the optimiser's way, and cuts.

    surface: the `LossSurface` that computes. map, frame_view: the two canvases. descent: the last way, None for the
    images' loss, which has no distances to follow. The controls are attributes, so that Python can turn them, too:
    space, u, v, form, alpha, reach, anneal, solver.
    """

    still = "widget_landscape.png"

    def __init__(self, model: PreparedPart, frame: Frame, cam_T_obj: FloatArray) -> None:
        """cam_T_obj: (4, 4), the middle: the true pose, or what a tracker found."""
        self.surface = LossSurface(model, frame, cam_T_obj)
        self._diameter = model.part.diameter
        self.descent: Descent | None = None
        self._slice: LossSlice | None = None
        self._images_loss: FloatArray | None = None
        self._make_controls()
        self.frame_view = PointCanvas(frame.image, title="frame", view=_view(self.surface), height_px=HEIGHT_PX)
        start = [0.78 * MAP_PX, 0.24 * MAP_PX]
        blank = (MAP_PX, MAP_PX)
        self.map = PointCanvas(
            None, [start], image_size=blank, labels=("start",), editable=True, height_px=HEIGHT_PX, title="e(I)"
        )
        self.cuts = tuple(CurvePlot((), ()) for _ in range(2))
        which = row([self.space, self.u, self.v, self.reach])
        how = row([self.form, self.alpha, self.anneal, self.solver])
        below = side_by_side(*((cut, "1 1 260px") for cut in self.cuts))
        maps = side_by_side((self.map, "1 1 360px"), (self.frame_view, "1 1 360px"))
        super().__init__([which, how, maps, below])
        self.map.observe(lambda _: self._show_start(), "points")
        self.map.observe(lambda _: self._go(), "settled")
        self._change_space()

    @property
    def start_offsets(self) -> FloatArray:
        """(8,) px or (6,) rad and mm from the middle: where the optimiser starts."""
        u, v = self._coordinates()
        offsets = np.zeros(len(self.surface.coordinates(self._space())))
        for coordinate, axis, place in zip((u, v), self.map.axes, self.map.points[0], strict=True):
            offsets[coordinate.index] = axis.value(float(place), MAP_PX) * coordinate.unit_step
        return offsets

    def _make_controls(self) -> None:
        narrow, style = ipywidgets.Layout(width="250px"), {"description_width": "60px"}
        self.space = ipywidgets.ToggleButtons(options={"control points": "control-points", "pose": "pose"})
        self.space.style.button_width = "auto"
        look = {"layout": narrow, "style": style}
        self.u, self.v = (ipywidgets.Dropdown(description=name, **look) for name in ("across", "down"))
        self.reach = ipywidgets.FloatSlider(1.0, min=0.25, max=3.0, step=0.25, description="reach ×", **look)
        self.reach.continuous_update = False
        forms = {"printed (eq. 6)" if form == "printed" else form: form for form in LOSS_FORMS}
        named = {"description": "form", "style": style, "layout": ipywidgets.Layout(width="320px")}
        self.form = ipywidgets.Dropdown(options={**forms, BCE: BCE}, value="geman-mcclure", **named)
        alpha = round(self.surface.alpha_px, 1)
        self.alpha = ipywidgets.FloatSlider(alpha, min=1.0, max=40.0, step=0.5, description="α [px]", **look)
        self.anneal = ipywidgets.Checkbox(False, description="anneal: α, α/2, α/4", indent=False)
        self.anneal.layout.width = "auto"
        self.solver = ipywidgets.Dropdown(options=tuple(SOLVERS), description="solver", **look)
        self.space.observe(lambda _: self._change_space(), "value")
        self.u.observe(lambda change: self._choose(change, self.v), "value")
        self.v.observe(lambda change: self._choose(change, self.u), "value")
        self.reach.observe(lambda _: self._slice_now(), "value")
        for control in (self.form, self.alpha):
            control.observe(lambda _: self._change_loss(), "value")
        for control in (self.anneal, self.solver):
            control.observe(lambda _: self._go(), "value")

    def _space(self) -> Space:
        return "control-points" if self.space.value == "control-points" else "pose"

    def _coordinates(self) -> tuple[Coordinate, Coordinate]:
        return self.u.value, self.v.value

    def _change_space(self) -> None:
        choice = {coordinate.name: coordinate for coordinate in self.surface.coordinates(self._space())}
        names = list(choice)
        self._slice = None  # keeps the two changes below from computing a slice each
        # x and y of one point; two turns out of the image plane.
        for dropdown, name in ((self.u, names[0]), (self.v, names[1])):
            dropdown.options = choice
            dropdown.value = choice[name]
        self._slice_now()

    def _choose(self, change: Bunch, other: ipywidgets.Dropdown) -> None:
        """Another coordinate for one axis; what the other axis has is swapped, or a map would have one variable."""
        if self._slice is None or change.new is None:
            return
        if other.value == change.new:
            other.value = change.old  # which comes here again
        else:
            self._slice_now()

    def _slice_now(self) -> None:
        u, v = self._coordinates()
        reach = (self._reach(u), self._reach(v))
        self.map.axes = tuple(Axis(c.name, c.unit, -r, r) for c, r in zip((u, v), reach, strict=True))
        self._slice = self.surface.slice(self._space(), u, v, reach, GRID)
        self._images_loss = None
        self._change_loss()

    def _reach(self, coordinate: Coordinate) -> float:
        reach = {"px": CONTROL_REACH_PX, "°": TURN_REACH_DEG, "mm": SHIFT_REACH_IN_DIAMETERS * self._diameter}
        return float(reach[coordinate.unit] * self.reach.value)

    def _change_loss(self) -> None:
        if self._slice is None:
            return
        if self.form.value == BCE:
            if self._images_loss is None:
                u, v = self._coordinates()
                reach = (self._reach(u), self._reach(v))
                self._images_loss = self.surface.image_values(self._space(), u, v, reach, GRID)
            self._values = self._images_loss
        else:
            self._values = self._slice.values(self.form.value, self.alpha.value)
        for control in (self.alpha, self.anneal, self.solver):  # of the descent, which this form has not
            control.disabled = self.form.value == BCE
        picture, low, high = map_picture(self._values)
        self.map.show(picture)
        self.map.status = f"{range_in_words(low, high)}, 2% cut off at each end"
        self._go()

    def _go(self) -> None:
        """Let the optimiser start anew."""
        self.descent = None
        if self.form.value != BCE:
            shares = ANNEALING if self.anneal.value else (1.0,)
            alphas = tuple(max(self.alpha.value * share, 1.0) for share in shares)
            solver = SOLVERS[self.solver.value]
            self.descent = self.surface.descend(self._space(), self.start_offsets, self.form.value, alphas, solver)
        self._show_way()
        self._show_start()

    def _show_way(self) -> None:
        u, v = self._coordinates()
        overlays = [Overlay("dots", self._places(np.zeros((1, 2))), WHITE, "the pose in the middle", 9.0)]
        if self.descent is not None:
            ends = self.descent.offsets[:, [u.index, v.index]] / (u.unit_step, v.unit_step)
            way = self._places(np.clip(ends, -1e4, 1e4))
            overlays.append(Overlay("line", way, GENERATED, "the optimiser's way, all variables free", 2.5))
            overlays.append(Overlay("dots", way[-1:], GENERATED, "", 9.0))
        self.map.draw(overlays)

    def _places(self, offsets: FloatArray) -> FloatArray:
        """Pixels (n, 2) of the map of offsets (n, 2) in the coordinates' units."""
        columns = [
            [axis.place(float(value), MAP_PX) for value in offsets[:, i]] for i, axis in enumerate(self.map.axes)
        ]
        return np.array(columns, np.float64).T.reshape(-1, 2)

    def _show_start(self) -> None:
        overlays = self._edges(self.start_offsets, START, "edges at the start")
        # While the start is dragged, the old way belongs to another start.
        if self.descent is not None and not self.map.dragging:
            overlays += self._edges(self.descent.offsets[-1], GENERATED, "edges at the end")
        self.frame_view.draw(overlays)
        if self._slice is not None and not self.map.dragging:
            self._show_cuts(self._slice)

    def _edges(self, offsets: FloatArray, colour: Colour, label: str) -> list[Overlay]:
        """The edges at some offsets; nothing where no homography exists."""
        try:
            return [edge_strokes(self.surface.edges_at(self._space(), offsets), colour, label, 2.0, STROKE_PX)]
        except GeometryError:
            return []

    def _show_cuts(self, over: LossSlice) -> None:
        place = np.clip(np.round(_on_grid(self.map.points[0], GRID)), 0, GRID - 1).astype(int)
        column, line = int(place[0]), int(place[1])
        through = (
            (over.u, over.offsets_u, self._values[line], column),
            (over.v, over.offsets_v, self._values[:, column], line),
        )
        for cut, (coordinate, offsets, values, cursor) in zip(self.cuts, through, strict=True):
            with cut.hold_sync():
                cut.x, cut.x_label = tuple(offsets.tolist()), f"{coordinate.name} [{coordinate.unit}]"
                cut.curves = (Curve(_within_reason(values), POINTS, "e through the start"),)
                cut.cursor = cursor


def map_picture(values: FloatArray) -> tuple[ByteImage, float, float]:
    """A grid (g, g) as a picture in bands of equal loss, with the values at its dark and its bright end.

    The outermost 2% of the values are cut off, or a pole would leave nothing to see of the rest.
    """
    finite = values[np.isfinite(values)]
    low, high = (float(x) for x in np.quantile(finite, (0.02, 0.98))) if len(finite) else (0.0, 1.0)
    share = np.clip((np.nan_to_num(values, nan=high) - low) / max(high - low, 1e-12), 0.0, 1.0)
    at = _on_grid(np.arange(MAP_PX), len(share)).astype(np.float32)
    column, line = np.meshgrid(at, at)
    fine = cv2.remap(share.astype(np.float32), column, line, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
    banded = np.clip(np.floor(fine * BANDS) / (BANDS - 1), 0.0, 1.0)
    coloured = cv2.applyColorMap(np.round(255.0 * banded).astype(np.uint8), cv2.COLORMAP_VIRIDIS)
    return cv2.cvtColor(coloured, cv2.COLOR_BGR2RGB).astype(np.uint8, copy=False), low, high


def range_in_words(low: float, high: float) -> str:
    """Both ends of a map's colours, with so many digits that a hundredth of what is between them shows."""
    digits = 3
    if 0.0 < high - low < np.inf:
        digits += math.floor(math.log10(max(abs(low), abs(high)))) - math.floor(math.log10(high - low))
    digits = min(max(digits, 3), 12)
    return f"from {low:.{digits}g} (dark) to {high:.{digits}g} (bright)"


def _on_grid(place_px: ArrayLike, count: int) -> FloatArray:
    """Where places on the map are on a grid of `count` values, the outermost of which are on the map's rim."""
    return (np.asarray(place_px, np.float64) + 0.5) / MAP_PX * (count - 1)


def _within_reason(values: FloatArray) -> FloatArray:
    """A cut's values with a pole's spikes cut off."""
    finite = values[np.isfinite(values)]
    if len(finite) == 0:
        return values
    low, high = np.quantile(finite, (0.05, 0.95))
    room = max(high - low, 1e-9)
    return np.clip(values, low - room, high + room)


def _view(surface: LossSurface) -> tuple[Any, ...]:
    points = surface.edges.points
    side = 1.35 * float(np.ptp(points, axis=0).max())
    x, y = 0.5 * (points.min(0) + points.max(0)) - 0.5 * side
    return float(x), float(y), side, side
