"""Outer contours of a part, and how well two of them agree after the best turn, shift and scale in the image.

Convention: contours are closed, (n, 2) px at even steps, of the largest region alone, holes left out: the "outer
contour" that region-based trackers and the eye see first. A turn in the image is a roll of the camera, a shift
and a scale are (nearly) a shift of the part and a change of its distance.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from acp_lab.cad.part import Part
from acp_lab.cad.raycast import RayCaster, hit_map
from acp_lab.errors import GeometryError
from acp_lab.geometry.arrays import BoolArray, FloatArray
from acp_lab.geometry.camera import Camera
from acp_lab.geometry.pose import make_pose, so3_exp

CONTOUR_POINTS = 256
PROFILE_BINS = 72


def outer_contour(
    part: Part, caster: RayCaster, camera: Camera, cam_T_obj: FloatArray, count: int = CONTOUR_POINTS
) -> FloatArray:
    """The outer contour of the part at a pose (4, 4), by rays: (count, 2) px.

    Raises GeometryError when the part is not in the image.
    """
    _, face = hit_map(part, caster, camera, cam_T_obj)
    return mask_contour(face >= 0, count)


def mask_contour(mask: BoolArray, count: int = CONTOUR_POINTS) -> FloatArray:
    """The outer contour of the largest region of a mask (h, w) bool: (count, 2) px.

    It runs through the outermost pixels' centres. Raises GeometryError for an empty mask.
    """
    found, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    if not found:
        raise GeometryError("outer contour of an empty mask: the part is not in the image, check its pose")
    chain = max(found, key=len)[:, 0].astype(np.float64)
    closed = np.vstack([chain, chain[:1]])
    lengths = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(closed, axis=0), axis=1))])
    at = np.linspace(0.0, lengths[-1], count, endpoint=False)
    return np.stack([np.interp(at, lengths, closed[:, k]) for k in range(2)], 1)


def radial_profile(contour: FloatArray) -> FloatArray:
    """(PROFILE_BINS,) how far the contour reaches in each direction from its middle, scaled to mean square 1.

    A turn of the contour is a cyclic shift of the profile. Empty directions take their neighbours' value.
    """
    arms = contour - contour.mean(0)
    reach = np.linalg.norm(arms, axis=1)
    angle = np.arctan2(arms[:, 1], arms[:, 0])
    bins = np.round(angle * (PROFILE_BINS / (2.0 * np.pi))).astype(int) % PROFILE_BINS
    profile = np.full(PROFILE_BINS, -1.0)
    np.maximum.at(profile, bins, reach)
    filled = np.flatnonzero(profile >= 0.0)
    profile = np.interp(np.arange(PROFILE_BINS), filled, profile[filled], period=PROFILE_BINS)
    return np.asarray(profile / np.sqrt((profile**2).mean()))


def profile_distances(profile: FloatArray, others: FloatArray) -> FloatArray:
    """(k, PROFILE_BINS) mean squared difference between a profile (b,) and each of others (k, b), turned.

    Column j turns the other contour by +j bins (from x towards y).
    """
    spectrum = np.fft.rfft(profile) * np.conj(np.fft.rfft(others, axis=1))
    correlation = np.fft.irfft(spectrum, n=PROFILE_BINS, axis=1) / PROFILE_BINS
    return np.asarray(np.maximum(2.0 - 2.0 * correlation, 0.0))


@dataclass(frozen=True)
class ImageAlignment:
    """A similarity of the image: x -> scale * R(angle_rad) (x - source) + target, px."""

    angle_rad: float
    scale: float
    source: tuple[float, float]
    target: tuple[float, float]

    def apply(self, points: FloatArray) -> FloatArray:
        """Points (n, 2) px, moved."""
        c, s = np.cos(self.angle_rad), np.sin(self.angle_rad)
        turned: FloatArray = (points - self.source) @ np.array([[c, s], [-s, c]]) * self.scale + self.target
        return turned

    def of_pose(self, cam_T_obj: FloatArray, centre_obj: FloatArray, camera: Camera) -> FloatArray:
        """The pose (4, 4) whose image is about the moved one: rolled, shifted and brought nearer or further.

        Exact for a part much smaller than its distance. centre_obj: (3,) mm, which is moved exactly.
        """
        rolled = so3_exp(np.array([0.0, 0.0, self.angle_rad])) @ cam_T_obj[:3, :3]
        centre_cam = cam_T_obj[:3, :3] @ centre_obj + cam_T_obj[:3, 3]
        place = self.apply(camera.project(centre_cam[None]))
        moved_cam = camera.rays(place)[0] * centre_cam[2] / self.scale
        return make_pose(rolled, moved_cam - rolled @ centre_obj)


def align_contours(contour: FloatArray, target: FloatArray, turn_bins: int) -> ImageAlignment:
    """The similarity that lays a contour on a target, near a known turn of `turn_bins` profile bins.

    Middles meet, the mean square radii agree, and the turn is the best of those within one bin.
    """
    source_middle, target_middle = contour.mean(0), target.mean(0)
    spread = [float(np.sqrt(((c - c.mean(0)) ** 2).sum(1).mean())) for c in (contour, target)]
    bin_rad = 2.0 * np.pi / PROFILE_BINS
    trials = [
        ImageAlignment((turn_bins + part) * bin_rad, spread[1] / spread[0], tuple(source_middle), tuple(target_middle))
        for part in np.linspace(-1.0, 1.0, 9)
    ]
    return min(trials, key=lambda trial: contour_distance(trial.apply(contour), target))


def contour_distance(first: FloatArray, second: FloatArray) -> float:
    """Mean distance, both ways, between two contours' points (n, 2) and (m, 2), px."""
    apart = np.linalg.norm(first[:, None] - second[None], axis=2)
    return 0.5 * float(apart.min(1).mean() + apart.min(0).mean())
