"""Where the CAD's edge lies beside an image edge, by what the image looks like across it.

A broken edge shows as a bright or dark line beside the step from face to face; a rounded rim darkens before the ground
begins; motion smears all of it. Such a profile, and how the two faces are seen, tell where the drawing's sharp edge
would be: a small network, trained on rendered parts with broken and sharp edges, says by how many px the CAD's edge
lies beside the image edge, and how unsure that is. What all edges of a part share it cannot know; it says by how much
that would move the edge, and `edge_traits` finds it out. What is left is for `contour_offsets`.
(Not in the paper, which takes image edges as they are; see docs/paper-ledger.md. How it is trained:
data_recipes/edge_profiles.py.)

Convention: across an edge, positive leads off the material for outlines, else towards the face that turns away more.
"""

from __future__ import annotations

from collections.abc import Mapping
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
from acp_lab.imaging.edge_search import Candidates, ImagePatch, half_widths
from acp_lab.imaging.edge_search_kernel import at_grey, average_along, read_profile
from acp_lab.prepared_part import DEFAULT_EDGE_BREAK_MM
from acp_lab.tracking.learning.edge_traits import EdgeTraits

WEIGHTS = Path(__file__).with_name("edge_profiles.safetensors")
# Slopes are read a px apart up to so many px from the edge; what is farther is another edge's.
_REACH_PX = 5
# Where the grey on either side is read, beside the ends.
_BESIDE_PX = 3
_PROFILE = 2 * _REACH_PX + 1
FEATURES = _PROFILE + 5 + 8 + 9 + 3 + 1
# A feature farther from its mean, in standard deviations, was never seen in training.
FARTHEST = 6.0
LEAST_LOG_SPREAD, MOST_LOG_SPREAD = -4.0, 2.0
# Candidates that are multiplied with a layer at once. Of more than about 100 the linear algebra (OpenBLAS) would make
# work for several threads, which wait for each other for 20 ms at times where other work keeps a core.
_ROWS = 96


@dataclass(frozen=True)
class ProfileConfig:
    """How much profiles say. mm are of parts of usual size, see `part_size`.

    Attributes:
        largest_px: no edge is moved by more.
        spread_share: of the network's own spread that is taken for the scatter of an edge about its true place.
        break_share: of a part's edge break beyond the usual one, usual_break_mm, by which its outlines lie farther
            inside than their profiles tell.
        outline_mm: where outlines of usual parts are expected beside what their profiles tell, outward. The network has
            learnt from rasterised pictures; with this much, frames of path-traced tuning sequences that are solved from
            the true pose are neither too far away nor too near on average.
        evidence_share: how much of what an edge says of the part's traits is new, as neighbours err alike; 0 for a
            usual part, whatever the edges say. See `edge_traits`.
        trait_memory: share of what earlier frames told of the traits that is kept from frame to frame.
        trait_shift_mm: standard deviation of the shift by which a solved pose may be off where traits are learnt: so
            large that edges alone tell it.
    """

    kind: ClassVar[str] = "on"
    in_mm: ClassVar[Mapping[str, int]] = {"usual_break_mm": 1, "outline_mm": 1, "trait_shift_mm": 1}
    largest_px: float = 1.5
    spread_share: float = 0.7
    break_share: float = 0.4
    usual_break_mm: float = DEFAULT_EDGE_BREAK_MM
    outline_mm: float = -0.03
    evidence_share: float = 0.04
    trait_memory: float = 0.7
    trait_shift_mm: float = 20.0

    def __post_init__(self) -> None:
        for name in ("largest_px", "spread_share"):
            value = getattr(self, name)
            if not 0.0 < value <= 100.0:
                raise TrackingError(f"learning.profiles.{name} = {value:g}: give a number above 0, at most 100")
        if not 0.0 <= self.break_share <= 10.0:
            raise TrackingError(f"learning.profiles.break_share = {self.break_share:g}: give 0 to 10")
        if not abs(self.outline_mm) <= 1e6:
            raise TrackingError(f"learning.profiles.outline_mm = {self.outline_mm:g}: give mm from -1e6 to 1e6")
        if not 0.0 <= self.usual_break_mm <= 1e6:
            raise TrackingError(f"learning.profiles.usual_break_mm = {self.usual_break_mm:g}: give mm from 0 to 1e6")
        if not 0.0 <= self.evidence_share <= 1.0:
            raise TrackingError(f"learning.profiles.evidence_share = {self.evidence_share:g}: give 0 to 1")
        if not 0.0 <= self.trait_memory < 1.0:
            raise TrackingError(f"learning.profiles.trait_memory = {self.trait_memory:g}: give 0 to less than 1")
        if not 1e-9 <= self.trait_shift_mm <= 1e9:
            raise TrackingError(f"learning.profiles.trait_shift_mm = {self.trait_shift_mm:g}: give mm from 1e-9 to 1e9")

    def expected_mm(self, edge_break_mm: float) -> float:
        """Where outlines are expected beside what their profiles tell, outward, before any was measured."""
        return self.outline_mm - self.break_share * (edge_break_mm - self.usual_break_mm)


