"""The detector of one part: from an image to ranked candidates."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import log

import numpy as np

from acp_lab.cad.part import Part
from acp_lab.cad.raycast import RayCaster, caster_of
from acp_lab.control_points.canonical_frame import eye_position
from acp_lab.detection.config import USUAL_DEPTHS_MM, DetectionConfig, usual_depths_mm
from acp_lab.detection.edge_maps import removing_specks
from acp_lab.detection.evidence import Evidence, Witness
from acp_lab.detection.pose_prior import PosePrior, rotation_from_axis
from acp_lab.detection.pose_search import ROUNDS, DistanceMaps, Poses, distinct, joined, search_round
from acp_lab.detection.scan import Candidates, depth_levels, scan
from acp_lab.detection.view_templates import Templates, Views, make_templates, make_views
from acp_lab.detection.work import Steps, finish
from acp_lab.errors import check_kind
from acp_lab.generator.base import RigidGenerator
from acp_lab.geometry.arrays import ByteImage, FloatArray, IntArray
from acp_lab.geometry.camera import Camera
from acp_lab.geometry.icosphere import icosphere
from acp_lab.geometry.pose import transform

EVIDENCE_WORK, START_WORK = 2500.0, 2.0
"""Of a pose, see `work`."""
# Half the distance of neighbouring views and turns of the scan; how far a pose search strays from where it starts.
_SCAN_SLACK_DEG, _SEARCH_SLACK_DEG = 12.0, 25.0
_SHARE_NEARBY = 0.3
_LEAST_WINDOW_PX, _STARTS_AT_ONCE = 48, 1000


@dataclass(frozen=True, eq=False)
class Candidate:
    """A place where the part may be.

    cam_T_obj: (4, 4) mm. evidence: what the image says of it.
    """

    cam_T_obj: FloatArray
    evidence: Evidence

    @property
    def score(self) -> float:
        """In [0, 1]."""
        return self.evidence.score


@dataclass(frozen=True, eq=False)
class Look:
    """Candidates, the best first, and the witness that can judge further poses in the same image."""

    candidates: tuple[Candidate, ...]
    witness: Witness


class Detector:
    """Finds one part in images."""

    def __init__(
        self,
        part: Part,
        generator: RigidGenerator,
        config: DetectionConfig | None = None,
        views: Views | None = None,
    ) -> None:
        """views: as they are stored with the part; without them they are made when they are first asked for."""
        self.part, self.generator = part, generator
        self._stored_views = views
        self._turns = part.symmetries.transforms()
        self.config = config or DetectionConfig()
        check_kind(self.config, DetectionConfig, "config", "DetectionConfig(depth_mm=(300, 900)) or the like")
        self._caster: RayCaster = caster_of(part)

    def prepare(self) -> None:
        """Make all of it now instead of when it is first asked for; the compiled loops are loaded, too."""
        import acp_lab.detection.kernels

        _ = self.views, self.templates.reads, self.groups, self._template_rotations, acp_lab.detection.kernels

    @cached_property
    def views(self) -> Views:
        """Those that are scanned."""
        return self.fine_views.subdivided(self.config.view_subdivisions)

    @cached_property
    def fine_views(self) -> Views:
        """Those whose samples the pose search projects."""
        return self._stored_views or make_views(self.part, self.generator)

    @cached_property
    def templates(self) -> Templates:
        """Views, turned in the image plane."""
        return make_templates(self.views, self.part.diameter, self.config)

    @cached_property
    def groups(self) -> IntArray:
        """(t,) 0 to 11: the corner of an icosahedron next to a template's view."""
        corners = icosphere(0)
        nearest: IntArray = np.argmax(self.views.directions_obj @ corners.T, axis=1).astype(np.int64)
        return nearest[self.templates.views]

    def candidates(self, image: ByteImage, camera: Camera, prior: PosePrior | None = None) -> Look:
        """Candidates in an undistorted image (h, w, 3) RGB, near a prior if one is given; none is an answer."""
        return finish(self.search(image, camera, prior))

    def depths(self, camera: Camera) -> FloatArray:
        """(n,) mm, ascending: the distances at which the part is looked for in a camera's images, without a prior."""
        return depth_levels(self.config.depth_mm or usual_depths_mm(self.part.diameter, camera), self.config.depth_step)

    def search(
        self,
        image: ByteImage,
        camera: Camera,
        prior: PosePrior | None = None,
        depths: FloatArray | None = None,
        share: float = 1.0,
    ) -> Steps[Look]:
        """`candidates`, in slices.

        depths, share: without a prior, at which distances (n,) mm the part is looked for in this image, and how many of
        all candidates are theirs.
        """
        config, diameter = self.config.sharing(share), self.part.diameter
        depths = self.depths(camera) if depths is None else depths
        templates, groups, views = self.templates, self.groups, self.fine_views
        if prior is not None:
            depth_mm = prior.depth_mm(self.part.box_centre)
            config, depths = self._narrowed(prior), depth_levels(depth_mm, self.config.depth_step)
            near = prior.allows(self._template_rotations, self.part.box_centre, self._turns, _SCAN_SLACK_DEG)
            templates, groups, views = templates.take(near), groups[near], self._views_near(prior)
            image, camera = self._window(image, camera, prior)
        image = yield from removing_specks(image)
        maps = DistanceMaps(image, camera, diameter, config)
        witness = Witness(self.part, self.generator, self._caster, maps)
        if not len(templates) or not len(views):
            return Look((), witness)
        scanned = yield from scan(image, camera, diameter, templates, groups, depths, config)
        started = []
        for first in range(0, max(len(scanned), 1), _STARTS_AT_ONCE):
            some = scanned.take(slice(first, first + _STARTS_AT_ONCE))
            started.append(start_poses(some, templates, self.views, camera))
            yield START_WORK * len(some)
        poses = joined(started)
        for how, most in zip(ROUNDS, (*config.kept, config.verified), strict=True):
            poses = yield from search_round(maps, views, poses, diameter, how)
            poses = yield from distinct(poses, diameter, most)
        found = list[Candidate]()
        for pose in self._matrices(poses):
            found += yield from judging(witness, pose)
        return Look(tuple(sorted(found, key=lambda candidate: -candidate.score)), witness)

    def _narrowed(self, prior: PosePrior) -> DetectionConfig:
        """With as many candidates as the prior's share of all poses asks for."""
        nearest, farthest = self.config.depth_mm or USUAL_DEPTHS_MM
        everywhere = log(farthest / nearest)
        # A depth that is known still takes one level of the pyramid.
        share = log(max(prior.depth_ratio**2, self.config.depth_step)) / everywhere if everywhere else 1.0
        share *= min(1.0, 2.0 * prior.within_deg / 180.0)
        if prior.around_px is not None:
            share *= _SHARE_NEARBY
        return self.config.sharing(share)

    @cached_property
    def _template_rotations(self) -> FloatArray:
        """(t, 3, 3) object to a camera that looks at the part's centre."""
        return turned_views(self.templates, self.views, np.arange(len(self.templates)))

    def _views_near(self, prior: PosePrior) -> Views:
        """Those of the pose search, whatever their turn in the image plane."""
        eyes = np.stack([eye_position(prior.cam_T_obj @ turn) for turn in self._turns]) - self.part.box_centre
        eyes /= np.maximum(np.linalg.norm(eyes, axis=1, keepdims=True), 1e-9)
        most = np.radians(min(prior.within_deg + _SEARCH_SLACK_DEG, 180.0))
        return self.fine_views.take((self.fine_views.directions_obj @ eyes.T).max(1) >= np.cos(most) - 1e-9)

    def window(self, camera: Camera, prior: PosePrior) -> tuple[int, int, int, int] | None:
        """Where (x0, y0, x1, y1) in a camera's image the part may be; None for all of it, also where little is left."""
        if prior.around_px is None:
            return None
        centre = transform(prior.cam_T_obj, self.part.box_centre)
        reach = prior.around_px + 0.5 * self.part.diameter * camera.fx * prior.depth_ratio / max(centre[2], 1.0)
        x, y = camera.project(centre[None])[0] if centre[2] > 1.0 else (camera.cx, camera.cy)
        x0, x1 = (int(np.clip(v, 0, camera.width)) for v in (x - reach, x + reach))
        y0, y1 = (int(np.clip(v, 0, camera.height)) for v in (y - reach, y + reach))
        return None if min(x1 - x0, y1 - y0) < _LEAST_WINDOW_PX else (x0, y0, x1, y1)

    def _window(self, image: ByteImage, camera: Camera, prior: PosePrior) -> tuple[ByteImage, Camera]:
        """The image around where the part may be, and its camera."""
        window = self.window(camera, prior)
        if window is None:
            return image, camera
        x0, y0, x1, y1 = window
        cropped = Camera(x1 - x0, y1 - y0, camera.fx, camera.fy, camera.cx - x0, camera.cy - y0)
        return np.ascontiguousarray(image[y0:y1, x0:x1]), cropped

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


