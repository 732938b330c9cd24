"""The edges that a camera can see on a CAD part, as 3D samples that are made once per part.

Two kinds of mesh edges show in an image: **creases** (the faces meet at more than 25 degrees), and
**silhouettes** (one adjacent face turns towards the camera, the other away), which on a curved
surface wander from mesh edge to mesh edge as the part turns. Both are sampled to points with
tangents in the object frame. What a view shows of them is then a matter of two tests per sample:
which adjacent faces face the camera (exact and cheap), and whether the part itself hides the
sample (one ray, or a learned or stored answer).
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from acp_lab.cad.part import Part
from acp_lab.cad.raycast import RayCaster
from acp_lab.compiled import kernel
from acp_lab.errors import PartError
from acp_lab.geometry.arrays import plain
from acp_lab.geometry.hull import hull_corners

if TYPE_CHECKING:
    import trimesh

CREASE_ANGLE_DEG = 25.0
# Two triangles of one flat face differ by rounding only; below this no silhouette can lie between them.
FLAT_ANGLE_DEG = 0.1
MOST_CREASE_SAMPLES = 12_000
"""Of creases and open rims together, at the default spacing: four times what machined parts need. Every later step
takes time with their number, and a scan or a heap of loose triangles would have millions."""
_NOISE_TIMES = 10
"""So many times as many at the default spacing are no part's: the noise of a scan, whose facets meet at any angle."""
_MOST_AT_A_SPACING = 20 * MOST_CREASE_SAMPLES
_USUAL_SAMPLES = 160.0
"""Of an edge as long as the diameter, by default."""
GOLDEN_RATIO = (np.sqrt(5.0) - 1.0) / 2.0


@dataclass(frozen=True)
class EdgeSamples:
    """Points on a part's mesh edges, in an order of which every prefix covers the part evenly.

    Attributes:
        points_obj: (n, 3) mm.
        tangents_obj: (n, 3) unit direction of the mesh edge.
        normals_obj: (n, 2, 3) outward unit normals of the two adjacent faces; at the rim of an open
            mesh the second is the negative of the first, so that a rim is a silhouette from everywhere.
        crease: (n,) bool, the faces meet at more than the crease angle.
        convex: (n,) bool, material lies inside the smaller angle between the faces.
        spacing_mm: distance of neighbouring samples along a crease.
    """

    points_obj: np.ndarray
    tangents_obj: np.ndarray
    normals_obj: np.ndarray
    crease: np.ndarray
    convex: np.ndarray
    spacing_mm: float

    def __post_init__(self) -> None:
        # As compiled loops take them.
        for name in ("points_obj", "tangents_obj", "normals_obj"):
            object.__setattr__(self, name, plain(getattr(self, name)))
        for name in ("crease", "convex"):
            object.__setattr__(self, name, np.require(getattr(self, name), np.bool_, ("C", "W")))

    def __len__(self) -> int:
        return len(self.points_obj)

    @cached_property
    def planes(self) -> tuple[np.ndarray, np.ndarray]:
        """All faces' planes as (2, n, 3) normals and (2, n) offsets: a face turns to e when normal . e > offset."""
        normals = np.ascontiguousarray(self.normals_obj.transpose(1, 0, 2))
        return normals, plain(np.einsum("knj,nj->kn", normals, self.points_obj))

    @cached_property
    def off_obj(self) -> np.ndarray:
        """(n, 3) the sum of the two face normals: leads off the material."""
        return plain(self.normals_obj.sum(1))

    @cached_property
    def outermost_obj(self) -> np.ndarray:
        """(k, 3) mm of the points that can be at the rim of a picture of all of them."""
        return hull_corners(self.points_obj)

    def take(self, rows: np.ndarray) -> EdgeSamples:
        """The samples of `rows` (k,), in that order."""
        return EdgeSamples(
            self.points_obj[rows],
            self.tangents_obj[rows],
            self.normals_obj[rows],
            self.crease[rows],
            self.convex[rows],
            self.spacing_mm,
        )


@dataclass(frozen=True)
class Facing:
    """Which adjacent faces of each edge sample turn towards a viewpoint.

    Attributes:
        shows: (n,) bool, the sample would be seen if nothing hid it.
        outline: (n,) bool, exactly one adjacent face turns towards the eye (a silhouette).
    """

    shows: np.ndarray
    outline: np.ndarray


