"""How exact must a CAD model be?

    python -m benchmarks.wrong_mesh metal_hard metal_dev own_checking --parts PARTS --wrong-parts OUT --split checking

The tracker is given another mesh than that of the part in the images (`MESHES`): its convex hull, one with a bolt or a
hole that the part does not have, with few and large faces, longer than it should be, or with faces that do not share
their edges. Forwards, from truth and from 5 degrees and 5 mm off, with defaults; the wrong parts are prepared as any
other, and kept in OUT.

Errors are measured, with the part's own mesh, against the truth; for a part of another size against the pose that
explains each image best, by least squares over the vertices. Moved: how far that pose is from the truth, ADD. A frame
counts when at least 30% of the part is visible. PARTS holds prepared parts, or one folder of them per data set.
Meshes must be closed; needs the extra "recipes".
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from acp_lab.commands.machine import limit_threads

limit_threads(1)  # before NumPy is imported

import numpy as np  # noqa: E402
import shapely  # noqa: E402
import trimesh  # noqa: E402
from manifold3d import Manifold, Mesh  # noqa: E402

from acp_lab.cad.part import Part  # noqa: E402
from acp_lab.errors import PartError  # noqa: E402
from acp_lab.evaluation.part_metric import PartMetric  # noqa: E402
from acp_lab.geometry.arrays import FloatArray  # noqa: E402
from acp_lab.geometry.camera import Camera  # noqa: E402
from acp_lab.geometry.point_pnp import solve_point_pnp  # noqa: E402
from acp_lab.geometry.pose import transform  # noqa: E402
from acp_lab.preparation import prepare  # noqa: E402
from acp_lab.prepared_part import PreparedPart  # noqa: E402
from acp_lab.sequences.bop import BopScene  # noqa: E402
from acp_lab.tracking.method import Method, method_named  # noqa: E402
from acp_lab.tracking.tracker import Tracker  # noqa: E402
from benchmarks.runs import prepared_part_of  # noqa: E402
from benchmarks.told_wrong import (  # noqa: E402
    STARTS_TOLD,
    UNIT,
    Told,
    ToldRun,
    arguments,
    follow,
    record,
    row_of,
    rows_of,
    true_frames,
)

POINTS = 200
"""Vertices that say which pose explains an image."""


def solid(part: Part) -> Manifold:
    """A part's body. Raises PartError where its mesh is not closed."""
    body = Manifold(Mesh(np.asarray(part.vertices, np.float32), np.asarray(part.faces, np.uint32)))
    if body.is_empty():
        raise PartError(f"{part.name}: its mesh is not closed: {body.status()}; give parts with closed meshes")
    return body


def hull(part: Part) -> Part:
    """Its convex hull: without any hole or notch."""
    return _part(solid(part).hull(), part)


def with_bolt(part: Part) -> Part:
    """With the head of a bolt upon its largest flat face, an eighth of the diameter wide and a twentieth high."""
    return _part(solid(part) + _rod(part, 0.06, 0.1), part)


def with_hole(part: Part) -> Part:
    """With a hole through its largest flat face, an eighth of the diameter wide."""
    return _part(solid(part) - _rod(part, 0.06, 2.0), part)


def coarse(share: float) -> Callable[[Part], Part]:
    """With as few faces as are within a share of its diameter."""
    return lambda part: _part(solid(part).simplify(share * part.diameter), part)


def longer(times: float) -> Callable[[Part], Part]:
    """So many times as long along its longest axis, about its centre."""

    def stretched(part: Part) -> Part:
        extents = np.ptp(part.vertices, axis=0)
        scale = np.where(np.arange(3) == extents.argmax(), times, 1.0)
        vertices = part.box_centre + scale * (part.vertices - part.box_centre)
        return Part.from_mesh(vertices, part.faces, part.name, part.symmetries)

    return stretched


def torn(share: float) -> Callable[[Part], Part]:
    """With nearly that share of its edges torn: one of the two faces has a vertex more in the middle of its side.

    Each face is cut once at most.
    """

    def with_gaps(part: Part) -> Part:
        mesh = trimesh.Trimesh(part.vertices, part.faces, process=False)
        vertices, faces, cut = list(part.vertices), list(part.faces), set[int]()
        order = np.random.default_rng(0).permutation(len(mesh.face_adjacency))
        for edge in order[: round(share * len(order))]:
            face = int(mesh.face_adjacency[edge, 0])
            if face in cut:
                continue
            cut.add(face)
            apex = int(np.flatnonzero(~np.isin(part.faces[face], mesh.face_adjacency_edges[edge]))[0])
            c, a, b = np.roll(part.faces[face], -apex)
            faces[face] = np.array([a, len(vertices), c])
            faces.append(np.array([len(vertices), b, c]))
            vertices.append(0.5 * (part.vertices[a] + part.vertices[b]))
        return Part.from_mesh(vertices, faces, part.name, part.symmetries)

    return with_gaps


