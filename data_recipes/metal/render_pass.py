"""One pass of the renderer: one sample per pixel, at one sub-pixel offset and one moment of the exposure.

Per pixel: nearest hit by ray casting; on metal, one mirror ray (into the room, or onto table and bodies, which are
then shaded once, without further bounce), one shadow ray per lamp and one ray for the ambient; on the table, its
texture times the light map.
Convention: world frame, mm; images are linear RGB; pixel (0, 0) is the centre of the top-left pixel.
"""

from __future__ import annotations

import cv2
import numpy as np

from data_recipes.metal.bodies import Placed, any_occluded
from data_recipes.metal.environment import Environment, sample_map
from data_recipes.metal.lighting import LightMap, hemisphere, lamp_light, lamp_rays, spread
from data_recipes.metal.primary_hits import BodyHits, Hits, nearest_hits
from data_recipes.metal.scene import Moment, Scene
from data_recipes.metal.surfaces import Surface

_AMBIENT_REACH_MM = 70.0
_FINE_RAYS = 3  # mirror rays per pass on the tracked part
_LIFT_MM = 0.02  # secondary rays start this far off the surface
_KEPT_SAMPLES = 2
_SAME_DEPTH, _SAME_FACING = 0.005, 0.98  # of a surface that passes share: relative distance, cosine of the normals


class KeptColours:
    """What all but the tracked part looked like, pixel by pixel, in the passes before.

    Where a pass meets the same surface at the same pixel as two earlier ones, their mean is taken again: outlines
    are sampled four times, what lies inside twice. The tracked part is shaded every time.
    """

    def __init__(self, pixels: int) -> None:
        self._owner = np.full(pixels, -1)
        self._distance = np.zeros(pixels)
        self._normal = np.zeros((pixels, 3), np.float32)
        self._colour = np.zeros((pixels, 3), np.float32)
        self._samples = np.zeros(pixels, np.int8)

    def take(self, image: np.ndarray, hits: Hits, bodies: tuple[Placed, ...]) -> np.ndarray:
        """Fill in an image (n, 3) where the surface seen is known; the pixels (m,) of all other hits on bodies."""
        known = self._same(hits, bodies)
        self._samples[~known] = 0
        enough = known & (self._samples >= _KEPT_SAMPLES)
        image[enough] = self._colour[enough]
        return np.flatnonzero((hits.owner >= 0) & ~enough)

    def keep(self, pixels: np.ndarray, colour: np.ndarray, hits: Hits, bodies: tuple[Placed, ...]) -> None:
        """Remember colours (m, 3) at pixels (m,), after `take`."""
        self._owner[pixels], self._distance[pixels] = hits.owner[pixels], hits.distance[pixels]
        before = self._samples[pixels, None]
        self._colour[pixels] = (self._colour[pixels] * before + colour) / (before + 1)
        self._samples[pixels] += 1
        for k, placed in enumerate(bodies):
            rows = pixels[hits.owner[pixels] == k]
            self._normal[rows] = placed.body.normals[hits.face[rows]]

    def _same(self, hits: Hits, bodies: tuple[Placed, ...]) -> np.ndarray:
        """Whether a hit (n,) is on what was kept for its pixel; never for the tracked part."""
        same = np.zeros(len(hits.owner), bool)
        close = (hits.owner == self._owner) & (np.abs(self._distance - hits.distance) < _SAME_DEPTH * hits.distance)
        for k, placed in enumerate(bodies):
            if k > 0:
                rows = np.flatnonzero(close & (hits.owner == k))
                normal = placed.body.normals[hits.face[rows]]
                same[rows] = np.einsum("ij,ij->i", normal, self._normal[rows]) > _SAME_FACING
        return same


