"""What moving four control points does to a part's edges: homography, spline and generators against the truth.

The paper's manipulative transformation (section IV-A, Fig. 3): edges of a reference view, or of a model, are made
to follow I. A homography moves every edge as if it lay in the plane of the four points; a thin-plate spline bends
the image between them; a generator t(I) has learned, or knows, the part. The truth is the CAD model seen from the
pose that planar PnP reads off I, its hidden edges removed by ray casting.

Convention: px of the full image; poses cam_T_obj, mm. The distances are Chamfer distances both ways.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from acp_lab.cad.edges import EdgeSamples, visible_samples
from acp_lab.cad.raycast import make_caster
from acp_lab.control_points.canonical_frame import eye_position
from acp_lab.control_points.coplanar_points import mid_section_points
from acp_lab.control_points.view_regions import ALL_REGIONS, choose_region
from acp_lab.errors import GeometryError
from acp_lab.generator.base import GeneratedEdges, RigidGenerator, VisibleSamples, generate_edges, project_samples
from acp_lab.generator.painted.edge_points import RIDGE_THRESHOLD, ridge
from acp_lab.generator.templates import RAY_OFFSET_IN_DIAMETERS
from acp_lab.geometry.arrays import FloatArray, IntArray
from acp_lab.geometry.camera import Camera
from acp_lab.geometry.homography import homography_from_points
from acp_lab.geometry.planar_pnp import solve_planar_pnp
from acp_lab.geometry.pose import check_pose, transform
from acp_lab.geometry.tps import warp_points_tps
from acp_lab.imaging.chamfer import Chamfer, chamfer
from acp_lab.prepared_part import PreparedPart
from acp_lab.tracking.frame_view import View
from acp_lab.tracking.sources.painted import RidgeSource

MOST_PAINTED = 20_000
Warp = Callable[[FloatArray], FloatArray]


@dataclass(frozen=True, eq=False)
class Manipulated:
    """Edges as one way of manipulating moves them.

    name: "homography", "thin-plate spline" or "t(I) ...". is_rigid: whether they are those of a rigid part by
    construction, whatever I. edges: px. distance: to the true edges, px; None when a side has no points.
    """

    name: str
    is_rigid: bool
    edges: GeneratedEdges
    distance: Chamfer | None


@dataclass(frozen=True, eq=False)
class ManipulationStudy:
    """All ways side by side for one I.

    cam_T_obj: (4, 4) from planar PnP. misfit_px: rms distance from I to where that pose puts the four points: 0
    when I is what a rigid part can show. truth: the true edges at that pose.
    """

    cam_T_obj: FloatArray
    misfit_px: float
    truth: GeneratedEdges
    ways: tuple[Manipulated, ...]


class ManipulationBench:
    """One part, one camera, one reference view; `study` compares what the ways make of other control points.

    reference: the true edges of the reference view. control_points: (4, 2) px there. points_obj: (4, 3) mm, W.
    """

    def __init__(self, model: PreparedPart, camera: Camera, cam_T_obj: FloatArray) -> None:
        """cam_T_obj: (4, 4), of the reference view, from outside the part; else GeometryError."""
        cam_T_obj = check_pose(cam_T_obj, f"{model.part.name}: the reference pose")
        self.model, self.camera = model, camera
        self.reference_pose = np.array(cam_T_obj, np.float64)
        part = model.part
        self.caster = make_caster(part)
        self._half_size = 0.5 * part.box_size
        self.region = choose_region(eye_position(self.reference_pose) - part.box_centre, self._half_size)
        self._view(self.reference_pose)  # for its error, which names the eye
        self._painter = None
        if self.region in model.autoencoders:
            # Asked at any I as it is: what the network makes of an I that no rigid motion makes is to be seen.
            self._painter = RidgeSource(model.autoencoder(), "mid-section", ridge, RIDGE_THRESHOLD, "prediction")
        self.points_obj = mid_section_points(part.box_min, part.box_max, ALL_REGIONS[self.region].axis)
        self.control_points = self.points_at(self.reference_pose)
        self.reference = self.true_edges(self.reference_pose)
        self._generators = _rigid_generators(model)

    def points_at(self, cam_T_obj: FloatArray) -> FloatArray:
        """The control points I (4, 2) px of a pose (4, 4)."""
        return self.camera.project(transform(cam_T_obj, self.points_obj))

    def true_edges(self, cam_T_obj: FloatArray) -> GeneratedEdges:
        """The edges that the CAD model shows at a pose (4, 4), hidden ones removed by rays."""
        edges = self.model.edges
        offset_mm = RAY_OFFSET_IN_DIAMETERS * self.model.part.diameter
        rows = np.flatnonzero(visible_samples(edges, self.caster, eye_position(cam_T_obj), offset_mm))
        return _projected(edges, rows, cam_T_obj, self.camera)

    def study(self, control_points: FloatArray, prior: FloatArray) -> ManipulationStudy:
        """Compare the ways for I (4, 2) px; prior (4, 4) decides between the two poses of planar PnP.

        Raises GeometryError when I is degenerate: three points collinear, folded.
        """
        cam_T_obj = solve_planar_pnp(self.points_obj, control_points, self.camera).nearest(prior)
        off = self.points_at(cam_T_obj) - control_points
        truth = self.true_edges(cam_T_obj)
        warps = (
            ("homography", _homography(self.control_points, control_points)),
            ("thin-plate spline", lambda points: warp_points_tps(points, self.control_points, control_points)),
        )
        ways = [_measured(name, False, _warped(self.reference, warp), truth) for name, warp in warps]
        if self._painter is not None:
            # The paper's network, in the canonical frame of the pose that PnP reads off I.
            painted = self._painter.generate(self._view(cam_T_obj).at_points(control_points), MOST_PAINTED)
            ways.append(_measured("t(I) auto-encoder", False, painted, truth))
        for name, generator in self._generators:
            generated = generate_edges(
                generator,
                control_points,
                self.points_obj,
                self.camera,
                prior,
                self._half_size,
                self.model.part.box_centre,
            )
            ways.append(_measured(name, True, generated, truth))
        return ManipulationStudy(cam_T_obj, float(np.sqrt((off**2).sum() / 4.0)), truth, tuple(ways))

    def _view(self, cam_T_obj: FloatArray) -> View:
        return view_of(self.model, self.camera, cam_T_obj, self.region)


def view_of(model: PreparedPart, camera: Camera, cam_T_obj: FloatArray, region: int) -> View:
    """What generators need to know of a frame: region 0..5, its W, the middle section, and its canonical frame.

    Raises GeometryError for an eye inside the part.
    """
    part = model.part
    points_obj = mid_section_points(part.box_min, part.box_max, ALL_REGIONS[region].axis)
    view = View(camera, cam_T_obj, region, points_obj, part)
    _ = view.canonical  # its error comes now, not when a generator asks
    return view


def _rigid_generators(model: PreparedPart) -> tuple[tuple[str, RigidGenerator], ...]:
    found: list[tuple[str, RigidGenerator]] = []
    if model.templates is not None:
        found.append(("t(I) view templates", model.templates))
    if model.networks:
        found.append(("t(I) visibility network", model.best_generator()))
    return tuple(found)


def _homography(src: FloatArray, dst: FloatArray) -> Warp:
    """kornia's homography, the one that a network could learn through; ours is its twin on the per-frame path."""
    homography_from_points(src, dst)  # for its errors, which name the points

    import torch
    from kornia.geometry.linalg import transform_points
    from kornia.geometry.transform import get_perspective_transform

    def tensor(points: FloatArray) -> torch.Tensor:
        return torch.tensor(points, dtype=torch.float64)[None]

    matrix = get_perspective_transform(tensor(src), tensor(dst))
    return lambda points: np.asarray(transform_points(matrix, tensor(points))[0].numpy(), dtype=np.float64)


