"""What metal reflects: a seeded room of light panels, dark and bright patches, walls and a gradient ceiling.

A metal part has no colour of its own: its look *is* its surroundings. Every patch is a rectangle at a finite place,
so reflections slide over the part as part, camera or lamp move, and differ from one end of a face to the other.
Roughness is a blur of what is mirrored: the convolution of a rectangle with a Gaussian lobe is a product of
two error functions, which is exact for a flat patch and needs no filtered maps; only the walls' faint
panorama is a small map with a pyramid of blurred levels.
Convention: world frame, z up, mm; radiance in linear RGB, 1 is about a sunlit sheet of paper.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import cv2
import numpy as np

_PANORAMA = (64, 128)
_LEVEL_SIGMA = (0.02, 0.08, 0.2, 0.45)  # blur of the panorama's levels, rad


@dataclass(frozen=True, eq=False)
class Patch:
    """A rectangle seen from its front side.

    centre (3,), half_u and half_v (3,) half edges in mm, radiance (3,); `lamp` patches cast shadows and light things.
    """

    centre: np.ndarray
    half_u: np.ndarray
    half_v: np.ndarray
    radiance: np.ndarray
    lamp: bool = False
    soft_mm: float = 8.0

    @cached_property
    def normal(self) -> np.ndarray:
        """Unit normal (3,) of the side that is seen."""
        n = np.cross(self.half_u, self.half_v)
        return n / np.linalg.norm(n)

    @property
    def area(self) -> float:
        """Area, mm²."""
        return float(4 * np.linalg.norm(np.cross(self.half_u, self.half_v)))

    def cover(
        self, points: np.ndarray, rays: np.ndarray, sigma: np.ndarray, streak: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Share of a Gaussian lobe about each ray that falls on the patch: (m,), of the rays (m,) that face it.

        points, rays (n, 3) world, rays unit; sigma (n,) rad; streak (n, 3): extra spread, along its direction, in rad.
        """
        n = self.normal.astype(np.float32)
        facing = rays @ n
        rows = np.flatnonzero(facing < -1e-4)
        centre = self.centre.astype(np.float32)
        s = ((centre - points[rows]) @ n) / facing[rows]
        rows, s = rows[s > 0], s[s > 0]
        spread = sigma[rows] * s / np.maximum(-facing[rows], 0.25)
        at = points[rows] + s[:, None] * rays[rows] - centre
        streak = streak[rows]
        share = np.ones(len(rows), np.float32)
        for half in (self.half_u, self.half_v):
            length = float(np.linalg.norm(half))
            unit = (half / length).astype(np.float32)
            q = at @ unit
            extra = (streak @ unit) * s
            width = np.sqrt(spread * spread + extra * extra + np.float32(self.soft_mm**2))
            share *= 0.5 * (_edge((q + length) / width) - _edge((q - length) / width))
        return rows, share


def _edge(x: np.ndarray) -> np.ndarray:
    """erf(x/sqrt(2)) to 1%: a tanh, which NumPy has in single precision."""
    rising: np.ndarray = np.tanh(np.float32(0.798) * x)
    return rising


def look_at_patch(
    centre: np.ndarray, target: np.ndarray, width: float, height: float, radiance: np.ndarray, **more: object
) -> Patch:
    """A patch of width x height mm at `centre` that faces `target`."""
    normal = target - centre
    normal = normal / np.linalg.norm(normal)
    side = np.cross(normal, [0.0, 0.0, 1.0])
    if np.linalg.norm(side) < 1e-3:
        side = np.array([1.0, 0.0, 0.0])
    side /= np.linalg.norm(side)
    up = np.cross(normal, side)
    return Patch(centre, side * width / 2, up * height / 2, np.asarray(radiance, float), **more)  # type: ignore[arg-type]


