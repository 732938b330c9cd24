"""A part as its CAD model describes it: one triangle mesh in the object frame, in millimetres.

Everything later in the package asks a `Part` for its geometry, so the mesh is cleaned once, here: duplicate
vertices are merged (an STL file has three of its own for every face; faces share edges only after merging),
faces without area and second copies of a face are dropped, faces that meet without sharing an edge are put together,
and the arrays are plain and read-only. Face winding is kept as it is in the file, except that closed bodies that are
turned inside out are turned back, so that normals point out of the metal.

Units: nothing in a PLY, OBJ or STL file says them. A size that smells of metres or inches is an error, not
a guess.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from acp_lab.cad.bodies import is_closed, turned_out, wound_alike
from acp_lab.cad.mesh_file import read_mesh_file, says_its_unit
from acp_lab.cad.models_info import PartInfo, Symmetries, read_models_info
from acp_lab.cad.stitching import is_flat, stitched
from acp_lab.errors import PartError, check_kind
from acp_lab.geometry.arrays import BoolArray, FloatArray, IntArray
from acp_lab.geometry.icosphere import icosphere
from acp_lab.input_file import LARGEST_NUMBER, path_of

__all__ = ["Part", "PartInfo", "Symmetries", "clean_mesh", "largest_distance", "read_models_info"]

SMALLEST_DIAMETER = 3.0
"""mm; below it a file in metres is likelier than a part that a camera could track."""
LARGEST_DIAMETER = 5000.0
USUAL_DIAMETERS = 60.0, 160.0
"""mm; what is told in mm for parts in general, such as how far edges are broken, is told for these."""
MOST_FACES = 2_000_000
"""Of a mesh file: they take some 2 GB and half a minute, and no camera sees so fine."""
DIAMETER_TOLERANCE = 0.02
"""Between models_info.json and the mesh: more than any re-meshing, less than any other part."""
COARSEST = 1e-4
"""Of the part's size: what its numbers tell apart. Beyond it, fillets lose their shape to rounding."""
_STRAY_SHARE = 0.05
"""Of a vertex's distance from the middle: where all others are nearer, it is no part of the part."""
_UNITS = (("metres", 1000.0), ("inches", 25.4), ("centimetres", 10.0))