@dataclass(frozen=True, eq=False)
class EdgeViews:
    """How n edge samples are seen.

    Attributes:
        edges: all samples of the part; ids: (n,) rows of those that are meant.
        outline: (n,) bool, which of these are silhouettes.
        cam_T_obj: (4, 4) mm; focal_px: of the camera.
        times_usual: of the part, see `Part.times_usual`. The network knows parts of usual size: it is told how large
            such a part would appear at the same place in the image.
    """

    edges: EdgeSamples
    ids: IntArray
    outline: BoolArray
    cam_T_obj: FloatArray
    focal_px: float
    times_usual: float


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
    sigma_px: float, least: float, blur_px: FloatArray | None = None,
) -> Profiles:  # fmt: skip
    """The profiles of all candidates whose score times nearness is above `least`; others could not be chosen.

    Args:
        points: (n, 2) px, full image; normals: (n, 2) unit: where the candidates were searched, and along what.
        sigma_px: how far away a candidate may lie, see `Level`.
        blur_px: (n,) over which motion smears edges along the normals; None for not at all.
    """
    smear = np.zeros(len(points)) if blur_px is None else np.abs(blur_px)
    halves = np.zeros(len(points), np.int64) if blur_px is None else half_widths(smear)
    count, edges = candidates.scores.size, views.edges
    rows, columns, sides = np.empty(count, np.int64), np.empty(count, np.int64), np.empty(len(points))
    features = np.empty((count, FEATURES), np.float32)
    found = _describe(
        patch.channels, *patch.origin, plain(points), plain(normals), candidates.offsets, candidates.scores,
        edges.points_obj, edges.normals_obj, edges.crease, edges.convex, np.ascontiguousarray(views.ids),
        np.ascontiguousarray(views.outline), plain(views.cam_T_obj), views.times_usual * views.focal_px,
        _log_light(patch.gamma), sigma_px, least, smear, halves, rows, columns, sides, features,
    )  # fmt: skip
    return Profiles(rows[:found], columns[:found], sides, features[:found])


