"""The start pose by hand: click corners, or drag four control points, until the generated edges sit on the part.

For the first frame of somebody's own video. "Find it for me" shows where the detector believes it to be; "snap"
lets the tracker's optimiser finish what the hand began. The result is the POSE.json that `acp-lab track --init` reads.
"""

from __future__ import annotations

import html
import os
from pathlib import Path
from typing import Any

import ipywidgets
import numpy as np
import traitlets

from acp_lab.control_points.canonical_frame import eye_position
from acp_lab.control_points.coplanar_points import mid_section_points
from acp_lab.control_points.view_regions import ALL_REGIONS, REGION_NAMES, choose_region
from acp_lab.display.look import GENERATED
from acp_lab.display.widgets.cad_view import CadView
from acp_lab.display.widgets.control_point_editor import ControlPointEditor
from acp_lab.display.widgets.controls import (
    Turn,
    button,
    close_with_parts,
    motion_buttons,
    row,
    side_by_side,
    turn_buttons,
    typed_path,
)
from acp_lab.display.widgets.corner_pairs import CornerPairs
from acp_lab.display.widgets.find_panel import LOOKING, FindPanel
from acp_lab.display.widgets.first_guess import pose_in_the_middle, rotation_seeing
from acp_lab.display.widgets.overlay import RESIDUAL_LABEL, edge_strokes, residual_strokes
from acp_lab.display.widgets.point_canvas import PointCanvas
from acp_lab.display.widgets.pose_origin import Origin
from acp_lab.display.widgets.still import Still
from acp_lab.errors import AcpLabError, GeometryError, check_kind
from acp_lab.generator.base import GeneratedEdges, project_samples
from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.planar_pnp import PlanarPnP, solve_planar_pnp
from acp_lab.geometry.pose import make_pose, rotation_angle_deg, transform
from acp_lab.geometry.pose_step import centre_position, move_pose
from acp_lab.prepared_part import PreparedPart
from acp_lab.sequences.frame import Frame, check_frame
from acp_lab.sequences.json_file import read_pose, was_found, write_pose
from acp_lab.tracking.find import Detection
from acp_lab.tracking.snap import SnapResult, snap

TURN_DEG = 15.0
DEPTH_STEP = 0.1
LIGHT_SAMPLES = 700
"""Edge points drawn while something is dragged."""
SAME_FIT, SAME_FIT_PX = 2.0, 1.0
"""Of the two poses of four points, one fits no worse while it is off by at most SAME_FIT times what the other is off by
plus SAME_FIT_PX, in px (rms)."""
HINT = "drag the points, or the area between them, until the edges sit on the part"
CLICK, DRAG = "click corners", "drag four points"


