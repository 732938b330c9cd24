"""Generators compared at the same views: how far their edges are from the true ones, and how long they take.

Every view is seen by its canonical camera (`control_points.canonical_frame`), in which the auto-encoder paints;
other generators answer there as well: four control points in, edge points out. `views_between` gives the views on the
way from one view to another.

Convention: canonical px; poses canonical_T_obj, mm; W is the middle section.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from acp_lab.cad.part import Part
from acp_lab.cad.raycast import RayCaster
from acp_lab.control_points.canonical_frame import canonical_frame, eye_position
from acp_lab.control_points.coplanar_points import mid_section_points
from acp_lab.control_points.view_regions import ViewRegion
from acp_lab.generator.base import GeneratedEdges, RigidGenerator, generate_edges
from acp_lab.generator.painted.edge_images import (
    EdgeImageConfig,
    EdgeView,
    analytic_view,
    draw_views,
    edges_to_draw,
    make_edge_views,
)
from acp_lab.generator.painted.edge_images import true_points as points_along
from acp_lab.generator.painted.edge_points import RidgePoints, ridge
from acp_lab.generator.painted.image_generator import AutoencoderGenerator
from acp_lab.generator.painted.quality import GenerationQuality, along_ridge, line_quality, mean_quality
from acp_lab.geometry.arrays import Float32Array, FloatArray
from acp_lab.geometry.camera import Camera

_Found = TypeVar("_Found")
_REPEATS = 3


@dataclass(frozen=True, eq=False)
class StudyView:
    """One eye's view of a part.

    Attributes:
        edges: what it sees, with its canonical frame.
        points: (4, 2) px, the control points I.
        points_obj: (4, 3) mm, their W.
    """

    edges: EdgeView
    points: FloatArray
    points_obj: FloatArray

    @property
    def camera(self) -> Camera:
        """The canonical camera."""
        frame = self.edges.frame
        middle = 0.5 * (frame.size - 1)
        return Camera(frame.size, frame.size, frame.focal_px, frame.focal_px, middle, middle)

    @property
    def true_points(self) -> FloatArray:
        """(n, 2) px along the true edges, less than a pixel apart."""
        return points_along(self.edges, np.eye(3))

    def image(self, line_sigma_px: float = 0.8) -> Float32Array:
        """(size, size) the true edge image."""
        return draw_views([self.edges], np.eye(3)[None], line_sigma_px)[0]


@dataclass(frozen=True)
class GeneratorScore:
    """One generator over a set of views: name, quality, and time_ms, the median wall time from I to edge points."""

    name: str
    quality: GenerationQuality
    time_ms: float

    def __str__(self) -> str:
        q = self.quality
        return (
            f"{self.name:>20}: there {q.generated_to_true_px:.3f} px, back {q.true_to_generated_px:.3f} px, "
            f"F-score {q.f_score:.3f}, {self.time_ms:.2f} ms"
        )


def study_views(
    part: Part, caster: RayCaster, region: ViewRegion, config: EdgeImageConfig, count: int, seed: int
) -> list[StudyView]:
    """`count` views of a region as `config` has them, without jitter; take a seed that training did not.

    Raises PartError when the mesh has no edges.
    """
    points_obj = mid_section_points(part.box_min, part.box_max, region.axis)
    views = make_edge_views(part, caster, region, config, count, seed)
    return [StudyView(view, view.frame.project(points_obj), points_obj) for view in views]


def views_between(
    part: Part,
    caster: RayCaster,
    region: ViewRegion,
    config: EdgeImageConfig,
    first: StudyView,
    last: StudyView,
    count: int,
) -> list[StudyView]:
    """`count` views of eyes on the arc from one view's eye to another's, both included.

    They are drawn as those of `study_views` with the same `config`, its analytic edges.

    Raises PartError when the mesh has no edges.
    """
    size = first.edges.frame.size
    samples = edges_to_draw(part, size)
    ends = [eye_position(view.edges.frame.canonical_T_obj) - part.box_centre for view in (first, last)]
    views = []
    for share in np.linspace(0.0, 1.0, count):
        direction = sum(w * end / np.linalg.norm(end) for w, end in zip((1.0 - share, share), ends, strict=True))
        distance = sum(w * float(np.linalg.norm(end)) for w, end in zip((1.0 - share, share), ends, strict=True))
        eye_obj = part.box_centre + distance * direction / np.linalg.norm(direction)
        frame = canonical_frame(eye_obj, part.box_centre, part.radius, region, size)
        seen = analytic_view(part, samples, caster, eye_obj, frame, config.outline_inset_mm)
        views.append(StudyView(seen, frame.project(first.points_obj), first.points_obj))
    return views


def rigid_edges(generator: RigidGenerator, part: Part, view: StudyView, points: FloatArray) -> GeneratedEdges:
    """What a rigid generator makes of any control points (4, 2): the edges at the pose that PnP reads off them.

    Raises GeometryError for degenerate points.
    """
    prior = view.edges.frame.canonical_T_obj
    return generate_edges(generator, points, view.points_obj, view.camera, prior, 0.5 * part.box_size, part.box_centre)


def score_painter(generator: AutoencoderGenerator, region: int, views: Sequence[StudyView]) -> GeneratorScore:
    """The auto-encoder: its edge points are the ridges of what it paints."""

    def ask(view: StudyView) -> RidgePoints:
        return ridge(generator.edge_image(view.points, region, "mid-section"))

    def lines(_: StudyView, found: RidgePoints) -> FloatArray:
        return along_ridge(found)

    return _score("auto-encoder", views, ask, lines)


def score_rigid(name: str, generator: RigidGenerator, part: Part, views: Sequence[StudyView]) -> GeneratorScore:
    """A rigid generator: each of its samples stands for a piece of edge as long as their spacing."""

    def ask(view: StudyView) -> GeneratedEdges:
        return rigid_edges(generator, part, view, view.points)

    def lines(view: StudyView, found: GeneratedEdges) -> FloatArray:
        seen, frame = generator.edges.take(found.sample_ids), view.edges.frame
        half = 0.5 * generator.edges.spacing_mm * seen.tangents_obj
        first, last = (frame.project(seen.points_obj + side * half) for side in (-1.0, 1.0))
        return points_along(EdgeView(frame, np.stack([first, last], 1), seen.points_obj), np.eye(3))

    return _score(name, views, ask, lines)


def _score(
    name: str,
    views: Sequence[StudyView],
    ask: Callable[[StudyView], _Found],
    lines: Callable[[StudyView, _Found], FloatArray],
) -> GeneratorScore:
    """Means over views. Each is asked three times, the fastest counts; lines: points close enough to stand for them."""
    qualities, times_ms = [], []
    for view in views:
        taken = []
        for _ in range(_REPEATS):
            begin = time.perf_counter()
            found = ask(view)
            taken.append(1e3 * (time.perf_counter() - begin))
        times_ms.append(min(taken))
        drawn = lines(view, found)
        qualities.append(line_quality(drawn, drawn, view.true_points, view.edges.frame.size))
    return GeneratorScore(name, mean_quality(qualities), float(np.median(times_ms)))
