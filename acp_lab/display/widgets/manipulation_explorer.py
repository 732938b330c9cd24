"""Drag four control points; see what homography, spline and generators make of the part's edges (paper Fig. 3)."""

from __future__ import annotations

import ipywidgets
import numpy as np

from acp_lab.cad.ray_shading import ray_shade
from acp_lab.display.look import GENERATED, TRUTH
from acp_lab.display.widgets.control_point_editor import ControlPointEditor
from acp_lab.display.widgets.controls import Turn, button, motion_buttons, row, side_by_side
from acp_lab.display.widgets.overlay import Overlay, edge_strokes
from acp_lab.display.widgets.point_canvas import PointCanvas
from acp_lab.display.widgets.still import Still
from acp_lab.errors import GeometryError
from acp_lab.geometry.arrays import ByteImage, FloatArray
from acp_lab.geometry.camera import Camera
from acp_lab.geometry.pose_step import centre_position, move_pose
from acp_lab.prepared_part import PreparedPart
from acp_lab.studies.manipulation import Manipulated, ManipulationBench, ManipulationStudy

TURN_DEG = 5.0
DEPTH_STEP = 0.05
PANEL_HEIGHT_PX = 270
PART = "part at the pose of PnP"
ROOM = 1.7
"""A panel shows this many times the part's extent, so that there is room to drag."""


class ManipulationExplorer(Still, ipywidgets.VBox):
    """An editor on the left, on the right one panel per way of manipulating edges, all following its points.

    editor: the `ControlPointEditor`, to be driven from Python as well. panels: by the way's name. study: the last
    comparison, None while the points are degenerate. Green is the part at the pose of PnP, orange what a way makes.
    Of PnP's two poses it is the one nearer to the last, so that a drag in small steps does not flip the part.
    """

    still = "widget_explorer.png"

    def __init__(
        self, model: PreparedPart, camera: Camera, cam_T_obj: FloatArray, image: ByteImage | None = None
    ) -> None:
        """cam_T_obj: (4, 4), the reference view. image: (h, w, 3) to lie under the points; else a picture of the
        part at the PnP pose, made anew whenever the points are let go."""
        self.bench = ManipulationBench(model, camera, cam_T_obj)
        self._pose = self.bench.reference_pose
        self._picture_follows = image is None
        picture = self._shaded() if image is None else image
        self.editor = ControlPointEditor(picture, self.bench.control_points, title="control points I", height_px=480)
        self.study: ManipulationStudy | None = self.bench.study(self.editor.points, self._pose)
        size, view = (camera.width, camera.height), _view_around(self.bench.reference.points)
        self.panels = {
            way.name: PointCanvas(title=way.name, image_size=size, view=view, height_px=PANEL_HEIGHT_PX, closed=True)
            for way in self.study.ways
        }
        grid = ipywidgets.Layout(grid_template_columns="repeat(2, minmax(0, 1fr))", grid_gap="8px 10px")
        right = ipywidgets.GridBox(list(self.panels.values()), layout=grid)
        turns = motion_buttons(
            self.move_rigidly, lambda factor: self.move_rigidly(depth_factor=factor), TURN_DEG, DEPTH_STEP
        )
        rigid = button("make rigid", "to the nearest points that a rigid part can show", self.move_rigidly)
        left = ipywidgets.VBox([self.editor, row([*turns, rigid])])
        super().__init__([side_by_side((left, "2 1 360px"), (right, "3 1 540px"))])
        self.editor.observe(self._follow, "points")
        self.editor.observe(self._let_go, "settled")
        self._show()

    def move_rigidly(self, turn_deg: Turn = (0.0, 0.0, 0.0), depth_factor: float = 1.0) -> None:
        """Put the points where the part would have them after a turn about its centre (deg, camera axes) and a
        change of depth, from the present PnP pose: a motion that a rigid part can make."""
        centre_obj = self.bench.model.part.box_centre
        shift = (depth_factor - 1.0) * centre_position(self._pose, centre_obj)
        moved = move_pose(self._pose, centre_obj, np.concatenate([np.radians(turn_deg), shift]))
        points = self.bench.points_at(moved)
        if np.isfinite(points).all():
            self._pose = moved
            self.editor.points = points

    def _follow(self, _: object) -> None:
        try:
            self.study = self.bench.study(self.editor.points, self._pose)
        except GeometryError:
            self.study = None
        else:
            self._pose = self.study.cam_T_obj
        self._show()

    def _let_go(self, _: object) -> None:
        if self._picture_follows and self.study is not None:
            self.editor.show(self._shaded())

    def _show(self) -> None:
        study, points = self.study, self.editor.points
        if study is None:
            for panel in self.panels.values():
                panel.draw(())
                panel.set_trait("points", points)
                panel.problem, panel.status = self.editor.problem or "no pose shows these points", ""
            self.editor.status = ""
            return
        self.editor.draw([edge_strokes(study.truth, TRUTH, PART)])
        self.editor.status = f"a rigid part misses these points by {study.misfit_px:.1f} px (rms)"
        for number, way in enumerate(study.ways):
            panel = self.panels[way.name]
            with panel.hold_sync():
                panel.draw(_layers(way, study, has_legend=number == 0))
                panel.points = points
                panel.problem = ""
                panel.status = _distance(way)

    def _shaded(self) -> ByteImage:
        return ray_shade(self.bench.model.part, self.bench.caster, self.bench.camera, self._pose)


def _layers(way: Manipulated, study: ManipulationStudy, has_legend: bool) -> tuple[Overlay, ...]:
    """What a way makes over the truth; one legend serves all panels."""
    truth, manipulated = (PART, "manipulated") if has_legend else ("", "")
    return (
        edge_strokes(study.truth, TRUTH, truth, width_px=3.0),
        edge_strokes(way.edges, GENERATED, manipulated, width_px=1.2),
    )


def _distance(way: Manipulated) -> str:
    if way.distance is None:
        return "no edges"
    there, back = way.distance.a_to_b, way.distance.b_to_a
    distance = f"Chamfer {way.distance.symmetric:.2f} px (there {there:.2f}, back {back:.2f})"
    return f"{distance}, rigid by construction" if way.is_rigid else distance


def _view_around(points: FloatArray) -> tuple[float, float, float, float]:
    low, high = points.min(0), points.max(0)
    size = ROOM * np.maximum(high - low, 20.0)
    x, y = 0.5 * (low + high) - 0.5 * size
    return float(x), float(y), float(size[0]), float(size[1])
