"""Looking into the detector: what each stage sees of one frame, where the right pose is in its lists, and why.

Convention: px of the image at hand, (x, y); directions of edges unsigned, in bins (see `detection.edge_maps`). Errors
of poses are mean distances of the part's points in diameters, of equal poses of a symmetric part the smallest.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from acp_lab.cad.part import Part
from acp_lab.cad.raycast import hit_map
from acp_lab.control_points.canonical_frame import eye_position
from acp_lab.control_points.view_regions import choose_region
from acp_lab.detection.detector import Detector, start_poses
from acp_lab.detection.edge_maps import direction_bins, oriented_edges, resized, without_specks
from acp_lab.detection.pose_search import MAP_BINS, ROUNDS, DistanceMaps, Poses, distinct, search_round
from acp_lab.detection.scan import Candidates, responses, scan
from acp_lab.detection.view_templates import SCAN_BINS
from acp_lab.detection.work import finish
from acp_lab.generator.base import project_samples
from acp_lab.geometry.arrays import ByteImage, Float32Array, FloatArray, IntArray
from acp_lab.geometry.pose import rotation_angle_deg, transform
from acp_lab.geometry.pose_step import move_pose
from acp_lab.sequences.frame import Frame
from acp_lab.studies.true_edges import TrueEdges
from acp_lab.tracking.find import Finder

RIGHT = 0.1
"""Of the diameter: a pose nearer than this counts as right."""
_BESIDE_PX = 3.0


def edges_by_direction(frame: Frame) -> ByteImage:
    """(SCAN_BINS, h, w): 1 where the detector sees an edge of each direction."""
    directions = finish(oriented_edges(without_specks(frame.image), SCAN_BINS))
    return (directions == np.arange(SCAN_BINS)[:, None, None]).astype(np.uint8)


def outline_contrast(truth: TrueEdges, frame: Frame, cam_T_obj: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Points (n, 2) of the outline at a pose (4, 4), and how much brighter (grey levels) the part is than its ground.

    Compared are the pixels 3 px on either side. A part of one brightness on a ground of another would have one sign.
    """
    edges = truth.at(cam_T_obj, frame.camera)
    body = hit_map(truth.part, truth.caster, frame.camera, cam_T_obj)[1] >= 0
    grey = cv2.cvtColor(frame.image, cv2.COLOR_RGB2GRAY).astype(np.float64)
    sides = [np.rint(edges.points + sign * _BESIDE_PX * edges.normals).astype(int) for sign in (1.0, -1.0)]
    size = np.array([frame.camera.width, frame.camera.height])
    inside = np.logical_and.reduce([((side >= 0) & (side < size)).all(1) for side in sides])
    points, (one, other) = edges.points[inside], [side[inside] for side in sides]
    on_one, on_other = body[one[:, 1], one[:, 0]], body[other[:, 1], other[:, 0]]
    difference = grey[one[:, 1], one[:, 0]] - grey[other[:, 1], other[:, 0]]
    is_outline = on_one != on_other
    return points[is_outline], np.where(on_one, difference, -difference)[is_outline]


@dataclass(frozen=True, eq=False)
class TemplateView:
    """One template at the place, size and turn in which a part is seen in a frame.

    image: (h, w, 3), the frame at the scale of the scan. centre: (2,) px where the part's centre is in it. offsets:
    (f, 2) int px of the template's features from there; bins: (f,) their directions. turn_deg: between the template's
    pose and the true one.
    """

    image: np.ndarray
    centre: FloatArray
    offsets: IntArray
    bins: IntArray
    turn_deg: float


