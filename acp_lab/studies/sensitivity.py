"""Figure 1 of the paper as a computation: how edges depend on the pose, and how on the control points.

The paper says that the gradient of the edges by the six pose parameters does not point along the true motion and that
its size changes from view to view, while the gradient by the eight control coordinates fares better. Here both are
computed, over viewpoints all around the part and for known small motions, for four sets of parameters:

- `pose`: rotation (rad) and shift (mm) of the part about its box centre, camera axes; the units as they come.
- `balanced pose`: the same, rotations measured in mm of arc at the bounding sphere.
- `points, homography`: eight coordinates in px, each moving the edges by the homography of all four (paper IV-C).
- `points, rigid`: the same coordinates, moving the edges as the rigid motion that fits them best.

Edges count along their normals, all that an edge shows of a motion. Every edge point knows its true partner after the
motion; with a real image's false partners everything gets worse, for all four alike.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from acp_lab.cad.edges import EdgeSamples
from acp_lab.cad.part import Part
from acp_lab.cad.raycast import RayCaster
from acp_lab.control_points.coplanar_points import mid_section_points
from acp_lab.control_points.motion_pairs import view_frame, visible_rows
from acp_lab.control_points.view_regions import ALL_REGIONS, choose_region, sphere_directions
from acp_lab.generator.base import image_tangents
from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.camera import Camera
from acp_lab.geometry.homography import homography_points_jacobian
from acp_lab.geometry.pose import transform
from acp_lab.geometry.pose_step import control_point_jacobian, image_directions, move_pose, step_jacobian

POSE_NAMES = ("turn x", "turn y", "turn z", "shift x", "shift y", "shift z")
POINT_NAMES = ("x1", "y1", "x2", "y2", "x3", "y3", "x4", "y4")
ALONE = 6
"""The first so many motions of a view change one pose parameter each; the others turn and shift at once."""
_TILTS = slice(0, 2)
_RANK_LIMIT = 1e-6
_GRADIENT = ("gradient cos", "sign", "tilt")
_COLUMNS = ("parameters", "condition", "spread", "variation", *_GRADIENT, "GN cos", "sign", "tilt")


@dataclass(frozen=True)
class SensitivityConfig:
    """Views and motions.

    Attributes:
        views: viewpoints, spread evenly over the sphere.
        distance: of the eye, in diameters.
        size: side of the virtual image in px, which the part nearly fills.
        points: at most so many edge points per view.
        turn_deg, shift_mm: size of the motions. The first six of a view (`ALONE`) change one pose parameter each,
            by this much; `random_motions` further ones, at least one, turn and shift at once, in random directions.
    """

    views: int = 200
    distance: float = 5.0
    size: int = 512
    points: int = 300
    turn_deg: float = 1.0
    shift_mm: float = 1.0
    random_motions: int = 6


@dataclass(frozen=True, eq=False)
class Behaviour:
    """How one set of p parameters behaves over v views and m motions each.

    Attributes:
        name: of the set.
        parameters: (p,) names.
        sensitivity: (v, p) px, root mean square over the edge points, per unit of each parameter.
        condition: (v,) largest over smallest singular value of the edges' Jacobian, those that are zero by
            construction left out (the rigid points have six of eight).
        truths: (v, m, p) the true change of the parameters.
        gradients: (v, m, p) J^T r, downhill on the squared distance between edges and moved edges.
        steps: (v, m, p) the Gauss-Newton step for the same distances, the shortest that fits best.
    """

    name: str
    parameters: tuple[str, ...]
    sensitivity: FloatArray
    condition: FloatArray
    truths: FloatArray
    gradients: FloatArray
    steps: FloatArray

    @property
    def gradient_cosine(self) -> FloatArray:
        """(v, m) cosine of the angle between gradient and true change; 1 is perfect, below 0 points away."""
        return _cosine(self.gradients, self.truths)

    @property
    def step_cosine(self) -> FloatArray:
        """(v, m) the same for the Gauss-Newton step."""
        return _cosine(self.steps, self.truths)

    @property
    def gradient_signs(self) -> FloatArray:
        """(v, m) share of the parameters that the gradient moves to the right side."""
        return _sign_agreement(self.gradients, self.truths)

    @property
    def step_signs(self) -> FloatArray:
        """(v, m) the same for the Gauss-Newton step."""
        return _sign_agreement(self.steps, self.truths)

    @property
    def spread(self) -> FloatArray:
        """(v,) largest over smallest sensitivity of one view's parameters."""
        return np.asarray(self.sensitivity.max(1) / np.maximum(self.sensitivity.min(1), 1e-12))

    @property
    def variation(self) -> FloatArray:
        """(p,) how much the sensitivity of each parameter changes with the view: 95% over 5% quantile."""
        low, high = np.quantile(self.sensitivity, [0.05, 0.95], axis=0)
        return np.asarray(high / np.maximum(low, 1e-12))


