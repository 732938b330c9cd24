"""Notebook 08: choosing control points."""

from __future__ import annotations

from typing import Any

import numpy as np

from acp_lab.control_points.coplanar_points import mid_section_points
from acp_lab.control_points.view_regions import ALL_REGIONS
from acp_lab.course.answers import Hint, as_array, as_function, as_number
from acp_lab.course.grader import exercise
from acp_lab.course.workshop import SAMPLE_REGION, sample_part
from acp_lab.errors import GeometryError
from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.homography import apply_homography, check_quad, homography_from_points

APART_MM = 5.0
_FLAT_MM = 0.01


@exercise("08.1")
def region_of(answer: Any) -> str:
    """region_of(direction_obj, half_size) -> 0..5."""
    find = as_function(answer, "a function region_of(direction_obj, half_size)")
    rng = np.random.default_rng(8)
    half_size = np.array([30.0, 20.0, 12.0])
    directions = rng.normal(size=(200, 3)) * np.array([30.0, 20.0, 12.0])
    found = np.array([as_number(find(direction, half_size), "a number from 0 to 5") for direction in directions])
    right = _regions(directions / half_size)
    if (found == right).all():
        return "Measured in half sides, the box is a cube, and a cube's regions are decided by the largest entry."
    if (found == _regions(directions)).all():
        raise Hint("Those are the regions of a cube; the corners of this box are elsewhere.")
    if (found == _regions(directions * half_size)).all():
        raise Hint("Multiply or divide? The long side of a box has the narrow region.")
    if (found // 2 == right // 2).all():
        raise Hint("The axis is right, the side of it is not: even numbers look from the positive side.")
    if (found == right // 2).all():
        raise Hint("That is the axis, 0 to 2; two regions lie along each.")
    if not np.isin(found, range(6)).all():
        raise Hint("Return one whole number from 0 to 5.")
    raise Hint("Try directions straight along an axis first, then one just beside a corner of the box.")


@exercise("08.2")
def other_points(answer: Any) -> str:
    """Four other points of the middle section's plane."""
    points_obj = as_array(answer, (4, 3), "four points, (4, 3) mm")
    part = sample_part()
    axis = ALL_REGIONS[SAMPLE_REGION].axis
    section = mid_section_points(part.box_min, part.box_max, axis)
    off = points_obj[:, axis] - part.box_centre[axis]
    if np.abs(off).max() > _FLAT_MM:
        if np.ptp(off) < _FLAT_MM:
            raise Hint("These four lie in one plane, but in another one: which number must not change?")
        raise Hint("What does e_3d depend on? These points are not in the plane of the middle section.")
    apart = np.linalg.norm(points_obj[:, None] - section[None], axis=2)
    if apart.min() < APART_MM:
        raise Hint(f"One of the points is {apart.min():.1f} mm from one of the middle section; move it further.")
    try:
        check_quad(np.delete(points_obj, axis, axis=1), minimum_px=1.0)
    except GeometryError:
        raise Hint("In their order, the four are no convex quad; no homography hangs on them.") from None
    return "Any four points of the plane tell the same homography, so e_3d cannot tell them apart. PnP can."


@exercise("08.3")
def homography(answer: Any) -> str:
    """homography(src, dst) -> (3, 3), its lower right entry 1."""
    make = as_function(answer, "a function homography(src, dst)")
    rng = np.random.default_rng(83)
    square = np.array([[100.0, 100.0], [300.0, 90.0], [310.0, 280.0], [95.0, 300.0]])
    for _ in range(3):
        src, dst = (square + rng.uniform(-25.0, 25.0, (4, 2)) for _ in range(2))
        found = as_array(make(src, dst), (3, 3), "a matrix, (3, 3)")
        right = homography_from_points(src, dst)
        if np.allclose(found, right, rtol=1e-5, atol=1e-7):
            continue
        _compare_homographies(found, right, src, dst)
    return "The eight moved coordinates are what the printed equation lost."


def _compare_homographies(found: FloatArray, right: FloatArray, src: FloatArray, dst: FloatArray) -> None:
    """Raise the hint that fits a wrong homography."""
    last = found[2, 2]
    if last != 0.0 and np.allclose(found / last, right, rtol=1e-5, atol=1e-7):
        raise Hint("The right map, in another scale: its lower right entry shall be one.")
    if np.allclose(found, homography_from_points(dst, src), rtol=1e-4, atol=1e-6):
        raise Hint("That is the way back: it takes the second quad to the first.")
    if np.allclose(found, right.T, rtol=1e-5, atol=1e-7):
        raise Hint("Transposed: the eight numbers fill the matrix row by row.")
    moved = apply_homography(found, src)
    if np.isfinite(moved).all() and np.abs(moved - dst).max() < 1e-3:
        raise Hint("It moves the four points well; compare the entries, and their accuracy.")
    raise Hint(
        "Each point gives two equations. Multiply x' = (h1 x + h2 y + h3) / (h7 x + h8 y + 1) by its denominator."
    )


def _regions(leaning: FloatArray) -> FloatArray:
    axis = np.abs(leaning).argmax(1)
    negative = leaning[np.arange(len(leaning)), axis] < 0.0
    return np.asarray(2 * axis + negative, dtype=np.float64)