@dataclass(frozen=True, eq=False)
class Environment:
    """Walls, then patches from back to front; `panorama` levels (h, w, 3) are equirectangular, row 0 straight up."""

    patches: tuple[Patch, ...]
    panorama: tuple[np.ndarray, ...]

    @property
    def lamps(self) -> tuple[Patch, ...]:
        """The patches that cast shadows, strongest first."""
        lamps = [p for p in self.patches if p.lamp]
        return tuple(sorted(lamps, key=lambda p: -p.area * float(p.radiance.mean()) / _square(p.centre)))

    def look(self, points: np.ndarray, rays: np.ndarray, sigma: np.ndarray, streak: np.ndarray) -> np.ndarray:
        """Blurred radiance (n, 3) seen from points (n, 3) along unit rays (n, 3); sigma (n,), streak (n, 3) in rad."""
        seen = self._walls(rays, sigma)
        for patch in self.patches:
            rows, cover = patch.cover(points, rays, sigma, streak)
            seen[rows] += cover[:, None] * (patch.radiance.astype(np.float32) - seen[rows])
        return seen

    def ambient(self) -> np.ndarray:
        """Mean radiance (3,) of the upper half without the lamps: what fills the shadows."""
        upper = self.panorama[-1][: _PANORAMA[0] // 2]
        mean: np.ndarray = upper.reshape(-1, 3).mean(0).astype(np.float64)
        return mean

    def moved(self, index: int, shift: np.ndarray, gain: float) -> Environment:
        """The same room with one patch carried by `shift` mm and scaled in brightness."""
        patches = list(self.patches)
        old = patches[index]
        patches[index] = replace(old, centre=old.centre + shift, radiance=old.radiance * gain)
        return Environment(tuple(patches), self.panorama)

    def _walls(self, rays: np.ndarray, sigma: np.ndarray) -> np.ndarray:
        height, width = _PANORAMA
        x = (np.arctan2(rays[:, 1], rays[:, 0]) * np.float32(width / (2 * np.pi)) + width / 2).astype(np.float32)
        y = (np.arccos(np.clip(rays[:, 2], -1, 1)) * np.float32(height / np.pi) - 0.5).astype(np.float32)
        level = np.searchsorted(np.sqrt(np.multiply(_LEVEL_SIGMA[:-1], _LEVEL_SIGMA[1:])), sigma)
        out = np.empty((len(rays), 3), np.float32)
        for k, image in enumerate(self.panorama):
            here = np.flatnonzero(level == k)
            out[here] = sample_map(image, x[here], y[here])
        return out


def sample_map(image: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Bilinear samples (n, channels) of an image at (x, y) pixel centres; wraps round at the border."""
    n = len(x)
    if n == 0:
        return np.zeros((0, image.shape[2]), np.float32)
    wide = 16384  # cv2.remap takes maps of at most 32767 in each direction
    pad = -n % wide
    maps = [np.pad(v.astype(np.float32), (0, pad)).reshape(-1, wide) for v in (x, y)]
    found = cv2.remap(image, maps[0], maps[1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP)
    flat: np.ndarray = found.reshape(-1, image.shape[2])[:n].astype(np.float32)
    return flat


def _square(v: np.ndarray) -> float:
    return float(v @ v)


def make_environment(rng: np.random.Generator) -> Environment:
    """A random workshop: ceiling strips, a window with bars, one or two soft boxes, shelves, and a dark operator."""
    tint = np.array([1.0, 1.0, 1.0]) + rng.uniform(-0.06, 0.06) * np.array([1.0, 0.1, -1.0])
    patches: list[Patch] = []
    turn = rng.uniform(0, 2 * np.pi)

    def around(angle: float, distance: float, height: float) -> np.ndarray:
        return np.array([distance * np.cos(angle), distance * np.sin(angle), height])

    aim = np.array([0.0, 0.0, 40.0])
    for _ in range(int(rng.integers(5, 8))):  # shelves, doors, posters: dull dark and bright areas all round
        angle, height = rng.uniform(0, 2 * np.pi), rng.uniform(150, 1500)
        shade = rng.uniform(0.02, 0.12) if rng.random() < 0.6 else rng.uniform(0.5, 1.1)
        colour = shade * (1 + rng.uniform(-0.2, 0.2, 3))
        size = rng.uniform(300, 1100, 2)
        patches.append(look_at_patch(around(angle, 2400, height), aim, size[0], size[1], colour))
    window = turn + rng.uniform(-0.5, 0.5)
    daylight = np.array([0.93, 1.0, 1.08]) * rng.uniform(3.5, 7.0)
    for k in range(2):  # a window of two panes with a bar between them
        side = np.array([-np.sin(window), np.cos(window), 0.0]) * (k - 0.5) * 560
        pane = around(window, 1700, rng.uniform(750, 1000)) + side
        patches.append(look_at_patch(pane, aim + side, 500, 900, daylight, lamp=k == 0))
    strip_angle = rng.uniform(0, np.pi)
    for k in range(int(rng.integers(2, 4))):  # ceiling strips
        offset = around(strip_angle + np.pi / 2, 480.0 * (k - 1) + rng.uniform(-60, 60), 0.0)
        length = np.array([np.cos(strip_angle), np.sin(strip_angle), 0.0]) * rng.uniform(450, 750)
        broad = np.array([-np.sin(strip_angle), np.cos(strip_angle), 0.0]) * rng.uniform(45, 80)
        centre = offset + np.array([rng.uniform(-250, 250), rng.uniform(-250, 250), 1650.0])
        patches.append(Patch(centre, broad, length, tint * rng.uniform(10.0, 16.0), lamp=k == 0))
    box = turn + rng.uniform(1.6, 3.2)
    place = around(box, rng.uniform(500, 750), rng.uniform(650, 950))
    patches.append(
        look_at_patch(place, aim, rng.uniform(220, 380), rng.uniform(160, 300), tint * rng.uniform(36, 60), lamp=True)
    )
    person = turn + rng.uniform(3.6, 4.6)
    patches.append(look_at_patch(around(person, 900, 520), aim, 420, 900, np.full(3, rng.uniform(0.02, 0.06))))
    # Lamps face the table; patches that face up are never seen from it.
    flipped = [p if (aim - p.centre) @ p.normal > 0 else replace(p, half_u=-p.half_u) for p in patches]
    return Environment(tuple(flipped), _panorama(rng, tint))


def _panorama(rng: np.random.Generator, tint: np.ndarray) -> tuple[np.ndarray, ...]:
    height, width = _PANORAMA
    theta = (np.arange(height) + 0.5) / height * np.pi
    up = np.cos(theta)[:, None, None]
    wall, ceiling, floor = rng.uniform(0.06, 0.15), rng.uniform(0.15, 0.35), rng.uniform(0.02, 0.06)
    base = np.where(up > 0, wall + (ceiling - wall) * np.clip(up, 0, 1) ** 0.8, floor + (wall - floor) * (1 + up) ** 6)
    blotch = cv2.GaussianBlur(np.hstack([rng.standard_normal((height, width)).astype(np.float32)] * 3), (0, 0), 3.5)[
        :, width : 2 * width
    ]
    blotch = blotch / blotch.std()
    image = (base * np.exp(0.45 * blotch[..., None]) * tint).astype(np.float32)
    levels = []
    for sigma in _LEVEL_SIGMA:
        s = sigma * height / np.pi
        levels.append(cv2.GaussianBlur(np.hstack([image] * 3), (0, 0), max(s, 0.3))[:, width : 2 * width])
    return tuple(np.ascontiguousarray(level) for level in levels)
