"""Arranging the scene: how a part rests on the bench, the clutter around it, its holder, its occluder."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from acp_lab.cad.raycast import EmbreeCaster
from acp_lab.geometry.pose import ROTATION_TOLERANCE, make_pose
from data_recipes.metal import clutter, surfaces
from data_recipes.metal.bodies import Body
from data_recipes.metal.cad_parts import CadPart
from data_recipes.metal.edge_break import break_edges
from data_recipes.metal.solids import mesh_arrays, rod

_BENCH_HALF_MM = 290.0


@dataclass
class Stock:
    """The scene's materials in the order of their index; `take` adds one."""

    materials: list[surfaces.Material] = field(default_factory=list)

    def take(self, material: surfaces.Material) -> int:
        """Index of the material, added if it is new."""
        if material not in self.materials:
            self.materials.append(material)
        return self.materials.index(material)


def stable_poses(vertices: np.ndarray, faces: np.ndarray) -> list[np.ndarray]:
    """Rotations (3, 3) in which the mesh can stand on a table, the steadiest first.

    A face of the convex hull can be stood on when the centre of mass lies above it; steadier means a larger
    face and a lower centre.
    """
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    volume = np.einsum("ij,ij->i", a, np.cross(b, c))
    mass = ((a + b + c) / 4 * volume[:, None]).sum(0) / volume.sum()
    hull = ConvexHull(vertices)
    planes, face_of = np.unique(np.round(hull.equations, 3), axis=0, return_inverse=True)
    found = []
    for k, plane in enumerate(planes):
        triangles = vertices[hull.simplices[face_of.ravel() == k]]
        foot = mass - (plane[:3] @ mass + plane[3]) * plane[:3]
        doubled = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
        signs = np.stack(
            [
                np.cross(triangles[:, (j + 1) % 3] - triangles[:, j], foot - triangles[:, j]) @ plane[:3]
                for j in range(3)
            ]
        )
        inside = ((signs >= -1e-6).all(0) | (signs <= 1e-6).all(0)) & (np.linalg.norm(doubled, axis=1) > 1e-9)
        if inside.any():
            height = max(-float(plane[:3] @ mass + plane[3]), 1e-3)
            found.append((float(np.linalg.norm(doubled, axis=1).sum()) / height**2, plane[:3]))
    found.sort(key=lambda item: -item[0])
    return [_turn_down(normal) for steady, normal in found if steady > 0.2 * found[0][0]]


def _turn_down(normal: np.ndarray) -> np.ndarray:
    """Rotation (3, 3) that takes a unit direction to -z.

    Directions come rounded to 1e-3. One that would make a matrix that readers of poses refuse is made exact; the others
    are left as they are, so that every seed keeps its truth.
    """
    if abs(normal @ normal - 1.0) > ROTATION_TOLERANCE:
        normal = normal / np.linalg.norm(normal)
    x = np.cross(normal, [0.0, 1.0, 0.0] if abs(normal[1]) < 0.9 else [1.0, 0.0, 0.0])
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(-normal, x), -normal])


def resting_rotation(
    rng: np.random.Generator, vertices: np.ndarray, faces: np.ndarray, choices: int = 3, pick: int | None = None
) -> np.ndarray:
    """world_R_part (3, 3) of a steady pose on the table (number `pick`, if given), turned at random about z."""
    poses = stable_poses(vertices, faces)[:choices]
    chosen = int(rng.integers(max(len(poses), 1)))
    lie = poses[chosen if pick is None else min(pick, len(poses) - 1)] if poses else np.eye(3)
    turn = Rotation.from_rotvec([0, 0, rng.uniform(0, 2 * np.pi)]).as_matrix()
    return np.asarray(turn @ lie)


def on_table(world_R_item: np.ndarray, vertices: np.ndarray, xy: tuple[float, float]) -> np.ndarray:
    """world_T_item (4, 4) with its lowest vertex on z = 0."""
    lowest = float((vertices @ world_R_item[2]).min())
    return make_pose(world_R_item, np.array([xy[0], xy[1], -lowest]))


def _clutter_material(rng: np.random.Generator) -> surfaces.Material:
    if rng.random() < 0.16:
        colour = np.clip(rng.uniform(0.03, 0.6, 3), 0, 1)
        return surfaces.paint((float(colour[0]), float(colour[1]), float(colour[2])))
    name = ("steel", "aluminium", "dark steel", "brass", "steel", "aluminium")[int(rng.integers(6))]
    finish: surfaces.Finish = ("milled", "brushed", "turned", "cast")[int(rng.integers(4))]  # type: ignore[assignment]
    return surfaces.metal(name, finish, float(np.round(rng.uniform(0.7, 1.4), 2)))


