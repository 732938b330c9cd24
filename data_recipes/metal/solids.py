"""Small building blocks for solid modelling in code, on top of manifold3d.

Convention: millimetres; a body is a `manifold3d.Manifold`, which is watertight by construction, so any
union, difference or hull of bodies is watertight too. Round things are cut into about 64 segments per
turn: coarse enough for a few thousand faces, fine enough that neighbouring facets (5.6 degrees apart)
are not taken for creases.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import pairwise

import numpy as np
from manifold3d import CrossSection, JoinType, Manifold, OpType

SEGMENTS = 64

Axis = str  # "x", "y" or "z"


def box(size: Sequence[float], centre: Sequence[float] = (0.0, 0.0, 0.0)) -> Manifold:
    """Axis-aligned block with the given size (3,) and centre (3,), mm."""
    return Manifold.cube(tuple(size), True).translate(tuple(centre))


def block(low: Sequence[float], high: Sequence[float]) -> Manifold:
    """Axis-aligned block between two corners, mm."""
    low_, high_ = np.asarray(low, float), np.asarray(high, float)
    return box(high_ - low_, (low_ + high_) / 2)


def along(body: Manifold, axis: Axis) -> Manifold:
    """Turn a body that was made along +z so that it points along +x, +y or +z."""
    if axis == "x":
        return body.rotate((0.0, 90.0, 0.0))
    if axis == "y":
        return body.rotate((-90.0, 0.0, 0.0))
    return body


def rod(
    radius: float,
    height: float,
    base: Sequence[float] = (0.0, 0.0, 0.0),
    axis: Axis = "z",
    chamfer: float = 0.0,
    radius_end: float | None = None,
    segments: int = SEGMENTS,
) -> Manifold:
    """Cylinder (or cone) that starts at `base` and runs `height` mm along +axis; `chamfer` bevels the far rim."""
    end = radius if radius_end is None else radius_end
    if chamfer > 0:
        straight = Manifold.cylinder(height - chamfer, radius, radius, segments)
        tip = Manifold.cylinder(chamfer, end, end - chamfer, segments).translate((0, 0, height - chamfer))
        body = straight + tip
    else:
        body = Manifold.cylinder(height, radius, end, segments)
    return along(body, axis).translate(tuple(base))


def bore(
    radius: float,
    centre: Sequence[float],
    axis: Axis = "z",
    length: float = 400.0,
    segments: int = SEGMENTS,
) -> Manifold:
    """A through hole to subtract: a long cylinder centred on `centre`."""
    body = Manifold.cylinder(length, radius, radius, segments, True)
    return along(body, axis).translate(tuple(centre))


def countersink(radius: float, depth: float, top: Sequence[float], axis: Axis = "z") -> Manifold:
    """A cone to subtract: `radius` at `top`, running to a point `depth` below it (towards -axis), open above."""
    cone = Manifold.cylinder(depth, 0.0, radius, SEGMENTS).translate((0, 0, -depth))
    cap = Manifold.cylinder(1.0, radius, radius, SEGMENTS)
    return along(cone + cap, axis).translate(tuple(top))


def slot(
    length: float, width: float, centre: Sequence[float], along_axis: Axis, through: Axis, depth: float = 400.0
) -> Manifold:
    """A slot with round ends to subtract: `length` between the end centres, cut along `through`."""
    step = {"x": np.array([1.0, 0, 0]), "y": np.array([0, 1.0, 0]), "z": np.array([0, 0, 1.0])}[along_axis]
    middle = np.asarray(centre, float)
    ends = [bore(width / 2, list(middle + s * step * length / 2), through, depth, 32) for s in (-1, 1)]
    return Manifold.batch_hull(ends)


def profile(points: Iterable[Sequence[float]], rounding: float = 0.0) -> CrossSection:
    """Closed 2D outline from its corners; `rounding` mm rounds convex corners (open, then close by offsets)."""
    outline = CrossSection([_counter_clockwise(np.asarray(list(points), float))])
    if rounding > 0:
        outline = outline.offset(-rounding, JoinType.Miter, 4.0).offset(rounding, JoinType.Round, 2.0, SEGMENTS)
    return outline


def fillet_inner(outline: CrossSection, radius: float) -> CrossSection:
    """Round the inner (concave) corners of a 2D outline."""
    return outline.offset(radius, JoinType.Miter, 4.0).offset(-radius, JoinType.Round, 2.0, SEGMENTS)


def prism(outline: CrossSection, height: float, base: Sequence[float] = (0, 0, 0), axis: Axis = "z") -> Manifold:
    """Extrude a 2D outline by `height`. Along x the outline's (u, v) become (y, z), along y they become (z, x)."""
    body = outline.extrude(height)
    if axis == "x":  # (u, v, w) -> (w, u, v)
        body = body.transform(np.array([[0, 0, 1, 0], [1, 0, 0, 0], [0, 1, 0, 0]], float))
    elif axis == "y":  # (u, v, w) -> (v, w, u)
        body = body.transform(np.array([[0, 1, 0, 0], [0, 0, 1, 0], [1, 0, 0, 0]], float))
    return body.translate(tuple(base))


def toothed(
    teeth: int,
    outer: float,
    inner: float,
    shares: Sequence[float] = (-0.36, -0.14, 0.14, 0.36),
    heights: Sequence[float] = (0, 1, 1, 0),
) -> CrossSection:
    """A toothed wheel's outline with straight flanks, mm: corners of a tooth by their share of its pitch and height."""
    angle = (np.arange(teeth)[:, None] + np.array(shares)) * (2 * np.pi / teeth)
    reach = inner + np.tile(np.array(heights) * (outer - inner), (teeth, 1))
    return CrossSection([np.stack([(reach * np.cos(angle)).ravel(), (reach * np.sin(angle)).ravel()], 1)])


def gusset(corner: Sequence[float], reach: Sequence[float], thickness: float, axis: Axis) -> Manifold:
    """Triangular rib: right angle at `corner`, legs `reach` along the other two axes, centred along `axis`.

    For axis y the legs run along z and x (in that order); for x along y and z; for z along x and y.
    """
    outline = CrossSection([_counter_clockwise(np.array([[0.0, 0.0], [reach[0], 0.0], [0.0, reach[1]]]))])
    body = prism(outline, thickness, axis=axis)
    shift = np.asarray(corner, float).copy()
    shift["xyz".index(axis)] -= thickness / 2
    return body.translate(tuple(shift))


def _counter_clockwise(points: np.ndarray) -> np.ndarray:
    u, v = points[:, 0], points[:, 1]
    area = 0.5 * float(np.sum(u * np.roll(v, -1) - np.roll(u, -1) * v))
    return points if area > 0 else points[::-1]


def tube(points: np.ndarray, radius: float, segments: int = 12) -> Manifold:
    """A round cable along a polyline (n, 3): hulls of neighbouring balls, joined."""
    balls = [Manifold.sphere(radius, segments).translate(tuple(p)) for p in np.asarray(points, float)]
    links = [Manifold.batch_hull([a, b]) for a, b in pairwise(balls)]
    return Manifold.batch_boolean(links, OpType.Add)


def mesh_arrays(body: Manifold) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (n, 3) float64 mm and faces (m, 3) int64 of a body, outward counter-clockwise."""
    mesh = body.to_mesh64()
    return np.array(mesh.vert_properties[:, :3], np.float64), np.array(mesh.tri_verts, np.int64)
