"""The graders of notebook 08."""

from __future__ import annotations

import numpy as np
import pytest

from acp_lab import course
from acp_lab.control_points.coplanar_points import mid_section_points
from acp_lab.control_points.view_regions import ALL_REGIONS
from acp_lab.geometry.homography import homography_from_points, homography_system
from tests.course.grading import hints, passes


def region_of(direction, half_size):  # type: ignore[no-untyped-def]
    leaning = direction / half_size
    axis = np.abs(leaning).argmax()
    return 2 * axis + int(leaning[axis] < 0.0)


def test_region() -> None:
    passes("08.1", region_of)


@pytest.mark.parametrize(
    ("wrong", "fragment"),
    [
        (lambda d, h: region_of(d, np.ones(3)), "of a cube"),
        (lambda d, h: region_of(d, 1.0 / h), "Multiply or divide"),
        (lambda d, h: region_of(-d, h), "side of it"),
        (lambda d, h: region_of(d, h) // 2, "That is the axis"),
        (lambda d, h: region_of(d, h) + 1, "0 to 5"),
        (lambda d, h: (region_of(d, h) + 2) % 6, "straight along an axis"),
        (lambda d, h: "z", "plain number"),
        (lambda d: 0, "stopped with TypeError"),
    ],
)
def test_wrong_regions(wrong, fragment: str) -> None:  # type: ignore[no-untyped-def]
    hints("08.1", wrong, fragment)


def test_other_points() -> None:
    part = course.sample_part()
    axis = ALL_REGIONS[course.SAMPLE_REGION].axis
    section = mid_section_points(part.box_min, part.box_max, axis)
    middle = section.mean(0)
    passes("08.2", middle + 0.5 * (section - middle))
    passes("08.2", (middle + 1.6 * (section - middle)).tolist())
    hints("08.2", section, "0.0 mm")
    hints("08.2", middle + 0.99 * (section - middle), "further")
    hints("08.2", (middle + 0.5 * (section - middle))[[1, 0, 2, 3]], "convex")
    hints("08.2", section + 10.0 * np.eye(3)[axis], "another one")
    hints("08.2", section + 10.0 * np.eye(4)[:, :3], "depend on")
    hints("08.2", section[:3], "(4, 3)")


def test_homography() -> None:
    passes("08.3", homography_from_points)
    passes("08.3", lambda a, b: np.append(np.linalg.solve(*homography_system(a, b)), 1.0).reshape(3, 3))


@pytest.mark.parametrize(
    ("wrong", "fragment"),
    [
        (lambda a, b: 2.0 * homography_from_points(a, b), "another scale"),
        (lambda a, b: homography_from_points(b, a), "way back"),
        (lambda a, b: homography_from_points(a, b).T, "row by row"),
        (lambda a, b: np.eye(3), "two equations"),
        (lambda a, b: homography_system(a, b)[0], "a matrix, (3, 3)"),
        (lambda a: np.eye(3), "stopped with TypeError"),
        (np.eye(3), "the function itself"),
    ],
)
def test_wrong_homographies(wrong, fragment: str) -> None:  # type: ignore[no-untyped-def]
    hints("08.3", wrong, fragment)