@dataclass(frozen=True, eq=False)
class Lying:
    """Something on the bench: vertices (n, 3) mm in the world, faces (m, 3), its material and world_T_item (4, 4)."""

    vertices: np.ndarray
    faces: np.ndarray
    material_index: int
    world_T_item: np.ndarray

    @property
    def spot(self) -> tuple[np.ndarray, float]:
        """Centre (2,) and radius of a circle about it on the bench, mm."""
        low, high = self.vertices[:, :2].min(0), self.vertices[:, :2].max(0)
        centre = (low + high) / 2
        return centre, float(np.linalg.norm(self.vertices[:, :2] - centre, axis=1).max())


def look_alikes(
    rng: np.random.Generator, mesh: tuple[np.ndarray, np.ndarray], world_R_part: np.ndarray, count: int, alone: bool
) -> list[Lying]:
    """More parts like the tracked one, of the same material (index 0), side by side around the origin.

    In every other scene they are sorted, all turned like the tracked one, else they lie as they fell. mesh: vertices
    and faces of the part. world_R_part (3, 3): how that lies on the bench, at the origin, unless they are `alone`.
    """
    vertices, faces = mesh
    there: list[np.ndarray] = [] if alone else [(vertices @ world_R_part.T)[:, :2]]
    sorted_in_rows, placed = rng.random() < 0.5, []
    for _ in range(count):
        turned = world_R_part if sorted_in_rows else resting_rotation(rng, vertices, faces)
        flat = vertices @ turned.T
        angle, gap_mm = rng.uniform(0, 2 * np.pi), rng.uniform(3.0, 12.0)
        way = np.array([np.cos(angle), np.sin(angle)])
        far_mm = 0.0
        while any(not _apart(flat[:, :2] + far_mm * way, other, gap_mm) for other in there):
            far_mm += 3.0
        there.append(flat[:, :2] + far_mm * way)
        x, y = far_mm * way
        pose = on_table(turned, vertices, (x, y))
        placed.append(Lying(flat + pose[:3, 3], faces, 0, pose))
    return placed


def _apart(a: np.ndarray, b: np.ndarray, gap_mm: float) -> bool:
    """Whether the convex hulls of points (n, 2) and (m, 2) leave a gap: a side of one has all of the other beyond."""
    for one, other in ((a, b), (b, a)):
        hull = ConvexHull(one)
        if (other @ hull.equations[:, :2].T + hull.equations[:, 2]).min(axis=0).max() >= gap_mm:
            return True
    return False


def bench(
    rng: np.random.Generator,
    stock: Stock,
    count: int,
    free_mm: float,
    avoid: str,
    break_mm: float,
    lying: Sequence[Lying] = (),
) -> Body:
    """All clutter and what is `lying` there, one body in world coordinates; no clutter within free_mm of the origin."""
    taken: list[tuple[np.ndarray, float]] = [(np.zeros(2), free_mm)] if free_mm > 0 else []
    taken += [item.spot for item in lying]
    meshes = [(item.vertices, item.faces, item.material_index, item.world_T_item[:3, :3]) for item in lying]
    for k in range(count):
        if k % 3 == 1:
            vertices, faces = clutter.other_part(rng, rng.uniform(0.45, 0.95), avoid)
            rotation = resting_rotation(rng, vertices, faces)
        else:
            vertices, faces = clutter.small_thing(rng)
            vertices, faces = break_edges(vertices, faces, break_mm)
            rotation = resting_rotation(rng, vertices, faces)
        flat = vertices @ rotation.T
        reach = float(np.linalg.norm(flat[:, :2], axis=1).max())
        for _ in range(40):
            spot = rng.uniform(-1, 1, 2) * _BENCH_HALF_MM * np.sqrt(rng.uniform(0.15, 1.0))
            if all(np.linalg.norm(spot - at) > 0.9 * (reach + r) for at, r in taken):
                break
        else:
            continue
        taken.append((spot, reach))
        pose = on_table(rotation, vertices, (float(spot[0]), float(spot[1])))
        index = stock.take(_clutter_material(rng))
        meshes.append((flat + pose[:3, 3], faces, index, rotation))
    for _ in range(int(rng.integers(1, 3)) if count > 4 else 0):
        for _ in range(12):
            vertices, faces = clutter.cable(rng, _BENCH_HALF_MM)
            if all(np.linalg.norm(vertices[:, :2] - at, axis=1).min() > 0.7 * r for at, r in taken):
                break
        else:
            continue
        colour = rng.uniform(0.02, 0.5, 3)
        index = stock.take(surfaces.paint((float(colour[0]), float(colour[1]), float(colour[2]))))
        meshes.append((vertices, faces, index, np.eye(3)))
    return _merge(meshes)