def judging(witness: Witness, cam_T_obj: FloatArray) -> Steps[list[Candidate]]:
    """The pose (4, 4) and what the image says of it, in slices; empty where it says nothing."""
    yield from witness.making_maps(cam_T_obj)  # of a size at which nothing was looked at yet, perhaps
    evidence = witness.look(cam_T_obj)
    yield EVIDENCE_WORK
    return [] if evidence is None else [Candidate(cam_T_obj, evidence)]


def start_poses(candidates: Candidates, templates: Templates, views: Views, camera: Camera) -> Poses:
    """The poses that candidates of the scan stand for: the template's view, turned to where it was found."""
    rays = camera.rays(candidates.centres) if len(candidates) else np.zeros((0, 3))
    centres = rays * candidates.depths[:, None]
    axis = rays / np.maximum(np.linalg.norm(rays, axis=1, keepdims=True), 1e-9)
    rotations = rotation_from_axis(axis) @ turned_views(templates, views, candidates.templates)
    return Poses(rotations.astype(np.float32), centres.astype(np.float32), candidates.scores.astype(np.float32))


def turned_views(templates: Templates, views: Views, rows: IntArray) -> FloatArray:
    """(n, 3, 3) rotations of templates, object to a camera that looks at the part's centre."""
    turns = templates.turns_rad[rows]
    in_plane = np.tile(np.eye(3), (len(rows), 1, 1))
    in_plane[:, 0, 0] = in_plane[:, 1, 1] = np.cos(turns)
    in_plane[:, 1, 0], in_plane[:, 0, 1] = np.sin(turns), -np.sin(turns)
    rotations: FloatArray = in_plane @ views.rotations[templates.views[rows]]
    return rotations