def sample_edges(
    part: Part,
    spacing_mm: float | None = None,
    crease_angle_deg: float = CREASE_ANGLE_DEG,
    max_smooth_samples: int = 6000,
    max_crease_samples: int | None = None,
) -> EdgeSamples:
    """Sample all mesh edges of a part that can ever be seen as edges.

    Args:
        spacing_mm: distance between samples; default diameter / 160.
        crease_angle_deg: faces that meet at more than this make a crease.
        max_smooth_samples: curved surfaces have many candidate silhouettes; they are sampled
            more sparsely where that many would be exceeded.
        max_crease_samples: the same for creases and rims, with a RuntimeWarning, since that is no machined
            part; default MOST_CREASE_SAMPLES, twenty times as many where a spacing was asked for.

    Time and memory are linear in the number of faces.

    Raises:
        PartError: the mesh is flat, a ball, or a scan full of noise; or has no edge that could be seen (every one is
            shared by three faces or more).

    A smooth body, with no crease and no rim, has its outline alone, which is told as a RuntimeWarning.
    """
    found = _mesh_edges(part, crease_angle_deg)
    if not found.crease.any() and not len(found.rim_vertices):
        warnings.warn(
            f"{part.path or part.name}: no two faces meet at more than {crease_angle_deg:g} degrees, so the part is "
            "tracked by its outline alone; turns that leave the outline as it is are not seen",
            RuntimeWarning,
            stacklevel=2,
        )
    spacing = part.diameter / _USUAL_SAMPLES if spacing_mm is None else spacing_mm
    length_mm = found.length_mm(part.vertices)
    if spacing_mm is None and max_crease_samples is None:
        _check_no_noise(part, length_mm)
    spacing = _affordable(part, length_mm, spacing, spacing_mm is None, max_crease_samples)

    # Normals and flags are looked up for the samples alone: for all edges they would be most of the memory.
    groups = []
    for chosen, limit in ((found.crease, None), (found.smooth, max_smooth_samples)):
        if chosen.any():
            points, tangents, edge = _sample_group(part.vertices, found.vertex_pairs[chosen], spacing, limit)
            row = np.flatnonzero(chosen)[edge]
            normals = found.face_normals[found.face_pairs[row]]
            groups.append((points, tangents, normals, found.crease[row], found.convex[row]))
    if len(found.rim_vertices):
        points, tangents, edge = _sample_group(part.vertices, found.rim_vertices, spacing, None)
        outward = found.face_normals[found.rim_faces[edge]]
        always = np.ones(len(edge), bool)
        groups.append((points, tangents, np.stack([outward, -outward], 1), always, always))
    columns = [np.concatenate(column) for column in zip(*groups, strict=True)]
    points, tangents, normal_pairs, is_crease, is_convex = columns
    # Golden-ratio order: any prefix of it is spread evenly along the edges, and it never changes from
    # frame to frame, which a memory per sample needs.
    order = np.argsort((np.arange(len(points)) * GOLDEN_RATIO) % 1.0, kind="stable")
    return EdgeSamples(
        points[order],
        tangents[order],
        normal_pairs[order],
        is_crease[order],
        is_convex[order],
        float(spacing),
    )


def check_has_edges(part: Part) -> None:
    """PartError for a part that `sample_edges` refuses, without sampling it."""
    _check_no_noise(part, _mesh_edges(part, CREASE_ANGLE_DEG).length_mm(part.vertices))


def _check_no_noise(part: Part, length_mm: float) -> None:
    if length_mm > _NOISE_TIMES * MOST_CREASE_SAMPLES * part.diameter / _USUAL_SAMPLES:
        raise PartError(
            f"{part.path or part.name}: has {length_mm / part.diameter:.0f} times its diameter of edges, as of a scan, "
            "whose noise looks like edges: take the CAD model, or smooth the mesh, reduce its faces and join them"
        )


def facing(edges: EdgeSamples, eye_obj: np.ndarray) -> Facing:
    """Which samples can show from an eye at `eye_obj` (3,) mm, hiding left aside.

    A convex crease shows when at least one of its faces turns towards the eye, a concave one when
    both do, a smooth edge only as a silhouette.
    """
    normals, offsets = edges.planes
    shows, outline = np.empty((2, len(edges)), np.bool_)
    _facing(normals, offsets, edges.convex, edges.crease, plain(eye_obj), shows, outline)
    return Facing(shows, outline)


@kernel("void(f8[:, :, ::1], f8[:, ::1], b1[::1], b1[::1], f8[::1], b1[::1], b1[::1])")
def _facing(
    normals: np.ndarray, offsets: np.ndarray, convex: np.ndarray, crease: np.ndarray, eye: np.ndarray,
    shows: np.ndarray, outline: np.ndarray,
) -> None:  # fmt: skip
    """Fill shows and outline (n,), see `Facing`; normals, offsets: see `EdgeSamples.planes`."""
    for i in range(len(convex)):
        first = normals[0, i, 0] * eye[0] + normals[0, i, 1] * eye[1] + normals[0, i, 2] * eye[2] > offsets[0, i]
        second = normals[1, i, 0] * eye[0] + normals[1, i, 1] * eye[1] + normals[1, i, 2] * eye[2] > offsets[1, i]
        outline[i] = (first != second) and convex[i]
        shows[i] = outline[i] or (first and second and crease[i])


