"""The widgets that kernel and page keep."""

from __future__ import annotations

from ipywidgets.widgets.widget import _instances


def open_widgets() -> set[str]:
    """The ids of all that were not closed; what ipywidgets tells of them in public is deprecated."""
    return set(_instances)