def _merge(meshes: list[tuple[np.ndarray, np.ndarray, int, np.ndarray]]) -> Body:
    if not meshes:  # something must be there for the ray caster: a washer far outside the view
        vertices, faces = mesh_arrays(rod(1.0, 1.0))
        meshes = [(vertices + np.array([5000.0, 0.0, 0.0]), faces, 0, np.eye(3))]
    start = np.cumsum([0] + [len(m[0]) for m in meshes[:-1]])
    return Body(
        "bench",
        np.vstack([m[0] for m in meshes]),
        np.vstack([m[1] + s for m, s in zip(meshes, start, strict=True)]),
        np.concatenate([np.full(len(m[1]), m[2]) for m in meshes]),
        np.concatenate([np.repeat(m[3].T[None], len(m[1]), 0) for m in meshes]),
    )


def handle(part: CadPart, cam_T_part: np.ndarray, spindle: bool, material_index: int) -> Body:
    """A thin rod that holds the part, in part coordinates, on the side that the camera sees least."""
    view = cam_T_part[:, :3, 3] / np.linalg.norm(cam_T_part[:, :3, 3], axis=1, keepdims=True)
    to_camera = -np.einsum("kij,ki->kj", cam_T_part[:, :3, :3], view)  # in the part's frame
    grid = np.array(np.meshgrid([-1, 0, 1], [-1, 0, 1], [-1, 0, 1])).reshape(3, -1).T.astype(float)
    grid = grid[np.linalg.norm(grid, axis=1) > 0.5]
    grid /= np.linalg.norm(grid, axis=1, keepdims=True)
    worst = (grid @ to_camera.T).max(axis=1)
    direction = grid[int(worst.argmin())]
    if spindle and len(cam_T_part) > 1:
        between = Rotation.from_matrix(cam_T_part[0, :3, :3].T @ cam_T_part[-1, :3, :3]).as_rotvec()
        axis = between / max(float(np.linalg.norm(between)), 1e-9)
        if np.linalg.norm(between) > 0.2:
            direction = axis if (to_camera @ axis).max() < (to_camera @ -axis).max() else -axis
    # Enter where a ray from outside meets the part; step sideways past holes.
    side = np.cross(direction, [0.3, 0.5, 0.8])
    side /= np.linalg.norm(side)
    caster = EmbreeCaster(part.vertices, part.faces)
    offsets = np.array([0.0, 6.0, -6.0, 12.0, -12.0, 18.0, -18.0])
    origins = direction * 300.0 + offsets[:, None] * side
    distance, _ = caster.first_hit(origins, np.repeat(-direction[None], len(offsets), 0))
    depth = 300.0 - distance  # how far out along `direction` the surface lies
    best = int(np.where(np.isfinite(distance), depth - 0.3 * np.abs(offsets), -1e9).argmax())
    base = direction * (depth[best] - 2.0) + offsets[best] * side if np.isfinite(distance[best]) else direction * 5.0
    frame = _frame_with_z(direction)
    vertices, faces = mesh_arrays(rod(4.5, 14.0) + rod(3.0, 340.0))
    return Body("handle", vertices @ frame.T + base, faces, np.full(len(faces), material_index))


def occluder(rng: np.random.Generator, stock: Stock, part: CadPart, like_it: Body | None = None) -> Body:
    """Another metal part, or `like_it`, on a rod, to be carried past the tracked one; about its own origin."""
    vertices, faces = clutter.other_part(rng, rng.uniform(0.5, 0.62), part.name)
    vertices, faces = break_edges(vertices, faces, 0.25)
    index = stock.take(_clutter_material(rng))
    if like_it is not None:
        vertices, faces, index = like_it.vertices, like_it.faces, 0
    stick, stick_faces = mesh_arrays(rod(2.6, 260.0))
    direction = np.array([rng.uniform(-0.5, 0.5), 0.9, -0.35])
    stick = stick @ _frame_with_z(direction / np.linalg.norm(direction)).T
    return Body(
        "occluder",
        np.vstack([vertices, stick]),
        np.vstack([faces, stick_faces + len(vertices)]),
        np.concatenate([np.full(len(faces), index), np.full(len(stick_faces), 2)]),
    )


def _frame_with_z(direction: np.ndarray) -> np.ndarray:
    """Rotation (3, 3) whose third column is the unit direction."""
    x = np.cross([0.31, 0.92, 0.24], direction)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(direction, x), direction], axis=1)