def nearly_showing(edges: EdgeSamples, eye_obj: np.ndarray, margin_deg: float = 5.0) -> np.ndarray:
    """(n,) bool: the sample shows from `eye_obj` (3,) mm or would from an eye up to about `margin_deg` away.

    For answers about hiding that are stored for one view and used for its neighbours.
    """
    normals, offsets = edges.planes
    slack = np.sin(np.radians(margin_deg)) * np.linalg.norm(eye_obj - edges.points_obj, axis=1)
    height = normals @ eye_obj - offsets
    maybe_front, maybe_back = height > -slack, height < slack
    outline = (maybe_front & maybe_back[::-1]).any(0) & edges.convex
    return outline | (maybe_front.all(0) & edges.crease)


def unoccluded(edges: EdgeSamples, caster: RayCaster, eye_obj: np.ndarray, offset_mm: float) -> np.ndarray:
    """(n,) bool: nothing of the part lies between the sample and an eye at `eye_obj` (3,) mm.

    A sample lies on the very surface that its ray must not hit, so rays start `offset_mm` nearer to the
    eye and as much off the surface (0.002 of the diameter serves).
    """
    outward = edges.off_obj / np.maximum(np.linalg.norm(edges.off_obj, axis=1, keepdims=True), 1e-9)
    lifted = edges.points_obj + offset_mm * outward
    to_eye = eye_obj - lifted
    distance = np.linalg.norm(to_eye, axis=1)
    direction = to_eye / distance[:, None]
    return ~caster.occluded(lifted + offset_mm * direction, direction, distance - offset_mm)


def visible_samples(edges: EdgeSamples, caster: RayCaster, eye_obj: np.ndarray, offset_mm: float) -> np.ndarray:
    """(n,) bool: the sample is seen as an edge from an eye at `eye_obj` (3,) mm; the exact answer, by rays."""
    shows = facing(edges, eye_obj).shows
    visible = np.zeros(len(edges), bool)
    rows = np.flatnonzero(shows)
    visible[rows] = unoccluded(edges.take(rows), caster, eye_obj, offset_mm)
    return visible


@dataclass(frozen=True)
class _MeshEdges:
    """The edges of a mesh: (n,) those between two faces, and (k,) the open rims.

    vertex_pairs, face_pairs (n, 2): ids. crease, smooth, convex (n,) bool. rim_vertices (k, 2), rim_faces (k,): ids.
    face_normals (m, 3).
    """

    face_normals: np.ndarray
    vertex_pairs: np.ndarray
    face_pairs: np.ndarray
    crease: np.ndarray
    smooth: np.ndarray
    convex: np.ndarray
    rim_vertices: np.ndarray
    rim_faces: np.ndarray

    def length_mm(self, vertices: np.ndarray) -> float:
        """Of creases and rims together; vertices (n, 3) mm."""
        pairs = (self.vertex_pairs[self.crease], self.rim_vertices)
        return sum(float(_lengths(vertices, rows).sum()) for rows in pairs)


def _mesh_edges(part: Part, crease_angle_deg: float) -> _MeshEdges:
    """The edges of a part's mesh; PartError as `sample_edges`."""
    import trimesh  # here, as it takes a while and much memory, and whoever tracks a prepared part never gets here

    # It goes when this returns: what it has worked out of a million faces is hundreds of MB.
    mesh = trimesh.Trimesh(part.vertices, part.faces, process=False)
    face_normals = np.asarray(mesh.face_normals, dtype=np.float64)
    if np.ptp(part.vertices @ face_normals[0]) < 1e-6 * part.diameter:
        raise PartError(f"{part.path or part.name}: all faces lie in one plane; export the part as a closed solid")
    angle_deg = np.degrees(np.asarray(mesh.face_adjacency_angles))
    convex = np.asarray(mesh.face_adjacency_convex)
    crease = angle_deg > crease_angle_deg
    # A concave fold hides its own silhouette, so smooth edges count only where they bulge.
    smooth = (angle_deg > FLAT_ANGLE_DEG) & ~crease & convex
    rim_vertices, rim_faces = _open_rims(mesh)
    has_rims = len(rim_vertices) > 0
    if smooth.any() and not crease.any() and not has_rims and _is_ball(part):
        raise PartError(f"{part.path or part.name}: a ball looks the same from all sides, so it has no pose to track")
    if not (smooth.any() or crease.any() or has_rims):
        raise PartError(
            f"{part.path or part.name}: the mesh has no edges to track (each is shared by three faces or more); "
            "export the part as a closed solid, once"
        )
    vertex_pairs, face_pairs = np.asarray(mesh.face_adjacency_edges), np.asarray(mesh.face_adjacency)
    return _MeshEdges(face_normals, vertex_pairs, face_pairs, crease, smooth, convex, rim_vertices, rim_faces)