@dataclass(frozen=True, eq=False)
class SensitivityStudy:
    """The four sets of parameters over the same views and motions. Prints as a table.

    Attributes:
        directions_obj: (v, 3) from the box centre to the eye.
        motions: (v, m, 6) rad and mm about the box centre, camera axes.
        sets: the four behaviours.
    """

    directions_obj: FloatArray
    motions: FloatArray
    sets: tuple[Behaviour, ...]

    def __getitem__(self, name: str) -> Behaviour:
        """The set of that name; KeyError for another."""
        for one in self.sets:
            if one.name == name:
                return one
        raise KeyError(f"{name}: one of {', '.join(each.name for each in self.sets)}")

    def __str__(self) -> str:
        table = [_COLUMNS, *(_cells(one) for one in self.sets)]
        widths = [max(len(row[i]) for row in table) for i in range(len(_COLUMNS))]
        lines = ["  ".join(cell.rjust(width) for cell, width in zip(row, widths, strict=True)) for row in table]
        mixed = self.motions.shape[1] - ALONE
        lines.append(
            f"{len(self.directions_obj)} views. condition: median; spread: largest over smallest sensitivity in one "
            "view, median; variation: one sensitivity's 95% over 5% quantile of the views, worst parameter."
        )
        lines.append(
            f"Direction, against the true change: cosine (median) and share of right signs (mean) over {mixed} mixed "
            "motions per view; tilt: cosine for turns about the image's axes alone. GN: Gauss-Newton step."
        )
        return "\n".join(lines)


def sensitivity_study(
    part: Part,
    edges: EdgeSamples,
    caster: RayCaster,
    config: SensitivityConfig = SensitivityConfig(),
    control_points: Mapping[int, FloatArray] | None = None,
    seed: int = 0,
) -> SensitivityStudy:
    """Compute Figure 1 for a part.

    Args:
        edges, caster: of this part.
        control_points: (4, 3) mm W by region 0..5; the mid-sections where not given.

    Raises:
        GeometryError: a W is seen edge-on, or the eye is inside the part.
    """
    rng = np.random.default_rng([seed, 4])
    directions = sphere_directions(config.views, rng.uniform(0.0, 2.0 * np.pi))
    motions = _motions(config, rng)
    views = [
        _study_view(part, edges, caster, config, direction, motion, control_points or {})
        for direction, motion in zip(directions, motions, strict=True)
    ]
    return SensitivityStudy(
        directions, motions, tuple(_stack([view[k] for view in views]) for k in range(len(views[0])))
    )


def _motions(config: SensitivityConfig, rng: np.random.Generator) -> FloatArray:
    """(v, m, 6): each pose parameter alone, then random ones of both kinds."""
    turn = math.radians(config.turn_deg)
    alone = np.diag([turn] * 3 + [config.shift_mm] * 3)
    mixed = rng.standard_normal((config.views, config.random_motions, 2, 3))
    mixed *= np.array([turn, config.shift_mm])[:, None] / np.linalg.norm(mixed, axis=-1, keepdims=True)
    mixed = mixed.reshape(config.views, config.random_motions, 6)
    return np.concatenate([np.broadcast_to(alone, (config.views, 6, 6)), mixed], axis=1)


