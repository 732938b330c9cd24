"""Where the parts lie that are like the tracked one, and how much of each a frame shows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from acp_lab.geometry.camera import Camera
from acp_lab.geometry.pose import inverse, make_pose, transform
from data_recipes.metal.bodies import Placed
from data_recipes.metal.scene import Moment, Scene

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
    moment = scene.at(float(frame))
    there = list(scene.look_alikes)
    if there and scene.occluder_path is not None:
        there.append(moment.world_T_cam @ scene.occluder_path.at(float(frame)))
    found = []
    for world_T_item in there:
        # How a part rests was rounded, and so may be the camera; told is the rotation that is nearest to what is seen.
        cam_T_obj = np.linalg.solve(moment.world_T_cam, world_T_item)
        left, _, right = np.linalg.svd(cam_T_obj[:3, :3])
        pose = make_pose(left @ right, cam_T_obj[:3, 3])
        found.append(LookAlike(pose, _visible(Placed(scene.part, world_T_item), moment, scene.camera)))
    return found


def _visible(item: Placed, moment: Moment, camera: Camera) -> float:
    """Of the pixels that a body would take alone, beyond the image's border too, the share that shows it."""
    world_T_cam = moment.world_T_cam
    points_cam = transform(inverse(world_T_cam) @ item.world_T_body, item.body.vertices)
    if points_cam[:, 2].min() <= 0.0:
        return 0.0
    outline = camera.project(points_cam)
    x, y = np.meshgrid(
        *(np.arange(low, high, _STEP_PX) for low, high in zip(outline.min(0), outline.max(0), strict=True))
    )
    pixels = np.stack([x.ravel(), y.ravel()], 1)
    rays = camera.rays(pixels) @ world_T_cam[:3, :3].T
    eye = np.broadcast_to(world_T_cam[:3, 3], rays.shape)
    own, _ = item.first_hit(eye, rays)
    nearest = np.min([placed.first_hit(eye, rays)[0] for placed in moment.bodies], axis=0)
    inside = (pixels >= 0.0).all(1) & (pixels <= [camera.width - 1, camera.height - 1]).all(1)
    alone = np.isfinite(own)
    shown = inside & (nearest > (1.0 - _SAME_SHARE) * own)
    return float(shown[alone].mean()) if alone.any() else 0.0
