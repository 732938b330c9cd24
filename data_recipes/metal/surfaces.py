"""Metals and finishes: what a surface point does to the light, as arrays over hit points.

A finish tilts the normals a little (tool marks, brush lines, cast grain) and spreads the mirror image, more
across the marks than along them. Its pattern is fixed to the part, mapped by the face's main direction in the part's
own frame, so it moves with the part as a real surface does.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.ndimage import gaussian_filter, gaussian_filter1d

Finish = Literal["milled", "brushed", "turned", "cast", "plain"]
_CELLS = 64
_LINES = 8192


@dataclass(frozen=True)
class Material:
    """Colour of the mirror part at normal incidence, diffuse albedo, spread of the lobe (rad) and the finish.

    rough: spread in all directions; streak: extra spread across the marks; wide: share of the light in a broad lobe.
    """

    name: str
    mirror: tuple[float, float, float]
    diffuse: tuple[float, float, float] = (0.0, 0.0, 0.0)
    rough: float = 0.1
    streak: float = 0.0
    wide: float = 0.3
    finish: Finish = "plain"
    marks: float = 0.02  # slope of the marks, rad
    stain: float = 0.1


METALS: dict[str, tuple[float, float, float]] = {
    "steel": (0.55, 0.55, 0.54),
    "aluminium": (0.80, 0.81, 0.82),
    "dark steel": (0.30, 0.29, 0.28),
    "brass": (0.78, 0.60, 0.36),
}


@dataclass(frozen=True)
class Texture:
    """What tools leave on a metal; the fields are those of `Material`."""

    rough: float
    streak: float
    wide: float
    marks: float
    stain: float


FINISHES: dict[Finish, Texture] = {
    "milled": Texture(rough=0.10, streak=0.10, wide=0.30, marks=0.030, stain=0.10),
    "brushed": Texture(rough=0.09, streak=0.20, wide=0.30, marks=0.035, stain=0.07),
    "turned": Texture(rough=0.07, streak=0.12, wide=0.25, marks=0.025, stain=0.08),
    "cast": Texture(rough=0.22, streak=0.00, wide=0.35, marks=0.050, stain=0.14),
}


def metal(name: str, finish: Finish, roughness: float = 1.0) -> Material:
    """A metal by name (see METALS) with a finish (see FINISHES), its spread scaled by `roughness`."""
    look = FINISHES[finish]
    return Material(
        name=f"{name}, {finish}",
        mirror=METALS[name],
        rough=look.rough * roughness,
        streak=look.streak * roughness,
        wide=look.wide,
        finish=finish,
        marks=look.marks,
        stain=look.stain,
    )


def paint(colour: tuple[float, float, float]) -> Material:
    """Painted or plastic thing: diffuse colour under a faint gloss."""
    return Material("paint", (0.045, 0.045, 0.045), diffuse=colour, rough=0.12, wide=0.2)


@dataclass(frozen=True, eq=False)
class Noise:
    """Noise of unit deviation: grain, wave (c, c, c, 3) and stain (c, c, c) volumes, lines (n,) of tool marks."""

    grain: np.ndarray
    wave: np.ndarray
    stain: np.ndarray
    lines: np.ndarray


def make_noise(rng: np.random.Generator) -> Noise:
    """Periodic noise, smooth over a few cells."""

    def field(cells: float, channels: int) -> np.ndarray:
        white = rng.standard_normal((*(_CELLS,) * 3, channels)).astype(np.float32)
        smooth = gaussian_filter(white, (cells, cells, cells, 0), mode="wrap", truncate=3.0)
        return np.asarray(smooth / smooth.std())

    lines = rng.standard_normal(_LINES)
    lines = gaussian_filter1d(lines, 1.2, mode="wrap") + 2.2 * gaussian_filter1d(lines, 9.0, mode="wrap")
    return Noise(field(1.6, 3), field(6.0, 3), field(5.0, 1)[..., 0], (lines / lines.std()).astype(np.float32))


@dataclass(frozen=True, eq=False)
class Surface:
    """Shading inputs of n hit points: unit normals (n, 3) world, spreads, streak directions (n, 3), colours (n, 3)."""

    normal: np.ndarray
    rough: np.ndarray
    streak: np.ndarray
    wide: np.ndarray
    mirror: np.ndarray
    diffuse: np.ndarray


class Materials:
    """A table of materials that answers for arrays of material indices."""

    def __init__(self, materials: tuple[Material, ...], noise: Noise) -> None:
        self.materials = materials
        self._noise = noise
        self._mirror = np.array([m.mirror for m in materials], np.float32)
        self._diffuse = np.array([m.diffuse for m in materials], np.float32)
        self._number = np.array([[m.rough, m.streak, m.wide, m.marks, m.stain] for m in materials], np.float32)
        self._finish = np.array([m.finish for m in materials])

    def surface(
        self, points_item: np.ndarray, normals_item: np.ndarray, material: np.ndarray, world_R_item: np.ndarray
    ) -> Surface:
        """Surface at points (n, 3) with geometric normals (n, 3), both in the frame that the marks are fixed to.

        world_R_item: (3, 3) or one per point (n, 3, 3); the answer is in the world frame.
        """
        p, n = points_item.astype(np.float32), normals_item.astype(np.float32)
        rough, streak, wide, marks, stain = self._number[material].T
        slope, across = self._marks(p, n, self._finish[material])
        grain = self._lookup(self._noise.grain, p, 0.45)
        is_cast = (self._finish[material] == "cast").astype(np.float32)
        wave = self._lookup(self._noise.wave, p, 1.0)  # no plane is flat to the micron: reflections bend
        tilt = (slope * marks)[:, None] * across + (is_cast * marks)[:, None] * grain
        tilt += np.float32(0.10) * marks[:, None] * grain + np.float32(0.012) * wave
        n = n + tilt - np.einsum("ij,ij->i", tilt, n)[:, None] * n
        n /= np.linalg.norm(n, axis=1, keepdims=True)
        spot = self._lookup(self._noise.stain, p, 1.1)
        dull = np.clip(1.0 - stain * np.clip(spot - 0.3, -0.5, 2.2), 0.45, 1.08)
        rough = rough * np.clip(1.0 + 0.25 * spot, 0.7, 1.7)
        if world_R_item.ndim == 2:
            rotation = world_R_item.astype(np.float32)
            n, across = n @ rotation.T, across @ rotation.T
        else:
            n = np.einsum("nij,nj->ni", world_R_item, n).astype(np.float32)
            across = np.einsum("nij,nj->ni", world_R_item, across).astype(np.float32)
        mirror = self._mirror[material] * dull[:, None]
        return Surface(n, rough, streak[:, None] * across, wide, mirror, self._diffuse[material] * dull[:, None])

    def _marks(self, p: np.ndarray, n: np.ndarray, finish: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Slope (n,) of the tool marks at each point and the unit direction (n, 3) across them."""
        main = np.abs(n).argmax(axis=1)
        u = np.where(main == 0, p[:, 1], p[:, 0])
        v = np.where(main == 2, p[:, 1], p[:, 2])
        # Face mill: arcs about a centre far off; brush: straight lines; lathe: rings about z.
        arc_u, arc_v = u - np.float32(23.0), v + np.float32(95.0)
        radius = np.sqrt(arc_u**2 + arc_v**2)
        ring = np.sqrt(p[:, 0] ** 2 + p[:, 1] ** 2) + np.float32(1e-3)
        brushed, turned = finish == "brushed", finish == "turned"
        on_end = main == 2
        coordinate = np.where(brushed, v, np.where(turned, np.where(on_end, ring, p[:, 2]), radius))
        du = np.where(brushed, 0.0, arc_u / radius)
        dv = np.where(brushed, 1.0, arc_v / radius)
        across = np.zeros_like(p)
        across[:, 0] = np.where(main == 0, 0.0, du)
        across[:, 1] = np.where(main == 0, du, np.where(on_end, dv, 0.0))
        across[:, 2] = np.where(on_end, 0.0, dv)
        lathe = np.where(
            on_end[:, None],
            np.stack([p[:, 0] / ring, p[:, 1] / ring, 0 * ring], 1),
            np.array([0.0, 0.0, 1.0], np.float32),
        )
        across = np.where(turned[:, None], lathe, across)
        across = across - np.einsum("ij,ij->i", across, n)[:, None] * n
        across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-3)
        slope = self._noise.lines[(coordinate * np.float32(9.0)).astype(np.int64) % _LINES]
        slope = np.where((finish == "plain") | (finish == "cast"), np.float32(0.0), slope)
        return slope.astype(np.float32), across.astype(np.float32)

    @staticmethod
    def _lookup(volume: np.ndarray, p: np.ndarray, cell_mm: float) -> np.ndarray:
        """Nearest cell of a periodic volume at points (n, 3) mm."""
        i, j, k = ((p * np.float32(1.0 / cell_mm)).astype(np.int64) % _CELLS).T
        value: np.ndarray = volume[i, j, k]
        return value