@dataclass(frozen=True, eq=False)
class ProfileNetwork:
    """Two hidden layers: features in; shift in px, logarithm of its spread, and px that each trait moves it by, out.

    weights: (inputs, outputs) float32 of each of three layers; biases: (outputs,) theirs; mean, scale: (FEATURES,).
    """

    weights: tuple[Float32Array, ...]
    biases: tuple[Float32Array, ...]
    mean: Float32Array
    scale: Float32Array

    @property
    def traits(self) -> int:
        """How many it knows of."""
        return len(self.biases[-1]) - 2

    def __call__(self, features: Float32Array) -> Float32Array:
        """(k, 2 + traits) of features (k, FEATURES): px across the edge from the image's to the CAD's on a usual part,
        log of its spread, px that each trait adds."""
        (first, second, last), (first_bias, second_bias, last_bias) = self.weights, self.biases
        shown, found = np.empty(features.shape, np.float32), np.empty((len(features), 2 + self.traits), np.float32)
        _standardise(np.ascontiguousarray(features), self.mean, self.scale, shown)
        hidden = _product(shown, first)
        _rectify(hidden, first_bias)
        farther = _product(hidden, second)
        _rectify(farther, second_bias)
        _answer(farther, np.ascontiguousarray(last.T), last_bias, found)
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
        slopes_px: (n, m, k) by how much each trait moves that place along the normals; 0 for those not described.
        told_with: (k,) the part's traits that the shifts take for true.
    """

    shifts_px: FloatArray
    spreads_px: FloatArray
    slopes_px: FloatArray
    told_with: FloatArray

    def spread_of_best(self, scores: FloatArray, offsets: FloatArray, sigma_px: float) -> FloatArray:
        """(n,) spread of the candidate that fits best, by scores and offsets (n, m); 0 where none was described."""
        found = np.empty(len(scores))
        _spread_of_best(plain(scores), plain(offsets), self.spreads_px, sigma_px, found)
        return found


class EdgeProfiles:
    """Asks the network about the candidates of a frame. traits: of the part, which what is told follows."""

    def __init__(self, config: ProfileConfig, network: ProfileNetwork | None = None) -> None:
        """network: another one than the package's."""
        self.config = config
        self._network = shipped_network() if network is None else network
        self.traits = EdgeTraits(
            self._network.traits, config.evidence_share, config.trait_memory, config.trait_shift_mm
        )

    def read(
        self,
        patch: ImagePatch,
        points: FloatArray,
        normals: FloatArray,
        candidates: Candidates,
        views: EdgeViews,
        sigma_px: float,
        least: float,
        blur_px: FloatArray | None = None,
    ) -> ProfileShifts:
        """Shifts and spreads of the candidates that `describe` describes; arguments as there."""
        profiles = describe(patch, points, normals, candidates, views, sigma_px, least, blur_px)
        shifts, spreads = np.zeros((2, *candidates.scores.shape))
        slopes = np.zeros((*candidates.scores.shape, self._network.traits))
        if len(profiles.rows):
            _put(
                self._network(profiles.features), self.traits.values, profiles.rows, profiles.columns, profiles.sides,
                self.config.largest_px, self.config.spread_share, shifts, spreads, slopes,
            )  # fmt: skip
        return ProfileShifts(shifts, spreads, slopes, self.traits.values)


@lru_cache(maxsize=8)
def _log_light(gamma: float) -> Float32Array:
    """(257,) logarithm of the light at each grey level, see `at_grey`; black is 2% of white, lest noise has a say."""
    table: Float32Array = np.log((np.minimum(np.arange(257.0), 255.0) / 255.0) ** gamma + 0.02).astype(np.float32)
    return table