@dataclass(frozen=True, eq=False, repr=False)
class Part:
    """A CAD model: vertices (n, 3) float64 mm, faces (m, 3) int64, counter-clockwise seen from outside.

    name: the mesh file's stem. sha256: of the file's bytes (of the arrays' bytes when made in memory).
    diameter: mm, as models_info.json says, else the largest distance between two vertices.
    box_min, box_max: (3,) mm, of the vertices. All in the object frame; the arrays are read-only.
    symmetries: as models_info.json says; of a mesh alone untold, until the part is prepared.

    Example:
        >>> from acp_lab.sample import sample_dataset
        >>> part = Part.from_file(sample_dataset() / "models" / "obj_000001.ply")
        >>> part.vertices.shape[1], round(part.diameter)
        (3, 94)
    """

    name: str
    path: Path | None
    sha256: str
    vertices: FloatArray
    faces: IntArray
    diameter: float
    box_min: FloatArray
    box_max: FloatArray
    symmetries: Symmetries = field(default_factory=Symmetries.none)

    def __repr__(self) -> str:
        size = f"{len(self.vertices)} vertices, {len(self.faces)} faces"
        return f"Part({self.name!r}, {size}, diameter {self.diameter:.1f} mm)"

    @cached_property
    def box_centre(self) -> FloatArray:
        """(3,) mm, object frame; read-only."""
        centre: FloatArray = 0.5 * (self.box_min + self.box_max)
        centre.flags.writeable = False
        return centre

    @property
    def box_size(self) -> FloatArray:
        """(3,) mm."""
        return self.box_max - self.box_min

    @property
    def times_usual(self) -> float:
        """How many times as large as usual parts, see USUAL_DIAMETERS: below 1 for smaller ones, 1 for one of these."""
        least, most = USUAL_DIAMETERS
        return self.diameter / min(max(self.diameter, least), most)

    @cached_property
    def radius(self) -> float:
        """Radius (mm) of the smallest sphere about the box centre that holds every vertex."""
        return float(np.linalg.norm(self.vertices - self.box_centre, axis=1).max())

    @cached_property
    def face_normals(self) -> FloatArray:
        """(m, 3) unit normals, object frame; they point out of the metal when the winding does."""
        a, b, c = self.vertices[self.faces].transpose(1, 0, 2)
        normals = np.cross(b - a, c - a)
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        normals.flags.writeable = False
        return normals

    @cached_property
    def is_closed(self) -> bool:
        """Whether the mesh is watertight and wound consistently; an open one may come from a damaged file."""
        return is_closed(self.faces)

    @classmethod
    def from_file(cls, path: str | Path, info: PartInfo | None = None, unit: str = "mm") -> Part:
        """Read a PLY, OBJ or STL file, or a STEP file; `info` gives its diameter and symmetries.

        unit: of the file's numbers, "mm", "cm", "m" or "inch"; the part is in mm whatever it is.
        Raises InputFileError when the file cannot be read whole, PartError when it holds no usable part: no
        faces, vertices that are not numbers, a size that smells of another unit or that `info` contradicts.
        """
        path = path_of(path, "a mesh file", "bracket.ply")
        if info is not None:
            check_kind(info, PartInfo, "info", "an entry of models_info.json; a unit is given as unit='m'")
        path = Path(path)
        raw = read_mesh_file(path, unit)
        vertices, faces = clean_mesh(raw.vertices, raw.faces, str(path), raw.unit_mm)
        diameter = largest_distance(vertices)
        if info is not None:
            check_against_info(diameter, info, path, unit)
            diameter = info.diameter
        check_size(diameter, path, unit)
        symmetries = Symmetries.untold() if info is None else info.symmetries
        return cls(path.stem, path, raw.sha256, vertices, faces, diameter, *_box(vertices), symmetries)

    @classmethod
    def from_mesh(cls, vertices: ArrayLike, faces: ArrayLike, name: str, symmetries: Symmetries | None = None) -> Part:
        """A part from arrays, vertices (n, 3) mm and faces (m, 3), cleaned and checked as a file would be.

        Raises PartError as `from_file` does.
        """
        if not isinstance(name, str):
            raise PartError(f"part {name!r}: its name is a {type(name).__name__}: give a word, such as 'bracket'")
        where = f"part '{name}'"
        vertices, faces = clean_mesh(vertices, faces, where)
        diameter = largest_distance(vertices)
        check_size(diameter, where)
        sha256 = hashlib.sha256(vertices.tobytes() + faces.tobytes()).hexdigest()
        symmetries = Symmetries.untold() if symmetries is None else symmetries
        return cls(name, None, sha256, vertices, faces, diameter, *_box(vertices), symmetries)


def box_corners(part: Part) -> FloatArray:
    """(8, 3) mm, object frame: the corners of a part's box; corner i has the bits of i as its sides (x, y, z)."""
    bits = np.array([[i & 1, i >> 1 & 1, i >> 2 & 1] for i in range(8)], dtype=np.float64)
    return part.box_min + bits * part.box_size


