"""The renderer: one picture from four passes, each with its own sub-pixel offset and its own moment of the exposure.

The mean of the passes anti-aliases and blurs motion at once, and stays centred on the mid-exposure pose because
offsets and moments both have mean zero. A picture that is read row by row is made of bands of rows, each at its own
time.
Convention: world frame, mm; images are linear RGB; pixel (0, 0) is the centre of the top-left pixel.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from data_recipes.metal.environment import Patch
from data_recipes.metal.lighting import LightMap, ambient_shade, lamp_shade, light_map
from data_recipes.metal.primary_hits import BodyHits
from data_recipes.metal.render_pass import KeptColours, Pass
from data_recipes.metal.scene import Scene

Passes = tuple[tuple[float, float, float], ...]
"""Offset of each pass in px, x and y, and its moment of the exposure, from -0.5 to 0.5."""
PASSES: Passes = ((-0.25, -0.25, -0.375), (0.25, -0.25, 0.125), (-0.25, 0.25, 0.375), (0.25, 0.25, -0.125))
LONG_PASSES: Passes = (
    (-0.375, -0.375, -0.4375), (0.125, 0.375, -0.3125), (-0.125, 0.125, -0.1875), (0.375, -0.125, -0.0625),
    (-0.25, 0.25, 0.0625), (0.25, -0.25, 0.1875), (0.0, 0.45, 0.3125), (0.0, -0.45, 0.4375),
)  # fmt: skip
"""Of exposures in which the part moves by more than some px: with four moments it would be seen four times."""

_BAND_ROWS = 16


@dataclass(frozen=True, eq=False)
class Picture:
    """Linear RGB image (h, w, 3) float32, and two masks (h, w): the part if it were alone, and what is seen of it."""

    image: np.ndarray
    part_alone: np.ndarray
    part_seen: np.ndarray


class Renderer:
    """Renders frames of one scene; the bench's own shadows are worked out once and kept."""

    def __init__(self, scene: Scene, passes: Passes = PASSES) -> None:
        self._scene = scene
        self._passes = passes
        camera = scene.camera
        u, v = np.meshgrid(np.arange(camera.width, dtype=float), np.arange(camera.height, dtype=float))
        self._rays_cam = camera.rays(np.stack([u.ravel(), v.ravel()], 1))
        self._map_size = int(np.clip(camera.width * 0.45, 64, 288))
        self._kept: dict[Patch, np.ndarray] = {}
        self._open: np.ndarray | None = None
        self._bench_hits: dict[int, BodyHits] = {}

    def frame(self, index: int) -> Picture:
        """Render one frame."""
        return self.picture(index, float(index), self.table_light(index))

    def picture(self, index: int, time: float, light: LightMap) -> Picture:
        """Render a frame as it is seen at a time in frames, with what falls on the table."""
        total = np.zeros((self._scene.camera.height, self._scene.camera.width, 3), np.float32)
        masks: tuple[np.ndarray, np.ndarray] | None = None
        kept = KeptColours(len(self._rays_cam))
        for k, (dx, dy, dt) in enumerate(self._passes):
            now = self._scene.at(time + dt * self._scene.exposure_frames)
            rng = np.random.default_rng([self._scene.config.seed, 100, index, k])
            # A held part is seen by a camera that stands still: pass k meets the bench where it did in the last frame.
            one = Pass(self._scene, now, light, self._rays_cam, (dx, dy), rng, kept, self._bench_hits.get(k))
            image, alone, seen = one.render()
            if self._scene.held and one.bench_hits is not None:
                self._bench_hits[k] = one.bench_hits
            total += image / len(self._passes)
            masks = masks or (alone, seen)
        assert masks is not None
        return Picture(total, *masks)

    def table_light(self, index: int) -> LightMap:
        """The table's light map of a frame: shadows of what stands still are kept for as long as their lamp does."""
        moment = self._scene.at(float(index))
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


class RowByRowRenderer:
    """Renders frames that a rolling shutter reads row by row, from the top, see `Scene.read_at`."""

    def __init__(self, scene: Scene) -> None:
        self._scene = scene
        self._whole = Renderer(scene)
        camera, starts = scene.camera, range(0, scene.camera.height, _BAND_ROWS)
        # The band of a picture is the picture of a lower camera.
        bands = [replace(camera, height=min(_BAND_ROWS, camera.height - y), cy=camera.cy - y) for y in starts]
        self._bands = [Renderer(replace(scene, camera=band)) for band in bands]
        self._rows = [y + 0.5 * (band.height - 1) for y, band in zip(starts, bands, strict=True)]

    def frame(self, index: int) -> Picture:
        """Render one frame."""
        light = self._whole.table_light(index)
        times = [self._scene.read_at(index, row) for row in self._rows]
        bands = [band.picture(index, time, light) for band, time in zip(self._bands, times, strict=True)]
        image, alone, seen = (
            np.concatenate([getattr(band, name) for band in bands]) for name in ("image", "part_alone", "part_seen")
        )
        return Picture(image, alone, seen)


def _enlarged(shade: np.ndarray, size: int) -> np.ndarray:
    """A light-map shade (s, s) resampled to (size, size); both span the map from edge texel to edge texel."""
    at = np.linspace(0, len(shade) - 1, size, dtype=np.float32)
    return np.asarray(cv2.remap(shade, *np.meshgrid(at, at), cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE))
