"""The detector of one part: from an image to ranked candidates."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import trimesh

from acp_lab.cad.part import Part
from acp_lab.cad.raycast import RayCaster, make_caster
from acp_lab.detection.config import DetectionConfig
from acp_lab.detection.edge_maps import without_specks
from acp_lab.detection.evidence import Evidence, Witness
from acp_lab.detection.pose_search import ROUNDS, DistanceMaps, Poses, distinct, search_round
from acp_lab.detection.scan import Candidates, scan
from acp_lab.detection.view_templates import Templates, Views, make_templates, make_views
from acp_lab.generator.base import RigidGenerator
from acp_lab.geometry.arrays import ByteImage, FloatArray, IntArray
from acp_lab.geometry.camera import Camera

FINE_SUBDIVISIONS = 3
"""Of the views whose samples the pose search projects."""


@dataclass(frozen=True, eq=False)
class Candidate:
    """A place where the part may be.

    cam_T_obj: (4, 4) mm. evidence: what the image says of it. view_obj: (3,) unit, from which side it is seen.
    """

    cam_T_obj: FloatArray
    evidence: Evidence

    @property
    def score(self) -> float:
        """In [0, 1]."""
        return self.evidence.score

    @property
    def view_obj(self) -> FloatArray:
        """(3,) unit: from the part towards the camera, object frame."""
        eye = -self.cam_T_obj[:3, :3].T @ self.cam_T_obj[:3, 3]
        return eye / max(float(np.linalg.norm(eye)), 1e-9)


@dataclass(frozen=True, eq=False)
class Look:
    """Candidates, the best first, and the witness that can judge further poses in the same image."""

    candidates: tuple[Candidate, ...]
    witness: Witness


class Detector:
    """Finds one part in images; templates are made once, in about half a second."""

    def __init__(self, part: Part, generator: RigidGenerator, config: DetectionConfig | None = None) -> None:
        self.part, self.generator = part, generator
        self.config = config or DetectionConfig()
        self._caster: RayCaster = make_caster(part)

    def prepare(self) -> None:
        """Make all of it now instead of when it is first asked for."""
        _ = self.fine_views, self.templates, self.groups

    @cached_property
    def views(self) -> Views:
        """Those that are scanned."""
        return make_views(self.part, self.generator, self.config.view_subdivisions)

    @cached_property
    def fine_views(self) -> Views:
        """Those whose samples the pose search projects."""
        return make_views(self.part, self.generator, FINE_SUBDIVISIONS)

    @cached_property
    def templates(self) -> Templates:
        """Views, turned in the image plane."""
        return make_templates(self.views, self.part.diameter, self.config)

    @cached_property
    def groups(self) -> IntArray:
        """(t,) 0 to 11: the corner of an icosahedron next to a template's view."""
        corners = np.asarray(trimesh.creation.icosphere(subdivisions=0).vertices)
        nearest: IntArray = np.argmax(self.views.directions_obj @ corners.T, axis=1).astype(np.int64)
        return nearest[self.templates.views]

    def candidates(self, image: ByteImage, camera: Camera) -> Look:
        """Candidates in an undistorted image (h, w, 3) RGB; none is an answer."""
        image = without_specks(image)
        config, diameter = self.config, self.part.diameter
        maps = DistanceMaps(image, camera, diameter, config)
        witness = Witness(self.part, self.generator, self._caster, maps)
        scanned = scan(image, camera, diameter, self.templates, self.groups, config)
        poses = start_poses(scanned, self.templates, self.views, camera)
        for how, most in zip(ROUNDS, (*config.kept, config.verified), strict=True):
            poses = distinct(search_round(maps, self.fine_views, poses, diameter, how), diameter, most)
        found = [
            Candidate(pose, evidence) for pose in self._matrices(poses) if (evidence := witness.look(pose)) is not None
        ]
        return Look(tuple(sorted(found, key=lambda candidate: -candidate.score)), witness)

    def _matrices(self, poses: Poses) -> list[FloatArray]:
        """(4, 4) each, rotations made exact again after many small steps in float32."""
        matrices = []
        for rotation, centre in zip(poses.rotations.astype(np.float64), poses.centres.astype(np.float64), strict=True):
            left, _, right = np.linalg.svd(rotation)
            pose = np.eye(4)
            pose[:3, :3] = left @ right
            pose[:3, 3] = centre - pose[:3, :3] @ self.part.box_centre
            matrices.append(pose)
        return matrices


def start_poses(candidates: Candidates, templates: Templates, views: Views, camera: Camera) -> Poses:
    """The poses that candidates of the scan stand for: the template's view, turned to where it was found."""
    rays = camera.rays(candidates.centres) if len(candidates) else np.zeros((0, 3))
    centres = rays * candidates.depths[:, None]
    axis = rays / np.maximum(np.linalg.norm(rays, axis=1, keepdims=True), 1e-9)
    turns = templates.turns_rad[candidates.templates]
    count = len(candidates)
    in_plane = np.tile(np.eye(3), (count, 1, 1))
    in_plane[:, 0, 0] = in_plane[:, 1, 1] = np.cos(turns)
    in_plane[:, 1, 0], in_plane[:, 0, 1] = np.sin(turns), -np.sin(turns)
    # The shortest turn from the optical axis to the ray.
    cross = np.zeros((count, 3, 3))
    cross[:, 0, 2], cross[:, 2, 0] = axis[:, 0], -axis[:, 0]
    cross[:, 1, 2], cross[:, 2, 1] = axis[:, 1], -axis[:, 1]
    to_ray = np.eye(3) + cross + cross @ cross / (1.0 + axis[:, 2])[:, None, None]
    rotations = to_ray @ in_plane @ views.rotations[templates.views[candidates.templates]]
    return Poses(rotations.astype(np.float32), centres.astype(np.float32), candidates.scores.astype(np.float32))
