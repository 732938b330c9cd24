"""The training set of the edge image generator: true edge images of one view region (paper IV-A).

A view is kept as edge *points* in its canonical image, not as a picture. Another virtual camera at the same
eye, rolled, turned aside or zoomed, sees the same edges moved by a homography, exact at any depth. So one view
gives any number of exact training pictures, each drawn in a millisecond, and the control points move with it.

Two sources of points: the part's own mesh edges as far as nothing hides them, sub-pixel exact; or rendered
surface normals through Canny, as the authors did, exact to half a pixel of the rendering. Canny on normals misses
the border between two parallel faces, one behind the other.

Real parts have broken edges, so their outlines lie inside the CAD model's: analytic outlines are drawn there.
(Deviation from the paper, which takes the CAD model as it is.)

Convention: canonical px, (0, 0) is the centre of the top-left pixel; images are (size, size) float32 in [0, 1].
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np

from acp_lab.cad.edges import EdgeSamples, facing, sample_edges, unoccluded
from acp_lab.cad.part import Part
from acp_lab.cad.raycast import RayCaster, normal_map
from acp_lab.control_points.canonical_frame import CANONICAL_SIZE, CanonicalFrame, canonical_frame
from acp_lab.control_points.view_regions import ViewRegion, sample_directions
from acp_lab.errors import PreparationError
from acp_lab.generator.templates import RAY_OFFSET_IN_DIAMETERS
from acp_lab.geometry.arrays import Float32Array, FloatArray
from acp_lab.geometry.camera import Camera
from acp_lab.geometry.homography import apply_homography

Source = Literal["analytic", "normals"]
PaintingFrame = Literal["pose", "prediction"]
"""Where a generator's canonical frame stands: at the pose that it paints, or at a frame's predicted pose, beside it."""

# Neighbouring points of a crease lie at most that far apart in the image, so that lines close.
POINTS_PER_DIAMETER_128 = 160
# Lines closer than about two pixels flow into one: a larger picture keeps the edges of small features apart.
PAINTING_SIZE = 192
MOST_SMOOTH_SAMPLES = 60_000
# Pixels further from an edge than this stay black; a Gaussian of 0.8 px has fallen to 0.01 there.
REACH_PX = 2
# Share of the edge break by which outlines lie inside, measured on path-traced milled parts.
OUTLINE_SHARE_OF_BREAK = 0.6
# Steps of the 8-bit normals, between neighbouring pixels; a crease of 25 degrees makes about 55.
CANNY_LOW, CANNY_HIGH = 60.0, 150.0


@dataclass(frozen=True)
class EdgeImageConfig:
    """What the views of one region are, and how they are drawn.

    Attributes:
        size: side of the canonical image, px.
        source: "analytic" edges of the mesh, or "normals" through Canny.
        views: for training, of one region; held_out: further ones for the report. With a quarter of the views, each
            seen four times as often, lines lie further off in held-out views. (Deviation from the paper: about 1000.)
        frame: where the canonical frame will stand. "pose": at the very pose that is painted, so the three degrees of
            freedom of eye and distance are all there is to learn, and nothing is jittered. (Deviation from the paper.)
            "prediction": at the pose that a frame expects; the part lies rolled, shifted and scaled in it.
        overlap: share by which a region reaches into its neighbours: the tracker stays up to 15% (`HYSTERESIS`).
        nearest, farthest: distances of the eye in diameters, sampled evenly in 1/distance.
        roll_deg, shift, scale: largest jitter of the virtual camera, each way; for "prediction" only. shift counts
            sides of the image (4%: 0.04).
        line_sigma_px: Gaussian width of a drawn edge.
        oversampling: of the rendered normals against the image.
        outline_inset_mm: how far inside the CAD model's the outlines are drawn; analytic edges only.
    """

    size: int = PAINTING_SIZE
    source: Source = "analytic"
    frame: PaintingFrame = "pose"
    views: int = 4000
    held_out: int = 100
    overlap: float = 0.2
    nearest: float = 1.5
    farthest: float = 12.0
    roll_deg: float = 5.0
    shift: float = 0.04
    scale: float = 0.05
    line_sigma_px: float = 0.8
    oversampling: int = 2
    outline_inset_mm: float = 0.0


@dataclass(frozen=True)
class EdgeView:
    """The edges that one eye sees, in its canonical image.

    Attributes:
        frame: the canonical frame; it projects any control points W.
        strokes: (n, 2, 2) canonical px, both ends of the short piece of edge that each sample stands for.
        points_obj: (n, 3) mm, these samples; NaN of edges that were found in a picture.
    """

    frame: CanonicalFrame
    strokes: FloatArray
    points_obj: FloatArray


def make_edge_views(
    part: Part, caster: RayCaster, region: ViewRegion, config: EdgeImageConfig, count: int, seed: int
) -> list[EdgeView]:
    """`count` views of a region, see `edge_views`."""
    return list(edge_views(part, caster, region, config, count, seed))


def edge_views(
    part: Part, caster: RayCaster, region: ViewRegion, config: EdgeImageConfig, count: int, seed: int
) -> Iterator[EdgeView]:
    """`count` views of a region one by one, directions even over it and distances even in 1/distance.

    Raises:
        PreparationError: an unknown source of edges.
        PartError: the mesh has no edges.
    """
    if config.source not in ("analytic", "normals"):
        raise PreparationError(f"source of edge images '{config.source}': choose analytic or normals")
    rng = np.random.default_rng([seed, region.index, 2])
    directions = sample_directions(region, 0.5 * part.box_size, count, config.overlap, seed)
    nearness = rng.uniform(1.0 / config.farthest, 1.0 / config.nearest, count)
    edges = edges_to_draw(part, config.size)
    for direction, near in zip(directions, nearness, strict=True):
        eye_obj = part.box_centre + part.diameter / near * direction
        frame = canonical_frame(eye_obj, part.box_centre, part.radius, region, config.size)
        if config.source == "analytic":
            yield analytic_view(part, edges, caster, eye_obj, frame, config.outline_inset_mm)
        else:
            yield canny_view(part, caster, frame, config.oversampling)


def edges_to_draw(part: Part, size: int) -> EdgeSamples:
    """The mesh's edge samples for pictures of a size in px; PartError where it has no edges.

    Those that trackers use thin smooth edges out; a picture of them would have gaps.
    """
    spacing = part.diameter / (POINTS_PER_DIAMETER_128 * size / CANONICAL_SIZE)
    return sample_edges(part, spacing, max_smooth_samples=MOST_SMOOTH_SAMPLES)


def analytic_view(
    part: Part,
    edges: EdgeSamples,
    caster: RayCaster,
    eye_obj: FloatArray,
    frame: CanonicalFrame,
    outline_inset_mm: float = 0.0,
) -> EdgeView:
    """The mesh's edge samples that an eye (3,) mm sees, outlines moved inwards by `outline_inset_mm`."""
    turned = facing(edges, eye_obj)
    rows = np.flatnonzero(turned.shows)
    rows = rows[unoccluded(edges.take(rows), caster, eye_obj, RAY_OFFSET_IN_DIAMETERS * part.diameter)]
    seen = edges.take(rows)
    half = 0.5 * edges.spacing_mm * seen.tangents_obj
    first, last = (frame.project(seen.points_obj + side * half) for side in (-1.0, 1.0))
    if outline_inset_mm != 0.0:
        shift = np.where(turned.outline[rows, None], outline_inset_mm, 0.0) * _inwards(seen, first, last, frame)
        first, last = first + shift, last + shift
    return EdgeView(frame, np.stack([first, last], 1), seen.points_obj)


