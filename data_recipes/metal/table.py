"""The table: a plane z = 0 with a procedural print on it, and its light map.

Convention: texture and light map cover the square |x|, |y| <= HALF_MM; pixel (0, 0) of either is the texel centre at
x = y = -HALF_MM. Colours are albedo in linear RGB; the light map is irradiance over pi.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import cv2
import numpy as np

TableKind = Literal["wood", "print", "grid", "speckle"]
TABLE_KINDS: tuple[TableKind, ...] = ("wood", "print", "grid", "speckle")
HALF_MM = 620.0


@dataclass(frozen=True, eq=False)
class Table:
    """kind; texture (s, s, 3) float32 albedo; texel_mm its scale; gloss 0..1, how much the top mirrors."""

    kind: str
    texture: np.ndarray
    texel_mm: float
    gloss: float

    @cached_property
    def mean(self) -> np.ndarray:
        """Mean albedo (3,), float32."""
        return np.asarray(self.texture.mean((0, 1)))

    @property
    def texture_from_mm(self) -> np.ndarray:
        """(3, 3) homography from table (x, y) mm to texture pixels."""
        s = 1.0 / self.texel_mm
        return np.array([[s, 0, HALF_MM * s], [0, s, HALF_MM * s], [0, 0, 1.0]])


def _noise(rng: np.random.Generator, size: int, sigma_x: float, sigma_y: float) -> np.ndarray:
    field = cv2.GaussianBlur(
        rng.standard_normal((size, size)).astype(np.float32), (0, 0), sigmaX=max(sigma_x, 0.3), sigmaY=max(sigma_y, 0.3)
    )
    unit: np.ndarray = field / max(float(field.std()), 1e-6)
    return unit


def make_table(rng: np.random.Generator, kind: TableKind, px_per_mm: float) -> Table:
    """Draw a table top at about `px_per_mm` texels per mm."""
    size = int(np.clip(2 * HALF_MM * px_per_mm, 96, 2600)) + 1
    texel = 2 * HALF_MM / (size - 1)
    draw = {"wood": _wood, "print": _print, "grid": _grid, "speckle": _speckle}[kind]
    texture = np.clip(draw(rng, size, texel), 0.01, 0.92).astype(np.float32)
    gloss = {"wood": 0.5, "print": 0.15, "grid": 0.3, "speckle": 0.6}[kind]
    return Table(kind, texture, texel, gloss)


def _wood(rng: np.random.Generator, size: int, texel: float) -> np.ndarray:
    base = np.array([0.36, 0.23, 0.13]) * rng.uniform(0.6, 1.35)
    fine = _noise(rng, size, 45 / texel, 0.35 / texel)
    broad = _noise(rng, size, 160 / texel, 6 / texel)
    x, y = np.meshgrid(np.arange(size) * texel, np.arange(size) * texel)
    ring = np.sin((y + 14 * broad + 0.0004 * (x - 500) ** 2) / 5.5)
    plank_mm = rng.uniform(90, 160)
    plank = (y / plank_mm).astype(int)
    tone = rng.uniform(0.82, 1.15, plank.max() + 1)[plank]
    gap = np.abs((y % plank_mm) - plank_mm / 2) > plank_mm / 2 - 0.7
    value = tone * np.exp(0.10 * fine + 0.10 * ring + 0.10 * broad) * np.where(gap, 0.35, 1.0)
    return np.asarray(value[..., None] * base)


def _print(rng: np.random.Generator, size: int, texel: float) -> np.ndarray:
    image = np.full((size, size, 3), 0.66, np.float32) * rng.uniform(0.8, 1.1)
    for _ in range(int(rng.integers(4, 8))):  # coloured sheets
        centre, extent, angle = rng.uniform(0.2, 0.8, 2) * size, rng.uniform(90, 260, 2) / texel, rng.uniform(0, 180)
        corners = cv2.boxPoints((tuple(centre), tuple(extent), angle))
        colour = rng.uniform(0.05, 0.75, 3) if rng.random() < 0.6 else np.full(3, rng.uniform(0.05, 0.8))
        cv2.fillPoly(image, [corners.astype(np.int32)], [float(c) for c in colour], cv2.LINE_AA)
        _text(rng, image, corners, texel)
    corners = np.array([[0.04, 0.04], [0.96, 0.04], [0.96, 0.96], [0.04, 0.96]]) * size
    _text(rng, image, corners.astype(np.float32), texel, share=0.35)
    return _soft(image)


def _soft(image: np.ndarray) -> np.ndarray:
    """Takes the stairs off drawn lines: OpenCV draws smooth ones in 8 bits only."""
    return np.asarray(cv2.GaussianBlur(image, (0, 0), 0.7))


def _text(rng: np.random.Generator, image: np.ndarray, corners: np.ndarray, texel: float, share: float = 0.8) -> None:
    """Lines of dashes, the look of print, inside a rectangle given by its corners (4, 2)."""
    origin, right, down = corners[0], corners[1] - corners[0], corners[3] - corners[0]
    width, height = np.linalg.norm(right) * texel, np.linalg.norm(down) * texel
    ink = [float(c) for c in rng.uniform(0.02, 0.15, 3)]
    line_mm = rng.uniform(5, 11)
    for row in np.arange(line_mm, height - line_mm, line_mm):
        if rng.random() > share:
            continue
        at, end = line_mm, width * rng.uniform(0.5, 0.95)
        while at < end:
            dash = rng.uniform(2, 12)
            a = origin + right * at / width + down * row / height
            b = origin + right * min(at + dash, end) / width + down * row / height
            thick = max(1, round(0.28 * line_mm / texel))
            cv2.line(image, tuple(np.rint(a).astype(int)), tuple(np.rint(b).astype(int)), ink, thick, cv2.LINE_AA)
            at += dash + rng.uniform(1.5, 4)


def _grid(rng: np.random.Generator, size: int, texel: float) -> np.ndarray:
    base = np.array([[0.05, 0.16, 0.11], [0.06, 0.10, 0.25], [0.10, 0.10, 0.11]])[rng.integers(3)]
    image = np.ones((size, size, 3), np.float32) * base.astype(np.float32)
    image *= np.exp(0.12 * _noise(rng, size, 1.0, 1.0) + 0.08 * _noise(rng, size, 60, 60))[..., None]
    ink = [float(c) for c in np.array([0.75, 0.74, 0.55]) * rng.uniform(0.6, 1.0)]
    turn = np.deg2rad(rng.uniform(0, 90))
    u, v = np.array([np.cos(turn), np.sin(turn)]), np.array([-np.sin(turn), np.cos(turn)])
    middle = np.array([size / 2, size / 2])
    for step_mm, thick_mm in ((10, 0.25), (50, 0.9)):
        thick = max(1, round(thick_mm / texel))
        shade = ink if step_mm == 50 else [0.5 * c + 0.5 * float(b) for c, b in zip(ink, base, strict=True)]
        for k in range(-90, 91):
            offset = k * step_mm / texel
            for a, b in ((u, v), (v, u)):
                p, q = middle + offset * a - size * b, middle + offset * a + size * b
                cv2.line(image, tuple(np.rint(p).astype(int)), tuple(np.rint(q).astype(int)), shade, thick, cv2.LINE_AA)
    return _soft(image)


def _speckle(rng: np.random.Generator, size: int, texel: float) -> np.ndarray:
    base = np.array([0.34, 0.33, 0.31]) * rng.uniform(0.4, 1.4)
    fine, broad = _noise(rng, size, 0.6 / texel, 0.6 / texel), _noise(rng, size, 25 / texel, 25 / texel)
    value = np.exp(0.09 * fine + 0.05 * broad)
    image = value[..., None] * base
    grains = _noise(rng, size, 1.0 / texel, 1.0 / texel)
    image[grains > 2.3] *= 0.35
    image[grains < -2.4] *= 1.7
    return np.asarray(image)