class PoseAligner(Still, ipywidgets.VBox):
    """Finds cam_T_obj in one frame by hand and snap.

    cam_T_obj: (4, 4) mm, the present pose; observe it, or assign it, and the points follow. snapped: the last
    `SnapResult`, None once the pose was moved on; pose_before: (4, 4) from which it was found. origin: where the
    present pose comes from. mode: whose value is CLICK or DRAG. chooser, picture, pairs: the CAD model, the frame and
    the corners clicked on both. editor: the frame with the four control points; region: 0..5, whose points they are;
    cad_view: the CAD model beside it. finder: the detector's hypotheses, `finder.find()`. All buttons are methods:
    `snap`, `save`, `turn`, `see_from`, `take_other_pose`, `solve_corners`. `load` goes on with the pose of an earlier
    day.
    """

    still = "widget_aligner.png"

    cam_T_obj = traitlets.Any()
    snapped = traitlets.Any(None, allow_none=True)
    pose_before: FloatArray | None = None
    _saved: FloatArray | None = None

    def __init__(self, model: PreparedPart, frame: Frame, cam_T_obj: FloatArray | None = None) -> None:
        """cam_T_obj: (4, 4) to begin with; by default the part is put into the middle of the image."""
        check_kind(model, PreparedPart, "model", "acp.PreparedPart.load('parts/bracket'), or what acp.prepare returned")
        check_frame(frame)
        self.model, self.frame = model, frame
        self._generator = model.best_generator()
        pose = pose_in_the_middle(model, frame) if cam_T_obj is None else np.array(cam_T_obj, np.float64)
        self.region = self._region_of(pose)
        self._is_linking = False  # pose and points are being brought together; neither answers the other
        self.editor = ControlPointEditor(frame.image, self.points_at(pose), title="frame", status=HINT, height_px=560)
        self.picture = PointCanvas(frame.image, title="frame", height_px=560, editable=True)
        self.cad_view = CadView(model.part, pose[:3, :3], title="CAD model")
        self.chooser = CadView(model.part, pose[:3, :3], title="CAD model")
        self.cad_view.on_orbit = self.turn
        self.pairs = CornerPairs(self.chooser, self.picture)
        self.finder = FindPanel(model, frame, self._take_found, self._tell)
        self.mode = ipywidgets.ToggleButtons(options=[CLICK, DRAG])
        self.mode.style.button_width = "auto"
        self.path = ipywidgets.Text("POSE.json", layout=ipywidgets.Layout(flex="1 1 260px", width="auto"))
        # A line of its own, there from the beginning: words that come must not move the picture below the pointer.
        self.message = ipywidgets.HTML(layout=ipywidgets.Layout(min_height="28px", margin="0"))
        self._left, self._right = ipywidgets.VBox(), ipywidgets.VBox()
        self._by_mode = {CLICK: self._click_page(), DRAG: self._drag_page()}
        save = [self.path, button("save", "write the pose as POSE.json", self._save_as_told)]
        self._snap_button = button("snap", "let the optimiser find the edges", self.snap, "primary")
        top = row([self.mode, self._snap_button, *save, self.finder.controls], gap="4px 12px")
        columns = side_by_side((self._left, "3 1 420px"), (self._right, "2 1 300px"))
        super().__init__([top, self.message, self.finder, columns], cam_T_obj=pose)
        self._came = (self.cam_T_obj, Origin.HAND)
        self._untouched = self.cam_T_obj if cam_T_obj is None else None
        self._pose_of_page = self.cam_T_obj
        self.mode.observe(lambda _: self._turn_page(), "value")
        self.editor.observe(self._follow, "points")
        self.editor.observe(lambda _: self._draw(), "settled")
        # While the model is turned, the points that go with it are held by the same hand.
        self.cad_view.observe(lambda change: self.editor.set_trait("dragging", change.new), "dragging")
        self.picture.observe(lambda _: self._follow_corners(), "settled")
        self.observe(self._pose_changed, "cam_T_obj")
        self._turn_page()
        self._draw()

    # ---- what the buttons do

    def snap(self) -> SnapResult | None:
        """Let the optimiser find the part near the present pose; None, with a message, when it is not seen.

        Where four points leave two poses and the nearer one fits nothing, the other one is tried, too. Where nothing
        moved since the part was found, that result stays.
        """
        if self.snapped is not None and self.snapped.is_good and self.editor.is_good:
            return self.snapped
        self._snap_button.disabled = True
        self._tell("searching …")
        try:
            found = snap(self.model, self.frame, self.cam_T_obj)
            other = self._other_pose()
            if not found.is_good and other is not None:
                self._tell("searching from the other pose …")
                found = max(found, snap(self.model, self.frame, other), key=lambda result: result.quality)
        except AcpLabError as error:
            self._tell(str(error))
            return None
        except KeyboardInterrupt:
            self._tell("snap was interrupted: the pose is as it was")
            raise
        finally:
            self._snap_button.disabled = False
        before = self.pose_before = self.cam_T_obj
        with self.hold_trait_notifications():
            self.cam_T_obj, self.snapped = found.cam_T_obj, found
        turned = rotation_angle_deg(before[:3, :3], found.cam_T_obj[:3, :3])
        verdict = "found" if found.is_good else "not found: bring the edges nearer to the part and snap again"
        self._tell("", verdict, f": quality {found.quality:.2f}, turned by {turned:.1f}° from where it was")
        return found

    def load(self, path: str | Path) -> bool:
        """Work on this POSE.json: the button saves there, and the pose of a file that is there is taken.

        A pose that was read counts as saved. Returns whether there was one; InputFileError for a malformed file.
        """
        self.path.value = str(path)
        if not os.path.lexists(path):
            return False
        self._take(read_pose(path), Origin.READ_AS_FOUND if was_found(path) else Origin.READ)
        self._saved = self.cam_T_obj
        self.chooser.look(self.cam_T_obj[:3, :3])
        return True

    def save(self, path: str | Path) -> None:
        """Write the pose as POSE.json; InputFileError when the place cannot be written or holds something else.

        The file says whether the pose was found in the image. One that says all of this already stays as it is, byte
        for byte.
        """
        is_found = self.origin.is_found
        if not _holds(Path(path), self.cam_T_obj, is_found):
            write_pose(path, self.cam_T_obj, is_found)
        self._saved = self.cam_T_obj

    @property
    def origin(self) -> Origin:
        """Where the present pose comes from: the hand's, as soon as anything else moved it."""
        if self.snapped is not None:
            return Origin.SNAP if self.snapped.is_good else Origin.FAILED_SNAP
        pose, origin = self._came
        return origin if pose is self.cam_T_obj else Origin.HAND

    @property
    def is_saved(self) -> bool:
        """Whether the present pose was saved, or read by `load`."""
        return self._saved is self.cam_T_obj

    def turn(self, turn_deg: Turn, depth_factor: float = 1.0) -> None:
        """Turn the part about its centre (deg, camera axes) and move it away; the control points may change.

        Nothing, with a message, where it would come so near that some of it might be behind the camera.
        """
        centre_obj = self.model.part.box_centre
        centre = centre_position(self.cam_T_obj, centre_obj)
        if depth_factor < 1.0 and depth_factor * centre[2] <= self.model.part.radius:
            self._tell("no nearer: the part would reach the camera")
            return
        shift = (depth_factor - 1.0) * centre
        self.cam_T_obj = move_pose(self.cam_T_obj, centre_obj, np.concatenate([np.radians(turn_deg), shift]))

    def see_from(self, region: int) -> None:
        """Show the face 0..5 = +x, -x, ... of the part's box, a little from the side, where the part is now."""
        self._turn_to(rotation_seeing(region))

    def take_other_pose(self) -> None:
        """Change to the second of the two poses that four coplanar points leave, if there is one."""
        other = self._other_pose()
        if other is None:
            self._tell("these points leave one pose only")
        else:
            self._follow_with(other)

    def solve_corners(self) -> None:
        """Take the pose of the clicked corners; a message says what is missing."""
        try:
            found = self.pairs.solve(self.frame.camera)
        except GeometryError as error:
            self._tell(str(error))
            return
        self.cam_T_obj = found.cam_T_obj
        worst = int(found.reprojection_px.argmax())
        self._tell(
            f"{self.pairs.count} corners, {found.rms_px:.1f} px off (rms), "
            f"most at corner {worst + 1}: {found.reprojection_px[worst]:.1f} px"
        )

    def points_at(self, pose: FloatArray) -> FloatArray:
        """Where a pose (4, 4) has the control points in use, (4, 2) px."""
        return self.frame.camera.project(transform(pose, self._points_obj()))

    def close(self) -> None:
        """Close it, and what is on the page that is not shown."""
        for columns in getattr(self, "_by_mode", {}).values():  # Python closes what was never finished, too
            for column in columns:
                close_with_parts(*column)
        super().close()

    # ---- following

    def _follow(self, _: object) -> None:
        if self._is_linking or not self.editor.is_good:
            return
        try:
            self._follow_with(_nearest_that_fits(self._solutions(), self.cam_T_obj))
        except GeometryError as error:
            self.editor.problem = str(error)

    def _follow_corners(self) -> None:
        if self.pairs.count >= 4:
            self.solve_corners()

    def _take_found(self, detection: Detection) -> None:
        self._take(detection.cam_T_obj, Origin.DETECTOR)
        self.chooser.look(self.cam_T_obj[:3, :3])
        self._tell("taken: look whether the edges sit, then snap")

    def _take(self, pose: FloatArray, origin: Origin) -> None:
        self.cam_T_obj = pose
        self._came = (self.cam_T_obj, origin)

    def _turn_to(self, rotation: FloatArray) -> None:
        """Turn the part about its centre to a rotation (3, 3), object to camera axes."""
        centre_obj = self.model.part.box_centre
        self.cam_T_obj = make_pose(rotation, centre_position(self.cam_T_obj, centre_obj) - rotation @ centre_obj)

    def _follow_with(self, pose: FloatArray) -> None:
        """Take a pose that comes from the points."""
        self._is_linking = True
        try:
            self.cam_T_obj = pose
        finally:
            self._is_linking = False

    @traitlets.validate("cam_T_obj")
    def _checked(self, proposal: dict[str, Any]) -> FloatArray:
        pose = np.array(proposal["value"], np.float64)
        if pose.shape != (4, 4) or not np.isfinite(pose).all():
            raise traitlets.TraitError(f"a pose of shape {pose.shape}: give a finite cam_T_obj (4, 4)")
        pose.flags.writeable = False
        return pose

    def _pose_changed(self, _: object) -> None:
        self._tell(LOOKING if self.finder.is_searching else "")  # what else was said was said of another pose
        if self.snapped is not None and not np.array_equal(self.snapped.cam_T_obj, self.cam_T_obj):
            self.snapped = None
        if not self._is_linking:
            self._bring_points()
        self._draw()

    def _bring_points(self) -> None:
        """Put the control points where the pose has them."""
        before, self.region = self.region, self._region_of(self.cam_T_obj)
        points = self.points_at(self.cam_T_obj)
        if not np.isfinite(points).all():
            return  # behind the camera; snap will say so
        self._is_linking = True
        try:
            # Points of another face are other points: undo must not mix the two.
            if before == self.region:
                self.editor.points = points
            else:
                self.editor.restart(points)
        finally:
            self._is_linking = False

    def _solutions(self) -> PlanarPnP:
        return solve_planar_pnp(self._points_obj(), self.editor.points, self.frame.camera)

    def _other_pose(self) -> FloatArray | None:
        try:
            poses = self._solutions().poses
        except GeometryError:
            return None
        near = self._solutions().nearest(self.cam_T_obj)
        other: FloatArray = poses[1] if np.array_equal(poses[0], near) else poses[0]
        return other if rotation_angle_deg(other[:3, :3], near[:3, :3]) > 1.0 else None

    def _region_of(self, pose: FloatArray) -> int:
        part = self.model.part
        return choose_region(eye_position(pose) - part.box_centre, 0.5 * part.box_size)

    def _points_obj(self) -> FloatArray:
        part = self.model.part
        return mid_section_points(part.box_min, part.box_max, ALL_REGIONS[self.region].axis)

    # ---- showing

    def _drag_page(self) -> tuple[list[ipywidgets.Widget], list[ipywidgets.Widget]]:
        turns = motion_buttons(self.turn, lambda factor: self.turn((0.0, 0.0, 0.0), factor), TURN_DEG, DEPTH_STEP)
        other = button("other pose", "four coplanar points leave two poses: take the other one", self.take_other_pose)
        faces = [
            button(name, f"look at the face {name} of the part's box", _calling(self.see_from, region))
            for region, name in enumerate(REGION_NAMES)
        ]
        label = ipywidgets.Label("seen from")
        return [self.editor], [self.cad_view, row([*turns, other]), row([label, *faces])]

    def _click_page(self) -> tuple[list[ipywidgets.Widget], list[ipywidgets.Widget]]:
        turns = turn_buttons(self.chooser.turn, TURN_DEG)
        clear = button("clear", "forget all corners", self.pairs.clear)
        faces = [
            button(name, f"look at the face {name}", _calling(lambda k: self.chooser.look(rotation_seeing(k)), region))
            for region, name in enumerate(REGION_NAMES)
        ]
        return [self.picture], [self.chooser, row([*turns, clear]), row([ipywidgets.Label("seen from"), *faces])]

    def _turn_page(self) -> None:
        """Change the mode; what was turned in the one is seen as turned in the other."""
        if self.mode.value == DRAG and self.cam_T_obj is self._untouched:
            self._turn_to(self.chooser.pose[:3, :3])
            self._untouched = self.cam_T_obj
        elif self.mode.value == CLICK and self.cam_T_obj is not self._pose_of_page:
            self.chooser.look(self.cam_T_obj[:3, :3])
        self._pose_of_page = self.cam_T_obj
        left, right = self._by_mode[self.mode.value]
        self._left.children, self._right.children = left, right
        self._draw()

    def _draw(self) -> None:
        """The generated edges on the frame; all of them, coloured by what was found, once a snap knows that."""
        canvas = self.editor if self.mode.value == DRAG else self.picture
        if self.snapped is not None:
            canvas.draw(residual_strokes(self.snapped.edges, self.snapped.residuals_px, RESIDUAL_LABEL))
        else:
            count = LIGHT_SAMPLES if canvas.dragging else len(self.model.edges)
            canvas.draw([edge_strokes(self._edges(count), GENERATED, "generated edges", 1.5)])
        if self.mode.value == DRAG and (not canvas.dragging or self.cad_view.dragging):
            self.cad_view.look(self.cam_T_obj[:3, :3])
            self.cad_view.closed = True
            self.cad_view.points = self.cad_view.project(self._points_obj())

    def _edges(self, count: int) -> GeneratedEdges:
        visible = self._generator.visible(self.cam_T_obj, self.region, count)
        return project_samples(self._generator.edges, visible, self.cam_T_obj, self.frame.camera)

    def _save_as_told(self) -> None:
        path = typed_path(self.path.value)
        try:
            self.save(path)
        except AcpLabError as error:
            self._tell(str(error))
        else:
            before, bold, after = self.origin.value
            self._tell(f"the pose is in {path.resolve()}{before}", bold, after)

    def _tell(self, text: str, strong: str = "", rest: str = "") -> None:
        """Show plain text, its middle in bold. Names of parts and files are in it: none of it is taken for HTML."""
        before, bold, after = (html.escape(piece) for piece in (text, strong, rest))
        self.message.value = f"{before}<b>{bold}</b>{after}" if bold else before


def _holds(path: Path, pose: FloatArray, is_found: bool) -> bool:
    """Whether a POSE.json says exactly this pose, and this of how it came about."""
    try:
        return bool(np.array_equal(read_pose(path), pose)) and was_found(path) == is_found
    except (AcpLabError, ValueError):  # no file can have such a name: whoever writes there says so
        return False


def _calling(action: Any, argument: int) -> Any:
    return lambda: action(argument)


def _nearest_that_fits(found: PlanarPnP, prior: FloatArray) -> FloatArray:
    """The pose nearer to the prior (4, 4), unless the other one fits the points far better.

    A hand may lead the points past the place where the two poses part: nearness alone would then keep the wrong one
    for good, however exactly the points sit in the end.
    """
    best_px, other_px = found.reprojection_px
    if other_px > SAME_FIT * best_px + SAME_FIT_PX:
        return found.poses[0]
    return found.nearest(prior)
