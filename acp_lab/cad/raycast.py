"""Asking a mesh where rays hit it: which face, how far, and whether anything stands in between.

Rays are given in the object frame: the search tree is built there once, and it is the camera's rays that
move. A distance counts lengths of the ray's direction: the hit lies at `origin + distance * direction`. So
for camera rays with z = 1 the distance is the depth. Faces are seen from both sides.

`EmbreeCaster` (Intel Embree through embreex) works in float32: a depth at 300 mm is good to about half a
micrometre. `BruteForceCaster` is its float64 NumPy twin, without any tree: every face is tried for every
ray. It is the last resort on machines without embreex, and the check in the tests.
"""

from __future__ import annotations

import warnings
from typing import Protocol
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import ArrayLike

from acp_lab.cad.part import Part
from acp_lab.cad.zbuffer import rasterise
from acp_lab.geometry.arrays import BoolArray, FloatArray, IntArray
from acp_lab.geometry.camera import Camera
from acp_lab.geometry.pose import inverse, transform

_FAR = 1e37
"""Embree's own "no hit" in embreex: infinity is kept out of its arithmetic."""


class RayCaster(Protocol):
    """Ray queries against one mesh.

    Origins and directions are (n, 3) in the object frame, mm; directions of any length but 0.
    """

    def first_hit(self, origins: ArrayLike, directions: ArrayLike) -> tuple[FloatArray, IntArray]:
        """Nearest hit of each ray: distance (n,), inf when none, and face (n,), -1 when none."""
        ...

    def occluded(self, origins: ArrayLike, directions: ArrayLike, max_distance: ArrayLike) -> BoolArray:
        """Whether anything is hit nearer than max_distance, which is (n,) or one number: (n,) bool.

        Any hit will do, which makes it cheaper than `first_hit`.
        """
        ...


class EmbreeCaster:
    """Embree's bounding-volume hierarchy over vertices (n, 3) mm and faces (m, 3): about 0.15 µs per ray."""

    def __init__(self, vertices: ArrayLike, faces: ArrayLike) -> None:
        from embreex.mesh_construction import TriangleMesh
        from embreex.rtcore_scene import EmbreeScene

        points = np.asarray(vertices, dtype=np.float64)
        # float32 is finest near zero: the box centre goes there, wherever the CAD file has its origin.
        self._centre = 0.5 * (points.min(axis=0) + points.max(axis=0))
        # Robust: a ray through the edge of two faces must not slip between them.
        self._scene = EmbreeScene(robust=True)
        points32 = (points - self._centre).astype(np.float32)
        TriangleMesh(self._scene, points32, np.asarray(faces, dtype=np.int32))

    def first_hit(self, origins: ArrayLike, directions: ArrayLike) -> tuple[FloatArray, IntArray]:
        """See `RayCaster`."""
        start, way = _rays(origins, directions, self._centre, np.float32)
        if len(start) == 0:
            return np.zeros(0), np.zeros(0, dtype=np.int64)
        hits = self._scene.run(start, way, query="INTERSECT", output=True)
        face = hits["primID"].astype(np.int64)
        return np.where(face >= 0, hits["tfar"].astype(np.float64), np.inf), face

    def occluded(self, origins: ArrayLike, directions: ArrayLike, max_distance: ArrayLike) -> BoolArray:
        """See `RayCaster`."""
        start, way = _rays(origins, directions, self._centre, np.float32)
        if len(start) == 0:
            return np.zeros(0, dtype=bool)
        # Embree marks an occluded ray by a negative length: a ray that begins with one would look occluded.
        limit, clipped = np.asarray(max_distance, dtype=np.float64), np.empty(len(start), np.float32)
        clipped[:] = limit.clip(0.0, _FAR)
        return (self._scene.run(start, way, clipped, query="OCCLUDED") != -1) & (limit > 0.0)


