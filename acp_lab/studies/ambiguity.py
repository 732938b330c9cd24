"""Figure 7b of the paper as a search: opposite poses whose outer contours agree.

The paper blames failures of contour and region trackers on views "whose outer contours are extremely similar but the
poses are opposite". Here all views around the part are compared, each with each: contours by their radial profiles,
over all rotations in the image at once, then the best pairs by their distance after alignment. Pairs whose
rotations differ by no more than 90 degrees, up to symmetries of the part, are no ambiguity. (Rotations, not
directions of view: a plate seen flat and the same plate rolled by 180 degrees are opposite poses, too.)

What inner edges add to a pair is measured in `distinction`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import trimesh
from scipy.optimize import minimize

from acp_lab.cad.edges import EdgeSamples
from acp_lab.cad.part import Part
from acp_lab.cad.raycast import RayCaster
from acp_lab.control_points.motion_pairs import view_frame, visible_rows
from acp_lab.control_points.view_regions import ALL_REGIONS, choose_region
from acp_lab.evaluation.metrics import rotation_error_deg
from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.camera import Camera
from acp_lab.geometry.pose import transform
from acp_lab.geometry.pose_step import move_pose
from acp_lab.imaging.chamfer import chamfer
from acp_lab.studies.silhouettes import (
    PROFILE_BINS,
    align_contours,
    contour_distance,
    outer_contour,
    profile_distances,
    radial_profile,
)

_SEARCH_SIZE = 96
_FINAL_SIZE = 256
# Contour points closer than a pixel: their spacing must not count as distance.
_FINAL_POINTS = 1024
_SAME_VIEW_DEG = 20.0
_REFINE_STEP_DEG = 3.0


@dataclass(frozen=True)
class AmbiguityConfig:
    """Settings of the search.

    Attributes:
        subdivisions: of the icosphere of views: 2 gives 162, 3 gives 642.
        distance: of the eye, in diameters.
        least_turn_deg: rotations that differ by less are not called opposite.
        pairs: how many pairs are returned; two whose views are within 20 degrees count as one.
        refine_steps: evaluations spent on moving the second pose of each pair until the contours fit best.
    """

    subdivisions: int = 3
    distance: float = 5.0
    least_turn_deg: float = 90.0
    pairs: int = 8
    refine_steps: int = 150


@dataclass(frozen=True, eq=False)
class AmbiguousPair:
    """Two poses with nearly the same outer contour.

    Attributes:
        first_T_obj, second_T_obj: (4, 4) cam_T_obj, mm, for the camera of the search.
        turn_deg: angle between their rotations, the smallest over the part's symmetries.
        outline_share: distance of their outer contours (both ways) as share of the diameter.
        edges_share: distance of all their visible edges (both ways) as share of the diameter. What it has beyond
            `outline_share` is what inner edges add.
    """

    first_T_obj: FloatArray
    second_T_obj: FloatArray
    turn_deg: float
    outline_share: float
    edges_share: float


@dataclass(frozen=True, eq=False)
class Ambiguities:
    """The pairs found, closest contours first, and the virtual camera that sees them. Prints as a table."""

    camera: Camera
    pairs: tuple[AmbiguousPair, ...]

    def __str__(self) -> str:
        lines = ["pair  turn deg  outline % of diameter  all edges % of diameter"]
        lines += [
            f"{rank:4d}  {pair.turn_deg:8.0f}  {100.0 * pair.outline_share:21.2f}  {100.0 * pair.edges_share:23.2f}"
            for rank, pair in enumerate(self.pairs)
        ]
        return "\n".join(lines)


def find_ambiguities(
    part: Part, edges: EdgeSamples, caster: RayCaster, config: AmbiguityConfig = AmbiguityConfig()
) -> Ambiguities:
    """Search all pairs of views for opposite poses with the same outer contour.

    Args:
        edges, caster: of this part, whose symmetries are accounted for.

    Raises:
        GeometryError: the eye is inside the part.
    """
    directions = np.asarray(trimesh.creation.icosphere(subdivisions=config.subdivisions).vertices)
    poses = np.stack([_pose_seen_from(part, direction, config.distance) for direction in directions])
    camera, final_camera = (_camera(part, config.distance, size) for size in (_SEARCH_SIZE, _FINAL_SIZE))
    contours = [outer_contour(part, caster, camera, pose) for pose in poses]
    profiles = np.stack([radial_profile(contour) for contour in contours])
    candidates = _candidates(part, poses, profiles, config.least_turn_deg)

    found: list[AmbiguousPair] = []
    taken: list[tuple[int, int]] = []
    for first, second, turn_bins in candidates:
        if len(found) >= config.pairs:
            break
        if any(_same_pair(directions, (first, second), pair) for pair in taken):
            continue
        taken.append((first, second))
        alignment = align_contours(contours[second], contours[first], turn_bins)
        guess = alignment.of_pose(poses[second], part.box_centre, camera)
        second_T_obj = _refine(part, caster, camera, contours[first], guess, config.refine_steps)
        turn_deg = rotation_error_deg(second_T_obj, poses[first], part.symmetries)
        if turn_deg >= config.least_turn_deg:
            found.append(_judge(part, edges, caster, final_camera, poses[first], second_T_obj, turn_deg))
    return Ambiguities(final_camera, tuple(sorted(found, key=lambda pair: pair.outline_share)))


def _pose_seen_from(part: Part, direction_obj: FloatArray, distance: float) -> FloatArray:
    region = ALL_REGIONS[choose_region(direction_obj, 0.5 * part.box_size)]
    return view_frame(part, region, direction_obj, distance * part.diameter, 0.0, _SEARCH_SIZE).canonical_T_obj


def _camera(part: Part, distance: float, size: int) -> Camera:
    """One camera for all views: the bounding sphere is equally large from everywhere. Room for shifts."""
    frame = view_frame(part, ALL_REGIONS[0], np.eye(3)[0], distance * part.diameter, 0.1 * part.radius, size)
    return Camera.from_matrix(frame.matrix, size, size)


def _candidates(
    part: Part, poses: FloatArray, profiles: FloatArray, least_turn_deg: float
) -> list[tuple[int, int, int]]:
    """(first view, second view, turn in bins) of the most similar opposite pairs, best first."""
    rolls = 2.0 * np.pi / PROFILE_BINS * np.arange(PROFILE_BINS)
    largest_trace = 1.0 + 2.0 * np.cos(np.radians(least_turn_deg))
    scores = np.empty((len(poses), len(poses)))
    turns = np.empty((len(poses), len(poses)), int)
    symmetric = [transform_[:3, :3] for transform_ in part.symmetries.transforms()]
    rotations = poses[:, :3, :3]
    for first in range(len(poses)):
        distances = profile_distances(profiles[first], profiles)
        for turn in symmetric:
            between = rotations @ (rotations[first] @ turn).T
            # Trace of roll times `between`, for all rolls.
            inside = between[:, 0, 0] + between[:, 1, 1]
            across = between[:, 0, 1] - between[:, 1, 0]
            trace = inside[:, None] * np.cos(rolls) + across[:, None] * np.sin(rolls) + between[:, 2, 2, None]
            distances = np.where(trace > largest_trace, np.inf, distances)
        turns[first] = distances.argmin(1)
        scores[first] = distances.min(1)
    scores[np.tril_indices(len(poses), -1)] = np.inf
    order = np.argsort(scores, axis=None, kind="stable")
    order = order[np.isfinite(scores.ravel()[order])]
    pairs = np.stack(np.unravel_index(order, scores.shape), 1)
    return [(int(a), int(b), int(turns[a, b])) for a, b in pairs]


def _same_pair(directions: FloatArray, one: tuple[int, int], other: tuple[int, int]) -> bool:
    near = np.cos(np.radians(_SAME_VIEW_DEG))
    (a, b), (c, d) = directions[list(one)], directions[list(other)]
    return bool((a @ c > near and b @ d > near) or (a @ d > near and b @ c > near))


def _refine(
    part: Part, caster: RayCaster, camera: Camera, target: FloatArray, start_T_obj: FloatArray, evaluations: int
) -> FloatArray:
    """The pose near `start_T_obj` whose outer contour is closest to `target` (n, 2) px, by Nelder-Mead."""
    turn = np.radians(_REFINE_STEP_DEG)
    unit = np.array([turn] * 3 + [turn * part.radius] * 2 + [3.0 * turn * part.radius])

    def apart(step: FloatArray) -> float:
        moved = move_pose(start_T_obj, part.box_centre, unit * step)
        return contour_distance(outer_contour(part, caster, camera, moved), target)

    simplex = np.vstack([np.zeros(6), np.eye(6)])
    options = {"maxfev": max(evaluations, 1), "initial_simplex": simplex, "xatol": 1e-2, "fatol": 1e-3}
    best = minimize(apart, np.zeros(6), method="Nelder-Mead", options=options)
    return move_pose(start_T_obj, part.box_centre, unit * best.x)


def _judge(
    part: Part,
    edges: EdgeSamples,
    caster: RayCaster,
    camera: Camera,
    first_T_obj: FloatArray,
    second_T_obj: FloatArray,
    turn_deg: float,
) -> AmbiguousPair:
    px_per_diameter = camera.fx * part.diameter / float(transform(first_T_obj, part.box_centre)[2])
    contours = [outer_contour(part, caster, camera, pose, _FINAL_POINTS) for pose in (first_T_obj, second_T_obj)]
    points = [
        camera.project(transform(pose, edges.points_obj[visible_rows(part, edges, caster, pose)]))
        for pose in (first_T_obj, second_T_obj)
    ]
    return AmbiguousPair(
        first_T_obj,
        second_T_obj,
        turn_deg,
        contour_distance(*contours) / px_per_diameter,
        chamfer(*points).symmetric / px_per_diameter,
    )
