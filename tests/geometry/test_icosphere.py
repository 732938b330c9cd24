"""Directions spread evenly over a sphere, against trimesh's."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from acp_lab.geometry.icosphere import icosphere


@pytest.mark.parametrize("subdivisions", range(5))
def test_it_has_the_directions_of_trimesh(subdivisions: int) -> None:
    found, expected = (
        icosphere(subdivisions),
        np.asarray(trimesh.creation.icosphere(subdivisions=subdivisions).vertices),
    )
    nearest = (found @ expected.T).argmax(1)
    assert sorted(nearest) == list(range(10 * 4**subdivisions + 2))
    np.testing.assert_allclose(found, expected[nearest], atol=1e-12)


def test_corners_of_an_icosahedron_come_as_trimesh_has_them() -> None:
    """The detector numbers groups of views by them."""
    np.testing.assert_allclose(icosphere(0), trimesh.creation.icosphere(subdivisions=0).vertices, atol=1e-15)


def test_those_of_fewer_subdivisions_come_first() -> None:
    np.testing.assert_array_equal(icosphere(3)[:162], icosphere(2))