def clean_mesh(vertices: ArrayLike, faces: ArrayLike, where: str, unit_mm: float = 1.0) -> tuple[FloatArray, IntArray]:
    """Merge duplicate vertices, drop faces without area and second copies, stitch, reverse faces that are inside out.

    vertices (n, 3) mm, faces (m, 3); both keep their order, except for faces that are cut (see `stitched`), and come
    back read-only. Two vertices are one when they are nearer than their numbers can tell apart, or than 1e-6 of the
    size. The numbers are taken for float32 (all that STL and most PLY files store) where each is one, in the file's
    unit of unit_mm.
    Raises PartError, whose message begins with `where`.
    """
    try:
        points, named = np.array(vertices, dtype=np.float64), np.asarray(faces)
    except (TypeError, ValueError):
        raise PartError(f"{where}: vertices or faces are no arrays: give numbers (n, 3), mm, and (m, 3)") from None
    if named.dtype.kind not in "iu" and named.size:
        raise PartError(f"{where}: faces are {named.dtype}: give whole numbers (m, 3), rows of the vertices")
    corners = named.astype(np.int64)
    if corners.size == 0:
        raise PartError(f"{where}: has no faces: export the part as a triangle mesh, not as points or curves")
    if len(corners) > MOST_FACES:
        raise PartError(f"{where}: has {len(corners)} faces, {MOST_FACES} is the most: export it coarser")
    if points.shape[1:] != (3,) or corners.shape[1:] != (3,):
        raise PartError(f"{where}: vertices {points.shape}, faces {corners.shape}: must be (n, 3) and (m, 3)")
    for index in (corners.min(), corners.max()):
        if not 0 <= index < len(points):
            raise PartError(f"{where}: a face names vertex {index} of {len(points)}: export the mesh again")
    points, corners = _without_unused(points, corners)
    usable = (np.abs(points) <= LARGEST_NUMBER).all(axis=1)  # not for NaN either
    if not usable.all():
        bad = points[~usable][0].tolist()
        raise PartError(f"{where}: a vertex is {bad}, which is no point: export the mesh again")
    size, resolution = float(np.ptp(points, axis=0).max()), _resolution(points, unit_mm)
    stray = _stray(points) if size > LARGEST_DIAMETER else None
    if stray is not None:
        raise PartError(f"{where}: a vertex is {stray.tolist()}, far from all others: export the mesh again without it")
    if resolution > COARSEST * size > 0.0:
        raise PartError(
            f"{where}: is {size:.3g} mm large but has coordinates up to {np.abs(points).max():.3g} mm, where its "
            f"float32 numbers are rounded to {resolution:.1g} mm: put the CAD origin near the part"
        )
    tolerance = max(1e-6 * size, resolution)
    points, corners = _merged(points, corners, tolerance)
    corners = corners[(corners != np.roll(corners, 1, axis=1)).all(axis=1)]
    corners = _without_copies(corners)
    alike = wound_alike(corners)
    is_mixed = alike is not corners
    if is_mixed and is_closed(alike):  # else only stitching says who neighbours whom
        corners, is_mixed = alike, False
    corners = turned_out(points, corners)
    # A face without height has no normal. It goes only now because dropping it can open a closed mesh.
    corners = corners[~is_flat(points[corners], tolerance)]
    if len(corners) == 0:
        raise PartError(f"{where}: every face has zero area: export the part as a triangle mesh")
    whole = stitched(points, corners, tolerance)
    if whole is not corners:  # bodies that are closed now may be inside out, and what met only now wound two ways
        corners, is_mixed = turned_out(points, _without_copies(whole)), True
    if is_mixed:
        corners = turned_out(points, wound_alike(corners))
    points, corners = _without_unused(points, np.ascontiguousarray(corners))
    points.flags.writeable = corners.flags.writeable = False
    return points, corners


def _without_unused(vertices: FloatArray, faces: IntArray) -> tuple[FloatArray, IntArray]:
    used = np.zeros(len(vertices), dtype=bool)
    used[faces] = True
    return vertices[used], (np.cumsum(used) - 1)[faces]


def _stray(points: FloatArray) -> FloatArray | None:
    """Of points (n, 3) the one (3,) beside which all others are near each other, if there is one."""
    away = np.linalg.norm(points - np.median(points, axis=0), axis=1)
    farthest = points[away.argmax()]
    others = away[(points != farthest).any(axis=1)]  # an STL file has it once for every face
    return farthest if len(others) and others.max() < _STRAY_SHARE * away.max() else None