def _study_view(
    part: Part,
    edges: EdgeSamples,
    caster: RayCaster,
    config: SensitivityConfig,
    direction_obj: FloatArray,
    motions: FloatArray,
    control_points: Mapping[int, FloatArray],
) -> list[Behaviour]:
    """The four behaviours in one view, without the leading axis of views."""
    region = ALL_REGIONS[choose_region(direction_obj, 0.5 * part.box_size)]
    points_obj = control_points.get(region.index)
    if points_obj is None:
        points_obj = mid_section_points(part.box_min, part.box_max, region.axis)
    frame = view_frame(part, region, direction_obj, config.distance * part.diameter, config.shift_mm, config.size)
    camera = Camera.from_matrix(frame.matrix, frame.size, frame.size)
    cam_T_obj = frame.canonical_T_obj
    rows = visible_rows(part, edges, caster, cam_T_obj)[: config.points]
    points_cam = transform(cam_T_obj, edges.points_obj[rows])
    tangents = image_tangents(points_cam, edges.tangents_obj[rows] @ cam_T_obj[:3, :3].T, camera)
    normals = np.stack([-tangents[:, 1], tangents[:, 0]], 1)
    centre_cam = transform(cam_T_obj, part.box_centre)
    here, quad = camera.project(points_cam), camera.project(transform(cam_T_obj, points_obj))

    by_pose = step_jacobian(points_cam, image_directions(points_cam, normals, camera), centre_cam)
    points_by_pose = control_point_jacobian(transform(cam_T_obj, points_obj), centre_cam, camera)
    by_homography = np.einsum("ni,nik->nk", normals, homography_points_jacobian(quad, quad, here))
    by_rigid_points = by_pose @ np.linalg.pinv(points_by_pose)

    moved_poses = [move_pose(cam_T_obj, part.box_centre, motion) for motion in motions]
    residuals = np.stack(
        [((camera.project(transform(pose, edges.points_obj[rows])) - here) * normals).sum(1) for pose in moved_poses]
    )
    quads = np.stack([camera.project(transform(pose, points_obj)) for pose in moved_poses])
    point_changes = (quads - quad).reshape(len(motions), 8)
    arc = np.array([part.radius] * 3 + [1.0] * 3)
    return [
        _behaviour("pose", POSE_NAMES, by_pose, motions, residuals),
        _behaviour("balanced pose", POSE_NAMES, by_pose / arc, motions * arc, residuals),
        _behaviour("points, homography", POINT_NAMES, by_homography, point_changes, residuals),
        _behaviour("points, rigid", POINT_NAMES, by_rigid_points, point_changes, residuals),
    ]


def _behaviour(
    name: str, parameters: tuple[str, ...], jacobian: FloatArray, truths: FloatArray, residuals: FloatArray
) -> Behaviour:
    """One view: jacobian (n, p), truths (m, p), residuals (m, n)."""
    values = np.linalg.svd(jacobian, compute_uv=False)
    values = values[values > _RANK_LIMIT * values[0]]
    return Behaviour(
        name,
        parameters,
        sensitivity=np.sqrt((jacobian**2).mean(0)),
        condition=np.array(values[0] / values[-1]),
        truths=truths,
        gradients=residuals @ jacobian,
        steps=residuals @ np.linalg.pinv(jacobian, rcond=_RANK_LIMIT).T,
    )


def _stack(views: list[Behaviour]) -> Behaviour:
    fields = ("sensitivity", "condition", "truths", "gradients", "steps")
    return Behaviour(
        views[0].name, views[0].parameters, *(np.stack([getattr(view, key) for view in views]) for key in fields)
    )


def _cosine(found: FloatArray, truth: FloatArray) -> FloatArray:
    length = np.linalg.norm(found, axis=-1) * np.linalg.norm(truth, axis=-1)
    return np.asarray((found * truth).sum(-1) / np.maximum(length, 1e-300))


def _sign_agreement(found: FloatArray, truth: FloatArray) -> FloatArray:
    """Parameters that hardly change (below a thousandth of the largest) have no side to be on."""
    moves = np.abs(truth) > 1e-3 * np.abs(truth).max(-1, keepdims=True)
    right = (np.sign(found) == np.sign(truth)) & moves
    return np.asarray(right.sum(-1) / moves.sum(-1))


def _cells(one: Behaviour) -> tuple[str, ...]:
    mixed = slice(ALONE, None)
    return (
        one.name,
        f"{np.median(one.condition):.3g}",
        f"{np.median(one.spread):.3g}",
        f"{one.variation.max():.3g}",
        f"{np.median(one.gradient_cosine[:, mixed]):.2f}",
        f"{one.gradient_signs[:, mixed].mean():.2f}",
        f"{np.median(one.gradient_cosine[:, _TILTS]):.2f}",
        f"{np.median(one.step_cosine[:, mixed]):.2f}",
        f"{one.step_signs[:, mixed].mean():.2f}",
        f"{np.median(one.step_cosine[:, _TILTS]):.2f}",
    )
