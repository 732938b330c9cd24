"""What stays fixed while one frame is solved, and what is sought in it.

A `View` is where the part is expected: camera, prior pose, view region with its W. An `Estimate` is a guess in that
view: control points I and a pose, of which the method varies one and the other follows. A `FrameView` is a view
with the image, cropped to where the part may be.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from acp_lab.cad.part import Part
from acp_lab.compiled import kernel
from acp_lab.control_points.canonical_frame import CANONICAL_SIZE, CanonicalFrame, canonical_frame, eye_position
from acp_lab.control_points.view_regions import ALL_REGIONS
from acp_lab.geometry.arrays import ByteImage, FloatArray, IntArray, plain
from acp_lab.geometry.camera import Camera
from acp_lab.geometry.planar_pnp import solve_planar_pnp
from acp_lab.geometry.planar_pnp_nearby import planar_pnp_nearby
from acp_lab.geometry.pose import transform
from acp_lab.geometry.pose_kernels import invert
from acp_lab.geometry.pose_step import (
    control_point_jacobian,
    image_directions,
    pose_step_between,
    step_jacobian,
)
from acp_lab.geometry.rolling_shutter import read_places

Box = tuple[int, int, int, int]
"""(x0, y0, x1, y1) px of the full image; x1 and y1 excluded."""
# A crop with less of the image than this shows nothing of the part.
_LEAST_OVERLAP_PX = 8
LEAST_PART_PX = 24
"""A part that is smaller than this, all of it, is not tracked: its edges are within each other's reach, so that any
pose fits."""


@dataclass(frozen=True, eq=False)
class View:
    """Where a part is expected in one frame.

    Attributes:
        camera: of the frame.
        prior: (4, 4) cam_T_obj, the expected pose.
        region: 0..5, the view region in use; points_obj: (4, 3) mm, its control points W.
        part: the CAD model.
        canonical_size: px, side of the canonical image that the part's generator paints.
        prior_information: (6, 6) how sure the prior is, the inverse covariance of a pose step (rad, mm) about the
            part's centre; None where nobody knows.
        motion: (6,) the pose step (rad, mm) about the part's centre that it is expected to make from frame to frame,
            which smears its edges while the shutter is open; None where nobody knows.
        steps: how many frames ago, as they usually come, what the prior was predicted from was seen.
        readout: (2,) how long the picture was read, see `geometry.rolling_shutter`; None where all at once, for all
            that is known.
    """

    camera: Camera
    prior: FloatArray
    region: int
    points_obj: FloatArray
    part: Part
    canonical_size: int = CANONICAL_SIZE
    prior_information: FloatArray | None = None
    motion: FloatArray | None = None
    steps: float = 1.0
    readout: FloatArray | None = None

    def at_pose(self, cam_T_obj: FloatArray) -> Estimate:
        """The estimate of a pose (4, 4)."""
        return Estimate(self, pose=cam_T_obj)

    def at_points(self, control_points: FloatArray, near: FloatArray | None = None) -> Estimate:
        """The estimate of control points I (4, 2) px; near: the pose (4, 4) of an I from which they moved a little."""
        return Estimate(self, points=control_points, near=near)

    def control_jacobian(self, cam_T_obj: FloatArray) -> FloatArray:
        """(8, 6) derivative of I by a pose step about the part's centre, at a pose (4, 4)."""
        centre_cam = transform(cam_T_obj, self.part.box_centre)
        return control_point_jacobian(transform(cam_T_obj, self.points_obj), centre_cam, self.camera)

    @cached_property
    def prior_covariance(self) -> FloatArray | None:
        """(6, 6) of a pose step (rad, mm) about the part's centre, away from the prior; None where nobody knows."""
        if self.prior_information is None:
            return None
        covariance = np.empty((6, 6))
        invert(plain(self.prior_information), covariance)
        return covariance

    @cached_property
    def canonical(self) -> CanonicalFrame:
        """The canonical frame of the prior; GeometryError where its eye is inside the part's bounding sphere."""
        part, region = self.part, ALL_REGIONS[self.region]
        return canonical_frame(eye_position(self.prior), part.box_centre, part.radius, region, self.canonical_size)

    @cached_property
    def image_H_canonical(self) -> FloatArray:
        """(3, 3) from the canonical frame to the image."""
        return self.canonical.homography_to(self.camera, self.prior)

    @cached_property
    def canonical_H_image(self) -> FloatArray:
        """(3, 3) from the image to the canonical frame."""
        return np.asarray(np.linalg.inv(self.image_H_canonical), np.float64)