def _warped(edges: GeneratedEdges, warp: Warp) -> GeneratedEdges:
    """Edge points moved by a warp; their tangents follow its derivative along them."""
    step_px = 0.25
    points, ahead = warp(edges.points), warp(edges.points + step_px * edges.tangents)
    along = ahead - points
    length = np.hypot(along[:, 0], along[:, 1])
    # A homography may send points to infinity and back from the other side.
    good = np.isfinite(points).all(1) & np.isfinite(length) & (length > 1e-9) & (np.abs(points) < 1e5).all(1)
    tangents = along[good] / length[good, None]
    return GeneratedEdges(points[good], tangents, edges.weights[good], edges.sample_ids[good])


def _projected(edges: EdgeSamples, rows: IntArray, cam_T_obj: FloatArray, camera: Camera) -> GeneratedEdges:
    everything = VisibleSamples(rows, np.zeros(len(rows), bool), np.ones(len(rows)))
    return project_samples(edges, everything, cam_T_obj, camera)


def _measured(name: str, is_rigid: bool, edges: GeneratedEdges, truth: GeneratedEdges) -> Manipulated:
    try:
        distance = chamfer(edges.points, truth.points)
    except GeometryError:  # one of the two shows no edge at all
        distance = None
    return Manipulated(name, is_rigid, edges, distance)
