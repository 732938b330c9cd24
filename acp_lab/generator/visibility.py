"""The visibility network: a light model, driven by control points, that generates edges (paper IV-A).

Four canonical control points (8 numbers) -> 128 -> 128 -> one logit per 3D edge sample: is it
unoccluded? Which faces are front-facing is computed exactly, so the network answers only what would take
a ray to find out. It is the paper's two-stage generator with the CAD's own 3D edges in place of
the decoder: exact in position, a hundred times smaller. (Deviation from paper IV-A, which decodes an image.)

One small network per view region, each with the control points and the up-vector of its region. Evaluated
in NumPy: importing torch would cost seconds at the start of tracking.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from acp_lab.cad.edges import EdgeSamples, facing
from acp_lab.cad.part import Part
from acp_lab.compiled import kernel
from acp_lab.control_points.canonical_frame import CANONICAL_SIZE, FILL, canonical_frame, eye_position
from acp_lab.control_points.coplanar_points import mid_section_points
from acp_lab.control_points.view_regions import ALL_REGIONS
from acp_lab.generator.base import RigidGenerator, VisibleSamples
from acp_lab.geometry.arrays import plain


@dataclass(frozen=True)
class RegionNetwork:
    """Weights of one region's network: 8 -> h -> h -> m logits, ReLU between.

    Attributes:
        weight1 (h, 8), bias1 (h,), weight2 (h, h), bias2 (h,), weight3 (m, h), bias3 (m,): float32.
        rows: (m,) int32, ascending: the edge samples that the region ever shows; the others have no output.
    """

    weight1: np.ndarray
    bias1: np.ndarray
    weight2: np.ndarray
    bias2: np.ndarray
    weight3: np.ndarray
    bias3: np.ndarray
    rows: np.ndarray

    def __post_init__(self) -> None:
        # As compiled loops take them.
        for layer in (1, 2, 3):
            for name in (f"weight{layer}", f"bias{layer}"):
                object.__setattr__(self, name, np.require(getattr(self, name), np.float32, ("C", "W")))
        object.__setattr__(self, "rows", np.require(self.rows, np.int32, ("C", "W")))

    def hidden(self, inputs: np.ndarray) -> np.ndarray:
        """(h,) last hidden layer for inputs (8,)."""
        found = np.empty(len(self.bias2), np.float32)
        _hidden(self.weight1, self.bias1, self.weight2, self.bias2, inputs, found)
        return found

    def free(self, inputs: np.ndarray, edges: EdgeSamples, eye_obj: np.ndarray, count: int) -> VisibleSamples:
        """The first `count` samples that show from an eye (3,) mm, and that the network calls unoccluded.

        Those beyond them are never looked at.
        """
        most = min(count, len(self.rows))
        ids, outline, belief = np.empty(most, np.int64), np.empty(most, np.bool_), np.empty(most)
        normals, offsets = edges.planes
        found = _first_free(
            self.weight3, self.bias3, self.rows, self.hidden(inputs), normals, offsets, edges.convex, edges.crease,
            plain(eye_obj), ids, outline, belief,
        )  # fmt: skip
        return VisibleSamples(ids[:found], outline[:found], belief[:found])


@kernel(
    "void(f4[:, ::1], f4[::1], f4[:, ::1], f4[::1], f4[::1], f4[::1])",
    fastmath=frozenset({"reassoc", "contract", "nsz"}),
)
def _hidden(
    weight1: np.ndarray, bias1: np.ndarray, weight2: np.ndarray, bias2: np.ndarray, inputs: np.ndarray,
    found: np.ndarray,
) -> None:  # fmt: skip
    """Fill found (h,) with the second layer."""
    first = np.empty_like(bias1)
    for i in range(len(bias1)):
        total = bias1[i]
        for j in range(len(inputs)):
            total += weight1[i, j] * inputs[j]
        first[i] = max(total, np.float32(0.0))
    for i in range(len(bias2)):
        total = bias2[i]
        for j in range(len(first)):
            total += weight2[i, j] * first[j]
        found[i] = max(total, np.float32(0.0))


@kernel(
    "i8(f4[:, ::1], f4[::1], i4[::1], f4[::1], f8[:, :, ::1], f8[:, ::1], b1[::1], b1[::1], f8[::1], i8[::1], b1[::1],"
    " f8[::1])",
    fastmath=frozenset({"reassoc", "contract", "nsz"}),
)
def _first_free(
    weights: np.ndarray, bias: np.ndarray, rows: np.ndarray, hidden: np.ndarray, normals: np.ndarray,
    offsets: np.ndarray, convex: np.ndarray, crease: np.ndarray, eye: np.ndarray, ids: np.ndarray, outline: np.ndarray,
    belief: np.ndarray,
) -> int:  # fmt: skip
    """Fill ids, outline and belief with as many of the free samples as they hold; returns how many there are.

    normals, offsets, convex, crease: of all samples, as `edges.facing` takes them from an eye (3,) mm.
    """
    count = 0
    for k in range(len(rows)):
        if count == len(ids):
            break
        i = rows[k]
        first = normals[0, i, 0] * eye[0] + normals[0, i, 1] * eye[1] + normals[0, i, 2] * eye[2] > offsets[0, i]
        second = normals[1, i, 0] * eye[0] + normals[1, i, 1] * eye[1] + normals[1, i, 2] * eye[2] > offsets[1, i]
        is_outline = (first != second) and convex[i]
        if is_outline or (first and second and crease[i]):
            logit = bias[k]
            for j in range(len(hidden)):
                logit += weights[k, j] * hidden[j]
            if logit > 0.0:
                ids[count], outline[count] = i, is_outline
                belief[count] = 1.0 / (1.0 + np.exp(-np.float64(logit)))
                count += 1
    return count


def network_inputs(part: Part, eye_obj: np.ndarray, region: int, points_obj: np.ndarray | None = None) -> np.ndarray:
    """(8,) float32: the region's control points in the canonical frame, scaled to about [-1, 1].

    Args:
        eye_obj: (3,) mm.
        region: 0..5.
        points_obj: (4, 3) W, mm; default the region's middle section.

    Raises:
        GeometryError: the eye is inside the part's bounding sphere.
    """
    if points_obj is None:
        points_obj = mid_section_points(part.box_min, part.box_max, ALL_REGIONS[region].axis)
    found = np.empty(8, np.float32)
    if not _inputs(
        plain(eye_obj), plain(part.box_centre), part.radius, _UP_OBJ[region], plain(points_obj), FILL * CANONICAL_SIZE,
        0.5 * (CANONICAL_SIZE - 1), found,
    ):  # fmt: skip
        canonical_frame(eye_obj, part.box_centre, part.radius, ALL_REGIONS[region])  # says what is wrong
    return found


_UP_OBJ = tuple(region.up_obj for region in ALL_REGIONS)


@kernel("b1(f8[::1], f8[::1], f8, f8[::1], f8[:, ::1], f8, f8, f4[::1])")
def _inputs(
    eye: np.ndarray, centre: np.ndarray, radius: float, up: np.ndarray, points_obj: np.ndarray, filled_px: float,
    middle: float, found: np.ndarray,
) -> bool:  # fmt: skip
    """Fill found (8,) with points (4, 3) in the frame of `canonical_frame`; whether the eye is outside the sphere.

    filled_px: radius of the sphere's image; middle: half the image's side.
    """
    x, y, z = centre[0] - eye[0], centre[1] - eye[1], centre[2] - eye[2]
    distance = np.sqrt(x * x + y * y + z * z)
    if not distance > radius:
        return False
    x, y, z = x / distance, y / distance, z / distance
    right = np.array([y * up[2] - z * up[1], z * up[0] - x * up[2], x * up[1] - y * up[0]])
    right /= np.sqrt(right[0] * right[0] + right[1] * right[1] + right[2] * right[2])
    down = np.array([y * right[2] - z * right[1], z * right[0] - x * right[2], x * right[1] - y * right[0]])
    focal = filled_px * np.sqrt(distance * distance - radius * radius) / radius
    for k in range(len(points_obj)):
        across, along, depth = 0.0, 0.0, 0.0
        for j, axis in enumerate((x, y, z)):
            way = points_obj[k, j] - eye[j]
            across += right[j] * way
            along += down[j] * way
            depth += axis * way
        found[2 * k], found[2 * k + 1] = focal * across / depth / middle, focal * along / depth / middle
    return True


class VisibilityNetwork:
    """t(I) by one small network per view region.

    Regions without a network, and eyes inside the bounding sphere, use `fallback`.

    Attributes:
        edges: the part's 3D edge samples.
        networks: by region 0..5.
        fallback: answers for the other regions; without one, whatever faces the camera counts as visible there.
    """

    name = "learned"

    def __init__(
        self,
        part: Part,
        edges: EdgeSamples,
        networks: Mapping[int, RegionNetwork],
        fallback: RigidGenerator | None,
    ) -> None:
        self.edges = edges
        self.networks = networks
        self._part = part
        self.fallback = fallback
        self._points = [mid_section_points(part.box_min, part.box_max, region.axis) for region in ALL_REGIONS]

    @property
    def regions(self) -> tuple[int, ...]:
        """The view regions 0..5 that it answers for, ascending: the trained ones, with a fallback also that one's."""
        return tuple(sorted({*self.networks, *(self.fallback.regions if self.fallback else ())}))

    def visible(self, cam_T_obj: np.ndarray, region: int, count: int) -> VisibleSamples:
        """At most `count` samples that show at a pose (4, 4), with the network's belief as weight."""
        eye_obj = eye_position(cam_T_obj)
        # Inside the bounding sphere of a long part there is no canonical frame, but still much to see.
        is_near = math.dist(eye_obj, self._part.box_centre) <= self._part.radius
        network = None if is_near else self.networks.get(region)
        if network is None and self.fallback is not None:
            return self.fallback.visible(cam_T_obj, region, count)
        if network is None:
            seen = facing(self.edges, eye_obj)
            rows = np.flatnonzero(seen.shows)[:count]
            return VisibleSamples(rows, seen.outline[rows], np.ones(len(rows)))
        inputs = network_inputs(self._part, eye_obj, region, self._points[region])
        return network.free(inputs, self.edges, eye_obj, count)
