"""Which points an image shows, against a slow twin."""

from __future__ import annotations

import numpy as np

from acp_lab.geometry.camera import Camera
from acp_lab.geometry.in_image import in_image

CAMERA = Camera(width=200, height=160, fx=320.0, fy=325.0, cx=99.5, cy=79.5)


def test_points_count_up_to_the_centres_of_the_outermost_pixels(rng: np.random.Generator) -> None:
    right, bottom = CAMERA.width - 1.0, CAMERA.height - 1.0
    points = rng.uniform((-0.5 * right, -0.5 * bottom), (1.5 * right, 1.5 * bottom), (300, 2))
    points[:4] = (0.0, 0.0), (right, bottom), (np.nextafter(right, np.inf), 0.0), (0.0, np.nan)
    expected = ((points >= 0.0) & (points <= (right, bottom))).all(1)
    np.testing.assert_array_equal(in_image(points, CAMERA), expected)
    assert expected[:4].tolist() == [True, True, False, False]
    assert 20 < expected.sum() < 280
    assert in_image(np.zeros((0, 2)), CAMERA).shape == (0,)
