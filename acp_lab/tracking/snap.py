"""Snap: from a pose set by hand to the pose that the image shows, in one frame and with nothing learnt yet.

What a hand leaves open is several degrees and, as perspective is weak, a good deal of depth: four points that are
each within 5 px of their places leave depth off by 6% and more. So a cloud of poses around the given one is
looked at, quickly and with few samples; the solver runs from those that agree best, coarse to fine; and the
best of these is refined on every visible sample. The same start gives the same result.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from acp_lab.control_points.canonical_frame import eye_position
from acp_lab.control_points.view_regions import choose_region
from acp_lab.errors import TrackingError
from acp_lab.generator.base import GeneratedEdges
from acp_lab.geometry.camera import Camera
from acp_lab.geometry.pose_step import centre_position, move_pose
from acp_lab.prepared_part import PreparedPart
from acp_lab.sequences.frame import Frame
from acp_lab.tracking.alignment import Aligner, Alignment, Level, SolverConfig
from acp_lab.tracking.learning.contour_offsets import ContourOffsets, OffsetConfig
from acp_lab.tracking.learning.edge_memory import EdgeMemory, MemoryConfig
from acp_lab.tracking.learning.reliability import ReliabilityConfig, SampleReliability
from acp_lab.tracking.start import SEARCH_LEVELS
from acp_lab.tracking.stopwatch import Stopwatch
from acp_lab.tracking.targets.image_edges import ImagePatch, SearchConfig

LOOK, JUDGE = Level(12, 5.0, 150), Level(6, 1.2)
LAST_LEVELS = (Level(8, 2.0, 4000), Level(5, 1.0, 4000), Level(5, 1.0, 4000))


@dataclass(frozen=True)
class SnapConfig:
    """Settings of the snap; standard deviations are those of the cloud around the given pose.

    Attributes:
        poses: in the cloud; solved: from how many of them the solver runs; refined: how many of its results.
        turn_deg: standard deviation about each axis.
        shift_px: across the image, each way.
        depth_share: of the distance.
        margin_px: image searched around the part.
        look: how the cloud is judged: wide and with few samples.
        search_levels: of the solver.
        judge: how its results are compared.
        last_levels: of the refinement; every visible sample counts.
        good_quality: what a pose that fits mostly has at least, in the units of the tracker's quality.
        seed: of the cloud.
    """

    poses: int = 600
    solved: int = 40
    refined: int = 4
    turn_deg: float = 8.0
    shift_px: float = 10.0
    depth_share: float = 0.06
    margin_px: float = 60.0
    look: Level = LOOK
    search_levels: tuple[Level, ...] = SEARCH_LEVELS
    judge: Level = JUDGE
    last_levels: tuple[Level, ...] = LAST_LEVELS
    good_quality: float = 0.42
    seed: int = 0


@dataclass(frozen=True)
class SnapResult:
    """Where a pose snapped to.

    Attributes:
        cam_T_obj: (4, 4) mm.
        quality: in [0, 1], as the tracker's: mean score of the best image edge per visible sample.
        agreement_before, agreement: in [0, 1], how well the frame agrees with the given and with the new pose.
        loss: e(I) at the new pose, see `loss.robust_loss`.
        edges: the generated edge points at the new pose.
        residuals_px: (n,) px along their normals to the image edge, NaN where none was found.
        is_good: whether the quality says that the part is there; if not, look closely, or start nearer.
    """

    cam_T_obj: np.ndarray
    quality: float
    agreement_before: float
    agreement: float
    loss: float
    edges: GeneratedEdges
    residuals_px: np.ndarray
    is_good: bool


def snap(model: PreparedPart, frame: Frame, cam_T_obj: np.ndarray, config: SnapConfig | None = None) -> SnapResult:
    """The pose near a hand-set one (4, 4) that the frame agrees with best; takes one to two seconds.

    Raises:
        TrackingError: at the given pose the part is behind the camera, outside the image or shows too few edges.
        PreparationError: the part has no generator.
    """
    config = config or SnapConfig()
    start = np.array(cam_T_obj, np.float64)
    aligner = _aligner(model)
    patch = aligner.patch(frame.image, frame.camera, start, config.margin_px)
    best = None if patch is None else _search(aligner, patch, frame.camera, start, config)
    if patch is None or best is None:
        raise TrackingError(
            f"{model.part.name}: at t = {np.round(start[:3, 3], 1).tolist()} mm the part is not seen in frame "
            f"{frame.index} ({frame.camera.width}x{frame.camera.height}); move the start onto it"
        )
    return SnapResult(
        cam_T_obj=best.cam_T_obj,
        quality=best.quality,
        agreement_before=_agreement(aligner, patch, frame.camera, start, config.judge),
        agreement=_agreement(aligner, patch, frame.camera, best.cam_T_obj, config.judge),
        loss=best.loss,
        edges=aligner.generated(best, frame.camera),
        residuals_px=best.residuals_px(),
        is_good=best.quality >= config.good_quality,
    )


def _search(
    aligner: Aligner, patch: ImagePatch, camera: Camera, start: np.ndarray, config: SnapConfig
) -> Alignment | None:
    """The best alignment from a cloud of poses; None when none of them sees the part."""
    cloud = _cloud(start, aligner.part.box_centre, camera, config)
    looked = sorted(cloud, key=lambda pose: -_agreement(aligner, patch, camera, pose, config.look))
    solved = _aligned(aligner, patch, camera, looked[: config.solved], config.search_levels, config.judge)
    poses = [alignment.cam_T_obj for alignment in solved[: config.refined]]
    refined = _aligned(aligner, patch, camera, poses, config.last_levels, config.judge)
    return refined[0] if refined else next(iter(solved), None)


def _cloud(start: np.ndarray, centre_obj: np.ndarray, camera: Camera, config: SnapConfig) -> list[np.ndarray]:
    """The start and poses (4, 4) scattered around it."""
    rng = np.random.default_rng(config.seed)
    centre_cam = centre_position(start, centre_obj)
    turns = rng.normal(0.0, np.radians(config.turn_deg), (config.poses, 3))
    across = rng.normal(0.0, config.shift_px, (config.poses, 2)) * centre_cam[2] / (camera.fx, camera.fy)
    away = rng.normal(0.0, config.depth_share, (config.poses, 1)) * centre_cam
    away[:, :2] += across
    return [start, *(move_pose(start, centre_obj, step) for step in np.concatenate([turns, away], 1))]


def _aligned(
    aligner: Aligner,
    patch: ImagePatch,
    camera: Camera,
    poses: list[np.ndarray],
    levels: tuple[Level, ...],
    judge: Level,
) -> list[Alignment]:
    """What the solver makes of poses (4, 4), the one that the frame agrees with best first."""
    clock = Stopwatch()
    found = []
    for pose in poses:
        alignment = aligner.align(patch, camera, pose, _region(aligner, pose), clock, levels, use_memory=False)
        if alignment is not None:
            found.append(alignment)
    return sorted(found, key=lambda alignment: -_agreement(aligner, patch, camera, alignment.cam_T_obj, judge))


def _agreement(aligner: Aligner, patch: ImagePatch, camera: Camera, cam_T_obj: np.ndarray, look: Level) -> float:
    """In [0, 1]: mean over visible samples of the best candidate's score times its nearness to the pose (4, 4)."""
    region = _region(aligner, cam_T_obj)
    seen = aligner.observe(patch, camera, cam_T_obj, region, look, Stopwatch(), use_memory=False)
    if seen is None:
        return 0.0
    return float((seen.scores * np.exp(-0.5 * (seen.targets / look.sigma_px) ** 2)).max(1).mean())


def _aligner(model: PreparedPart) -> Aligner:
    """With empty memories: in the first frame there is nothing to remember."""
    generator = model.best_generator()
    edges = generator.edges
    return Aligner(
        model.part,
        generator,
        EdgeMemory(len(edges), MemoryConfig()),
        ContourOffsets(edges, model.part.diameter, model.edge_break_mm, OffsetConfig()),
        SampleReliability(len(edges), ReliabilityConfig()),
        SearchConfig(),
        SolverConfig(),
    )


def _region(aligner: Aligner, cam_T_obj: np.ndarray) -> int:
    part = aligner.part
    return choose_region(eye_position(cam_T_obj) - part.box_centre, 0.5 * part.box_size)
