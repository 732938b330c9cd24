"""Reading the triangles of a PLY, OBJ, STL or STEP file, and noticing when part of the file is missing.

trimesh does the parsing. It raises many kinds of exceptions on damaged files and reads some cut-off files
short without a word, so the counts that PLY and STL files promise are checked here. (An OBJ file promises
nothing: cut off between two lines it is a smaller OBJ file, and only `Part.is_closed` can hint at it.) It fills
concave polygons as if they were convex, so these are cut into triangles here. STEP goes through OpenCASCADE (the
`cascadio` package) and comes back in metres, whatever unit the file names: here it becomes mm.
"""

from __future__ import annotations

import gc
import hashlib
import io
import logging
import re
import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from acp_lab.cad.obj_text import BYTE_ORDER_MARK, plain_obj
from acp_lab.cad.polygons import concave, ears
from acp_lab.errors import InputFileError, PartError
from acp_lab.geometry.arrays import FloatArray, IntArray
from acp_lab.input_file import read_bytes
from acp_lab.quiet import native_output_silenced

_STEP_SUFFIXES = (".step", ".stp")
SUFFIXES = (".ply", ".obj", ".stl", *_STEP_SUFFIXES)

UNITS_MM: Mapping[str, float] = {"mm": 1.0, "cm": 10.0, "m": 1000.0, "inch": 25.4}

_BLANK = b" \t\r\n\0"
_STEP_END = re.compile(rb"END-ISO-10303-21\s*;")
_ODD_LENGTH = "PLY is unexpected length!"
LARGE_MESH = 100_000
"""Vertices from which on memory counts more than the time to tidy it up."""

_STEP_UNIT_MM = 1000.0
STEP_TOLERANCE_MM = 0.02
STEP_TOLERANCE_RAD = 0.1
"""How finely curved STEP surfaces are cut. cascadio's own 0.5 rad leaves small holes with a dozen corners, up to
29 degrees apart: creases to an edge extractor. At 0.1 rad facets stay well below any crease angle (the worst
pair on a ball: 13 degrees)."""


@dataclass(frozen=True, eq=False)
class MeshFile:
    """What a mesh file holds, uncleaned: vertices (n, 3) mm, faces (m, 3), and the SHA-256 of its bytes.

    unit_mm: mm per unit of the numbers in the file.
    """

    vertices: FloatArray
    faces: IntArray
    sha256: str
    unit_mm: float = 1.0


def says_its_unit(path: Path) -> bool:
    """Whether a mesh file is a STEP file, by its name: the others hold plain numbers."""
    return path.suffix.lower() in _STEP_SUFFIXES


def read_mesh_file(path: Path, unit: str = "mm") -> MeshFile:
    """Read a PLY, OBJ, STL or STEP file; several bodies become one mesh. It may have no faces.

    unit: a key of UNITS_MM, in which the file's numbers are; a STEP file says its own and takes "mm" alone.
    Raises InputFileError (missing, empty, cut off, unknown suffix) or PartError (unit, STEP support not installed).
    """
    suffix = path.suffix.lower()
    if unit not in UNITS_MM:
        raise PartError(f"{path}: unit '{unit}': choose one of {', '.join(UNITS_MM)}")
    if unit != "mm" and says_its_unit(path):
        raise PartError(f"{path}: a STEP file says its unit itself: leave {unit} away")
    if suffix not in SUFFIXES:
        raise InputFileError(f"{path}: unknown mesh type '{path.suffix}': give one of {', '.join(SUFFIXES)}")
    data = read_bytes(path, "give a mesh file", "mesh file")
    if not data.strip(_BLANK):
        raise InputFileError(f"{path}: the file is empty: export the mesh again")
    unit_mm = UNITS_MM[unit]
    if says_its_unit(path):
        unit_mm, (vertices, faces) = _STEP_UNIT_MM, _read_step(data, path)
    else:
        plain = {".ply": _in_ascii, ".obj": _plain_obj, ".stl": _plain_stl}[suffix]
        vertices, faces = _parse(plain(data, path), suffix[1:], path)
        if suffix == ".ply":
            _check_ply(data, len(vertices), len(faces), path)
    if unit_mm != 1.0:
        vertices = unit_mm * vertices
    return MeshFile(vertices, faces, hashlib.sha256(data).hexdigest(), unit_mm)