@kernel(
    "i8(f4[:, :, ::1], f8, f8, f8[:, ::1], f8[:, ::1], f8[:, ::1], f8[:, ::1], f8[:, ::1], f8[:, :, ::1], b1[::1],"
    " b1[::1], i8[::1], b1[::1], f8[:, ::1], f8, f4[::1], f8, f8, f8[::1], i8[::1], i8[::1], i8[::1], f8[::1],"
    " f4[:, ::1])",
    fastmath=frozenset({"contract"}),
)
def _describe(
    channels: Float32Array, x0: float, y0: float, points: FloatArray, normals: FloatArray, offsets: FloatArray,
    scores: FloatArray, points_obj: FloatArray, normals_obj: FloatArray, crease: BoolArray, convex: BoolArray,
    ids: IntArray, outline: BoolArray, pose: FloatArray, focal: float, light: Float32Array, sigma: float, least: float,
    smear: FloatArray, halves: IntArray, rows: IntArray, columns: IntArray, sides: FloatArray, features: Float32Array,
) -> int:  # fmt: skip
    """Fill rows, columns, sides and features, see `Profiles`; returns how many candidates were described.

    channels, x0, y0: see `edge_search_kernel.strongest_peaks`.
    """
    count, narrow = 0, -0.5 / (sigma * sigma)
    view, across, along = np.empty(3), np.empty(3), np.empty(3)
    at, faces, facing = np.empty(3), np.empty((2, 3)), np.empty((2, 3))
    room = 0
    for i in range(len(halves)):
        room = max(room, halves[i])
    middle = room + _REACH_PX
    raw = np.empty((3, 2 * middle + 1), np.float32)
    profile, greys = np.empty((2, _PROFILE), np.float32), raw[2]
    for i in range(len(points)):
        sample, nx, ny = ids[i], normals[i, 0], normals[i, 1]
        for k in range(3):
            place, first_face, second_face = pose[k, 3], 0.0, 0.0
            for j in range(3):
                place += pose[k, j] * points_obj[sample, j]
                first_face += pose[k, j] * normals_obj[sample, 0, j]
                second_face += pose[k, j] * normals_obj[sample, 1, j]
            at[k], faces[0, k], faces[1, k] = place, first_face, second_face
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
            by_across, by_view, by_along = 0.0, 0.0, 0.0
            for k in range(3):
                by_across += faces[face, k] * across[k]
                by_view += faces[face, k] * view[k]
                by_along += faces[face, k] * along[k]
            facing[which, 0], facing[which, 1], facing[which, 2] = by_across, by_view, by_along
        towards = facing[0, 0] + facing[1, 0] if outline[i] else facing[1, 0] - facing[0, 0]
        side = -1.0 if towards < 0.0 else 1.0
        sides[i] = side
        turn = facing[0, 0] * facing[1, 0] + facing[0, 1] * facing[1, 1] + facing[0, 2] * facing[1, 2]
        scale, half = np.log(focal / at[2]), halves[i]
        for m in range(offsets.shape[1]):
            # The exponential is at most 1.
            if not scores[i, m] > least or not scores[i, m] * np.exp(narrow * offsets[i, m] * offsets[i, m]) > least:
                continue
            first = offsets[i, m] - side * middle
            x, y = points[i, 0] - x0 + first * nx, points[i, 1] - y0 + first * ny
            read_profile(channels, x, y, side * nx, side * ny, raw)
            average_along(raw[0], room, half, profile[0])
            average_along(raw[1], room, half, profile[1])
            slope = profile[0, _REACH_PX]
            peak = abs(slope) + 1e-3
            sign = -1.0 if slope < 0.0 else 1.0
            row = features[count]
            # All in single precision, in which twice as many are worked out at once.
            per_peak = np.float32(sign / peak)
            for k in range(_PROFILE):
                row[k] = min(max(per_peak * profile[0, k], np.float32(-3.0)), np.float32(3.0))
            place = _PROFILE
            for k in range(5):
                row[place + k] = min(abs(per_peak * profile[1, 2 * k + 1]), np.float32(2.0))
            place += 5
            row[place], row[place + 1] = np.log(peak), sign
            beside, far = half + _BESIDE_PX, half + _REACH_PX
            row[place + 2] = at_grey(light, greys[middle - beside])
            row[place + 3] = at_grey(light, greys[middle + beside])
            row[place + 4], row[place + 5] = at_grey(light, greys[middle - far]), at_grey(light, greys[middle + far])
            row[place + 6], row[place + 7] = scale, scores[i, m]
            place += 8
            for k in range(3):
                # The axis to the eye stays; the others turn with the side, so that it does not matter.
                flip = 1.0 if k == 1 else side
                row[place + k], row[place + 3 + k] = flip * facing[0, k], flip * facing[1, k]
            row[place + 6], row[place + 7], row[place + 8] = outline[i], crease[sample], convex[sample]
            place += 9
            row[place], row[place + 1], row[place + 2] = turn, side * nx, side * ny
            row[place + 3] = np.log(1.0 + smear[i])
            rows[count], columns[count] = i, m
            count += 1
    return count


