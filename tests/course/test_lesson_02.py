"""The graders of notebook 02."""

from __future__ import annotations

import numpy as np
import pytest

from acp_lab.imaging import nearest_distances
from tests.course.grading import hints, passes

AFFINE = ["shift", "rotation", "scaling", "shear"]


def test_exact_maps() -> None:
    passes("02.1", AFFINE)
    hints("02.1", [*AFFINE, "perspective"], "parallel")
    hints("02.1", "shift", "more")
    hints("02.1", [], "weights w")
    hints("02.1", ["bending"], "a list of some of these words")


def apart(a, b):  # type: ignore[no-untyped-def]
    return np.linalg.norm(np.asarray(a)[:, None] - b, axis=2)


def test_one_way() -> None:
    passes("02.2", lambda a, b: apart(a, b).min(1).mean())
    passes("02.2", lambda a, b: nearest_distances(a, b).mean())


@pytest.mark.parametrize(
    ("wrong", "fragment"),
    [
        (lambda a, b: apart(a, b).min(0).mean(), "way back"),
        (lambda a, b: 0.5 * (apart(a, b).min(0).mean() + apart(a, b).min(1).mean()), "both directions"),
        (lambda a, b: apart(a, b).min(0).mean() + apart(a, b).min(1).mean(), "added up"),
        (lambda a, b: round(apart(a, b).min(1).mean(), 4), "rounded"),
        (lambda a, b: round(apart(a, b).min(1).mean(), 2), "rounded"),
        (lambda a, b: apart(a, b).mean(), "all pairs"),
        (lambda a, b: apart(a, b).min(1).max(), "largest"),
        (lambda a, b: apart(a, b).min(1).sum(), "sum"),
        (lambda a, b: (apart(a, b).min(1) ** 2).mean(), "squared"),
        (lambda a, b: np.sqrt((apart(a, b).min(1) ** 2).mean()), "root"),
        (lambda a, b: 3.0, "the least of these"),
        (lambda a, b: apart(a, b).min(1), "one number"),
        (lambda a: 0.0, "stopped with TypeError"),
        (1.0, "the function itself"),
    ],
)
def test_wrong_ways(wrong, fragment: str) -> None:  # type: ignore[no-untyped-def]
    hints("02.2", wrong, fragment)


def test_obedient() -> None:
    passes("02.3", ["thin-plate spline", "homography"])
    hints("02.3", ["homography", "view templates"], "PnP")
    hints("02.3", ["homography", "thin-plate spline", "visibility network"], "PnP")
    hints("02.3", "homography", "One more")
    hints("02.3", [], "Two of them")
    hints("02.3", 2, "some of these words")