def _parse(data: bytes, file_type: str, path: Path) -> tuple[FloatArray, IntArray]:
    import trimesh

    log = logging.getLogger("trimesh")
    level = log.level
    log.setLevel(logging.CRITICAL)  # what it has to say is said below, in one line
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            # NumPy's way of saying that a line of numbers ends in something else; trimesh would read on.
            warnings.filterwarnings("error", message="string or file could not be read")
            scene = trimesh.load_scene(io.BytesIO(data), file_type=file_type, process=False, skip_materials=True)
            bodies = scene.dump()
    except Exception as error:  # trimesh raises whatever its parsers happen to meet
        reason = " ".join(str(error).split())[:100] or type(error).__name__
        if _ODD_LENGTH in reason:
            reason = "its length does not fit its header, or it has faces of several sizes"
        kind = file_type.upper()
        raise InputFileError(
            f"{path}: damaged, cut off or no {kind} file ({reason}): export it again, as triangles"
        ) from None
    finally:
        log.setLevel(level)
    vertices, faces, count = [np.zeros((0, 3))], [np.zeros((0, 3), dtype=np.int64)], 0
    for body in bodies:  # a point cloud or a curve has no faces
        # np.array makes plain copies: trimesh's own TrackedArray is slow in loops.
        points = np.array(getattr(body, "vertices", []), dtype=np.float64)
        if points.size and points.shape[1:] != (3,):
            raise InputFileError(
                f"{path}: a vertex has {points.shape[-1]} numbers, not x, y, z: export it again, as triangles"
            )
        triangles = np.array(getattr(body, "faces", []), dtype=np.int64).reshape(-1, 3)
        if file_type == "ply":
            points, triangles = _with_polygons(body.metadata.get("_ply_raw", {}), points, triangles, path)
        faces.append(triangles + count)
        vertices.append(points.reshape(-1, 3))
        count += len(points)
    if count > LARGE_MESH:
        # trimesh's objects refer to each other in circles: of a million faces they would keep hundreds of MB for long.
        del scene, bodies
        gc.collect()
    return np.concatenate(vertices), np.concatenate(faces)


def _with_polygons(
    raw: Mapping[str, Any], points: FloatArray, triangles: IntArray, path: Path
) -> tuple[FloatArray, IntArray]:
    """What was read of a PLY file, points (n, 3) and triangles (m, 3); made anew where a polygon is concave.

    raw: the file's elements, as trimesh keeps them.
    """
    rows = raw.get("face", {}).get("data")
    if not len(triangles) or rows is None:
        return points, triangles
    is_binary = isinstance(rows, np.ndarray)
    names = rows.dtype.names if is_binary else tuple(rows)
    name = next((name for name in names if name in ("vertex_index", "vertex_indices")), names[0])
    polygons = rows[name]["f1"] if is_binary else rows[name]
    corners = np.column_stack([raw["vertex"]["data"][axis] for axis in "xyz"]).astype(np.float64)
    try:
        hollow = set(concave(corners, polygons))
    except IndexError:  # a vertex that is not there is told with those of the other formats
        return points, triangles
    if not hollow:
        return points, triangles
    cut = []
    for place, polygon in enumerate(polygons):
        fan = [[0, i, i + 1] for i in range(1, len(polygon) - 1)]
        cut.append(polygon[ears(corners[polygon], str(path)) if place in hollow else np.array(fan, int).reshape(-1, 3)])
    return corners, np.concatenate(cut).astype(np.int64)


