"""A widget that takes the keyboard as soon as it is there, taught to wait until it is clicked.

rerun's viewer asks for the keyboard with every picture that it draws; in a notebook the next Shift + Enter would
go to it, and no cell would run any more.
"""

from __future__ import annotations

import anywidget
import ipywidgets

from acp_lab.display.widgets.point_canvas import module_text
from acp_lab.display.widgets.still import Still


class KeyboardGuard(anywidget.AnyWidget):
    """Invisible; what follows it in its box gets neither keyboard nor pointer before the first click into it."""

    _esm = module_text("keyboard_guard.js")


class GuardedViewer(Still, ipywidgets.VBox):
    """rerun's viewer in a box of its own."""

    still = "replay_viewer.png"


def guarded(widget: ipywidgets.Widget) -> GuardedViewer:
    """A viewer in a box of its own, which leaves the keyboard to the notebook until it is clicked."""
    return GuardedViewer([KeyboardGuard(), widget])
