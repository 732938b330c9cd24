"""Where the CAD's edge lies beside an image edge, by what the image looks like across it.

A broken edge shows as a bright or dark line beside the step from face to face; a rounded rim darkens before the ground
begins; motion smears all of it. Such a profile, and how the two faces are seen, tell where the drawing's sharp edge
would be: a small network, trained on rendered parts with broken and sharp edges, says by how many px the CAD's edge
lies beside the image edge, and how unsure that is. What it cannot know, as all edges of a part share it, is left to
`contour_offsets`.
(Not in the paper, which takes image edges as they are; see docs/paper-ledger.md. How it is trained:
data_recipes/edge_profiles.py.)

Convention: across an edge, positive leads off the material for outlines, else towards the face that turns away more.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import ClassVar

import numpy as np
from safetensors.numpy import load_file, save_file

from acp_lab.cad.edges import EdgeSamples
from acp_lab.compiled import kernel
from acp_lab.errors import TrackingError
from acp_lab.files import replacing
from acp_lab.geometry.arrays import BoolArray, Float32Array, FloatArray, IntArray, plain
from acp_lab.imaging.edge_search import Candidates, ImagePatch
from acp_lab.imaging.edge_search_kernel import read_profile
from acp_lab.prepared_part import DEFAULT_EDGE_BREAK_MM

WEIGHTS = Path(__file__).with_name("edge_profiles.safetensors")
# Slopes are read a px apart up to so many px from the edge; what is farther is another edge's.
_REACH_PX = 5
# Where the grey on either side is read, beside the ends.
_BESIDE_PX = 3
_PROFILE = 2 * _REACH_PX + 1
FEATURES = _PROFILE + 5 + 8 + 9 + 3
# A feature farther from its mean, in standard deviations, was never seen in training.
FARTHEST = 6.0
LEAST_LOG_SPREAD, MOST_LOG_SPREAD = -4.0, 2.0


@dataclass(frozen=True)
class ProfileConfig:
    """How much profiles say.

    Attributes:
        largest_px: no edge is moved by more.
        spread_share: of the network's own spread that is taken for the scatter of an edge about its true place.
        break_share: of a part's edge break beyond the usual one, by which its outlines lie farther inside than their
            profiles tell.
    """

    kind: ClassVar[str] = "on"
    largest_px: float = 1.5
    spread_share: float = 1.0
    break_share: float = 0.4

    def __post_init__(self) -> None:
        for name in ("largest_px", "spread_share"):
            if not 0.0 < getattr(self, name) <= 100.0:
                raise TrackingError(f"learning.profiles.{name} = {getattr(self, name):g}: give a number above 0")
        if not 0.0 <= self.break_share <= 10.0:
            raise TrackingError(f"learning.profiles.break_share = {self.break_share:g}: give 0 to 10")

    def expected_mm(self, edge_break_mm: float) -> float:
        """Where outlines are expected beside what their profiles tell, outward, before any was measured."""
        return -self.break_share * (edge_break_mm - DEFAULT_EDGE_BREAK_MM)


@dataclass(frozen=True, eq=False)
class EdgeViews:
    """How n edge samples are seen.

    Attributes:
        edges: all samples of the part; ids: (n,) rows of those that are meant.
        outline: (n,) bool, which of these are silhouettes.
        cam_T_obj: (4, 4) mm; focal_px: of the camera.
    """

    edges: EdgeSamples
    ids: IntArray
    outline: BoolArray
    cam_T_obj: FloatArray
    focal_px: float


@dataclass(frozen=True, eq=False)
class Profiles:
    """What k candidates look like.

    Attributes:
        rows, columns: (k,) of the candidates.
        sides: (n,) 1 where positive across the edge is along the sample's image normal, -1 where against it.
        features: (k, FEATURES) float32.
    """

    rows: IntArray
    columns: IntArray
    sides: FloatArray
    features: Float32Array


def describe(
    patch: ImagePatch, points: FloatArray, normals: FloatArray, candidates: Candidates, views: EdgeViews,
    sigma_px: float, least: float,
) -> Profiles:  # fmt: skip
    """The profiles of all candidates whose score times nearness is above `least`; others could not be chosen.

    Args:
        points: (n, 2) px, full image; normals: (n, 2) unit: where the candidates were searched, and along what.
        sigma_px: how far away a candidate may lie, see `Level`.
    """
    count, edges = candidates.scores.size, views.edges
    rows, columns, sides = np.empty(count, np.int64), np.empty(count, np.int64), np.empty(len(points))
    features = np.empty((count, FEATURES), np.float32)
    found = _describe(
        patch.channels, plain(points - patch.origin), plain(normals), candidates.offsets, candidates.scores,
        edges.points_obj, edges.normals_obj, edges.crease, edges.convex, np.ascontiguousarray(views.ids),
        np.ascontiguousarray(views.outline), plain(views.cam_T_obj), views.focal_px, patch.gamma, sigma_px, least,
        rows, columns, sides, features,
    )  # fmt: skip
    return Profiles(rows[:found], columns[:found], sides, features[:found])


@dataclass(frozen=True, eq=False)
class ProfileNetwork:
    """Two hidden layers: features in, shift in px and logarithm of its spread out.

    weights: (inputs, outputs) float32 of each of three layers; biases: (outputs,) theirs; mean, scale: (FEATURES,).
    """

    weights: tuple[Float32Array, ...]
    biases: tuple[Float32Array, ...]
    mean: Float32Array
    scale: Float32Array

    def __call__(self, features: Float32Array) -> Float32Array:
        """(k, 2) of features (k, FEATURES): px across the edge from the image's to the CAD's, and log of its spread."""
        values: np.ndarray = (features - self.mean) * self.scale
        np.clip(values, -FARTHEST, FARTHEST, out=values)
        for weight, bias in zip(self.weights[:-1], self.biases[:-1], strict=True):
            values = values @ weight
            values += bias
            np.maximum(values, 0.0, out=values)
        found: Float32Array = values @ self.weights[-1] + self.biases[-1]
        np.clip(found[:, 1], LEAST_LOG_SPREAD, MOST_LOG_SPREAD, out=found[:, 1])
        return found


@lru_cache(maxsize=1)
def shipped_network() -> ProfileNetwork:
    """The network that comes with the package."""
    return read_network(WEIGHTS)


def save_network(network: ProfileNetwork, path: Path) -> None:
    """Write a network, whole or not at all. Raises InputFileError where that cannot be done."""
    arrays = {"mean": network.mean, "scale": network.scale}
    for i, (weight, bias) in enumerate(zip(network.weights, network.biases, strict=True)):
        arrays |= {f"weight_{i}": weight, f"bias_{i}": bias}
    with replacing(path, "the network") as temporary:
        save_file(arrays, temporary)


def read_network(path: Path) -> ProfileNetwork:
    """What `save_network` wrote."""
    arrays = load_file(path)
    layers = range(sum(name.startswith("weight") for name in arrays))
    return ProfileNetwork(
        tuple(np.ascontiguousarray(arrays[f"weight_{i}"]) for i in layers),
        tuple(arrays[f"bias_{i}"] for i in layers),
        arrays["mean"],
        arrays["scale"],
    )


@dataclass(frozen=True, eq=False)
class ProfileShifts:
    """What the profiles of n samples' m candidates say.

    Attributes:
        shifts_px: (n, m) along the samples' normals from the candidate to the CAD's edge; 0 for those not described.
        spreads_px: (n, m) standard deviation of that; 0 for those not described.
    """

    shifts_px: FloatArray
    spreads_px: FloatArray

    def spread_of_best(self, scores: FloatArray, offsets: FloatArray, sigma_px: float) -> FloatArray:
        """(n,) spread of the candidate that fits best, by scores and offsets (n, m); 0 where none was described."""
        best = (scores * np.exp(-0.5 * (offsets / sigma_px) ** 2)).argmax(1)
        found: FloatArray = self.spreads_px[np.arange(len(best)), best]
        return found


class EdgeProfiles:
    """Asks the network about the candidates of a frame."""

    def __init__(self, config: ProfileConfig, network: ProfileNetwork | None = None) -> None:
        """network: another one than the package's."""
        self.config = config
        self._network = shipped_network() if network is None else network

    def read(
        self,
        patch: ImagePatch,
        points: FloatArray,
        normals: FloatArray,
        candidates: Candidates,
        views: EdgeViews,
        sigma_px: float,
        least: float,
    ) -> ProfileShifts:
        """Shifts and spreads of the candidates that `describe` describes; arguments as there."""
        profiles = describe(patch, points, normals, candidates, views, sigma_px, least)
        shifts, spreads = np.zeros((2, *candidates.scores.shape))
        if len(profiles.rows):
            found = self._network(profiles.features).astype(np.float64)
            limit, at = self.config.largest_px, (profiles.rows, profiles.columns)
            shifts[at] = np.clip(found[:, 0], -limit, limit) * profiles.sides[profiles.rows]
            spreads[at] = self.config.spread_share * np.exp(found[:, 1])
        return ProfileShifts(shifts, spreads)