def template_view(detector: Detector, frame: Frame, cam_T_obj: FloatArray) -> TemplateView:
    """The template next to the true pose (4, 4), in the frame at the scale at which it fits."""
    camera, part, config = frame.camera, detector.part, detector.config
    centre_cam = transform(cam_T_obj, part.box_centre)
    pixel = camera.project(centre_cam[None])
    templates = detector.templates
    count = len(templates)
    here = Candidates(
        np.zeros(count, np.float32), np.arange(count), np.repeat(pixel, count, 0), np.full(count, centre_cam[2])
    )
    rotations = start_poses(here, templates, detector.views, camera).rotations.astype(np.float64)
    nearest = int(np.einsum("nij,ij->n", rotations, cam_T_obj[:3, :3]).argmax())
    scale = config.scan_px * centre_cam[2] / (0.5 * (camera.fx + camera.fy) * part.diameter)
    small = resized(without_specks(frame.image), float(scale))
    ratio = np.array([small.shape[1] / camera.width, small.shape[0] / camera.height])
    features = slice(0, int(templates.counts[nearest]))
    return TemplateView(
        small,
        (pixel[0] + 0.5) * ratio - 0.5,
        templates.offsets[nearest, features],
        templates.bins[nearest, features],
        rotation_angle_deg(rotations[nearest], cam_T_obj[:3, :3]),
    )


def template_scores(response: Float32Array, offsets: IntArray, bins: IntArray) -> FloatArray:
    """(h, w): the mean response of a template with its centre at each pixel; 0 is counted outside of the image."""
    _, height, width = response.shape
    reach = int(np.abs(offsets).max())
    padded = np.pad(response, ((0, 0), (reach, reach), (reach, reach)))
    total = np.zeros((height, width))
    for (x, y), layer in zip(offsets, bins, strict=True):
        total += padded[layer, reach + y : reach + y + height, reach + x : reach + x + width]
    return total / len(bins)


@dataclass(frozen=True, eq=False)
class SpreadScores:
    """What one template scores everywhere when edges reach `reach_px` far.

    scores: (h, w). at_truth: the best within 2 px of the true centre. elsewhere: the best further than 9 px from it.
    width_px: how far to the side (x) the score stays above half of its peak, both ways together.
    """

    reach_px: float
    scores: FloatArray
    at_truth: float
    elsewhere: float
    width_px: int


def spread_scores(detector: Detector, seen: TemplateView, reach_px: float) -> SpreadScores:
    """Scan an image with one template whose edges reach `reach_px` far; see `SpreadScores`."""
    response = finish(responses(seen.image, replace(detector.config, spread_px=reach_px)))
    scores = template_scores(response, seen.offsets, seen.bins)
    column, row = np.rint(seen.centre).astype(int)
    top, left = max(row - 2, 0), max(column - 2, 0)
    around = scores[top : row + 3, left : column + 3]
    at_truth = float(around.max())
    row = top + int(np.unravel_index(around.argmax(), around.shape)[0])
    column = left + int(np.unravel_index(around.argmax(), around.shape)[1])
    others = scores.copy()
    others[max(row - 9, 0) : row + 10, max(column - 9, 0) : column + 10] = -np.inf
    below = np.flatnonzero(scores[row] < 0.5 * at_truth)
    left = below[below < column].max(initial=-1)
    right = below[below > column].min(initial=scores.shape[1])
    return SpreadScores(reach_px, scores, at_truth, float(others.max()), int(right - left - 1))


def turned_agreement(
    detector: Detector, frame: Frame, cam_T_obj: FloatArray, turns_deg: FloatArray, reach_px: float = 4.0
) -> tuple[FloatArray, FloatArray]:
    """How well edges agree when the part is turned in the image plane by turns (n,), each (n,) in [0, 1].

    First with the distance to the nearest edge whatever its direction, then with that to edges of their own direction.
    """
    part, generator = detector.part, detector.generator
    maps = DistanceMaps(without_specks(frame.image), frame.camera, part.diameter, detector.config)
    level = int(maps.level(transform(cam_T_obj, part.box_centre)[2:])[0])
    _, distance = maps.scaled(level)
    fx, fy, cx, cy = maps.intrinsics(level)
    height, width = distance.shape[1:]
    camera = replace(frame.camera, width=width, height=height, fx=fx, fy=fy, cx=cx, cy=cy)
    region = choose_region(eye_position(cam_T_obj) - part.box_centre, 0.5 * part.box_size)
    visible = generator.visible(cam_T_obj, region, len(generator.edges))
    plain: list[float] = []
    directional: list[float] = []
    for turn in np.radians(turns_deg):
        turned = move_pose(cam_T_obj, part.box_centre, np.array([0.0, 0.0, turn, 0.0, 0.0, 0.0]))
        edges = project_samples(generator.edges, visible, turned, camera)
        column, row = np.rint(edges.points).astype(int).T
        seen = (column >= 0) & (row >= 0) & (column < width) & (row < height)
        own = direction_bins(edges.tangents, MAP_BINS)
        for found, px in (
            (plain, distance.min(0)[row[seen], column[seen]]),
            (directional, distance[own[seen], row[seen], column[seen]]),
        ):
            found.append(float(np.maximum(1.0 - px / reach_px, 0.0).mean()))
    return np.array(plain), np.array(directional)


