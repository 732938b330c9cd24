"""Light from the lamps: irradiance at a point, soft shadows by a few rays, and the table's light map.

Convention: world frame, mm; irradiance is divided by pi, so `albedo * light` is radiance.
Shadow rays are spread over lamp and hemisphere by a low-discrepancy sequence that is turned from point to point, which
leaves fine grain instead of bands; the light map is blurred by a texel afterwards.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from data_recipes.metal.bodies import Placed, any_occluded
from data_recipes.metal.environment import Patch, sample_map

MAP_HALF_MM = 300.0
_AMBIENT_REACH_MM = 90.0


def spread(n: int, seed: int) -> np.ndarray:
    """(n, 2) numbers in [0, 1): the R2 low-discrepancy sequence from a seeded start."""
    k = np.arange(n, dtype=np.float64)[:, None]
    return (0.5 + 0.618033988749895 * seed + k * np.array([0.7548776662466927, 0.5698402909980532])) % 1.0


def lamp_light(lamp: Patch, points: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Unshadowed irradiance over pi (n,) of a lamp of radiance 1, as if it all came from its centre."""
    to_lamp = lamp.centre - points
    square = np.einsum("ij,ij->i", to_lamp, to_lamp)
    inverse = 1.0 / np.sqrt(square)
    at_surface = np.einsum("ij,ij->i", to_lamp, normals) * inverse
    at_lamp = -(to_lamp @ lamp.normal) * inverse
    light: np.ndarray = np.clip(at_surface, 0, None) * np.clip(at_lamp, 0, None) * lamp.area / (np.pi * square)
    return light


def lamp_rays(lamp: Patch, points: np.ndarray, uv: np.ndarray) -> np.ndarray:
    """Vectors (n, 3) from points to places uv (n, 2) in [0, 1] on the lamp."""
    st = 2 * uv - 1
    rays: np.ndarray = lamp.centre + st[:, :1] * lamp.half_u + st[:, 1:] * lamp.half_v - points
    return rays


def hemisphere(normals: np.ndarray, uv: np.ndarray) -> np.ndarray:
    """Cosine-weighted unit directions (n, 3) about unit normals, from uv (n, 2) in [0, 1]."""
    z = 2 * uv[:, 0] - 1
    phi = 2 * np.pi * uv[:, 1]
    r = np.sqrt(np.clip(1 - z * z, 0, 1))
    ball = np.stack([r * np.cos(phi), r * np.sin(phi), z], 1)
    direction = normals * 1.0001 + ball  # a point on the unit ball that touches the surface
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    return np.asarray(direction)


@dataclass(frozen=True, eq=False)
class LightMap:
    """Light on the table: image (s, s, 3), irradiance over pi, covering |x|, |y| <= MAP_HALF_MM."""

    image: np.ndarray

    @property
    def texel_mm(self) -> float:
        """Texel pitch."""
        return 2 * MAP_HALF_MM / (len(self.image) - 1)

    @property
    def map_from_mm(self) -> np.ndarray:
        """(3, 3) homography from table (x, y) mm to light-map pixels."""
        s = 1.0 / self.texel_mm
        return np.array([[s, 0, MAP_HALF_MM * s], [0, s, MAP_HALF_MM * s], [0, 0, 1.0]])

    def at(self, xy: np.ndarray) -> np.ndarray:
        """Light (n, 3) at table points (n, 2) mm."""
        pixel = np.clip((xy + MAP_HALF_MM) / self.texel_mm, 0, len(self.image) - 1)
        return sample_map(self.image, pixel[:, 0], pixel[:, 1])


def lamp_shade(bodies: tuple[Placed, ...], lamp: Patch, size: int, samples: int, seed: int) -> np.ndarray:
    """Share (s, s) of a lamp's light that bodies leave to each texel of the table's light map."""
    points, turn = _texels(size)
    lit = np.ones(len(points))
    near = _in_reach(bodies, points, lamp)
    for uv in spread(samples, seed):
        rays = lamp_rays(lamp, points[near], (uv + turn[near]) % 1.0)
        lit[near] -= any_occluded(bodies, points[near], rays, 1.0) / samples
    return _smooth(lit, size)


def ambient_shade(bodies: tuple[Placed, ...], size: int, samples: int, seed: int) -> np.ndarray:
    """Share (s, s) of the ambient light that bodies leave to each texel of the table's light map."""
    points, turn = _texels(size)
    open_sky = np.ones(len(points))
    near = _in_reach(bodies, points, None)
    up = np.repeat([[0.0, 0.0, 1.0]], len(near), axis=0)
    for uv in spread(samples, seed + 17):
        rays = hemisphere(up, (uv + turn[near]) % 1.0)
        open_sky[near] -= any_occluded(bodies, points[near], rays, _AMBIENT_REACH_MM) / samples
    return _smooth(open_sky, size)


def _texels(size: int) -> tuple[np.ndarray, np.ndarray]:
    """Table points (s*s, 3), just above it, and a shift (s*s, 2) of the sampling pattern for each."""
    axis = np.linspace(-MAP_HALF_MM, MAP_HALF_MM, size)
    x, y = (grid.ravel() for grid in np.meshgrid(axis, axis))
    turn = np.stack([(x * 0.7548 + y * 0.5698) * 7.3, (x * 0.3819 - y * 0.8567) * 5.7], 1)
    return np.stack([x, y, np.full(x.size, 0.02)], 1), turn


def _smooth(shade: np.ndarray, size: int) -> np.ndarray:
    return np.asarray(cv2.GaussianBlur(np.clip(shade, 0, 1).reshape(size, size), (0, 0), 0.8))


def _in_reach(bodies: tuple[Placed, ...], points: np.ndarray, lamp: Patch | None) -> np.ndarray:
    """Indices of table points that a shadow (or, without lamp, the ambient occlusion) of the bodies can reach."""
    reach = np.zeros(len(points), bool)
    for item in bodies:
        centre = item.middle
        if lamp is None:
            square = ((points - centre) ** 2).sum(1)
            reach |= square < (item.body.radius + _AMBIENT_REACH_MM) ** 2
        else:
            ray = lamp.centre - points
            width = item.body.radius + float(np.hypot(np.linalg.norm(lamp.half_u), np.linalg.norm(lamp.half_v))) * 0.3
            s = np.clip(((centre - points) * ray).sum(1) / (ray**2).sum(1), 0, 1)
            reach |= ((points + s[:, None] * ray - centre) ** 2).sum(1) < width**2
    return np.flatnonzero(reach)


def light_map(
    lamps: tuple[Patch, ...], lamp_shades: list[np.ndarray], ambient: np.ndarray, ambient_shade: np.ndarray
) -> LightMap:
    """Light on the table: what each shade (s, s) leaves of its lamp, and `ambient_shade` of the ambient (3,)."""
    size = len(ambient_shade)
    points, _ = _texels(size)
    up = np.repeat([[0.0, 0.0, 1.0]], len(points), axis=0)
    image = ambient_shade[..., None] * ambient
    for lamp, shade in zip(lamps, lamp_shades, strict=True):
        free = lamp_light(lamp, points, up).reshape(size, size)
        image = image + (free * shade)[..., None] * lamp.radiance
    return LightMap(image.astype(np.float32))