class BruteForceCaster:
    """Every ray against every face in float64 (Möller and Trumbore 1997): about 0.07 µs per ray and face."""

    def __init__(self, vertices: ArrayLike, faces: ArrayLike) -> None:
        corners = np.asarray(vertices, dtype=np.float64)[np.asarray(faces)]
        self._corner = corners[:, 0]
        self._edge1 = corners[:, 1] - corners[:, 0]
        self._edge2 = corners[:, 2] - corners[:, 0]
        self._rays_per_chunk = max(1, 200_000 // max(1, len(corners)))

    def first_hit(self, origins: ArrayLike, directions: ArrayLike) -> tuple[FloatArray, IntArray]:
        """See `RayCaster`."""
        start, way = _rays(origins, directions, np.zeros(3), np.float64)
        distance = np.full(len(start), np.inf)
        face = np.full(len(start), -1, dtype=np.int64)
        for first in range(0, len(start), self._rays_per_chunk):
            chunk = slice(first, first + self._rays_per_chunk)
            distances = self._distances(start[chunk], way[chunk])
            nearest = distances.argmin(axis=1)
            distance[chunk] = distances[np.arange(len(nearest)), nearest]
            face[chunk] = np.where(np.isfinite(distance[chunk]), nearest, -1)
        return distance, face

    def occluded(self, origins: ArrayLike, directions: ArrayLike, max_distance: ArrayLike) -> BoolArray:
        """See `RayCaster`."""
        distance, _ = self.first_hit(origins, directions)
        return distance < np.asarray(max_distance, dtype=np.float64)

    def _distances(self, start: FloatArray, way: FloatArray) -> FloatArray:
        """Of r rays, (r, 3) each, to all m faces: (r, m), inf where the ray misses the face."""
        p = np.cross(way[:, None], self._edge2)
        to_start = start[:, None] - self._corner
        q = np.cross(to_start, self._edge1)
        with np.errstate(divide="ignore", invalid="ignore"):  # a ray in the plane of a face misses it
            scale = 1.0 / np.einsum("rmk,mk->rm", p, self._edge1)
            u = np.einsum("rmk,rmk->rm", to_start, p) * scale
            v = np.einsum("rk,rmk->rm", way, q) * scale
            distance = np.einsum("rmk,mk->rm", q, self._edge2) * scale
            # A small tolerance: a ray through the edge of two faces must not slip between them.
            inside = (u >= -1e-9) & (v >= -1e-9) & (u + v <= 1.0 + 1e-9) & (distance >= 0.0)
        return np.where(inside, distance, np.inf)


def make_caster(part: Part) -> RayCaster:
    """An EmbreeCaster for the part or, with a RuntimeWarning, the NumPy twin where embreex does not load."""
    try:
        return EmbreeCaster(part.vertices, part.faces)
    except (ImportError, OSError) as error:
        message = f"embreex does not load ({error}): rays are cast in NumPy, hundreds of times slower"
        warnings.warn(message, RuntimeWarning, stacklevel=2)
        return BruteForceCaster(part.vertices, part.faces)


_casters: WeakKeyDictionary[Part, RayCaster] = WeakKeyDictionary()


def caster_of(part: Part) -> RayCaster:
    """The one caster of a part, as of `make_caster`, made when it is first asked for: that takes milliseconds."""
    if part not in _casters:
        _casters[part] = make_caster(part)
    return _casters[part]


def depth_map(part: Part, caster: RayCaster, camera: Camera, cam_T_obj: FloatArray) -> FloatArray:
    """Depth (camera z, mm) at the pixel centres: (h, w), 0 where the part is not. See `hit_map`."""
    depth, _ = hit_map(part, caster, camera, cam_T_obj)
    return depth


def normal_map(part: Part, caster: RayCaster, camera: Camera, cam_T_obj: FloatArray) -> FloatArray:
    """Unit normals at the pixel centres: (h, w, 3), camera frame, facing the camera; 0 where no part is."""
    _, face = hit_map(part, caster, camera, cam_T_obj)
    normals = np.zeros((*face.shape, 3))
    rows, columns = np.nonzero(face >= 0)
    seen = part.face_normals[face[rows, columns]] @ cam_T_obj[:3, :3].T
    rays_cam = camera.rays(np.column_stack([columns, rows]))
    # Only an open or badly wound mesh shows the inside of a face.
    seen[np.einsum("ij,ij->i", seen, rays_cam) > 0.0] *= -1.0
    normals[rows, columns] = seen
    return normals


def hit_map(part: Part, caster: RayCaster, camera: Camera, cam_T_obj: FloatArray) -> tuple[FloatArray, IntArray]:
    """What each pixel sees: depth (h, w) in mm, 0 where nothing, and face (h, w), -1 where nothing.

    caster: of this part. camera: its pinhole part alone counts. cam_T_obj: (4, 4). Pixel (0, 0) is the
    centre of the top-left pixel, so the ray of pixel (u, v) is ((u - cx) / fx, (v - cy) / fy, 1), with no
    half pixel anywhere. In place of a BruteForceCaster the z-buffer answers: the same map, some hundred
    times sooner.
    """
    if isinstance(caster, BruteForceCaster):
        return rasterise(transform(cam_T_obj, part.vertices), part.faces, camera)
    depth = np.zeros((camera.height, camera.width))
    face = np.full((camera.height, camera.width), -1, dtype=np.int64)
    window = _window(part, camera, cam_T_obj)
    v, u = np.mgrid[window]
    rays_cam = camera.rays(np.column_stack([u.ravel(), v.ravel()]))
    obj_T_cam = inverse(cam_T_obj)
    origins = np.broadcast_to(obj_T_cam[:3, 3], rays_cam.shape)
    distance, hit = caster.first_hit(origins, rays_cam @ obj_T_cam[:3, :3].T)
    depth[window] = np.where(hit >= 0, distance, 0.0).reshape(u.shape)
    face[window] = hit.reshape(u.shape)
    return depth, face


def _window(part: Part, camera: Camera, cam_T_obj: FloatArray) -> tuple[slice, slice]:
    """Rows and columns that hold the part's projected box; all of them if it reaches behind the camera."""
    corners_obj = np.array(np.meshgrid(*np.stack([part.box_min, part.box_max], axis=1))).reshape(3, -1).T
    corners_cam = transform(cam_T_obj, corners_obj)
    if corners_cam[:, 2].min() <= 1e-3 * part.diameter:
        return slice(0, camera.height), slice(0, camera.width)
    pixels = camera.project(corners_cam)
    size = (camera.width, camera.height)
    left, top = np.clip(np.floor(pixels.min(axis=0)), 0, size).astype(int)
    right, bottom = np.clip(np.ceil(pixels.max(axis=0)) + 1, 0, size).astype(int)
    return slice(int(top), int(bottom)), slice(int(left), int(right))


def _rays(
    origins: ArrayLike, directions: ArrayLike, centre: FloatArray, dtype: type[np.floating]
) -> tuple[np.ndarray, np.ndarray]:
    start = np.asarray(origins, dtype=np.float64)
    way = np.asarray(directions, dtype=dtype)
    if way.ndim != 2 or way.shape[1] != 3 or start.shape != way.shape:
        raise ValueError(f"origins {start.shape} and directions {way.shape} must both be (n, 3)")
    return (start - centre).astype(dtype), way
