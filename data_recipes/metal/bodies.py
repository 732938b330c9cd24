"""Meshes ready for shading: smooth corner normals, a ray caster, a material per face, and a pose in the world.

Convention: world frame with z up and the table at z = 0, mm; `world_T_body` takes body to world coordinates.
Rays are moved into the body's frame, so the search tree is built once per body and never per frame.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from acp_lab.cad.raycast import EmbreeCaster
from acp_lab.geometry.pose import transform
from data_recipes.metal.edge_break import face_normals

_SMOOTH_DEG = 30.0
_WIDE_MM = 300.0  # bodies wider than this are asked with every ray


def corner_normals(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Shading normals (m, 3 corners, 3): smooth over curved faces, sharp at creases, exact on large planes.

    At each vertex the faces are gathered into planes; a plane's normal is averaged with its neighbours' within 30
    degrees, weighted by the planes' whole areas. So a big plane keeps its normal right up to the fillet that
    joins it, and a hole of 64 facets reflects like a round one.
    """
    normals = face_normals(vertices, faces)
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    area = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)
    plane = _planes(faces, normals, len(vertices))
    plane_area = np.bincount(plane, area)
    plane_normal = np.stack([np.bincount(plane, area * normals[:, k]) for k in range(3)], 1)
    plane_normal = plane_normal / np.maximum(np.linalg.norm(plane_normal, axis=1, keepdims=True), 1e-12)

    corner = faces.ravel().astype(np.int64) * (plane.max() + 1) + np.repeat(plane, 3)
    pairs, of_corner = np.unique(corner, return_inverse=True)
    vertex, at_plane = np.divmod(pairs, plane.max() + 1)
    start = np.searchsorted(vertex, vertex, side="left")
    count = np.searchsorted(vertex, vertex, side="right") - start
    smooth = np.zeros((len(pairs), 3))
    limit = np.cos(np.deg2rad(_SMOOTH_DEG))
    for k in range(int(count.max())):
        other = at_plane[np.minimum(start + k, len(pairs) - 1)]
        near = np.einsum("ij,ij->i", plane_normal[at_plane], plane_normal[other]) > limit
        weight = np.where((k < count) & near, plane_area[other], 0.0)
        smooth += weight[:, None] * plane_normal[other]
    smooth /= np.maximum(np.linalg.norm(smooth, axis=1, keepdims=True), 1e-12)
    per_corner: np.ndarray = smooth[of_corner.ravel()].reshape(-1, 3, 3)
    return per_corner


def _planes(faces: np.ndarray, normals: np.ndarray, n_vertices: int) -> np.ndarray:
    """Label (m,) of the plane that each face belongs to: neighbours whose normals agree to half a degree."""
    half = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    owner = np.tile(np.arange(len(faces)), 3)
    order = np.argsort(np.sort(half, axis=1) @ np.array([n_vertices, 1]), kind="stable")
    first, second = owner[order[0::2]], owner[order[1::2]]  # watertight: every edge has exactly two halves
    flat = np.einsum("ij,ij->i", normals[first], normals[second]) > np.cos(np.deg2rad(0.5))
    graph = coo_matrix((np.ones(flat.sum()), (first[flat], second[flat])), shape=(len(faces),) * 2)
    labels: np.ndarray = connected_components(graph, directed=False)[1]
    return labels