class Pass:
    """One sample per pixel at one moment.

    kept: shared by the passes of a frame. bench_hits: of an earlier pass with the same rays; `render` sets them.
    """

    def __init__(
        self,
        scene: Scene,
        now: Moment,
        light: LightMap,
        rays_cam: np.ndarray,
        offset: tuple[float, float],
        rng: np.random.Generator,
        kept: KeptColours,
        bench_hits: BodyHits | None = None,
    ) -> None:
        self._scene, self._now, self._light, self._offset, self._rng = scene, now, light, offset, rng
        self._kept, self.bench_hits = kept, bench_hits
        self._room: Environment = now.environment
        camera = scene.camera
        shift = np.array([offset[0] / camera.fx, offset[1] / camera.fy, 0.0])
        self._rays = (rays_cam + shift) @ now.world_T_cam[:3, :3].T
        self._eye = now.world_T_cam[:3, 3]
        self._shape = (camera.height, camera.width)

    def render(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Image (h, w, 3) and the part's two masks."""
        hits = nearest_hits(self._now, self._rays, self._scene.camera, self.bench_hits)
        self.bench_hits = hits.bench
        image = self._table_image().reshape(-1, 3)
        rows = self._kept.take(image, hits, self._now.bodies)
        points = self._eye + hits.distance[rows, None] * self._rays[rows]
        view = self._rays[rows] / np.linalg.norm(self._rays[rows], axis=1, keepdims=True)
        image[rows] = self._shade(points, view, hits.owner[rows], hits.face[rows])
        self._kept.keep(rows, image[rows], hits, self._now.bodies)
        seen = (hits.owner == 0).reshape(self._shape)
        return image.reshape(*self._shape, 3), hits.alone.reshape(self._shape), seen

    def _table_image(self) -> np.ndarray:
        camera, table = self._scene.camera, self._scene.table
        cam_R_world = self._now.world_T_cam[:3, :3].T
        shift = -cam_R_world @ self._eye
        k = camera.matrix.copy()
        k[:2, 2] -= self._offset
        pixel_from_mm = k @ np.column_stack([cam_R_world[:, 0], cam_R_world[:, 1], shift])
        size = (camera.width, camera.height)
        albedo = cv2.warpPerspective(
            table.texture, pixel_from_mm @ np.linalg.inv(table.texture_from_mm), size,
            flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT,
        )  # fmt: skip
        light = cv2.warpPerspective(
            self._light.image, pixel_from_mm @ np.linalg.inv(self._light.map_from_mm), size,
            flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE,
        )  # fmt: skip
        return np.asarray(albedo * light + self._sheen())

    def _sheen(self) -> np.ndarray:
        """The faint mirror image of the room in the table top, on a coarse grid: it is blurred anyway."""
        h, w = self._shape
        step = 8
        rows, columns = np.arange(0, h + step, step).clip(max=h - 1), np.arange(0, w + step, step).clip(max=w - 1)
        rays = self._rays.reshape(h, w, 3)[np.ix_(rows, columns)].reshape(-1, 3)
        falling = rays[:, 2] < -1e-3
        points = self._eye + (-self._eye[2] / np.where(falling, rays[:, 2], -1.0))[:, None] * rays
        view = rays / np.linalg.norm(rays, axis=1, keepdims=True)
        fresnel = 0.04 + 0.96 * (1 - np.clip(-view[:, 2], 0, 1)) ** 5
        mirror = view * np.array([1.0, 1.0, -1.0])
        n = len(points)
        sigma, streak = np.full(n, 0.22, np.float32), np.zeros((n, 3), np.float32)
        seen = self._room.look(points.astype(np.float32), mirror.astype(np.float32), sigma, streak)
        sheen = (seen * (fresnel * self._scene.table.gloss)[:, None]).reshape(len(rows), len(columns), 3)
        return np.asarray(cv2.resize(sheen.astype(np.float32), (w, h), interpolation=cv2.INTER_LINEAR))

    def _surface(
        self, points: np.ndarray, view: np.ndarray, owner: np.ndarray, face: np.ndarray
    ) -> tuple[Surface, np.ndarray]:
        """Shading inputs of hits on any of the bodies, and the geometric normals (n, 3) turned towards the viewer."""
        n = len(points)
        geometric = np.zeros((n, 3))
        parts: list[tuple[np.ndarray, Surface]] = []
        for k, placed in enumerate(self._now.bodies):
            rows = np.flatnonzero(owner == k)
            if len(rows) == 0:
                continue
            body, rotation = placed.body, placed.world_T_body[:3, :3]
            local = (points[rows] - placed.world_T_body[:3, 3]) @ rotation
            at = face[rows]
            normal = body.shading_normals(local, at, -(view[rows] @ rotation))
            flat = body.normals[at] @ rotation.T
            flat *= np.where(np.einsum("ij,ij->i", flat, view[rows]) > 0, -1.0, 1.0)[:, None]
            geometric[rows] = flat
            if body.lay_frame is None:
                surface = self._scene.materials.surface(local, normal, body.material[at], rotation)
            else:
                turn = body.lay_frame[at]
                surface = self._scene.materials.surface(
                    np.einsum("nij,nj->ni", turn, local), np.einsum("nij,nj->ni", turn, normal),
                    body.material[at], np.einsum("ij,nkj->nik", rotation, turn),
                )  # fmt: skip
            parts.append((rows, surface))
        fields = []
        for name in ("normal", "rough", "streak", "wide", "mirror", "diffuse"):
            first = getattr(parts[0][1], name)
            whole = np.zeros((n, *first.shape[1:]), np.float32)
            for rows, surface in parts:
                whole[rows] = getattr(surface, name)
            fields.append(whole)
        return Surface(*fields), geometric

    def _shade(self, points: np.ndarray, view: np.ndarray, owner: np.ndarray, face: np.ndarray) -> np.ndarray:
        if len(points) == 0:
            return np.zeros((0, 3), np.float32)
        surface, flat = self._surface(points, view, owner, face)
        ray, cosine = _mirror(view, surface.normal, flat)
        start = points + _LIFT_MM * flat
        seen = self._room.look(points.astype(np.float32), ray.astype(np.float32), surface.rough, surface.streak)
        seen = self._with_things(seen, start, ray, flat, surface, owner == 0)
        light = self._lamp_and_ambient(start, surface.normal, flat)
        fresnel = surface.mirror + (1 - surface.mirror) * (0.7 * (1 - cosine) ** 5)[:, None].astype(np.float32)
        wide = surface.wide[:, None]
        return np.asarray(fresnel * ((1 - wide) * seen + wide * light) + surface.diffuse * light, np.float32)

    def _with_things(
        self, room: np.ndarray, start: np.ndarray, ray: np.ndarray, flat: np.ndarray, surface: Surface, fine: np.ndarray
    ) -> np.ndarray:
        """Mirror image (n, 3) of table and bodies over that of the room; several spread rays where `fine`, else one."""
        seen = np.zeros_like(room)
        turn = self._rng.random((len(ray), 2))
        for k, uv in enumerate(spread(_FINE_RAYS, int(self._rng.integers(1000)))):
            rows = np.arange(len(ray)) if k == 0 else np.flatnonzero(fine)
            part = np.where(fine[rows], 1.0 / _FINE_RAYS, 1.0)[:, None].astype(np.float32)
            place = (uv + turn[rows]) % 1.0
            towards = _scatter(ray[rows], surface.rough[rows], surface.streak[rows], place, flat[rows])
            colour = room[rows]
            self._see_things(colour, start[rows], towards)
            seen[rows] += part * colour
        return seen

    def _see_things(self, seen: np.ndarray, start: np.ndarray, ray: np.ndarray) -> None:
        """Replace what mirror rays see by the table or the body that they hit."""
        falling = ray[:, 2] < -1e-3
        distance = np.where(falling, -start[:, 2] / np.where(falling, ray[:, 2], -1.0), np.inf)
        distance[distance > 900.0] = np.inf
        owner, face = np.full(len(ray), -1), np.full(len(ray), -1)
        for k, placed in enumerate(self._now.bodies):
            ask = placed.candidates(start, ray, 900.0)
            reach, at = placed.first_hit(start[ask], ray[ask])
            front = reach < distance[ask]
            distance[ask[front]], face[ask[front]], owner[ask[front]] = reach[front], at[front], k
        table = np.flatnonzero((owner < 0) & np.isfinite(distance))
        xy = (start[table] + distance[table, None] * ray[table])[:, :2]
        seen[table] = self._table_colour(xy)
        metal = np.flatnonzero(owner >= 0)
        if len(metal):
            points = start[metal] + distance[metal, None] * ray[metal]
            seen[metal] = self._second(points, ray[metal], owner[metal], face[metal])

    def _table_colour(self, xy: np.ndarray) -> np.ndarray:
        table = self._scene.table
        half = (table.texture.shape[0] - 1) / 2
        pixel = np.clip(xy / table.texel_mm + half, 0, 2 * half)
        return sample_map(table.texture, pixel[:, 0], pixel[:, 1]) * self._light.at(xy)

    def _second(self, points: np.ndarray, view: np.ndarray, owner: np.ndarray, face: np.ndarray) -> np.ndarray:
        """What a mirror ray finds on another surface: that surface's own mirror image of the room, a little dulled."""
        surface, flat = self._surface(points, view, owner, face)
        ray, _ = _mirror(view, surface.normal, flat)
        seen = self._room.look(
            points.astype(np.float32), ray.astype(np.float32), surface.rough + np.float32(0.12), surface.streak
        )
        low = np.clip(-ray[:, 2:], 0, 1).astype(np.float32)  # rays that go down end on the table, not in the room
        ground = self._light.at(points[:, :2]) * self._scene.table.mean
        seen = seen * (1 - low) + ground * low
        ambient = self._room._walls(surface.normal, np.full(len(points), 0.6, np.float32))
        return np.asarray(surface.mirror * (0.7 * seen + 0.2 * ambient) + surface.diffuse * 0.9 * ambient, np.float32)

    def _lamp_and_ambient(self, start: np.ndarray, normal: np.ndarray, flat: np.ndarray) -> np.ndarray:
        """Light over pi (n, 3) that falls on the points: lamps with soft shadows, ambient with occlusion."""
        bodies = self._now.bodies
        n = len(start)
        sky = hemisphere(flat, self._rng.random((n, 2)))
        open_sky = ~any_occluded(bodies, start, sky, _AMBIENT_REACH_MM)
        open_sky &= (sky[:, 2] > 0) | (start[:, 2] > _AMBIENT_REACH_MM * -sky[:, 2])
        ambient = self._room._walls(normal.astype(np.float32), np.full(n, 0.6, np.float32))
        light = ambient * (0.25 + 0.75 * open_sky[:, None])
        for lamp in self._room.lamps:
            free = lamp_light(lamp, start, normal.astype(np.float64))
            lit = np.flatnonzero(free > 1e-5)
            rays = lamp_rays(lamp, start[lit], self._rng.random((len(lit), 2)))
            lit = lit[~any_occluded(bodies, start[lit], rays, 1.0)]
            light[lit] += free[lit, None] * lamp.radiance
        return np.asarray(light, np.float32)


def _mirror(view: np.ndarray, normal: np.ndarray, flat: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mirrored unit rays (n, 3), kept above the real surface, and the cosine (n,) of incidence."""
    along = np.einsum("ij,ij->i", view, normal)
    ray = view - 2 * along[:, None] * normal
    below = np.einsum("ij,ij->i", ray, flat)
    ray = ray + flat * np.clip(0.01 - below, 0, None)[:, None]
    ray /= np.linalg.norm(ray, axis=1, keepdims=True)
    return ray, np.clip(-along, 0.0, 1.0)


def _scatter(ray: np.ndarray, rough: np.ndarray, streak: np.ndarray, uv: np.ndarray, flat: np.ndarray) -> np.ndarray:
    """Mirrored rays (n, 3) spread by the finish: a Gaussian of deviation `rough`, stretched along `streak` (n, 3)."""
    radius = np.sqrt(-2 * np.log(np.clip(1 - uv[:, 0], 1e-4, 1.0)))
    g, h = radius * np.cos(2 * np.pi * uv[:, 1]), radius * np.sin(2 * np.pi * uv[:, 1])
    aside = np.cross(ray, flat + 1e-3)
    aside /= np.maximum(np.linalg.norm(aside, axis=1, keepdims=True), 1e-6)
    # Narrower than the lobe that blurs the room: a few rays cannot fill the tails and would leave grain.
    out = ray + 0.7 * (rough * g)[:, None] * aside + 0.7 * (rough * h)[:, None] * np.cross(aside, ray)
    out += 0.7 * g[:, None] * streak
    out += flat * np.clip(0.02 - np.einsum("ij,ij->i", out, flat), 0, None)[:, None]
    out /= np.linalg.norm(out, axis=1, keepdims=True)
    return np.asarray(out)
