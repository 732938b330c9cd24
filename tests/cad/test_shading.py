"""The shaded picture lies where the rays say; without OpenGL there is one line that says what to install."""

from __future__ import annotations

import os
import subprocess
import sys

import numpy as np
import pytest
from meshes import bushing

from acp_lab.cad import shading
from acp_lab.cad.raycast import depth_map, make_caster
from acp_lab.cad.shading import Look, Shaded, shade
from acp_lab.errors import AcpLabError
from acp_lab.geometry.camera import Camera
from acp_lab.geometry.pose import make_pose, so3_exp

CAMERA = Camera(320, 240, 700.0, 720.0, 150.3, 130.7)


def _pose() -> np.ndarray:
    rotation = so3_exp(np.array([2.2, 0.5, 0.3]))
    return make_pose(rotation, np.array([4.0, -3.0, 160.0]) - rotation @ bushing().box_centre)


@pytest.fixture(scope="module")
def shaded() -> Shaded:
    try:
        return shade(bushing(), CAMERA, _pose())
    except AcpLabError as error:
        pytest.skip(str(error))


def test_picture_and_depth_have_our_shapes(shaded: Shaded) -> None:
    assert shaded.image.shape == (240, 320, 3)
    assert shaded.image.dtype == np.uint8
    assert shaded.depth.shape == (240, 320)
    assert shaded.depth.dtype == np.float64
    seen = shaded.depth > 0.0
    assert shaded.image[seen].mean() > 60.0
    assert shaded.image[~seen].mean() < 5.0


def test_the_depth_is_that_of_the_rays_to_the_pixel_and_below(shaded: Shaded) -> None:
    part = bushing()
    rays = depth_map(part, make_caster(part), CAMERA, _pose())
    differ = ((rays > 0.0) != (shaded.depth > 0.0)).sum()
    assert differ <= 3
    both = (rays > 0.0) & (shaded.depth > 0.0)
    assert np.quantile(np.abs(rays - shaded.depth)[both], 0.99) < 0.01
    # Half a pixel, or an axis turned round, would be seen at once.
    for shift_x, shift_y in ((0.5, 0.0), (-0.5, 0.0), (0.0, 0.5), (0.0, -0.5)):
        beside = Camera(320, 240, 700.0, 720.0, 150.3 + shift_x, 130.7 + shift_y)
        moved = depth_map(part, make_caster(part), beside, _pose())
        assert ((moved > 0.0) != (shaded.depth > 0.0)).sum() > 30


def test_the_picture_lies_where_its_depth_lies(shaded: Shaded) -> None:
    # Anti-aliasing spreads the outline evenly to both sides, so the weighted area and centre stay.
    bright = shade(bushing(), CAMERA, _pose(), Look(colour=(1.0, 1.0, 1.0), metallic=0.0, ambient=50.0)).image
    weight = bright[..., 0] / 255.0
    v, u = np.mgrid[:240, :320]
    seen = shaded.depth > 0.0
    assert weight[seen].min() > 0.2
    centre = [(u * weight).sum() / weight.sum(), (v * weight).sum() / weight.sum()]
    np.testing.assert_allclose(centre, [u[seen].mean(), v[seen].mean()], atol=0.05)


def test_pictures_of_two_sizes_do_not_mix(shaded: Shaded) -> None:
    half = Camera(160, 120, 350.0, 360.0, 74.9, 65.1)
    small = shade(bushing(), half, _pose())
    again = shade(bushing(), CAMERA, _pose())
    assert small.image.shape == (120, 160, 3)
    np.testing.assert_array_equal(again.image, shaded.image)
    np.testing.assert_array_equal(again.depth, shaded.depth)


def test_the_look_changes_the_colour(shaded: Shaded) -> None:
    look = Look(colour=(0.8, 0.1, 0.1), background=(0.0, 0.0, 1.0))
    red = shade(bushing(), CAMERA, _pose(), look).image
    seen = shaded.depth > 0.0
    assert red[seen][:, 0].mean() > 2.0 * red[seen][:, 2].mean()
    np.testing.assert_array_equal(red[0, 0], [0, 0, 255])


def test_without_pyrender_one_line_names_the_packages(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pyrender", None)
    with pytest.raises(AcpLabError, match=r"libegl1 .*nothing else in acp_lab needs it") as caught:
        shade(bushing(), CAMERA, _pose())
    assert "\n" not in str(caught.value)


def test_without_a_driver_one_line_names_the_packages(monkeypatch: pytest.MonkeyPatch) -> None:
    class NoDriver:
        def OffscreenRenderer(self, width: int, height: int) -> None:
            raise ValueError("Invalid device ID (0)\n")

    monkeypatch.setattr(shading, "_pyrender", NoDriver)
    with pytest.raises(AcpLabError, match=r"\(Invalid device ID \(0\)\): on Debian, apt install libegl1"):
        shading._renderer(7, 5, os.getpid())


def test_importing_the_module_imports_neither_opengl_nor_torch() -> None:
    heavy = {"pyrender", "OpenGL", "torch", "kornia", "trimesh"}
    code = f"import sys, acp_lab.cad.shading; print({heavy} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "set()"
