"""The renderer: one picture from four passes, each with its own sub-pixel offset and its own moment of the exposure.

Per pass and pixel: nearest hit by ray casting; on metal, one mirror ray (into the room, or onto table and bodies,
which are then shaded once, without further bounce), one shadow ray per lamp and one ray for the ambient; on
the table, its texture times the light map. The mean of the passes anti-aliases and blurs motion at once, and stays
centred on the mid-exposure pose because offsets and moments both have mean zero.
Convention: world frame, mm; images are linear RGB; pixel (0, 0) is the centre of the top-left pixel.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from data_recipes.metal.bodies import Placed, any_occluded
from data_recipes.metal.environment import Environment, Patch, sample_map
from data_recipes.metal.lighting import (
    LightMap,
    ambient_shade,
    hemisphere,
    lamp_light,
    lamp_rays,
    lamp_shade,
    light_map,
    spread,
)
from data_recipes.metal.scene import Moment, Scene
from data_recipes.metal.surfaces import Surface

_PASSES = ((-0.25, -0.25, -0.375), (0.25, -0.25, 0.125), (-0.25, 0.25, 0.375), (0.25, 0.25, -0.125))
_AMBIENT_REACH_MM = 70.0
_FINE_RAYS = 3  # mirror rays per pass on the tracked part
_LIFT_MM = 0.02  # secondary rays start this far off the surface


@dataclass(frozen=True, eq=False)
class Picture:
    """Linear RGB image (h, w, 3) float32, and two masks (h, w): the part if it were alone, and what is seen of it."""

    image: np.ndarray
    part_alone: np.ndarray
    part_seen: np.ndarray


class Renderer:
    """Renders frames of one scene; the bench's own shadows are worked out once and kept."""

    def __init__(self, scene: Scene) -> None:
        self._scene = scene
        camera = scene.camera
        u, v = np.meshgrid(np.arange(camera.width, dtype=float), np.arange(camera.height, dtype=float))
        self._rays_cam = camera.rays(np.stack([u.ravel(), v.ravel()], 1))
        self._map_size = int(np.clip(camera.width * 0.45, 64, 288))
        self._kept: dict[Patch, np.ndarray] = {}
        self._open: np.ndarray | None = None

    def frame(self, index: int) -> Picture:
        """Render one frame."""
        moment = self._scene.at(float(index))
        light = self._table_light(moment, index)
        total = np.zeros((self._scene.camera.height, self._scene.camera.width, 3), np.float32)
        masks: tuple[np.ndarray, np.ndarray] | None = None
        for k, (dx, dy, dt) in enumerate(_PASSES):
            now = self._scene.at(index + dt * self._scene.exposure_frames)
            rng = np.random.default_rng([self._scene.config.seed, 100, index, k])
            image, alone, seen = _Pass(self._scene, now, light, self._rays_cam, (dx, dy), rng).render()
            total += image / len(_PASSES)
            masks = masks or (alone, seen)
        assert masks is not None
        return Picture(total, *masks)

    def _table_light(self, moment: Moment, index: int) -> LightMap:
        """The table's light map: shadows of what stands still are kept for as long as their lamp does."""
        scene, size, room = self._scene, self._map_size, moment.environment
        lying = () if scene.held else (moment.part,)
        still, moving = (*lying, moment.bench), moment.moving if scene.held else moment.others
        if self._open is None:
            self._open = ambient_shade(still, size, 20, scene.config.seed)
        shades = []
        for lamp in room.lamps:
            if lamp not in scene.room.lamps:  # it swings: a rough shade for this frame alone
                shades.append(lamp_shade(still, lamp, size, 6, scene.config.seed))
                continue
            if lamp not in self._kept:
                self._kept[lamp] = lamp_shade(still, lamp, size, 20, scene.config.seed)
            shades.append(self._kept[lamp])
        clear = self._open
        if moving:  # held well above the table, so their shadows are soft: a coarser map will do
            seed, coarse = scene.config.seed + index, size // 2
            cast = [_enlarged(lamp_shade(moving, lamp, coarse, 6, seed), size) for lamp in room.lamps]
            shades = [a * b for a, b in zip(shades, cast, strict=True)]
            clear = clear * _enlarged(ambient_shade(moving, coarse, 6, seed), size)
        return light_map(room.lamps, shades, room.ambient(), clear)


def _enlarged(shade: np.ndarray, size: int) -> np.ndarray:
    """A light-map shade (s, s) resampled to (size, size); both span the map from edge texel to edge texel."""
    at = np.linspace(0, len(shade) - 1, size, dtype=np.float32)
    return np.asarray(cv2.remap(shade, *np.meshgrid(at, at), cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE))


class _Pass:
    """One sample per pixel at one moment."""

    def __init__(
        self,
        scene: Scene,
        now: Moment,
        light: LightMap,
        rays_cam: np.ndarray,
        offset: tuple[float, float],
        rng: np.random.Generator,
    ) -> None:
        self._scene, self._now, self._light, self._offset, self._rng = scene, now, light, offset, rng
        self._room: Environment = now.environment
        camera = scene.camera
        shift = np.array([offset[0] / camera.fx, offset[1] / camera.fy, 0.0])
        self._rays = (rays_cam + shift) @ now.world_T_cam[:3, :3].T
        self._eye = now.world_T_cam[:3, 3]
        self._shape = (camera.height, camera.width)

    def render(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Image (h, w, 3) and the part's two masks."""
        nearest, face, owner, alone = self._primary()
        image = self._table_image().reshape(-1, 3)
        hit = np.flatnonzero(owner >= 0)
        points = self._eye + nearest[hit, None] * self._rays[hit]
        view = self._rays[hit] / np.linalg.norm(self._rays[hit], axis=1, keepdims=True)
        image[hit] = self._shade(points, view, owner[hit], face[hit])
        seen = (owner == 0).reshape(self._shape)
        return image.reshape(*self._shape, 3), alone.reshape(self._shape), seen

    def _primary(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        n = len(self._rays)
        falling = self._rays[:, 2] < -1e-6
        nearest = np.full(n, np.inf)
        nearest[falling] = -self._eye[2] / self._rays[falling, 2]
        face, owner = np.full(n, -1), np.full(n, -1)
        alone = np.zeros(n, bool)
        for k, placed in enumerate(self._now.bodies):
            ask = self._pixels_near(placed)
            origins = np.broadcast_to(self._eye, (len(ask), 3))
            distance, at = placed.first_hit(origins, self._rays[ask])
            if k == 0:
                alone[ask] = at >= 0
            front = distance < nearest[ask]
            nearest[ask[front]], face[ask[front]], owner[ask[front]] = distance[front], at[front], k
        return nearest, face, owner, alone

    def _pixels_near(self, placed: Placed) -> np.ndarray:
        """Indices of the pixels in the box round a body's bounding sphere."""
        centre = (placed.middle - self._eye) @ self._now.world_T_cam[:3, :3]
        camera, radius = self._scene.camera, placed.body.radius
        if centre[2] < 1.2 * radius:
            return np.arange(len(self._rays))
        middle = camera.project(centre[None])[0]
        half = 1.15 * camera.fx * radius / (centre[2] - radius) + 2
        low = np.clip(np.floor(middle - half), 0, [camera.width, camera.height]).astype(int)
        high = np.clip(np.ceil(middle + half), 0, [camera.width, camera.height]).astype(int)
        rows = np.arange(low[1], high[1])[:, None] * camera.width
        return np.asarray((rows + np.arange(low[0], high[0])).ravel())

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