def _is_ball(part: Part) -> bool:
    """Whether the outer vertices are all as far from the middle of the box, within 1% of the diameter."""
    far = np.linalg.norm(part.vertices - part.box_centre, axis=1)
    outer = far[far > 0.8 * far.max()]  # it may be hollow
    return float(np.ptp(outer)) < 0.01 * part.diameter and len(outer) > 0.2 * len(far)


def _open_rims(mesh: trimesh.Trimesh) -> tuple[np.ndarray, np.ndarray]:
    """Edges that belong to one face only: (k, 2) vertex ids and the face of each, (k,)."""
    import trimesh

    lonely = trimesh.grouping.group_rows(mesh.edges_sorted, require_count=1)
    return np.asarray(mesh.edges_sorted)[lonely], np.asarray(mesh.edges_face)[lonely]


def _affordable(part: Part, length_mm: float, spacing_mm: float, is_default: bool, most: int | None) -> float:
    """The spacing (mm) at which edges of a length give no more than `most` samples; as told where they do not."""
    if most is None:
        most = MOST_CREASE_SAMPLES if is_default else _MOST_AT_A_SPACING
    if length_mm <= most * spacing_mm:
        return spacing_mm
    wider = length_mm / most
    warnings.warn(
        f"{part.path or part.name}: {length_mm / spacing_mm:.0f} edge samples would be needed, {most} are taken, one "
        f"every {wider:.2g} mm; where that is far more than the part has edges, the mesh is a scan, or its triangles "
        "do not hang together",
        RuntimeWarning,
        stacklevel=3,
    )
    return wider


def _lengths(vertices: np.ndarray, vertex_pairs: np.ndarray) -> np.ndarray:
    lengths: np.ndarray = np.linalg.norm(vertices[vertex_pairs[:, 1]] - vertices[vertex_pairs[:, 0]], axis=1)
    return lengths


def _sample_group(
    vertices: np.ndarray, vertex_pairs: np.ndarray, spacing_mm: float, limit: int | None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Samples at equal steps of length along all edges laid end to end: points, tangents, and the edge of each.

    Laying them end to end gives tiny edges of a finely tessellated hole their share of length, no more.
    """
    walk = _chain_order(vertex_pairs)
    length = _lengths(vertices, vertex_pairs)[walk]
    ends = np.cumsum(length)
    step = spacing_mm if limit is None else max(spacing_mm, ends[-1] / limit)
    at = np.arange(0.5 * step, ends[-1], step)
    if len(at) == 0:
        at = np.array([0.5 * ends[-1]])
    place = np.minimum(np.searchsorted(ends, at), len(length) - 1)
    along = (at - (ends[place] - length[place])) / length[place]
    edge = walk[place]
    start, end = vertices[vertex_pairs[edge, 0]], vertices[vertex_pairs[edge, 1]]
    return start + along[:, None] * (end - start), (end - start) / length[place, None], edge


def _chain_order(vertex_pairs: np.ndarray) -> np.ndarray:
    """An order of edges that walks along connected ones, so that even steps of length are even on the part."""
    count = len(vertex_pairs)
    # Plain buffers of small numbers: on a million edges, lists of lists would take a gigabyte.
    ends = vertex_pairs.astype(np.int32).reshape(-1)  # each edge's two vertices, one after the other
    edge_at = (np.argsort(ends, kind="stable").astype(np.int32) // 2).data  # vertex after vertex
    at_vertex = np.bincount(ends)
    ends_at = np.cumsum(at_vertex)
    # At each vertex, the edges before this place are used: it only moves on, so a hub is not searched again and again.
    place, last, vertex_of = (ends_at - at_vertex).data, ends_at.data, ends.data
    used = bytearray(count)
    order = np.empty(count, dtype=np.intp)
    walk, done = order.data, 0
    for seed in range(count):
        edge, vertex = seed, vertex_of[2 * seed + 1]
        while not used[edge]:
            used[edge] = 1
            walk[done] = edge
            done += 1
            at, end = place[vertex], last[vertex]
            while at < end and used[edge_at[at]]:
                at += 1
            place[vertex] = at
            if at == end:
                break
            edge = edge_at[at]
            vertex = vertex_of[2 * edge] + vertex_of[2 * edge + 1] - vertex  # its other end
    return order