@dataclass(frozen=True, eq=False)
class Body:
    """A rigid mesh: vertices (n, 3) mm, faces (m, 3), material index per face (m,) into the scene's materials."""

    name: str
    vertices: np.ndarray
    faces: np.ndarray
    material: np.ndarray
    lay_frame: np.ndarray | None = None  # (m, 3, 3) body-to-item rotation per face, None for identity

    @cached_property
    def caster(self) -> EmbreeCaster:
        """Ray caster in the body's own frame."""
        return EmbreeCaster(self.vertices, self.faces)

    @cached_property
    def normals(self) -> np.ndarray:
        """Face normals (m, 3)."""
        return face_normals(self.vertices, self.faces)

    @cached_property
    def corners(self) -> np.ndarray:
        """Corner normals (m, 3, 3)."""
        return corner_normals(self.vertices, self.faces)

    @cached_property
    def middle(self) -> np.ndarray:
        """Centre (3,) of the bounding box, body frame, mm."""
        return np.asarray((self.vertices.min(0) + self.vertices.max(0)) / 2)

    @cached_property
    def radius(self) -> float:
        """Radius of the bounding sphere about `middle`, mm."""
        return float(np.linalg.norm(self.vertices - self.middle, axis=1).max())

    def shading_normals(self, points: np.ndarray, face: np.ndarray, towards: np.ndarray) -> np.ndarray:
        """Interpolated unit normals (n, 3) at points (n, 3) on the given faces, never facing away from `towards`."""
        a, b, c = (self.vertices[self.faces[face, k]] for k in range(3))
        e0, e1, d = b - a, c - a, points - a
        d00, d01, d11 = (np.einsum("ij,ij->i", u, v) for u, v in ((e0, e0), (e0, e1), (e1, e1)))
        d20, d21 = np.einsum("ij,ij->i", d, e0), np.einsum("ij,ij->i", d, e1)
        scale = 1.0 / np.maximum(d00 * d11 - d01 * d01, 1e-12)
        v = np.clip((d11 * d20 - d01 * d21) * scale, 0, 1)
        w = np.clip((d00 * d21 - d01 * d20) * scale, 0, 1)
        corner = self.corners[face]
        normal = corner[:, 0] * (1 - v - w)[:, None] + corner[:, 1] * v[:, None] + corner[:, 2] * w[:, None]
        normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-9)
        away = np.einsum("ij,ij->i", normal, towards) < 0.02
        normal[away] = self.normals[face[away]]
        return normal


@dataclass(frozen=True, eq=False)
class Placed:
    """A body at a pose in the world."""

    body: Body
    world_T_body: np.ndarray

    @cached_property
    def middle(self) -> np.ndarray:
        """Centre (3,) of the bounding sphere in the world, mm."""
        return transform(self.world_T_body, self.body.middle[None])[0]

    def first_hit(self, origins: np.ndarray, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Distance (n,), inf when none, and face (n,), -1 when none, for world rays (n, 3)."""
        return self.body.caster.first_hit(*self._local(origins, directions))

    def occluded(self, origins: np.ndarray, directions: np.ndarray, reach: np.ndarray | float) -> np.ndarray:
        """Whether the body stands within `reach` (multiples of the direction's length) of each world ray."""
        return self.body.caster.occluded(*self._local(origins, directions), reach)

    def _local(self, origins: np.ndarray, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """World rays in the body's frame."""
        rotation, shift = self.world_T_body[:3, :3], self.world_T_body[:3, 3]
        if np.array_equal(self.world_T_body, np.eye(4)):
            return origins, directions
        if len(origins) and origins.strides[0] == 0:  # one eye for all rays
            return np.broadcast_to((origins[0] - shift) @ rotation, origins.shape), directions @ rotation
        return (origins - shift) @ rotation, directions @ rotation

    def candidates(self, origins: np.ndarray, directions: np.ndarray, reach: np.ndarray | float) -> np.ndarray:
        """Indices of the world rays that pass the body's bounding sphere; saves most rays their tree search."""
        if self.body.radius > _WIDE_MM:
            return np.arange(len(origins))
        to_centre = self.middle - origins
        square = np.einsum("ij,ij->i", directions, directions)
        s = np.clip(np.einsum("ij,ij->i", to_centre, directions) / square, 0.0, reach)
        to_centre -= s[:, None] * directions
        return np.flatnonzero(np.einsum("ij,ij->i", to_centre, to_centre) <= self.body.radius**2)


def any_occluded(
    placed: tuple[Placed, ...], origins: np.ndarray, directions: np.ndarray, reach: np.ndarray | float
) -> np.ndarray:
    """Whether any of the bodies stands within `reach` of each world ray: (n,) bool."""
    hidden = np.zeros(len(origins), bool)
    for item in placed:
        ask = item.candidates(origins, directions, reach)
        hidden[ask] |= item.occluded(origins[ask], directions[ask], reach)
    return hidden