class ImageLines:
    """How projected points move, each along one image direction.

    directions: (n, 3) px per mm in camera axes, see `pose_step.image_directions`.
    """

    def __init__(self, points_cam: FloatArray, normals: FloatArray, centre_cam: FloatArray, camera: Camera) -> None:
        self.directions = image_directions(points_cam, normals, camera)
        self._points_cam = points_cam
        self._centre_cam = centre_cam

    @cached_property
    def jacobian(self) -> FloatArray:
        """(n, 6) by a pose step about the part's centre (rad, mm)."""
        return step_jacobian(self._points_cam, self.directions, self._centre_cam)


@dataclass(frozen=True, eq=False)
class Estimate:
    """Control points and pose in one view: one of the two is given, the other is worked out when it is asked for.

    From pose to points by projection of W, from points to pose by planar PnP, of whose two solutions the one nearer to
    the view's prior is taken (paper IV-B); or the one that the pose `near` goes over into, where that is known.
    """

    view: View
    pose: FloatArray | None = None
    points: FloatArray | None = None
    near: FloatArray | None = None
    _lines: tuple[FloatArray, ImageLines] | None = field(default=None, init=False, repr=False)

    @cached_property
    def cam_T_obj(self) -> FloatArray:
        """(4, 4) mm; GeometryError where I is degenerate."""
        if self.pose is not None:
            return self.pose
        assert self.points is not None, "an estimate is of a pose or of control points"
        view = self.view
        if self.near is not None:
            refined = planar_pnp_nearby(view.points_obj, self.points, view.camera, self.near)
            if refined is not None:
                return refined
        return solve_planar_pnp(view.points_obj, self.points, view.camera).nearest(view.prior)

    @cached_property
    def centre_cam(self) -> FloatArray:
        """(3,) mm: the part's centre, camera frame."""
        return transform(self.cam_T_obj, self.view.part.box_centre)

    @cached_property
    def control_points(self) -> FloatArray:
        """(4, 2) px: I."""
        if self.points is not None:
            return self.points
        return self.view.camera.project(transform(self.cam_T_obj, self.view.points_obj))

    def lines(self, points_obj: FloatArray, normals: FloatArray) -> ImageLines:
        """How 3D points (n, 3) mm move across image lines with normals (n, 2), at the pose.

        Kept for the normals that were asked last: what is learnt of edges, the motion and the search ask for the same.
        """
        if self._lines is None or self._lines[0] is not normals:
            kept = ImageLines(transform(self.cam_T_obj, points_obj), normals, self.centre_cam, self.view.camera)
            object.__setattr__(self, "_lines", (normals, kept))
            return kept
        return self._lines[1]

    def read_places(self, points: FloatArray, points_obj: FloatArray) -> FloatArray:
        """(n, 2) px where the picture shows edge points that are at (n, 2) px, (n, 3) mm on the part.

        Elsewhere where it was read row by row, while the part moved.
        """
        view = self.view
        if view.readout is None or self.motion is None:
            return points
        centre_obj = view.part.box_centre
        return read_places(points, points_obj, self.cam_T_obj, centre_obj, view.camera, self.motion, view.readout)

    @cached_property
    def motion(self) -> FloatArray | None:
        """(6,) the pose step (rad, mm) that leads here from frame to frame; None where nobody knows."""
        view = self.view
        # Where the prior is no prediction, nobody knows what led from it to here.
        if view.motion is None or view.prior_information is None:
            return view.motion
        return view.motion + pose_step_between(view.prior, self.cam_T_obj, view.part.box_centre) / view.steps

    @property
    def is_possible(self) -> bool:
        """Whether all numbers are finite and the part's centre, by a given pose, is in front of the camera."""
        if self.pose is None:
            return bool(np.isfinite(self.control_points).all())
        # The centre: the origin of a CAD file may lie anywhere, also behind the camera.
        depth = self.pose[2, :3] @ self.view.part.box_centre + self.pose[2, 3]
        return bool(depth > 0.0 and np.isfinite(self.pose.sum()))


