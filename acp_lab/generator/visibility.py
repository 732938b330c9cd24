"""The visibility network: a light model, driven by control points, that generates edges (paper IV-A).

Four canonical control points (8 numbers) -> 128 -> 128 -> one logit per 3D edge sample: is it
unoccluded? Which faces are front-facing is computed exactly, so the network answers only what would take
a ray to find out. It is the paper's two-stage generator with the CAD's own 3D edges in place of
the decoder: exact in position, a hundred times smaller. (Deviation from paper IV-A, which decodes an image.)

One small network per view region, each with the control points and the up-vector of its region. Evaluated
in NumPy: importing torch would cost seconds at the start of tracking.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from acp_lab.cad.edges import EdgeSamples, facing
from acp_lab.cad.part import Part
from acp_lab.control_points.canonical_frame import CANONICAL_SIZE, canonical_frame, eye_position
from acp_lab.control_points.coplanar_points import mid_section_points
from acp_lab.control_points.view_regions import ALL_REGIONS
from acp_lab.generator.base import RigidGenerator, VisibleSamples


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

    def hidden(self, inputs: np.ndarray) -> np.ndarray:
        """(h,) last hidden layer for inputs (8,)."""
        first = np.maximum(self.weight1 @ inputs + self.bias1, 0.0)
        return np.maximum(self.weight2 @ first + self.bias2, 0.0)

    def free(self, inputs: np.ndarray, shows: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
        """The first `count` of the samples that `shows` (n,) bool that the network calls unoccluded.

        Returns:
            Their ids (k,) and logits (k,); samples beyond them are never computed.
        """
        hidden = self.hidden(inputs)
        outputs = np.flatnonzero(shows[self.rows])
        logits = np.empty(0, np.float32)
        while len(logits) < len(outputs):
            # Most samples that show are free, so 25% more than needed usually suffices.
            wanted = count - int(np.count_nonzero(logits > 0.0))
            if wanted <= 0:
                break
            more = outputs[len(logits) : len(logits) + wanted + wanted // 4 + 16]
            logits = np.concatenate([logits, self.weight3[more] @ hidden + self.bias3[more]])
        called = np.flatnonzero(logits > 0.0)[:count]
        return self.rows[outputs[called]], logits[called]


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
    frame = canonical_frame(eye_obj, part.box_centre, part.radius, ALL_REGIONS[region])
    middle = 0.5 * (CANONICAL_SIZE - 1)
    return ((frame.project(points_obj) - middle) / middle).astype(np.float32).ravel()


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
        is_near = np.linalg.norm(eye_obj - self._part.box_centre) <= self._part.radius
        network = None if is_near else self.networks.get(region)
        if network is None and self.fallback is not None:
            return self.fallback.visible(cam_T_obj, region, count)
        seen = facing(self.edges, eye_obj)
        if network is None:
            rows = np.flatnonzero(seen.shows)[:count]
            return VisibleSamples(rows, seen.outline[rows], np.ones(len(rows)))
        inputs = network_inputs(self._part, eye_obj, region, self._points[region])
        ids, logits = network.free(inputs, seen.shows, count)
        belief = 1.0 / (1.0 + np.exp(-logits.astype(np.float64)))
        return VisibleSamples(ids, seen.outline[ids], belief)
