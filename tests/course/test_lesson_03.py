"""The graders of notebook 03, and the made part it looks at."""

from __future__ import annotations

import numpy as np
import pytest

from acp_lab import course
from acp_lab.cad.edges import facing
from acp_lab.control_points.canonical_frame import eye_position
from acp_lab.course.made_parts import knob, portrait
from acp_lab.geometry.pose import transform
from acp_lab.studies.true_edges import TrueEdges
from tests.course.grading import hints, passes


def angles_deg(a, b):  # type: ignore[no-untyped-def]
    return np.degrees(np.arccos(np.clip((a * b).sum(1), -1.0, 1.0)))


def test_creases() -> None:
    passes("03.1", lambda a, b, limit: angles_deg(a, b) > limit)
    passes("03.1", lambda a, b, limit: ((a * b).sum(1) < np.cos(np.radians(limit))).tolist())


@pytest.mark.parametrize(
    ("wrong", "fragment"),
    [
        (lambda a, b, limit: angles_deg(a, b) < limit, "other way round"),
        (lambda a, b, limit: np.radians(angles_deg(a, b)) > limit, "radians"),
        (lambda a, b, limit: angles_deg(a, -b) < limit, "not that inside the material"),
        (
            lambda a, b, limit: np.linalg.norm(np.cross(a, b), axis=1) > np.sin(np.radians(limit)),
            "sign of the scalar product",
        ),
        (lambda a, b, limit: np.abs((a * b).sum(1)) < np.cos(np.radians(limit)), "sign of the scalar product"),
        (lambda a, b, limit: (a * b).sum(1) > limit, "angles compared, in degrees"),
        (lambda a, b, limit: (a * b).sum(1) < np.cos(limit), "np.cos takes them"),
        (lambda a, b, limit: angles_deg(a, b) > min(limit, 90.0), "beyond 90"),
        (lambda a, b, limit: angles_deg(a, b), "True or False"),
        (lambda a, b, limit: np.ones(3), "one True or False per row"),
        (25.0, "the function itself"),
    ],
)
def test_wrong_creases(wrong, fragment: str) -> None:  # type: ignore[no-untyped-def]
    hints("03.1", wrong, fragment)


def turned(points: np.ndarray, normals: np.ndarray, eye: np.ndarray) -> np.ndarray:
    return (normals * (eye - points)[:, None]).sum(2) > 0.0


def test_silhouettes() -> None:
    passes("03.2", lambda *given: turned(*given)[:, 0] ^ turned(*given)[:, 1])


@pytest.mark.parametrize(
    ("wrong", "fragment"),
    [
        (lambda *given: turned(*given).any(1), "inside the part's image"),
        (lambda *given: turned(*given).all(1), "goes on behind"),
        (lambda *given: turned(*given)[:, 0] == turned(*given)[:, 1], "opposite"),
        (lambda points, normals, eye: turned(0.0 * points, normals, eye).sum(1) == 1, "a ray of its own"),
        (lambda *given: turned(*given)[:, 0], "agree in sign"),
    ],
)
def test_wrong_silhouettes(wrong, fragment: str) -> None:  # type: ignore[no-untyped-def]
    hints("03.2", wrong, fragment)


def test_hidden_share() -> None:
    truth, scene = TrueEdges(course.sample_part()), course.sample_scene()
    shares = {}
    for frame_id in (0, 20):
        pose = scene.truth(frame_id, 1)
        assert pose is not None
        shows, seen = facing(truth.edges, eye_position(pose)).shows.sum(), len(truth.rows(pose))
        shares[frame_id] = 1.0 - seen / shows
        if frame_id == 20:
            passes("03.3", shares[20])
            hints("03.3", 1.0 - shares[20], "can be seen")
            hints("03.3", 1.0 - seen / len(truth.edges), "share of what")
    hints("03.3", 100.0 * shares[20], "percent")
    hints("03.3", shares[0], "frame 0")
    hints("03.3", 0.5, "after the rays")
    hints("03.3", -1, "between 0 and 1")
    hints("03.3", [0.1, 0.2], "one number")


def test_the_knob_is_closed_and_turned_about_z() -> None:
    part = knob()
    assert part.is_closed
    assert len(part.symmetries.continuous) == 1
    quarter = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    turned_vertices = part.vertices @ quarter.T
    nearest = np.linalg.norm(turned_vertices[:, None] - part.vertices[None], axis=2).min(1)
    assert nearest.max() < 1e-6


def test_portraits_hold_the_whole_part() -> None:
    part = knob()
    for direction in ([1.0, 0.0, 0.0], [0.0, 0.0, -2.0], [0.3, -0.5, 0.2]):
        camera, pose = portrait(part, np.array(direction), 200, distance=4.0)
        pixels = camera.project(transform(pose, part.vertices))
        assert (pixels > 0.0).all()
        assert (pixels < 199.0).all()
        away = eye_position(pose) - part.box_centre
        assert np.isclose(np.linalg.norm(away), 4.0 * part.diameter)
        assert np.allclose(away / np.linalg.norm(away), np.array(direction) / np.linalg.norm(direction))
