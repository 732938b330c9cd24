"""Curves over one shared axis with a cursor: what a run or a slice of a loss looks like from the side."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import anywidget
import numpy as np
import traitlets
from numpy.typing import ArrayLike

from acp_lab.display.widgets.overlay import Colour, css_colour
from acp_lab.display.widgets.point_canvas import STATIC, module_text
from acp_lab.geometry.arrays import FloatArray


@dataclass(frozen=True, eq=False)
class Curve:
    """Values (n,) over the plot's x; NaN leaves a gap.

    label: beside the value at the cursor. row: the panel's heading, with the unit; curves of one row share it.
    most: where larger values were cut, as they would flatten the rest; the value at the cursor then says "≥".
    """

    values: FloatArray
    colour: Colour
    row: str
    label: str = ""
    most: float | None = None


@dataclass(frozen=True)
class Mark:
    """A horizontal line at `value` in the panel `row`, such as a limit."""

    value: float
    row: str
    label: str = ""


def _floats(values: ArrayLike, _: Any = None) -> memoryview:
    return memoryview(np.asarray(values, dtype=np.float32).tobytes())


def _curves(curves: Iterable[Curve], _: Any = None) -> list[dict[str, Any]]:
    return [
        {
            "data": _floats(curve.values),
            "colour": css_colour(curve.colour),
            "row": curve.row,
            "label": curve.label,
            "most": curve.most,
        }
        for curve in curves
    ]


def _marks(marks: Iterable[Mark], _: Any = None) -> list[dict[str, Any]]:
    return [vars(mark) for mark in marks]


class CurvePlot(anywidget.AnyWidget):
    """Panels of curves, one per row, under each other.

    x: (n,) of all curves, rising; cursor: index into x, moved by mouse, finger and arrow keys; limits: (low,
    high) of the vertical axis, () to fit the values. Change curves by assignment.
    """

    _esm = module_text("common.js", "curve_plot.js")
    _css = (STATIC / "widgets.css").read_text(encoding="utf-8")

    x = traitlets.Tuple().tag(sync=True, to_json=_floats)
    curves = traitlets.Tuple().tag(sync=True, to_json=_curves)
    marks = traitlets.Tuple().tag(sync=True, to_json=_marks)
    limits = traitlets.Tuple().tag(sync=True)
    cursor = traitlets.Int(0).tag(sync=True)
    title = traitlets.Unicode("").tag(sync=True)
    x_label = traitlets.Unicode("").tag(sync=True)

    def __init__(self, x: ArrayLike, curves: Iterable[Curve], marks: Iterable[Mark] = (), **traits: Any) -> None:
        """x: (n,); curves and marks as above."""
        values = tuple(np.asarray(x, dtype=np.float64).tolist())
        super().__init__(x=values, curves=tuple(curves), marks=tuple(marks), **traits)

    @traitlets.validate("cursor")
    def _within(self, proposal: dict[str, Any]) -> int:
        return int(np.clip(proposal["value"], 0, max(len(self.x) - 1, 0)))
