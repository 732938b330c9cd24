"""Notebook 03: from CAD to edges."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

from acp_lab.cad.edges import facing
from acp_lab.control_points.canonical_frame import eye_position
from acp_lab.course.answers import Hint, as_array, as_function, as_number, near
from acp_lab.course.grader import exercise
from acp_lab.course.workshop import SAMPLE_OBJECT, sample_part, sample_scene
from acp_lab.geometry.arrays import BoolArray, FloatArray
from acp_lab.studies.true_edges import TrueEdges

ASKED_FRAME = 20


@exercise("03.1")
def crease(answer: Any) -> str:
    """is_crease(normals_a, normals_b, limit_deg) -> (n,) bool, for unit normals (n, 3)."""
    is_crease = as_function(answer, "a function is_crease(normals_a, normals_b, limit_deg)")
    rng = np.random.default_rng(3)
    normals_a, normals_b = (_unit(rng.normal(size=(60, 3))) for _ in range(2))
    normals_b[:20] = _unit(normals_a[:20] + 0.3 * normals_b[:20])
    angles_deg = np.degrees(np.arccos(np.clip((normals_a * normals_b).sum(1), -1.0, 1.0)))
    for limit_deg in (60.0, 25.0, 120.0):
        found = _booleans(is_crease(normals_a, normals_b, limit_deg), 60)
        if (found == (angles_deg > limit_deg)).all():
            continue
        if (found == (angles_deg < limit_deg)).all():
            raise Hint("The other way round: flat ground has an angle of zero between its normals, and is no crease.")
        if (found == (np.radians(angles_deg) > limit_deg)).all():
            raise Hint(
                "No edge passes at all: are angles compared, in degrees? np.arccos gives radians and np.cos takes them."
            )
        if (found == (angles_deg > 180.0 - limit_deg)).all():
            raise Hint("The angle is that between the normals, not that inside the material.")
        if (found == (np.minimum(angles_deg, 180.0 - angles_deg) > limit_deg)).all():
            raise Hint("120 degrees are taken for 60: keep the sign of the scalar product.")
        if limit_deg > 90.0:
            raise Hint("Right for small limits; try a limit beyond 90 degrees, where the cosine changes its sign.")
        raise Hint("The cosine of the angle between two unit vectors is their scalar product, pair by pair.")
    return "On this part nothing lies between 12 and 28 degrees, so any limit in there finds the same creases."


@exercise("03.2")
def silhouette(answer: Any) -> str:
    """outline(points_obj, normals_obj, eye_obj) -> (n,) bool: exactly one of both faces turns to the eye."""
    outline = as_function(answer, "a function outline(points_obj, normals_obj, eye_obj)")
    rng = np.random.default_rng(4)
    points_obj = rng.uniform(-40.0, 40.0, (400, 3))
    normals_obj = _unit(rng.normal(size=(400, 2, 3)))
    eye_obj = np.array([60.0, 50.0, 90.0])
    found = _booleans(outline(points_obj, normals_obj, eye_obj), 400)
    turned = np.einsum("nkj,nj->nk", normals_obj, eye_obj - points_obj) > 0.0
    if (found == (turned[:, 0] != turned[:, 1])).all():
        return "One face seen, one not. It takes no ray, two scalar products per sample."
    if (found == turned.any(1)).all():
        raise Hint("Where both faces are seen there is an edge inside the part's image, and no outline.")
    if (found == turned.all(1)).all():
        raise Hint("Where both faces are seen, the part goes on behind the edge: that is no outline.")
    if (found == (turned[:, 0] == turned[:, 1])).all():
        raise Hint("Just the opposite.")
    from_origin = np.einsum("nkj,j->nk", normals_obj, eye_obj) > 0.0
    if (found == (from_origin[:, 0] != from_origin[:, 1])).all():
        raise Hint("A near camera sees each point along a ray of its own: from where to where does it run?")
    raise Hint("A face turns towards the eye when its normal and the way from the sample to the eye agree in sign.")


@exercise("03.3")
def hidden_share(answer: Any) -> str:
    """Of the samples whose faces turn to the camera in frame 20, the share that the part itself hides."""
    share = as_number(answer, "a share between 0 and 1")
    if 1.0 < share <= 100.0:
        raise Hint("Percent? Give the share itself, between 0 and 1.")
    if not 0.0 <= share <= 1.0:
        raise Hint("A share lies between 0 and 1.")
    shows, seen, count = _counts(ASKED_FRAME)
    if near(share, 1.0 - seen / shows, absolute=0.004):
        return "These would all be drawn by a generator that asks no ray, and each attracts a wrong edge."
    if near(share, seen / shows, absolute=0.004):
        raise Hint("That is the share that can be seen.")
    if near(share, 1.0 - seen / count, absolute=0.004) or near(share, (shows - seen) / count, absolute=0.004):
        raise Hint("Share of what? Not of all samples, of those whose faces turn to the camera.")
    other_shows, other_seen, _ = _counts(0)
    if near(share, 1.0 - other_seen / other_shows, absolute=0.004):
        raise Hint(f"That is frame 0; the question is about frame {ASKED_FRAME}.")
    raise Hint("facing(...).shows tells who turns to the camera; TrueEdges.rows, who of them is left after the rays.")


@cache
def _counts(frame_id: int) -> tuple[int, int, int]:
    """Samples that turn to the camera, that are seen, and all of them."""
    true_pose = sample_scene().truth(frame_id, SAMPLE_OBJECT)
    assert true_pose is not None, "the sample has truth for every frame"
    truth = TrueEdges(sample_part())
    shows = facing(truth.edges, eye_position(true_pose)).shows
    return int(shows.sum()), len(truth.rows(true_pose)), len(truth.edges)


def _booleans(answer: Any, count: int) -> BoolArray:
    """(count,) of a function's answer; Hint for anything but true and false."""
    array = as_array(answer, (count,), f"one True or False per row, ({count},)")
    if not np.isin(array, (0.0, 1.0)).all():
        raise Hint("Return True or False per row, not numbers: compare with the limit inside the function.")
    return array > 0.5


def _unit(vectors: FloatArray) -> FloatArray:
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