def _read_step(data: bytes, path: Path) -> tuple[FloatArray, IntArray]:
    try:
        import cascadio
    except ImportError as error:
        if isinstance(error, ModuleNotFoundError) and error.name == "cascadio":
            raise PartError(
                f"{path}: STEP files need one more package: pip install -e '.[step]' in the checkout, "
                "or export the part as PLY"
            ) from None
        reason = " ".join(str(error).split())[:100]
        raise PartError(
            f"{path}: STEP files need cascadio, which is installed but cannot be imported ({reason}): mend that, "
            "or export the part as PLY"
        ) from None
    # OpenCASCADE takes half a file for a whole one, so its two ends are looked for first.
    end = _STEP_END.search(data)
    if b"ISO-10303-21" not in data[:4096] or end is None:
        raise InputFileError(f"{path}: cut off, or no STEP file (lacks END-ISO-10303-21): export it again")
    # A signature may follow, a blank stand within it and a mark before it all: OpenCASCADE gets the plain words.
    whole = data[: end.start()].removeprefix(BYTE_ORDER_MARK) + b"END-ISO-10303-21;\n"
    with native_output_silenced():  # errors are told in one line, below
        glb = cascadio.load(whole, file_type="step", tol_linear=STEP_TOLERANCE_MM, tol_angular=STEP_TOLERANCE_RAD)
    if not glb:
        raise InputFileError(f"{path}: OpenCASCADE cannot read this STEP file: export it again")
    return _parse(glb, "glb", path)


def _in_ascii(data: bytes, path: Path) -> bytes:
    """A PLY file with "?" for whatever is not ASCII in its header: comments in Latin-1 stop trimesh's parser."""
    header, end, body = data.partition(b"end_header")
    return header.decode("ascii", errors="replace").replace("\ufffd", "?").encode("ascii") + end + body


def _check_ply(data: bytes, vertex_count: int, face_count: int, path: Path) -> None:
    """Compare what was read with what the header promises; faces may be more: polygons become triangles."""
    header, _, body = data.partition(b"end_header")
    promised = {name: int(count) for name, count in re.findall(rb"^element\s+(\w+)\s+(\d+)", header, re.MULTILINE)}
    vertices, faces = promised.get(b"vertex", 0), promised.get(b"face", 0)
    short = vertex_count < vertices or face_count < faces
    if re.search(rb"^format\s+ascii", header, re.MULTILINE):
        lines = sum(1 for line in body.splitlines() if line.strip())
        short = short or lines < sum(promised.values())
        if lines > sum(promised.values()):
            raise InputFileError(
                f"{path}: holds {lines} lines, but its header promises {vertices} vertices and {faces} faces: "
                "export it again"
            )
    if short:
        raise InputFileError(
            f"{path}: cut off: the header promises {vertices} vertices and {faces} faces, of which "
            f"{min(vertex_count, vertices)} and {min(face_count, faces)} were read: export it again"
        )


def _plain_stl(data: bytes, path: Path) -> bytes:
    """A whole STL file, without what stands around it.

    Binary: 84 bytes, then 50 per face. ASCII: every `facet` has its `endfacet`; an `endsolid` follows.
    """
    faces = int.from_bytes(data[80:84], "little")
    whole = 84 + 50 * faces
    # Some programs begin the header of binary files with "solid" too, so lengths are asked first.
    if len(data) >= whole and not data[whole:].strip(_BLANK):
        return data[:whole]
    text = data.removeprefix(BYTE_ORDER_MARK).lstrip()
    if text[:5].lower() == b"solid" and b"facet" in text[:1000].lower():
        opened, closed, ends = (
            len(re.findall(rb"^\s*" + word + rb"\b", text.lower(), re.MULTILINE))
            for word in (b"facet", b"endfacet", b"endsolid")
        )
        if opened != closed or ends == 0:
            raise InputFileError(f"{path}: cut off: ASCII STL stops after face {closed}: export it again")
        return text
    raise InputFileError(
        f"{path}: cut off or no STL file: the header promises {faces} faces in {whole} bytes, "
        f"the file has {len(data)}: export it again"
    )


def _plain_obj(data: bytes, path: Path) -> bytes:
    """See `plain_obj`. The last line may be torn; whole lines that are missing leave no trace."""
    words = data.rstrip().rpartition(b"\n")[2].split()
    if words and words[0] in (b"f", b"v") and len(words) < 4:
        raise InputFileError(f"{path}: cut off: the last line is '{words[0].decode()} …': export it again")
    return plain_obj(data, str(path))
