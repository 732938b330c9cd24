"""From light to a picture file: lens blur, fall-off, exposure, photon and read noise, tone curve."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np


@dataclass(frozen=True)
class Sensor:
    """blur_px: deviation of the lens blur; gain: how noisy; falloff: darkening in the corners; exposure: scale."""

    exposure: float
    blur_px: float
    gain: float
    falloff: float

    def expose(self, light: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """(h, w, 3) linear light -> (h, w, 3) RGB uint8."""
        h, w = light.shape[:2]
        image = cv2.GaussianBlur(light, (0, 0), self.blur_px) * np.float32(self.exposure)
        y, x = np.mgrid[:h, :w]
        radius = ((x - w / 2) ** 2 + (y - h / 2) ** 2) / ((w / 2) ** 2 + (h / 2) ** 2)
        image *= (1 - self.falloff * radius)[..., None].astype(np.float32)
        image = np.minimum(image, 4.0)
        # Photon noise grows with the root of the light; read noise is there in the dark.
        deviation = self.gain * np.sqrt(3e-4 * image + 8e-6)
        image = image + deviation * rng.standard_normal(image.shape).astype(np.float32)
        return np.asarray(np.rint(255 * tone(np.clip(image, 0, None))), np.uint8)


def tone(linear: np.ndarray) -> np.ndarray:
    """Tone curve to [0, 1]: sRGB's gamma with a soft shoulder above 0.7, as camera pictures have."""
    knee = 0.6
    soft = np.where(linear > knee, knee + (1 - knee) * (1 - np.exp(-(linear - knee) / (1 - knee))), linear)
    low = 12.92 * soft
    high = 1.055 * np.power(np.maximum(soft, 1e-6), 1 / 2.4) - 0.055
    return np.asarray(np.clip(np.where(soft <= 0.0031308, low, high), 0, 1))


def make_sensor(rng: np.random.Generator, first: np.ndarray, part: np.ndarray) -> Sensor:
    """A camera set up on the first frame (h, w, 3): exposed for the whole picture, sparing the part (mask)."""
    grey = first.mean(2)
    target = rng.uniform(0.20, 0.30) / max(float(np.mean(np.minimum(grey, np.quantile(grey, 0.97)))), 1e-6)
    if part.any():  # a part that glares on the first frame may lower the exposure to a half, no further
        target = min(target, max(0.9 / max(float(np.quantile(grey[part], 0.75)), 1e-6), 0.5 * target))
    scale = first.shape[1] / 640.0
    blur_px = rng.uniform(0.5, 0.62) * max(scale, 1.0) ** 0.5
    return Sensor(target, blur_px, gain=rng.uniform(0.6, 1.0), falloff=rng.uniform(0.05, 0.22))