def _product(units: Float32Array, weights: Float32Array) -> Float32Array:
    """(k, m): units (k, n) times weights (n, m), on the thread that asks."""
    found = np.empty((len(units), weights.shape[1]), np.float32)
    for start in range(0, len(units), _ROWS):
        np.matmul(units[start : start + _ROWS], weights, out=found[start : start + _ROWS])
    return found


@kernel("void(f4[:, ::1], f4[::1], f4[::1], f4[:, ::1])")
def _standardise(features: Float32Array, mean: Float32Array, scale: Float32Array, shown: Float32Array) -> None:
    """Fill shown (k, n): features (k, n) less their mean (n,), times scale (n,), within `FARTHEST`."""
    farthest = np.float32(FARTHEST)
    for k in range(len(features)):
        for i in range(features.shape[1]):
            shown[k, i] = min(max((features[k, i] - mean[i]) * scale[i], -farthest), farthest)


@kernel("void(f4[:, ::1], f4[::1])")
def _rectify(units: Float32Array, bias: Float32Array) -> None:
    """Add bias (m,) to units (k, m), and put 0 where that is less."""
    for k in range(len(units)):
        for j in range(units.shape[1]):
            units[k, j] = max(units[k, j] + bias[j], np.float32(0.0))


@kernel("void(f4[:, ::1], f4[:, ::1], f4[::1], f4[:, ::1])", fastmath=frozenset({"contract", "reassoc"}))
def _answer(units: Float32Array, weights: Float32Array, bias: Float32Array, found: Float32Array) -> None:
    """Fill found (k, n), see `ProfileNetwork.__call__`: units (k, m) times weights (n, m), plus bias (n,)."""
    for k in range(len(units)):
        for i in range(len(bias)):
            total = bias[i]
            for j in range(units.shape[1]):
                total += units[k, j] * weights[i, j]
            found[k, i] = total
        found[k, 1] = min(max(found[k, 1], np.float32(LEAST_LOG_SPREAD)), np.float32(MOST_LOG_SPREAD))


@kernel("void(f4[:, ::1], f8[::1], i8[::1], i8[::1], f8[::1], f8, f8, f8[:, ::1], f8[:, ::1], f8[:, :, ::1])")
def _put(
    found: Float32Array, traits: FloatArray, rows: IntArray, columns: IntArray, sides: FloatArray, largest: float,
    share: float, shifts: FloatArray, spreads: FloatArray, slopes: FloatArray,
) -> None:  # fmt: skip
    """Put what was found (k, 2 + traits) of candidates in their rows and columns of shifts, spreads (n, m) and slopes
    (n, m, traits), px."""
    for k in range(len(rows)):
        row, column = rows[k], columns[k]
        shift = np.float64(found[k, 0])
        for j in range(len(traits)):
            shift += traits[j] * found[k, 2 + j]
            slopes[row, column, j] = sides[row] * found[k, 2 + j]
        shifts[row, column] = min(max(shift, -largest), largest) * sides[row]
        spreads[row, column] = share * np.exp(np.float64(found[k, 1]))


@kernel("void(f8[:, ::1], f8[:, ::1], f8[:, ::1], f8, f8[::1])")
def _spread_of_best(
    scores: FloatArray, offsets: FloatArray, spreads: FloatArray, sigma: float, found: FloatArray
) -> None:  # fmt: skip
    """Fill found (n,), see `ProfileShifts.spread_of_best`."""
    narrow = -0.5 / (sigma * sigma)
    for i in range(len(scores)):
        best, found[i] = 0.0, 0.0
        for m in range(scores.shape[1]):
            # Most have no candidate, and an exponential takes its time.
            if scores[i, m] <= best:
                continue
            fit = scores[i, m] * np.exp(narrow * offsets[i, m] * offsets[i, m])
            if fit > best:
                best, found[i] = fit, spreads[i, m]
