"""Where the parts lie that are like the tracked one, and how much of each a frame shows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from acp_lab.geometry.pose import inverse, make_pose, transform
from data_recipes.metal.scene import Scene

# Every so many-th pixel each way is asked what it shows.
_STEP_PX = 3
# Where it shows the part's surface, to so much of its distance.
_SAME_SHARE = 1e-3


@dataclass(frozen=True, eq=False)
class LookAlike:
    """cam_T_obj: (4, 4) mm. visible: the share of it that is neither hidden nor beyond the image's border."""

    cam_T_obj: np.ndarray
    visible: float


def look_alikes_in(scene: Scene, frame: int) -> list[LookAlike]:
    """All of a scene's, in a frame: those that lie there, and the one that passes in front."""
    cam_T_world = inverse(scene.at(float(frame)).world_T_cam)
    there = [cam_T_world @ world_T_item for world_T_item in scene.look_alikes]
    if scene.look_alikes and scene.occluder_path is not None:
        there.append(scene.occluder_path.at(float(frame)))
    found = []
    for cam_T_obj in there:
        # How a part rests was rounded; told is the rotation that is nearest to it.
        left, _, right = np.linalg.svd(cam_T_obj[:3, :3])
        pose = make_pose(left @ right, cam_T_obj[:3, 3])
        found.append(LookAlike(pose, _visible(scene, frame, pose)))
    return found


def _visible(scene: Scene, frame: int, cam_T_obj: np.ndarray) -> float:
    camera, moment = scene.camera, scene.at(float(frame))
    corners = transform(cam_T_obj, scene.part.vertices)
    if corners[:, 2].min() <= 0.0:
        return 0.0
    (x0, y0), (x1, y1) = (f(camera.project(corners)) for f in (lambda p: p.min(0), lambda p: p.max(0)))
    x, y = np.meshgrid(np.arange(x0, x1, _STEP_PX), np.arange(y0, y1, _STEP_PX))
    pixels = np.stack([x.ravel(), y.ravel()], 1)
    own = _depths(scene, cam_T_obj, camera.rays(pixels))
    pixels, own = pixels[np.isfinite(own)], own[np.isfinite(own)]
    if not len(own):
        return 0.0
    rays, nearest = camera.rays(pixels), np.full(len(own), np.inf)
    for placed in moment.bodies:
        body_T_cam = inverse(placed.world_T_body) @ moment.world_T_cam
        origins = np.broadcast_to(body_T_cam[:3, 3], rays.shape)
        nearest = np.minimum(nearest, placed.body.caster.first_hit(origins, rays @ body_T_cam[:3, :3].T)[0])
    inside = (pixels >= 0.0).all(1) & (pixels <= [camera.width - 1, camera.height - 1]).all(1)
    return float(np.mean(inside & (nearest > (1.0 - _SAME_SHARE) * own)))


def _depths(scene: Scene, cam_T_obj: np.ndarray, rays: np.ndarray) -> np.ndarray:
    """(n,) mm at which rays (n, 3) meet the part alone; inf for those that do not."""
    obj_T_cam = inverse(cam_T_obj)
    origins = np.broadcast_to(obj_T_cam[:3, 3], rays.shape)
    return np.asarray(scene.part.caster.first_hit(origins, rays @ obj_T_cam[:3, :3].T)[0])
