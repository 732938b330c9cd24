"""The plain picture: the part where it is, lit faces brighter than others, the ground elsewhere."""

from __future__ import annotations

import numpy as np

from acp_lab.cad.ray_shading import ray_shade
from acp_lab.cad.raycast import hit_map, make_caster
from acp_lab.geometry.camera import Camera
from tests.made_parts import box, looking_at, open_box

CAMERA = Camera(120, 100, 220.0, 220.0, 59.5, 49.5)
GROUND = (10, 200, 30)


def test_the_picture_covers_what_rays_hit() -> None:
    part = box()
    pose = looking_at(part, np.array([0.6, 0.5, 1.0]), 220.0)
    image = ray_shade(part, make_caster(part), CAMERA, pose, GROUND)
    assert image.shape == (100, 120, 3)
    assert image.dtype == np.uint8
    depth, _ = hit_map(part, make_caster(part), CAMERA, pose)
    is_ground = (image == GROUND).all(2)
    inside = np.pad(depth > 0, 1)
    # A pixel whose neighbours are hit too is wholly metal, one whose neighbours are all missed wholly ground.
    shifted = np.stack([inside[1 + y : 101 + y, 1 + x : 121 + x] for y in (-1, 0, 1) for x in (-1, 0, 1)])
    assert not is_ground[shifted.all(0)].any()
    assert is_ground[~shifted.any(0)].all()


def test_the_three_faces_of_a_box_differ() -> None:
    part = box()
    pose = looking_at(part, np.array([1.0, 1.0, 1.0]), 220.0)
    image = ray_shade(part, make_caster(part), CAMERA, pose)
    shades, counts = np.unique(image[..., 0], return_counts=True)
    assert (counts > 300).sum() == 4  # the ground and three faces
    assert np.ptp(shades[counts > 300]) > 60


def test_the_inside_of_an_open_box_is_lit_as_it_faces_the_camera() -> None:
    part = open_box()
    image = ray_shade(part, make_caster(part), CAMERA, looking_at(part, np.array([0.0, 0.1, 1.0]), 220.0), GROUND)
    # Its floor, seen through the missing lid, turns its back to nobody: brighter than the least that faces have.
    assert image[48, 60, 0] > 120
