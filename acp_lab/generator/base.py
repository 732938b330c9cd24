"""The generative model t(I): image control points in, visible edge points out (paper IV-A, eq. 5).

The paper's t(I) is a network that paints an edge image. Everything downstream needs the edge
*points* (where, which way they run, how much they count), so points are the interface here and
the edge image is drawn from them on request.

Rigid generators, such as the view templates and the visibility network, are t(I) = t(pose(PnP(I))):
they choose among the CAD's own 3D edge samples and project the chosen ones, so their edges are
exact in position and always those of a rigid part.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Protocol

import cv2
import numpy as np

from acp_lab.cad.edges import EdgeSamples
from acp_lab.compiled import kernel
from acp_lab.control_points.canonical_frame import eye_position
from acp_lab.control_points.view_regions import choose_region
from acp_lab.geometry.arrays import plain
from acp_lab.geometry.camera import Camera
from acp_lab.geometry.planar_pnp import solve_planar_pnp


@dataclass(frozen=True)
class GeneratedEdges:
    """Visible edge points of a part as t(I) generates them.

    Attributes:
        points: (n, 2) px in the full image.
        tangents: (n, 2) unit direction of the edge in the image.
        weights: (n,) in [0, 1], the belief that the edge point is visible.
        sample_ids: (n,) row of the part's 3D edge sample that each point shows; -1 when a
            generator knows no 3D sample.
        outline: (n,) bool, the point is on the silhouette; all False when a generator does not know.
    """

    points: np.ndarray
    tangents: np.ndarray
    weights: np.ndarray
    sample_ids: np.ndarray
    outline: np.ndarray = field(default_factory=lambda: np.zeros(0, bool))

    def __post_init__(self) -> None:
        if len(self.outline) == 0:
            object.__setattr__(self, "outline", np.zeros(len(self.points), bool))

    def __len__(self) -> int:
        return len(self.points)

    def take(self, rows: np.ndarray) -> GeneratedEdges:
        """The edge points of some rows: their numbers, or a bool for each."""
        return GeneratedEdges(
            self.points[rows], self.tangents[rows], self.weights[rows], self.sample_ids[rows], self.outline[rows]
        )

    @cached_property
    def normals(self) -> np.ndarray:
        """(n, 2) unit, the tangents turned from x towards y."""
        normals = np.empty_like(self.tangents)
        np.negative(self.tangents[:, 1], out=normals[:, 0])
        normals[:, 1] = self.tangents[:, 0]
        return normals

    def image(self, width: int, height: int, half_length_px: float = 1.0) -> np.ndarray:
        """The edge image E of eq. 5: (height, width) uint8, 0 or 255, short strokes along the tangents."""
        canvas = np.zeros((height, width), np.uint8)
        # cv2 takes fixed-point coordinates; 4 fractional bits keep the strokes sub-pixel exact.
        ends = np.stack([self.points - half_length_px * self.tangents, self.points + half_length_px * self.tangents], 1)
        in_reach = np.isfinite(ends).all((1, 2)) & (np.abs(ends) < 1e5).all((1, 2))
        cv2.polylines(canvas, list(np.round(ends[in_reach] * 16).astype(np.int32)), False, 255, shift=4)
        return canvas


@dataclass(frozen=True)
class VisibleSamples:
    """The 3D edge samples that a view shows, best-spread first.

    Attributes:
        ids: (n,) rows of the part's edge samples, ascending, hence in their stable order.
        outline: (n,) bool, the sample is a silhouette in this view.
        weights: (n,) in [0, 1], the belief that nothing hides it.
    """

    ids: np.ndarray
    outline: np.ndarray
    weights: np.ndarray

    def __post_init__(self) -> None:
        # As compiled loops take them, whatever a generator of one's own gives.
        for name, kind in (("ids", np.int64), ("outline", np.bool_), ("weights", np.float64)):
            object.__setattr__(self, name, np.require(getattr(self, name), kind, ("C", "W")))


class RigidGenerator(Protocol):
    """A t(I) that chooses visible samples of a rigid part.

    Attributes:
        edges: the part's 3D edge samples.
    """

    name: str
    edges: EdgeSamples

    @property
    def regions(self) -> tuple[int, ...]:
        """The view regions 0..5 that it was prepared for, ascending."""
        ...

    def visible(self, cam_T_obj: np.ndarray, region: int, count: int) -> VisibleSamples:
        """At most `count` samples that show at a pose (4, 4); `region` 0..5 is the view region in use."""
        ...


def project_samples(
    edges: EdgeSamples, visible: VisibleSamples, cam_T_obj: np.ndarray, camera: Camera
) -> GeneratedEdges:
    """The edge points of visible samples at a pose (4, 4) in the image of `camera`."""
    points, tangents = np.empty((2, len(visible.ids), 2))
    _project(edges.points_obj, edges.tangents_obj, visible.ids, plain(cam_T_obj), camera.numbers, points, tangents)
    return GeneratedEdges(points, tangents, visible.weights, visible.ids, visible.outline)


@kernel("void(f8[:, ::1], f8[:, ::1], i8[::1], f8[:, ::1], f8[::1], f8[:, ::1], f8[:, ::1])")
def _project(
    points_obj: np.ndarray, tangents_obj: np.ndarray, ids: np.ndarray, pose: np.ndarray, camera: np.ndarray,
    points: np.ndarray, tangents: np.ndarray,
) -> None:  # fmt: skip
    """Fill points and tangents (n, 2): pixels of the samples `ids` and unit directions; NaN behind the camera.

    pose: (4, 4); camera: (4,), see `Camera.numbers`.
    """
    fx, fy, cx, cy = camera[0], camera[1], camera[2], camera[3]
    at, along = np.empty(3), np.empty(3)
    for n in range(len(ids)):
        i = ids[n]
        for k in range(3):
            at[k], along[k] = pose[k, 3], 0.0
            for j in range(3):
                at[k] += pose[k, j] * points_obj[i, j]
                along[k] += pose[k, j] * tangents_obj[i, j]
        if not at[2] > 0.0:
            points[n] = np.nan
            tangents[n] = np.nan
            continue
        points[n, 0], points[n, 1] = fx * at[0] / at[2] + cx, fy * at[1] / at[2] + cy
        slope = along[2] / at[2]
        x, y = fx * (along[0] - at[0] * slope), fy * (along[1] - at[1] * slope)
        length = max(np.sqrt(x * x + y * y), 1e-12)
        tangents[n, 0], tangents[n, 1] = x / length, y / length


def image_tangents(points_cam: np.ndarray, tangents_cam: np.ndarray, camera: Camera) -> np.ndarray:
    """(n, 2) unit image directions of edges with 3D directions (n, 3) at points (n, 3) mm, camera frame."""
    along = tangents_cam[:, :2] - points_cam[:, :2] * (tangents_cam[:, 2:] / points_cam[:, 2:])
    along *= (camera.fx, camera.fy)
    return along / np.maximum(np.hypot(along[:, 0], along[:, 1]), 1e-12)[:, None]


def generate_edges(
    generator: RigidGenerator,
    control_points: np.ndarray,
    points_obj: np.ndarray,
    camera: Camera,
    prior: np.ndarray,
    half_size: np.ndarray,
    box_centre: np.ndarray,
    count: int = 1_000_000,
) -> GeneratedEdges:
    """t(I) of a rigid generator: PnP, then visible samples, then their projections (paper eq. 5).

    Args:
        control_points: (4, 2) image control points I, px.
        points_obj: (4, 3) their 3D points W, mm.
        prior: (4, 4) pose that decides between the two solutions of planar PnP.
        half_size: (3,) half the box's sides, mm; box_centre: (3,) mm; they choose the view region.

    Raises:
        GeometryError: the control points are degenerate (three collinear, folded, coincident).
    """
    cam_T_obj = solve_planar_pnp(points_obj, control_points, camera).nearest(prior)
    region = choose_region(eye_position(cam_T_obj) - box_centre, half_size)
    return project_samples(generator.edges, generator.visible(cam_T_obj, region, count), cam_T_obj, camera)
