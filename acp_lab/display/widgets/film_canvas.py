"""A canvas that plays a film: pictures and what lies over them are sent ahead, so that playing needs no round trip.

The browser asks for the pictures that come next and keeps them; here they are only made. So a film runs at its speed
also while the kernel, the server or the machine is busy.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import traitlets

from acp_lab.display.widgets.overlay import Overlay, serialised
from acp_lab.display.widgets.point_canvas import PointCanvas, module_text
from acp_lab.errors import AcpLabError
from acp_lab.geometry.arrays import FloatArray


@dataclass(frozen=True, eq=False)
class Picture:
    """One frame of a film. image: bytes of a JPEG or PNG, b"" for none; image_size: (width, height) px; points: (n, 2)
    px; view: (x, y, width, height) px, () for all of it."""

    image: bytes
    image_size: tuple[int, int]
    title: str = ""
    status: str = ""
    points: FloatArray | tuple[()] = ()
    overlays: tuple[Overlay, ...] = ()
    view: tuple[float, ...] = ()


class FilmCanvas(PointCanvas):
    """A `PointCanvas` whose traits hold the first picture, and which plays the others.

    frame: which one is shown, counted from 0; follows the hand, and moves the film when it is assigned. count: how many
    there are. interval_ms: from picture to picture. repeat: begin again after the last one.
    """

    _esm = module_text("common.js", "canvas_axes.js", "canvas_scene.js", "point_canvas.js", "film.js", "film_canvas.js")

    frame = traitlets.Int(0)
    count = traitlets.Int(1).tag(sync=True)
    interval_ms = traitlets.Int(40).tag(sync=True)
    repeat = traitlets.Bool(False).tag(sync=True)
    seek = traitlets.Tuple(traitlets.Int(), traitlets.Int(), default_value=(0, 0)).tag(sync=True)
    """(how often, where to): what the kernel tells the browser; where the browser is comes as a message."""
    place = traitlets.Int(0).tag(sync=True)
    """The frame, whoever moved it: where a view that is made anew begins, and where one goes that another one leads."""
    leader = traitlets.Unicode("").tag(sync=True)
    """The view whose hand moved the film last; it alone does not go to `place`, being ahead of it."""
    edition = traitlets.Int(0).tag(sync=True)
    """Counts up when all pictures change: those on their way are then of no use."""

    def __init__(self, picture_of: Callable[[int], Picture], count: int, **traits: Any) -> None:
        """picture_of: makes the picture of a frame; an AcpLabError of it is shown instead of the picture."""
        self._picture_of = picture_of
        self._is_told = False
        super().__init__(count=count, **traits)
        self.renew()

    def picture(self) -> Picture:
        """Of the frame that is shown."""
        return self._made(self.frame)

    def renew(self, count: int | None = None) -> None:
        """All pictures have changed: make them again, beginning with the one that is shown."""
        with self.hold_sync():
            self.count = self.count if count is None else count
            self.frame = min(self.frame, self.count - 1)
            self.edition += 1
            self.seek = (self.seek[0] + 1, self.frame)  # for a page that is loaded anew
            picture = self.picture()
            if picture.image:
                self.image_size = picture.image_size
            self.image, self.title, self.status = picture.image, picture.title, picture.status
            self.points, self.view = picture.points, picture.view
            self.draw(picture.overlays)

    @traitlets.validate("frame")
    def _within(self, proposal: dict[str, Any]) -> int:
        return int(np.clip(proposal["value"], 0, self.count - 1))

    @traitlets.observe("frame")
    def _tell_browser(self, _: object) -> None:
        self.place = self.frame
        if not self._is_told:
            self.seek = (self.seek[0] + 1, self.frame)

    def _hear(self, widget: Any, content: dict[str, Any], buffers: Any) -> None:
        kind = content.get("kind")
        if kind == "at":
            view = str(content.get("view", ""))
            if view != self.leader and not content.get("by_hand", True):
                return  # it plays on until it hears that a hand moved another view
            self._is_told = True
            try:
                with self.hold_sync():
                    self.leader = view
                    self.frame = int(content["frame"])
            finally:
                self._is_told = False
        elif kind == "want" and content.get("edition") == self.edition:
            self._send_pictures([int(frame) for frame in content["frames"]])
        else:
            super()._hear(widget, content, buffers)

    def _made(self, frame: int) -> Picture:
        try:
            return self._picture_of(frame)
        except AcpLabError as error:
            return Picture(b"", (0, 0), status=str(error))

    def _send_pictures(self, frames: list[int]) -> None:
        """Answer for each: the browser waits for all that it asked for. What is no AcpLabError is raised at the end."""
        failures = []
        for frame in frames:
            try:
                picture = self._made(frame)
            except Exception as error:  # a fault of this package; the film goes on without this picture
                failures.append(error)
                picture = Picture(b"", (0, 0), status=f"this picture cannot be shown: {error!r}")
            self._send_picture(frame, picture)
        if failures:
            raise failures[0]

    def _send_picture(self, frame: int, picture: Picture) -> None:
        overlays = serialised(picture.overlays)
        buffers = [picture.image, *(overlay.pop("data") for overlay in overlays)]
        content = {
            "kind": "picture",
            "frame": frame,
            "edition": self.edition,
            "image_size": picture.image_size if picture.image else self.image_size,
            "title": picture.title,
            "status": picture.status,
            "points": np.round(np.reshape(picture.points, (-1, 2)), 4).tolist(),
            "view": picture.view,
            "overlays": overlays,
        }
        self.send(content, buffers)