MESHES: dict[str, Callable[[Part], Part]] = {
    "as it is": lambda part: part,
    "convex hull": hull,
    "a bolt too many": with_bolt,
    "a hole too many": with_hole,
    "0.2% coarse": coarse(0.002),
    "1% coarse": coarse(0.01),
    "1% longer": longer(1.01),
    "3% longer": longer(1.03),
    "a tenth torn": torn(0.1),
}


def main() -> None:
    """See the module."""
    parser = arguments(__doc__)
    parser.add_argument("--wrong-parts", type=Path, required=True, metavar="OUT")
    parser.add_argument("--meshes", nargs="+", default=list(MESHES), choices=list(MESHES), metavar="NAME")
    args = parser.parse_args()
    method = method_named(args.method)
    rows = rows_of(args, lambda scene: _runs(scene, args.meshes, args.parts, args.wrong_parts, method), row_of)
    record(args, "wrong_mesh", "a CAD model that is not exact", UNIT, rows)


def explained(part: Part, cam_T_obj: FloatArray, camera: Camera, wrong: Part) -> FloatArray:
    """The pose (4, 4) at which a part that is told wrong appears most like the part does at `cam_T_obj` (4, 4).

    Where both have the same vertices, one for one; elsewhere it is that very pose.
    """
    if not np.array_equal(wrong.faces, part.faces):
        return cam_T_obj
    chosen = np.random.default_rng(0).permutation(len(part.vertices))[:POINTS]
    pixels = camera.project(transform(cam_T_obj, part.vertices[chosen]))
    return solve_point_pnp(wrong.vertices[chosen], pixels, camera).cam_T_obj


def _runs(scene: BopScene, names: Sequence[str], parts: Path, wrong_parts: Path, method: Method) -> Iterator[ToldRun]:
    right, frames = prepared_part_of(scene, parts), true_frames(scene)
    metric, seed = PartMetric(right.part), (0, scene.scene_id, scene.object_ids[0])
    for name in names:
        model = right
        if name != "as it is":
            model = _prepared(MESHES[name](right.part), wrong_parts / name.replace(" ", "_") / scene.dataset.name)
        best = [explained(right.part, one.truth, one.frame.camera, model.part) for one in frames]
        told = [Told(one.frame, pose, one.counts) for one, pose in zip(frames, best, strict=True)]
        moved = [metric.share(pose, one.truth) for one, pose in zip(frames, best, strict=True)]
        for start in STARTS_TOLD:
            errors = follow(told, Tracker(model, method), metric, start, seed)
            yield ToldRun(name, start, errors, np.array(moved[1:]))


def _prepared(part: Part, folder: Path) -> PreparedPart:
    stored = folder / part.name
    return PreparedPart.load(stored) if (stored / "part.json").exists() else prepare(part, out=folder)


def _rod(part: Part, radius: float, length: float) -> Manifold:
    """Across the largest flat face, its middle where there is most room around it; radius and length in diameters."""
    mesh = trimesh.Trimesh(part.vertices, part.faces, process=False)
    largest = int(np.argmax(mesh.facets_area))
    triangles = mesh.facets[largest]
    plane_T_obj = trimesh.geometry.plane_transform(mesh.triangles_center[triangles[0]], mesh.facets_normal[largest])
    corners = trimesh.transform_points(mesh.vertices, plane_T_obj)[mesh.faces[triangles], :2]
    middle = shapely.maximum_inscribed_circle(shapely.unary_union(shapely.polygons(corners))).coords[0]
    rod = Manifold.cylinder(length * part.diameter, radius * part.diameter, -1.0, 64, True)
    return rod.translate((*middle, 0.0)).transform(np.linalg.inv(plane_T_obj)[:3])


def _part(body: Manifold, part: Part) -> Part:
    mesh = body.to_mesh()
    vertices = np.asarray(mesh.vert_properties, np.float64)[:, :3]
    return Part.from_mesh(vertices, np.asarray(mesh.tri_verts, np.int64), part.name, part.symmetries)


if __name__ == "__main__":
    main()