@kernel("f8(f8, f8)")
def _light(grey: float, gamma: float) -> float:
    """Logarithm of the light that a grey level stands for; black is 2% of white, lest noise has a say."""
    return float(np.log((min(max(grey, 0.0), 255.0) / 255.0) ** gamma + 0.02))


@kernel(
    "i8(f4[:, :, ::1], f8[:, ::1], f8[:, ::1], f8[:, ::1], f8[:, ::1], f8[:, ::1], f8[:, :, ::1], b1[::1], b1[::1],"
    " i8[::1], b1[::1], f8[:, ::1], f8, f8, f8, f8, i8[::1], i8[::1], f8[::1], f4[:, ::1])"
)
def _describe(
    channels: Float32Array, points: FloatArray, normals: FloatArray, offsets: FloatArray, scores: FloatArray,
    points_obj: FloatArray, normals_obj: FloatArray, crease: BoolArray, convex: BoolArray, ids: IntArray,
    outline: BoolArray, pose: FloatArray, focal: float, gamma: float, sigma: float, least: float, rows: IntArray,
    columns: IntArray, sides: FloatArray, features: Float32Array,
) -> int:  # fmt: skip
    """Fill rows, columns, sides and features, see `Profiles`; returns how many candidates were described."""
    count, narrow = 0, -0.5 / (sigma * sigma)
    view, across, along = np.empty(3), np.empty(3), np.empty(3)
    at, faces, facing = np.empty(3), np.empty((2, 3)), np.empty((2, 3))
    profile = np.empty((3, _PROFILE))
    for i in range(len(points)):
        sample, nx, ny = ids[i], normals[i, 0], normals[i, 1]
        for k in range(3):
            at[k], faces[0, k], faces[1, k] = pose[k, 3], 0.0, 0.0
            for j in range(3):
                at[k] += pose[k, j] * points_obj[sample, j]
                faces[0, k] += pose[k, j] * normals_obj[sample, 0, j]
                faces[1, k] += pose[k, j] * normals_obj[sample, 1, j]
        # Axes at the sample: to the eye, across the edge in the image plane, along it.
        length = np.sqrt(at[0] * at[0] + at[1] * at[1] + at[2] * at[2])
        for k in range(3):
            view[k] = -at[k] / length
        into = nx * view[0] + ny * view[1]
        across[0], across[1], across[2] = nx - into * view[0], ny - into * view[1], -into * view[2]
        length = max(np.sqrt(across[0] ** 2 + across[1] ** 2 + across[2] ** 2), 1e-9)
        for k in range(3):
            across[k] /= length
        along[0] = view[1] * across[2] - view[2] * across[1]
        along[1] = view[2] * across[0] - view[0] * across[2]
        along[2] = view[0] * across[1] - view[1] * across[0]
        first_view, second_view = 0.0, 0.0
        for k in range(3):
            first_view += faces[0, k] * view[k]
            second_view += faces[1, k] * view[k]
        # The first face is the one that turns to the eye more.
        front = 1 if second_view > first_view else 0
        for which in range(2):
            face = front if which == 0 else 1 - front
            for k in range(3):
                facing[which, k] = 0.0
            for k in range(3):
                facing[which, 0] += faces[face, k] * across[k]
                facing[which, 1] += faces[face, k] * view[k]
                facing[which, 2] += faces[face, k] * along[k]
        towards = facing[0, 0] + facing[1, 0] if outline[i] else facing[1, 0] - facing[0, 0]
        side = -1.0 if towards < 0.0 else 1.0
        sides[i] = side
        turn = facing[0, 0] * facing[1, 0] + facing[0, 1] * facing[1, 1] + facing[0, 2] * facing[1, 2]
        scale = np.log(focal / at[2])
        for m in range(offsets.shape[1]):
            if not scores[i, m] * np.exp(narrow * offsets[i, m] * offsets[i, m]) > least:
                continue
            first = offsets[i, m] - side * _REACH_PX
            x, y = points[i, 0] + first * nx, points[i, 1] + first * ny
            read_profile(channels, x, y, side * nx, side * ny, profile)
            middle = profile[0, _REACH_PX]
            peak = abs(middle) + 1e-3
            sign = -1.0 if middle < 0.0 else 1.0
            row = features[count]
            for k in range(_PROFILE):
                row[k] = min(max(sign * profile[0, k] / peak, -3.0), 3.0)
            place = _PROFILE
            for k in range(5):
                row[place + k] = min(abs(profile[1, 2 * k + 1]) / peak, 2.0)
            place += 5
            row[place], row[place + 1] = np.log(peak), sign
            row[place + 2] = _light(profile[2, _REACH_PX - _BESIDE_PX], gamma)
            row[place + 3] = _light(profile[2, _REACH_PX + _BESIDE_PX], gamma)
            row[place + 4], row[place + 5] = _light(profile[2, 0], gamma), _light(profile[2, _PROFILE - 1], gamma)
            row[place + 6], row[place + 7] = scale, scores[i, m]
            place += 8
            for k in range(3):
                # The axis to the eye stays; the others turn with the side, so that it does not matter.
                flip = 1.0 if k == 1 else side
                row[place + k], row[place + 3 + k] = flip * facing[0, k], flip * facing[1, k]
            row[place + 6], row[place + 7], row[place + 8] = outline[i], crease[sample], convex[sample]
            place += 9
            row[place], row[place + 1], row[place + 2] = turn, side * nx, side * ny
            rows[count], columns[count] = i, m
            count += 1
    return count