def _inwards(seen: EdgeSamples, first: FloatArray, last: FloatArray, frame: CanonicalFrame) -> FloatArray:
    """(n, 2) px per mm, across each stroke towards the material."""
    along = last - first
    along /= np.maximum(np.hypot(along[:, 0], along[:, 1]), 1e-12)[:, None]
    across = np.column_stack([-along[:, 1], along[:, 0]])
    canonical_R_obj = frame.canonical_T_obj[:3, :3]
    depth = seen.points_obj @ canonical_R_obj[2] + frame.canonical_T_obj[2, 3]
    outward = seen.off_obj @ canonical_R_obj[:2].T
    side = np.sign(np.einsum("nj,nj->n", across, outward))
    return -(side * frame.focal_px / depth)[:, None] * across


def canny_view(part: Part, caster: RayCaster, frame: CanonicalFrame, oversampling: int) -> EdgeView:
    """Edge pixels of the rendered normals, as the authors made theirs; on a picture `oversampling` times as large."""
    side = oversampling * frame.size
    # Pixel centres: (0, 0) of the large picture lies half a small pixel up and left of ours.
    middle = 0.5 * (side - 1)
    focal = oversampling * frame.focal_px
    normals = normal_map(part, caster, Camera(side, side, focal, focal, middle, middle), frame.canonical_T_obj)
    picture = np.round(127.5 * (normals + 1.0)).astype(np.uint8)
    # Background stands apart from every normal, also from those across the line of sight.
    picture[~normals.any(2)] = (0, 0, 255)
    rows, columns = np.nonzero(cv2.Canny(picture, CANNY_LOW, CANNY_HIGH, L2gradient=True))
    points = (np.column_stack([columns, rows]) + 0.5) / oversampling - 0.5
    return EdgeView(frame, np.stack([points, points], 1), np.full((len(points), 3), np.nan))


