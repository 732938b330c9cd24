"""A picture of the part as a metal one, through OpenGL (pyrender): for displays, examples and rendered data.

Nothing that tracks needs it: edges, depths and normals come from `acp_lab.cad.raycast`. So pyrender, whose
mere import fails without OpenGL libraries, is imported only here and only on the first call.

This is the one place where OpenGL's conventions meet ours. Its camera looks along -z with y up; ours looks
along +z with y down: a half turn about x. Its pixel centres lie at +0.5; ours at whole numbers: cx and cy
grow by half a pixel on their way in.
"""

from __future__ import annotations

import os
import sys
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from acp_lab.cad.part import Part
from acp_lab.errors import AcpLabError
from acp_lab.geometry.arrays import ByteImage, FloatArray
from acp_lab.geometry.camera import Camera
from acp_lab.geometry.pose import transform

_GL_T_CV = np.diag([1.0, -1.0, -1.0, 1.0])


@dataclass(frozen=True)
class Look:
    """How the part is shown: colours are RGB in 0..1, `metallic` and `roughness` 0..1 as in glTF materials.

    The one light shines past the camera from its upper left. OpenGL here knows no surroundings, so a rough
    metal looks right and a mirror would look black.
    """

    colour: tuple[float, float, float] = (0.75, 0.76, 0.78)
    metallic: float = 0.5
    roughness: float = 0.5
    ambient: float = 0.12
    light: float = 5.0
    background: tuple[float, float, float] = (0.0, 0.0, 0.0)


@dataclass(frozen=True, eq=False)
class Shaded:
    """image: (h, w, 3) RGB uint8, anti-aliased. depth: (h, w) mm at the pixel centres, 0 where nothing."""

    image: ByteImage
    depth: FloatArray


def shade(part: Part, camera: Camera, cam_T_obj: FloatArray, look: Look = Look()) -> Shaded:
    """Render the part at cam_T_obj (4, 4) as the camera's pinhole part sees it, flat-shaded.

    Raises AcpLabError, naming what to install, where OpenGL does not work.
    """
    pyrender = _pyrender()
    depth_range = transform(cam_T_obj, part.box_centre)[2] + part.radius * np.array([-1.05, 1.05])
    near = max(float(depth_range[0]), 1e-3 * part.diameter)
    far = max(float(depth_range[1]), 2.0 * near)
    scene = pyrender.Scene(bg_color=(*look.background, 1.0), ambient_light=[look.ambient] * 3)
    # A scene of its own for every picture: one that has been in two renderers draws garbage.
    node = scene.add(_mesh(pyrender, part, look), pose=_GL_T_CV @ cam_T_obj)
    intrinsics = (camera.fx, camera.fy, camera.cx + 0.5, camera.cy + 0.5)
    scene.add(pyrender.IntrinsicsCamera(*intrinsics, znear=near, zfar=far), pose=np.eye(4))
    scene.add(pyrender.DirectionalLight(intensity=look.light), pose=_light_pose())
    renderer = _renderer(camera.width, camera.height, os.getpid())
    image, _ = renderer.render(scene)
    # The depth of an anti-aliased picture is that of one sample, 0.4 px beside the centre. pyrender switches
    # anti-aliasing off for segmentation pictures alone, so the depth is taken from one of those.
    _, depth = renderer.render(scene, pyrender.RenderFlags.SEG, {node: 255})
    return Shaded(np.array(image[..., :3], dtype=np.uint8), np.array(depth, dtype=np.float64))


def _mesh(pyrender: Any, part: Part, look: Look) -> Any:
    """Every face with its own three corners and normal: flat shading shows the edges of a machined part."""
    material = pyrender.MetallicRoughnessMaterial(
        baseColorFactor=(*look.colour, 1.0),
        metallicFactor=look.metallic,
        roughnessFactor=look.roughness,
        alphaMode="OPAQUE",  # transparent meshes are sorted by Mesh.bounds, which NumPy 2 breaks
        doubleSided=True,
    )
    primitive = pyrender.Primitive(
        positions=part.vertices[part.faces].reshape(-1, 3).astype(np.float32),
        normals=np.repeat(part.face_normals, 3, axis=0).astype(np.float32),
        material=material,
    )
    return pyrender.Mesh([primitive])


def _light_pose() -> FloatArray:
    """A directional light shines along its -z: from the upper left, past the camera, onto the part."""
    backwards = np.array([-0.45, 0.6, 1.0]) / np.linalg.norm([-0.45, 0.6, 1.0])
    right = np.cross([0.0, 1.0, 0.0], backwards)
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3, :3] = np.column_stack([right, np.cross(backwards, right), backwards])
    return pose


def _pyrender() -> Any:
    if sys.platform == "linux":
        # OpenGL without a display; it has to be said before PyOpenGL's first import.
        os.environ.setdefault("PYOPENGL_PLATFORM", "egl")
    try:
        import pyrender
    except Exception as error:  # PyOpenGL raises ImportError, OSError or AttributeError, whatever fails first
        raise _no_opengl(error) from None
    return pyrender


@lru_cache(maxsize=4)
def _renderer(width: int, height: int, process: int) -> Any:
    """One renderer per size and process: making one takes longer than a picture; a fork cannot share it."""
    try:
        return _pyrender().OffscreenRenderer(width, height)
    except AcpLabError:
        raise
    except Exception as error:  # whatever EGL and its drivers come up with
        raise _no_opengl(error) from None


def _no_opengl(error: Exception) -> AcpLabError:
    reason = " ".join(str(error).split())[:100] or type(error).__name__
    return AcpLabError(
        f"shaded pictures need OpenGL, which does not work here ({reason}): on Debian, apt install libegl1 "
        "libgl1 libegl-mesa0 libgl1-mesa-dri; nothing else in acp_lab needs it"
    )
