"""What distinguishes the right pose from a wrong one in an image: outer contour, edges, unexplained image edges.

For pairs of poses whose outer contours agree (`ambiguity`), or any two poses that a tracker may confuse. Measures are
mean distances to the nearest edge in px, capped, so that missing edges cannot decide alone (alpha of eq. 6).
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from acp_lab.cad.edges import EdgeSamples
from acp_lab.cad.part import Part
from acp_lab.cad.raycast import RayCaster, normal_map
from acp_lab.control_points.motion_pairs import draw_samples, visible_rows
from acp_lab.geometry.arrays import BoolArray, ByteImage, Float32Array, FloatArray, IntArray
from acp_lab.geometry.camera import Camera
from acp_lab.geometry.pose import transform
from acp_lab.imaging.canny import canny
from acp_lab.imaging.distance import distance_map
from acp_lab.studies.silhouettes import outer_contour


@dataclass(frozen=True)
class Contest:
    """One measure of two poses in one image, px: the mean of capped distances. The smaller one wins."""

    right_px: float
    wrong_px: float

    @property
    def margin_px(self) -> float:
        """px by which the wrong pose loses; at 0 or below the measure chooses wrongly."""
        return self.wrong_px - self.right_px

    def __str__(self) -> str:
        return f"right {self.right_px:.2f} px, wrong {self.wrong_px:.2f} px"


@dataclass(frozen=True)
class Distinction:
    """How well an image distinguishes the right pose from a wrong one.

    Attributes:
        outline: from the outer contour of a pose to the image's edges.
        edges: from all its visible edges to the image's edges, the direction that trackers minimise.
        image: from the image's edges inside the outer contour to the visible edges: punishes a pose that shows a
            bare face where the image has holes and creases.
    """

    outline: Contest
    edges: Contest
    image: Contest

    def __str__(self) -> str:
        return f"outer contour: {self.outline}; all edges: {self.edges}; image to edges: {self.image}"


def tells_apart(
    part: Part,
    edges: EdgeSamples,
    caster: RayCaster,
    image: ByteImage,
    camera: Camera,
    right_T_obj: FloatArray,
    wrong_T_obj: FloatArray,
    cap_share: float = 0.05,
) -> Distinction:
    """How well an image distinguishes two poses.

    Args:
        edges, caster: of this part.
        image: (h, w) or (h, w, 3) uint8, rendered or real, that shows the part at right_T_obj.
        cap_share: distances are cut off at this share of the diameter as seen, as alpha does in eq. 6.
    """
    found = canny(image)
    distances = distance_map(found)
    image_points = np.argwhere(found)[:, ::-1].astype(np.int64)
    measures = []
    for pose in (right_T_obj, wrong_T_obj):
        depth = float(transform(pose, part.box_centre)[2])
        cap = cap_share * camera.fx * part.diameter / depth
        rows = visible_rows(part, edges, caster, pose)
        contour = outer_contour(part, caster, camera, pose)
        inner = image_points[_inside(contour, image_points, camera)]
        drawn = distance_map(draw_samples(edges, rows, camera, pose))
        measures.append(
            (
                _mean_distance(distances, contour, cap),
                _mean_distance(distances, camera.project(transform(pose, edges.points_obj[rows])), cap),
                _mean_distance(drawn, inner, cap),
            )
        )
    return Distinction(*(Contest(right, wrong) for right, wrong in zip(*measures, strict=True)))


def shaded_picture(part: Part, caster: RayCaster, camera: Camera, cam_T_obj: FloatArray) -> ByteImage:
    """A plain grey picture (h, w) uint8 of the part at a pose (4, 4), by rays: matt, lit from the upper left."""
    normals = normal_map(part, caster, camera, cam_T_obj)
    light = np.array([-0.5, -0.6, -0.62])
    shade = 60.0 + 90.0 * np.maximum(normals @ light, 0.0) + 80.0 * np.maximum(-normals[..., 2], 0.0)
    return np.where(normals.any(2), np.minimum(shade, 255.0), 20.0).astype(np.uint8)


def _inside(contour: FloatArray, points: IntArray, camera: Camera) -> BoolArray:
    """(n,) bool: which of the pixels (n, 2) lie within a contour or on it."""
    filled = np.zeros((camera.height, camera.width), np.uint8)
    cv2.fillPoly(filled, [np.round(contour).astype(np.int32)], 1)
    return np.asarray(filled[points[:, 1], points[:, 0]] > 0)


def _mean_distance(distances: Float32Array, points: FloatArray | IntArray, cap: float) -> float:
    """Mean of the capped distances at the pixels of points (n, 2); outside the image counts as the cap.

    Without any point it is the cap: a pose that shows nothing fits nothing.
    """
    if len(points) == 0:
        return cap
    size = np.array(distances.shape[::-1])
    pixels = np.round(points).astype(int)
    inside = ((pixels >= 0) & (pixels < size)).all(1)
    values = np.full(len(points), cap)
    values[inside] = np.minimum(distances[pixels[inside, 1], pixels[inside, 0]], cap)
    return float(values.mean())