@dataclass(frozen=True, eq=False, kw_only=True)
class FrameView(View):
    """A view with the image.

    Attributes:
        image: (h, w, 3) uint8 RGB, the whole frame.
        box: what is looked at. edge_box: where in it edges are searched.
    """

    image: ByteImage
    box: Box
    edge_box: Box


def crop_box(points_obj: FloatArray, cam_T_obj: FloatArray, camera: Camera, margin_px: float) -> Box | None:
    """The box around points (n, 3) mm of a part at a pose (4, 4), wider by a margin.

    None where a point is behind the camera, the box outside the image, or the part too small in it to be tracked.
    """
    box = np.zeros(4, np.int64)
    is_in_sight = _box(plain(points_obj), plain(cam_T_obj), camera.numbers, camera.width, camera.height, margin_px, box)
    x0, y0, x1, y1 = box.tolist()
    return (x0, y0, x1, y1) if is_in_sight else None


@kernel("b1(f8[:, ::1], f8[:, ::1], f8[::1], f8[::1])")
def _extent(points_obj: FloatArray, pose: FloatArray, camera: FloatArray, extent: FloatArray) -> bool:
    """Fill extent (4,) with least x and y and most x and y, px, of points (n, 3) at a pose (4, 4).

    camera: see `Camera.numbers`. False where a point has no image, or none that is finite.
    """
    extent[0], extent[1], extent[2], extent[3] = np.inf, np.inf, -np.inf, -np.inf
    for i in range(len(points_obj)):
        x, y, z = pose[0, 3], pose[1, 3], pose[2, 3]
        for k in range(3):
            x += pose[0, k] * points_obj[i, k]
            y += pose[1, k] * points_obj[i, k]
            z += pose[2, k] * points_obj[i, k]
        if not z > 0.0:
            return False
        u, v = camera[0] * x / z + camera[2], camera[1] * y / z + camera[3]
        if not np.isfinite(u + v):
            return False
        extent[0], extent[1] = min(extent[0], u), min(extent[1], v)
        extent[2], extent[3] = max(extent[2], u), max(extent[3], v)
    return True


@kernel("b1(f8[:, ::1], f8[:, ::1], f8[::1], i8, i8, f8, i8[::1])")
def _box(
    points_obj: FloatArray, pose: FloatArray, camera: FloatArray, width: int, height: int, margin_px: float,
    box: IntArray,
) -> bool:  # fmt: skip
    """Fill box (4,), see `crop_box`; False where there is none. camera: see `Camera.numbers`."""
    extent = np.empty(4)
    if not _extent(points_obj, pose, camera, extent):
        return False
    if max(extent[2] - extent[0], extent[3] - extent[1]) < LEAST_PART_PX:
        return False
    extent[:2] -= margin_px
    extent[2:] += margin_px
    least = _LEAST_OVERLAP_PX
    if extent[2] < least or extent[3] < least or extent[0] > width - least or extent[1] > height - least:
        return False
    # A part that fills far more than the image is searched inside the image only; keep the numbers small.
    far = max(1e4, 2.0 * max(width, height))
    for i in range(4):
        box[i] = int(min(max(extent[i], -far), far)) + i // 2
    return True
