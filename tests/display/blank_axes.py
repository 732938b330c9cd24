"""Empty axes to draw on."""

from __future__ import annotations

from typing import Any

from matplotlib.figure import Figure


def axes_of(count: int = 1, projection: str | None = None) -> list[Any]:
    """Axes beside each other; projection "3d" for drawings in space."""
    figure = Figure()
    return [figure.add_subplot(1, count, i + 1, projection=projection) for i in range(count)]
