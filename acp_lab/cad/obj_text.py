"""An OBJ file in the words that trimesh's reader knows.

The format allows more: indented lines, tabs, remarks behind numbers, and vertices that a face counts backwards (-1 is
the last one before it; trimesh counts from the end of the file). Faces may be concave polygons, which trimesh fills as
if they were convex. A file without any of it stays as it is.
"""

from __future__ import annotations

import re

import numpy as np

from acp_lab.cad.polygons import concave, ears
from acp_lab.errors import InputFileError

BYTE_ORDER_MARK = b"\xef\xbb\xbf"
_BACKWARDS_OR_POLYGON = re.compile(rb"^f(?:[^\n]*-|(?: +[^ \n]+){4})", re.MULTILINE)
_NAMES_0 = re.compile(rb"\nf\b[^\n]*[ /][-+]?0+(?![^ /\n])")


def plain_obj(data: bytes, where: str) -> bytes:
    """The bytes of an OBJ file, rewritten where trimesh would read them as another part.

    Raises InputFileError, beginning with `where`, for a face that names vertex 0, that counts back beyond the first
    vertex or that crosses itself.
    """
    text = data.removeprefix(BYTE_ORDER_MARK).replace(b"\r\n", b"\n").replace(b"\r", b"\n").replace(b"\t", b" ")
    text = re.sub(rb"^ +", b"", text, flags=re.MULTILINE)
    text = re.sub(rb"^([vf][^#\n]*)?#[^\n]*", rb"\1", text, flags=re.MULTILINE).replace(b"\\\n", b" ")
    _check_counts_from_1(text, where)
    if _BACKWARDS_OR_POLYGON.search(text) is None:
        return text
    lines = text.split(b"\n")
    counts = {b"v": 0, b"vt": 0, b"vn": 0}  # of those so far; a corner names one of each, in this order
    points: list[list[bytes]] = []
    faces: dict[int, list[bytes]] = {}
    for number, line in enumerate(lines):
        key, _, rest = line.partition(b" ")
        if key in counts:
            counts[key] += 1
            if key == b"v":
                points.append(rest.split()[:3])
        elif key == b"f":
            faces[number] = [_from_the_first(corner, counts, where) for corner in rest.split()]
            lines[number] = b"f " + b" ".join(faces[number])
    try:
        vertices = np.array(points, dtype=np.float64).reshape(-1, 3)
        polygons = [[int(corner.partition(b"/")[0]) - 1 for corner in face] for face in faces.values()]
        numbers, hollow = list(faces), concave(vertices, polygons)
    except (ValueError, IndexError, OverflowError):  # what is wrong with such numbers is told by whoever reads them all
        return b"\n".join(lines)
    for place in hollow:
        corners = faces[numbers[place]]
        triangles = ears(vertices[polygons[place]], where)
        lines[numbers[place]] = b"\n".join(b"f " + b" ".join(corners[i] for i in triangle) for triangle in triangles)
    return b"\n".join(lines)


def _check_counts_from_1(text: bytes, where: str) -> None:
    """trimesh would take 0 for the last one."""
    found = _NAMES_0.search(b"\n" + text)  # a line's end before each face, not ^: it is searched for much faster
    if found is not None:
        vertices = (corner.partition(b"/")[0] for corner in found[0].split()[1:])
        what = "vertex" if any(not vertex.strip(b"+-0") for vertex in vertices) else "texture point or normal"
        raise InputFileError(f"{where}: a face names {what} 0, but OBJ counts from 1: export it again")


def _from_the_first(corner: bytes, counts: dict[bytes, int], where: str) -> bytes:
    """A corner such as -1/-1 as 8/14, where 8 vertices and 14 texture points stand before the face."""
    if b"-" not in corner:
        return corner
    words = corner.split(b"/")
    for place, (word, count) in enumerate(zip(words, counts.values(), strict=False)):
        if word.startswith(b"-") and word[1:].isdigit() and len(word) < 19:
            if count + int(word) < 0:
                raise InputFileError(
                    f"{where}: a face names vertex {int(word)}, but {count} stand before it: export it again"
                )
            words[place] = b"%d" % (count + 1 + int(word))
    return b"/".join(words)
