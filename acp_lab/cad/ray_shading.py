"""A plain picture of the part by ray casting: flat faces under one light, no OpenGL.

For displays that must work everywhere; `acp_lab.cad.shading` makes finer ones where OpenGL is there.
"""

from __future__ import annotations

import cv2
import numpy as np

from acp_lab.cad.part import Part
from acp_lab.cad.raycast import RayCaster, hit_map
from acp_lab.geometry.arrays import ByteImage, FloatArray
from acp_lab.geometry.camera import Camera
from acp_lab.geometry.pose import transform

# From the upper left, past the camera; camera axes, y points down.
TO_LIGHT_CAM = np.array([-0.45, -0.6, -1.0]) / np.linalg.norm([-0.45, -0.6, -1.0])
AMBIENT = 0.38
METAL = np.array([206.0, 210.0, 216.0], np.float32)
FINE = 2


def ray_shade(
    part: Part,
    caster: RayCaster,
    camera: Camera,
    cam_T_obj: FloatArray,
    background: tuple[int, int, int] = (44, 48, 54),
    fine: int = FINE,
) -> ByteImage:
    """The part at cam_T_obj (4, 4) as the camera's pinhole part sees it: (h, w, 3) RGB.

    Each pixel is the mean of fine x fine rays, of four by default.
    """
    _, face = hit_map(part, caster, _finer(camera, fine), cam_T_obj)
    hit = face >= 0
    # The last entry answers for the pixels that hit nothing, face -1.
    bright = np.append(_light_of_faces(part, cam_T_obj), 0.0).astype(np.float32)[face]
    size = (camera.width, camera.height)
    covered = cv2.resize(hit.astype(np.float32), size, interpolation=cv2.INTER_AREA)[..., None]
    light = cv2.resize(bright, size, interpolation=cv2.INTER_AREA)[..., None]
    image = light * METAL + (1.0 - covered) * np.array(background, np.float32)
    return np.round(image).astype(np.uint8)


def _light_of_faces(part: Part, cam_T_obj: FloatArray) -> FloatArray:
    """(m,) in [0, 1]: how bright each face is, by the side that it turns to the camera."""
    normals_cam = part.face_normals @ cam_T_obj[:3, :3].T
    corners_cam = transform(cam_T_obj, part.vertices[part.faces[:, 0]])
    # Only an open or badly wound mesh shows the inside of a face.
    turned_away = np.einsum("ij,ij->i", normals_cam, corners_cam) > 0.0
    towards = np.where(turned_away, -1.0, 1.0) * (normals_cam @ TO_LIGHT_CAM)
    lit: FloatArray = AMBIENT + (1.0 - AMBIENT) * np.clip(towards, 0.0, 1.0)
    return lit


def _finer(camera: Camera, fine: int) -> Camera:
    """The camera of an image with `fine` times as many pixels each way; pixel centres stay whole numbers."""
    return Camera(
        camera.width * fine,
        camera.height * fine,
        camera.fx * fine,
        camera.fy * fine,
        (camera.cx + 0.5) * fine - 0.5,
        (camera.cy + 0.5) * fine - 0.5,
    )