def jitter_homographies(
    frames: Sequence[CanonicalFrame], config: EdgeImageConfig, rng: np.random.Generator
) -> FloatArray:
    """(b, 3, 3) canonical px to px of another camera at the same eye, drawn at random: Kc' R Kc^-1.

    The camera is turned, so that the part's centre lands up to `shift` of a side off the middle, and not its image
    shifted: that is what a part off the axis looks like.
    """
    count = len(frames)
    roll = np.radians(rng.uniform(-config.roll_deg, config.roll_deg, count))
    shift = rng.uniform(-config.shift, config.shift, (count, 2)) * config.size
    scale = 1.0 + rng.uniform(-config.scale, config.scale, count)
    return np.stack(
        [jitter_homography(*values) for values in zip(frames, roll.tolist(), shift, scale.tolist(), strict=True)]
    )


def jitter_homography(frame: CanonicalFrame, roll_rad: float, shift: FloatArray, scale: float) -> FloatArray:
    """(3, 3) to a camera rolled by roll_rad, zoomed by `scale`, in which the part's centre is `shift` (2,) px off."""
    zoomed = CanonicalFrame(frame.canonical_T_obj, frame.focal_px * scale, frame.size)
    towards = np.array([shift[0], shift[1], zoomed.focal_px])
    z = towards / np.linalg.norm(towards)
    x = np.cross([0.0, 1.0, 0.0], z)
    x /= np.linalg.norm(x)
    tilt = np.stack([x, np.cross(z, x), z], 1)
    c, s = np.cos(roll_rad), np.sin(roll_rad)
    roll = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    return zoomed.matrix @ tilt @ roll @ np.linalg.inv(frame.matrix)


def draw_views(views: Sequence[EdgeView], homographies: FloatArray, line_sigma_px: float) -> Float32Array:
    """(b, size, size) edge images of views as jittered cameras (b, 3, 3) see them."""
    strokes = np.concatenate([moved_strokes(view, h) for view, h in zip(views, homographies, strict=True)])
    owner = np.repeat(np.arange(len(views)), [len(view.strokes) for view in views])
    return draw_strokes(strokes, owner, len(views), views[0].frame.size, line_sigma_px)


def draw_strokes(strokes: FloatArray, owner: np.ndarray, count: int, size: int, line_sigma_px: float) -> Float32Array:
    """(count, size, size) soft edge images: exp(-d^2 / 2 sigma^2), d the distance in px to the nearest stroke.

    Not the sum of blurred strokes: lines that come close would flow into one.

    Args:
        strokes: (n, 2, 2) px, their ends.
        owner: (n,) the image that each belongs to.
    """
    middle = strokes.mean(1)
    half = (0.5 * (strokes[:, 1] - strokes[:, 0])).astype(np.float32)
    length2 = np.maximum((half * half).sum(1), 1e-12)
    centre = np.round(middle)
    inside = ((centre >= REACH_PX) & (centre < size - REACH_PX)).all(1)
    off = (centre - middle)[inside].astype(np.float32)
    half, length2 = half[inside], length2[inside]
    cell = (owner[inside] * size + centre[inside, 1].astype(np.int64)) * size + centre[inside, 0].astype(np.int64)
    distance2 = np.full(count * size * size, (4 * size) ** 2, np.float32)
    for dy in range(-REACH_PX, REACH_PX + 1):
        for dx in range(-REACH_PX, REACH_PX + 1):
            x, y = off[:, 0] + dx, off[:, 1] + dy
            along = np.clip((x * half[:, 0] + y * half[:, 1]) / length2, -1.0, 1.0)
            x -= along * half[:, 0]
            y -= along * half[:, 1]
            np.minimum.at(distance2, cell + (dy * size + dx), x * x + y * y)
    images: Float32Array = np.exp(distance2 * np.float32(-0.5 / line_sigma_px**2)).reshape(count, size, size)
    return images


def true_points(view: EdgeView, homography: FloatArray, border_px: float = 2.0) -> FloatArray:
    """(3 n, 2) px: points along the view's n strokes in a jittered camera (3, 3), without those that lie outside.

    Three per stroke, so that the distance to the nearest is that to the edge.
    """
    first, last = moved_strokes(view, homography).transpose(1, 0, 2)
    points = np.concatenate([first + share * (last - first) for share in (1 / 6, 1 / 2, 5 / 6)])
    return points[((points >= border_px) & (points <= view.frame.size - 1 - border_px)).all(1)]


def moved_strokes(view: EdgeView, homography: FloatArray) -> FloatArray:
    """(n, 2, 2) px: the view's strokes in a jittered camera (3, 3)."""
    return apply_homography(homography, view.strokes.reshape(-1, 2)).reshape(-1, 2, 2)