def _merged(vertices: FloatArray, faces: IntArray, tolerance: float) -> tuple[FloatArray, IntArray]:
    """Give vertices nearer than `tolerance` one number; the first of them stays, and so does their order."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    # Exact copies first (an STL file has about six of each vertex): equal rows are neighbours once sorted.
    order = np.lexsort(vertices.T)
    is_new = np.append(True, (np.diff(vertices[order], axis=0) != 0.0).any(axis=1))
    group = np.empty(len(vertices), dtype=np.int64)
    group[order] = np.cumsum(is_new) - 1
    # Then the rare near ones.
    unique = vertices[order[is_new]]
    pairs = cKDTree(unique).query_pairs(tolerance, output_type="ndarray")
    links = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(unique), len(unique)))
    count, label = connected_components(links, directed=False)
    group = label[group]
    first = np.full(count, len(vertices))
    np.minimum.at(first, group, np.arange(len(vertices)))
    rank = np.empty(count, dtype=np.int64)
    rank[np.argsort(first)] = np.arange(count)
    return vertices[np.sort(first)], rank[group][faces]


def _resolution(points: FloatArray, unit_mm: float) -> float:
    """Four steps, mm, of the float32 or float64 numbers that points (n, 3) mm have been in units of unit_mm."""
    stored = points / unit_mm
    step = float(np.finfo(np.float32).eps)
    # Not "equal": the unit was multiplied in and is divided out.
    is_single = (np.abs(stored - stored.astype(np.float32)) <= 1e-6 * step * np.abs(stored)).all()
    return 4.0 * (step if is_single else float(np.finfo(np.float64).eps)) * float(np.abs(points).max())


def _without_copies(faces: IntArray) -> IntArray:
    """The first of all faces (m, 3) that run around the same vertices the same way."""
    first = faces.argmin(axis=1)[:, None]
    around = np.take_along_axis(faces, (first + np.arange(3)) % 3, axis=1)
    order = np.lexsort(around.T)
    is_copy = np.zeros(len(faces), dtype=bool)
    is_copy[order[1:]] = (np.diff(around[order], axis=0) == 0).all(axis=1)
    return faces[~is_copy] if is_copy.any() else faces


def largest_distance(points: FloatArray) -> float:
    """Largest distance between two of the points (n, 3), to 1e-6 of itself.

    Only points far enough from the middle can be its ends, and the one farthest from p is found as a nearest
    neighbour. With radii r about any middle, the largest of them R, and d the distance between p and q, s that
    between p and -q::

        d^2 = 2 r_p^2 + 2 R^2 - (s^2 + 2 R^2 - 2 r_q^2),

    and the bracket is the squared distance from (-p, 0) to (q, sqrt(2 R^2 - 2 r_q^2)) in four dimensions. A tree
    answers that in about log n, also on a sphere, where trying pairs takes n^2. (Bodies of constant width that are no
    balls are the slow case.)
    """
    from scipy.spatial import KDTree

    centred = points - 0.5 * (points.min(axis=0) + points.max(axis=0))
    largest, start = 0.0, centred[0]
    for _ in range(8):  # walking to the farthest point and on from there soon gives a good first answer
        distance = np.linalg.norm(centred - start, axis=1)
        largest, start = max(largest, float(distance.max())), centred[distance.argmax()]
    radius = np.linalg.norm(centred, axis=1)
    centred = centred[radius > (1.0 + 1e-6) * largest - radius.max()]  # an inner point has no partner that would win
    if len(centred) > 10_000:
        centred = centred[_can_end(centred, largest)]
    radius = np.linalg.norm(centred, axis=1)
    if len(centred) < 2:
        return largest
    reach = 2.0 * float(radius.max()) ** 2
    tree = KDTree(np.column_stack([centred, np.sqrt(np.maximum(reach - 2.0 * radius**2, 0.0))]))
    for first in range(0, len(centred), 4096):
        rows = slice(first, first + 4096)
        # Farther than this in four dimensions is nearer than what was found before.
        bound = 2.0 * float(radius[rows].max()) ** 2 + reach - ((1.0 + 1e-6) * largest) ** 2
        if bound <= 0.0:
            continue
        mirrored = np.column_stack([-centred[rows], np.zeros(len(centred[rows]))])
        _, partner = tree.query(mirrored, distance_upper_bound=np.sqrt(bound))
        found = partner < len(centred)
        if found.any():
            pairs = np.linalg.norm(centred[rows][found] - centred[partner[found]], axis=1)
            largest = max(largest, float(pairs.max()))
    return largest


def _can_end(points: FloatArray, largest: float) -> BoolArray:
    """Which points (n, 3) may end a pair longer than ``largest``: (n,) bool.

    The direction of such a pair is within an angle delta of one of the directions tried. Along that one its ends are
    more than largest cos(delta) apart, so each lies within width - largest cos(delta) of that side of the points.
    """
    sphere = icosphere(4)
    directions = sphere[sphere[:, 2] > -1e-9]  # one half: a direction and its opposite are the same
    spacing = np.cos(np.radians(3.0))  # no direction is as far as this from one of them or from its opposite
    kept = np.zeros(len(points), dtype=bool)
    for chunk in np.array_split(directions, 40):
        along = points @ chunk.T
        low, high = along.min(axis=0), along.max(axis=0)
        slack = high - low - spacing * largest
        wide = slack > 0.0
        along, low, high, slack = along[:, wide], low[wide], high[wide], slack[wide]
        kept |= ((along >= high - slack) | (along <= low + slack)).any(axis=1)
    return kept


def check_size(diameter: float, where: str | Path, unit: str = "mm") -> None:
    """PartError, beginning with `where`, for a diameter, mm, that no part has; unit: that the numbers were read in.

    where: the mesh file's path, or words for what came from none.
    """
    if isinstance(where, Path) and says_its_unit(where) and not SMALLEST_DIAMETER <= diameter <= LARGEST_DIAMETER:
        raise PartError(
            f"{where}: its diameter would be {diameter:.4g} mm: its unit is wrong in the file: export it again in mm, "
            "or as PLY or STL and give --unit"
        )
    if unit != "mm" and not SMALLEST_DIAMETER <= diameter <= LARGEST_DIAMETER:
        raise PartError(
            f"{where}: with --unit {unit} its diameter would be {diameter:.4g} mm: leave --unit out, or check it"
        )
    if diameter < SMALLEST_DIAMETER:
        raise PartError(
            f"{where}: its diameter would be {diameter:.4g} mm, which looks like metres: scale by 1000, or "
            "prepare it with --unit m (inches: by 25.4, --unit inch)"
        )
    if diameter > LARGEST_DIAMETER:
        raise PartError(
            f"{where}: its diameter would be {diameter:.4g} mm, more than {LARGEST_DIAMETER / 1000:g} m: "
            "scale the mesh to mm (micrometres: by 0.001)"
        )


def check_against_info(diameter: float, info: PartInfo, path: Path, unit: str = "mm") -> None:
    """PartError where a mesh file's diameter, mm, is not what models_info.json tells; unit: that it was read in."""
    ratio = info.diameter / diameter
    source = info.source or "models_info"
    if unit != "mm" and abs(ratio - 1.0) > DIAMETER_TOLERANCE:
        raise PartError(
            f"{path}: with --unit {unit} its diameter is {diameter:.5g} mm, but {info.diameter:.5g} mm in {source}: "
            "leave --unit out, or check it"
        )
    numbers = f"{path}: its diameter is {diameter:.5g}, but {info.diameter:.5g} mm in {source}"
    if abs(1000.0 * ratio - 1.0) < 0.05 and diameter > LARGEST_DIAMETER:
        raise PartError(f"{numbers}: the mesh looks like micrometres: scale by 0.001")
    for unit, factor in _UNITS:
        if abs(ratio / factor - 1.0) < 0.05:
            raise PartError(f"{numbers}: the mesh looks like {unit}: scale by {factor:g}")
        if abs(ratio * factor - 1.0) < 0.05:
            raise PartError(f"{numbers}: the latter looks like {unit}: scale its numbers by {factor:g}")
    if abs(ratio - 1.0) > DIAMETER_TOLERANCE:
        raise PartError(f"{numbers}: these are two meshes: give the file that belongs to this mesh")


def _box(vertices: FloatArray) -> tuple[FloatArray, FloatArray]:
    box = vertices.min(axis=0), vertices.max(axis=0)
    for corner in box:
        corner.flags.writeable = False
    return box
