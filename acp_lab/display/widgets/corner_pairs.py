"""Pairs of a CAD corner and the pixel where it is seen, clicked one after the other, and the pose they give."""

from __future__ import annotations

import numpy as np

from acp_lab.display.look import GENERATED
from acp_lab.display.widgets.cad_view import CadView
from acp_lab.display.widgets.overlay import Overlay
from acp_lab.display.widgets.point_canvas import PointCanvas
from acp_lab.errors import GeometryError
from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.camera import Camera
from acp_lab.geometry.point_pnp import LEAST_POINTS, PointPnP, solve_point_pnp


class CornerPairs:
    """Click a corner in `view`, then its place in `picture`; again for the next one.

    view: the CAD model, its corners as dots. picture: the image, with a numbered point per pair, which can still
    be dragged. Pairs keep their numbers when the view is turned.
    """

    def __init__(self, view: CadView, picture: PointCanvas) -> None:
        self.view, self.picture = view, picture
        self._corners: list[int] = []
        self._corners_at: dict[bytes, tuple[int, ...]] = {}  # by the points that they had
        self._waiting: int | None = None
        view.clickable = picture.clickable = True
        view.on_click(self._corner_clicked)
        picture.on_click(self.place)
        view.observe(lambda _: self.show(), "image")
        picture.observe(lambda _: self._follow_undo(), "points")
        self.show()

    @property
    def count(self) -> int:
        """Complete pairs."""
        return len(self._corners)

    def choose(self, corner: int) -> None:
        """Say which corner (a row of the view's `corners_obj`) the next pixel belongs to; a known one is moved."""
        self._waiting = corner
        self.show()

    def place(self, pixel: FloatArray) -> None:
        """Say where the chosen corner is seen, (2,) px; nothing happens before one was chosen."""
        if self._waiting is None:
            return
        corner, self._waiting = self._waiting, None
        points = self.picture.points.copy()
        if corner in self._corners:
            points[self._corners.index(corner)] = pixel
        else:
            self._corners.append(corner)
            points = np.vstack([points, pixel])
        self.picture.points = points
        self.show()

    def clear(self) -> None:
        """Forget all pairs."""
        self._corners, self._corners_at, self._waiting = [], {}, None
        self.picture.restart(np.zeros((0, 2)))
        self.show()

    def solve(self, camera: Camera) -> PointPnP:
        """The pose by PnP of all pairs, each then labelled by how far it is from where that pose has its corner.

        Raises GeometryError for fewer than four pairs and for pairs that give no pose.
        """
        try:
            found = solve_point_pnp(self.view.corners_obj[self._corners], self.picture.points, camera)
        except GeometryError:
            self.picture.labels = ()  # they were those of another pose
            raise
        self.picture.labels = tuple(f"{n}: {px:.1f} px" for n, px in enumerate(found.reprojection_px, start=1))
        return found

    def show(self) -> None:
        """Bring points, dots and the next thing to do up to date."""
        view, waiting = self.view, self._waiting
        shown = [*self._corners] if waiting is None or waiting in self._corners else [*self._corners, waiting]
        view.points = view.project(view.corners_obj[shown])
        view.active = -1 if waiting is None else shown.index(waiting)
        self.picture.active = -1 if waiting not in self._corners else shown.index(waiting)
        dots = view.project(view.corners_obj[view.seen_corners()])
        view.draw([Overlay("dots", dots, GENERATED, "corners to choose from", 7.0)])
        missing = max(LEAST_POINTS - self.count, 0)
        if missing:
            self.picture.labels = ()  # numbers alone: fewer pairs than four have no residuals
        if waiting is not None:
            view.status, self.picture.status = "", "now click where the marked corner is in the picture"
        elif missing:
            view.status = f"click a corner (drag to turn the model), {missing} more needed"
            self.picture.status = "choose a corner on the model first, then click where it is here"
        else:
            view.status, self.picture.status = "more corners make the pose surer", ""

    def _corner_clicked(self, pixel: FloatArray) -> None:
        corner = self.view.corner_at(pixel)
        if corner is not None:
            self.choose(corner)

    def _follow_undo(self) -> None:
        """Undo and reset in the picture take points away, and undo brings them back; their corners go with them."""
        points = self.picture.points
        if len(points) != len(self._corners):
            known = self._corners_at.get(points.tobytes())
            self._corners = list(self._last_corners(len(points)) if known is None else known)
            if len(points) > len(self._corners):  # of pairs that are forgotten
                self.picture.points = points[: len(self._corners)]
                return
            self.show()
        self._corners_at.pop(points.tobytes(), None)  # behind all others: the last ones known
        self._corners_at[points.tobytes()] = tuple(self._corners)

    def _last_corners(self, count: int) -> tuple[int, ...]:
        """The corners of so many points that were never seen; those there are where there never were so many.

        More points than before come from a drag that began before the page heard of an undo: it takes that back.
        """
        if count < len(self._corners):
            return tuple(self._corners[:count])
        as_many = (corners for corners in reversed(self._corners_at.values()) if len(corners) == count)
        return next(as_many, tuple(self._corners))
