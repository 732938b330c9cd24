"""Rows of buttons and names of files that several widgets have, and the end of widgets."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from pathlib import Path

import ipywidgets

Turn = tuple[float, float, float]


def row(children: Iterable[ipywidgets.Widget], gap: str = "2px 4px") -> ipywidgets.Box:
    """Side by side, on as many lines as it takes."""
    layout = ipywidgets.Layout(display="flex", flex_flow="row wrap", grid_gap=gap, align_items="center")
    return ipywidgets.Box(tuple(children), layout=layout)


def button(label: str, tooltip: str, action: Callable[[], object], style: str = "") -> ipywidgets.Button:
    """A button as wide as its label; style: "" or "primary"."""
    made = ipywidgets.Button(
        description=label, tooltip=tooltip, button_style=style, layout=ipywidgets.Layout(width="auto")
    )
    made.on_click(lambda _: action())
    return made


def motion_buttons(
    turn: Callable[[Turn], object], move_away: Callable[[float], object], turn_deg: float, depth_step: float
) -> tuple[ipywidgets.Button, ...]:
    """Turns about the camera's axes, called as turn((x, y, z) deg), and nearer, farther, as move_away(factor)."""
    nearer = button("nearer", f"{depth_step:.0%} nearer", lambda: move_away(1.0 - depth_step))
    farther = button("farther", f"{depth_step:.0%} farther", lambda: move_away(1.0 + depth_step))
    return (*turn_buttons(turn, turn_deg), nearer, farther)


def turn_buttons(turn: Callable[[Turn], object], turn_deg: float) -> tuple[ipywidgets.Button, ...]:
    """Turns about the camera's axes alone."""
    buttons = []
    for number, axis in enumerate("xyz"):
        for sign in (-1.0, 1.0):
            angles = [0.0, 0.0, 0.0]
            angles[number] = sign * turn_deg
            label = f"{axis} {'−' if sign < 0 else '+'}{turn_deg:.0f}°"
            tooltip = f"turn the part about the camera's {axis} axis"
            buttons.append(button(label, tooltip, _turning(turn, (angles[0], angles[1], angles[2]))))
    return tuple(buttons)


def side_by_side(*columns: tuple[ipywidgets.Widget, str]) -> ipywidgets.Box:
    """Widgets with their CSS flex, such as "1 1 380px"; under each other where the page is narrow."""
    for widget, flex in columns:
        widget.layout.flex, widget.layout.min_width = flex, "0"
    layout = ipywidgets.Layout(display="flex", flex_flow="row wrap", grid_gap="12px 16px", align_items="flex-start")
    return ipywidgets.Box([widget for widget, _ in columns], layout=layout)


def typed_path(text: str) -> Path:
    """The file that somebody means who typed its name: "~" is the home folder, spaces around it are none of it."""
    return Path(os.path.expanduser(text.strip()))


def close_with_parts(*widgets: ipywidgets.Widget) -> None:
    """Close widgets that are not shown any more and all that they are made of.

    Kernel and page keep every widget until it is closed, and ipywidgets closes none along with another: neither its
    children nor its layout and style.
    """
    for widget in widgets:
        parts = [*getattr(widget, "children", ()), getattr(widget, "layout", None), getattr(widget, "style", None)]
        close_with_parts(*(part for part in parts if isinstance(part, ipywidgets.Widget)))
        widget.close()


def _turning(turn: Callable[[Turn], object], angles_deg: Turn) -> Callable[[], object]:
    return lambda: turn(angles_deg)