@dataclass(frozen=True, eq=False)
class Stage:
    """The list after one stage. poses: (n, 4, 4), the best first; errors: (n,) diameters from the truth."""

    name: str
    poses: FloatArray
    errors: FloatArray

    @property
    def right(self) -> int:
        """How many are right."""
        return int((self.errors < RIGHT).sum())

    @property
    def first_right(self) -> int | None:
        """The place of the first right one, counted from 1; None for none."""
        rows = np.flatnonzero(self.errors < RIGHT)
        return int(rows[0]) + 1 if len(rows) else None

    def __str__(self) -> str:
        place = "" if self.first_right is None else f", the first at place {self.first_right}"
        told = f"{self.name}: {len(self.errors)} poses, {self.right} right{place}"
        return f"{told}, the nearest {100.0 * self.errors.min():.1f}% off"


def find_stages(finder: Finder, frame: Frame, cam_T_true: FloatArray, top: int = 8) -> tuple[Stage, ...]:
    """The lists of all stages, from the scan to what `Finder.find` returns, each with its errors from the truth.

    Of the frame as it is: where a part would appear small `Finder.find` looks at a magnified one, too.
    """
    detector = finder.detector
    part, config = detector.part, detector.config
    image = without_specks(frame.image)
    maps = DistanceMaps(image, frame.camera, part.diameter, config)
    depths = detector.depths(frame.camera)
    scanned = finish(scan(image, frame.camera, part.diameter, detector.templates, detector.groups, depths, config))
    poses = start_poses(scanned, detector.templates, detector.views, frame.camera)
    lists = [("scan", _matrices(poses, part))]
    for number, (how, most) in enumerate(zip(ROUNDS, (*config.kept, config.verified), strict=True), start=1):
        poses = finish(search_round(maps, detector.fine_views, poses, part.diameter, how))
        poses = finish(distinct(poses, part.diameter, most))
        lists.append((f"search, round {number}", _matrices(poses, part)))
    found = np.array([one.cam_T_obj for one in finder.find(frame, top)]).reshape(-1, 4, 4)
    lists.append(("judged and aligned", found))
    return tuple(Stage(name, listed, pose_errors(part, listed, cam_T_true)) for name, listed in lists if len(listed))


def pose_errors(part: Part, poses: FloatArray, cam_T_true: FloatArray) -> FloatArray:
    """(n,) mean distances, in diameters, of the part's points at poses (n, 4, 4) from where they truly are."""
    points = part.vertices[:: max(1, len(part.vertices) // 200)]
    placed = points @ poses[:, :3, :3].transpose(0, 2, 1) + poses[:, None, :3, 3]
    off = [
        np.linalg.norm(placed - transform(cam_T_true @ turn, points), axis=2).mean(1)
        for turn in part.symmetries.transforms()
    ]
    errors: FloatArray = np.min(off, axis=0) / part.diameter
    return errors


def nearest_in(stage: Stage, part: Part, cam_T_obj: FloatArray) -> int:
    """The place, from 1, in a stage's list of the pose nearest to one (4, 4): where a hypothesis came from."""
    return int(pose_errors(part, stage.poses, cam_T_obj).argmin()) + 1


def _matrices(poses: Poses, part: Part) -> FloatArray:
    """(n, 4, 4) from rotations and centres."""
    made = np.tile(np.eye(4), (len(poses), 1, 1))
    made[:, :3, :3] = poses.rotations
    made[:, :3, 3] = poses.centres - poses.rotations.astype(np.float64) @ part.box_centre
    return made
