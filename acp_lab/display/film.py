"""Moving pictures in a notebook: a figure drawn once per moment, packed into one image that plays by itself.

An animated WebP inside the page: no player, no file, and it is there, playing, on the site as well.
"""

from __future__ import annotations

import base64
import io
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from acp_lab.errors import ParameterError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

QUALITY = 60
LAST_S = 1.5
"""How long the last moment stays, before it begins again."""


@dataclass(frozen=True)
class Film:
    """An animated WebP (bytes) that shows itself in a notebook; size: (width, height) px; count: of moments."""

    webp: bytes
    size: tuple[int, int]
    count: int

    def _repr_html_(self) -> str:
        data = base64.b64encode(self.webp).decode("ascii")
        width, height = self.size
        return f'<img src="data:image/webp;base64,{data}" alt="moving picture" width="{width}" height="{height}">'


def film(
    draw: Callable[[Figure, int], object],
    count: int,
    width_in: float = 8.0,
    height_in: float = 3.4,
    moments_per_s: float = 5.0,
) -> Film:
    """Draw moments 0 to count - 1, each into a figure of its own, and pack them; it plays for ever.

    draw: called with an empty figure and the number of the moment; it makes the axes, too.
    Raises ParameterError for less than one moment, and for other speeds than those above 0 up to 1000 moments per s.
    """
    if count < 1:
        raise ParameterError(f"count = {count}: a film has one moment or more")
    if not 0.0 < moments_per_s <= 1000.0:
        raise ParameterError(f"moments_per_s = {moments_per_s}: give a number above 0, 1000 at most")
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from PIL import Image

    pictures = []
    for number in range(count):
        figure = Figure(figsize=(width_in, height_in))
        canvas = FigureCanvasAgg(figure)
        draw(figure, number)
        # Of one size all of them, so nothing is cut away; the ground is the page's, as in other figures.
        figure.set_facecolor("none")
        canvas.draw()
        pictures.append(Image.frombuffer("RGBA", canvas.get_width_height(), bytes(canvas.buffer_rgba())))
    durations = [round(1000.0 / moments_per_s)] * (count - 1) + [round(1000.0 * LAST_S)]
    file = io.BytesIO()
    pictures[0].save(
        file, "WEBP", save_all=True, append_images=pictures[1:], duration=durations, loop=0, quality=QUALITY
    )
    return Film(file.getvalue(), pictures[0].size, count)
