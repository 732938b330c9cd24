"""Small sequences drawn by ray casting: flat-shaded faces on a plain ground, blurred, with a little noise."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from itertools import islice

import cv2
import numpy as np

from acp_lab.cad.edges import sample_edges
from acp_lab.cad.part import Part
from acp_lab.cad.raycast import hit_map, make_caster
from acp_lab.generator.templates import build_templates
from acp_lab.geometry.arrays import ByteImage, FloatArray
from acp_lab.geometry.camera import Camera
from acp_lab.geometry.pose import transform
from acp_lab.geometry.pose_step import move_pose
from acp_lab.prepared_part import PreparedPart
from acp_lab.sequences.frame import Frame, UnreadableFrame
from acp_lab.tracking.learning.knowledge import Off, SampleLearning
from acp_lab.tracking.method import ACP
from acp_lab.tracking.start import TrustedStart

AS_DRAWN = replace(
    ACP, learning=SampleLearning(profiles=Off()), start=TrustedStart(bias_in_breaks=1.0), magnification=Off()
)
"""`acp` for exact poses: profiles expect the edges of metal, which are mostly broken, not sharp edges of flat greys.

Not magnified, though parts are small here, so that px are those of the frame.
"""
CAMERA = Camera(width=200, height=160, fx=320.0, fy=325.0, cx=99.5, cy=79.5)
FINE = 3
GAMMA = 1.4
GROUND = 45.0
# A spin of about 2 degrees and a shift of about 1.5 mm from frame to frame.
STEP = np.array([0.02, -0.025, 0.015, 0.8, -0.5, 1.2])


def draw(parts_at: list[tuple[Part, FloatArray]], seed: int = 0, camera: Camera = CAMERA) -> ByteImage:
    """(h, w, 3) RGB: parts at their poses (4, 4), nearer ones in front; the grey of a face goes with its normal."""
    large = Camera(
        camera.width * FINE,
        camera.height * FINE,
        camera.fx * FINE,
        camera.fy * FINE,
        (camera.cx + 0.5) * FINE - 0.5,
        (camera.cy + 0.5) * FINE - 0.5,
    )
    grey = np.full((large.height, large.width), GROUND)
    nearest = np.full_like(grey, np.inf)
    for part, cam_T_obj in parts_at:
        depth, face = hit_map(part, make_caster(part), large, cam_T_obj)
        shade = 140.0 + part.face_normals @ np.array([45.0, 60.0, -30.0])
        front = (face >= 0) & (depth < nearest)
        grey[front] = shade[face[front]]
        nearest[front] = depth[front]
    # Light adds up in a pixel, as in a camera, which then encodes it.
    light = cv2.resize((grey / 255.0) ** GAMMA, (camera.width, camera.height), interpolation=cv2.INTER_AREA)
    image = 255.0 * cv2.GaussianBlur(light, (0, 0), 0.6) ** (1.0 / GAMMA)
    image += np.random.default_rng(seed).normal(0.0, 2.0, image.shape)
    return np.repeat(np.clip(np.round(image), 0, 255).astype(np.uint8)[..., None], 3, 2)


def prepared(part: Part, edge_break_mm: float = 0.0) -> PreparedPart:
    """With coarse templates, for speed."""
    edges = sample_edges(part)
    templates = build_templates(part, edges, make_caster(part), subdivisions=3)
    return PreparedPart(part, edges, edge_break_mm=edge_break_mm, templates=templates)


def poses(part: Part, start: FloatArray, count: int, step: FloatArray = STEP) -> list[FloatArray]:
    """The part spins about its centre and drifts, the same step from each frame to the next."""
    found = [start]
    for _ in range(count - 1):
        found.append(move_pose(found[-1], part.box_centre, step))
    return found


def add_percent(part: Part, cam_T_obj: FloatArray, truth: FloatArray) -> float:
    """ADD in per cent of the diameter."""
    off = transform(cam_T_obj, part.vertices) - transform(truth, part.vertices)
    return 100.0 * float(np.linalg.norm(off, axis=1).mean()) / part.diameter


class MadeSequence:
    """Frames that are there already, with the true poses by object id; ids go up in twos."""

    def __init__(self, images: list[ByteImage | None], truth: Mapping[int, list[FloatArray]]) -> None:
        self.name, self.scene_id = "made", 7
        self._images, self._truth = images, truth

    @property
    def frame_ids(self) -> tuple[int, ...]:
        return tuple(range(0, 2 * len(self._images), 2))

    @property
    def object_ids(self) -> tuple[int, ...]:
        return tuple(self._truth)

    def frames(self, max_frames: int | None = None) -> Iterator[Frame | UnreadableFrame]:
        frames = zip(self.frame_ids, self._images, strict=True)
        for index, image in islice(frames, max_frames):
            if image is None:
                yield UnreadableFrame(index, CAMERA, f"{index:06d}.png: the file is empty")
            else:
                yield Frame(index, image, CAMERA)

    def truth(self, frame_id: int, object_id: int) -> FloatArray | None:
        return self._truth[object_id][frame_id // 2]

    @property
    def first_poses(self) -> Mapping[int, FloatArray]:
        return {object_id: found[0] for object_id, found in self._truth.items()}

    @property
    def first_pose(self) -> FloatArray:
        (pose,) = self.first_poses.values()
        return pose
