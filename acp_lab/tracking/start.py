"""The first frame: is the start pose exact enough to learn from, and if not, where is the part?

A start pose is trusted when the frame agrees with it nearly as well as with the pose that the solver
would rather have, and the two lie within a pixel or so: then the difference is the edges' own offset, not
an error of the pose, and the offsets can be measured. They may lie somewhat further apart where the frame agrees
with both equally: what the image cannot tell, whoever gave the pose can. Otherwise the part is searched around the
start: the solver runs from a set of turned poses and the best fit wins.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from acp_lab.geometry.camera import Camera
from acp_lab.geometry.pose_step import move_pose
from acp_lab.tracking.alignment import Aligner, Alignment, Level, Stopwatch
from acp_lab.tracking.targets.image_edges import ImagePatch


@dataclass(frozen=True)
class StartConfig:
    """Settings of the first frame.

    Attributes:
        agreement: least ratio of the frame's agreement with the start pose to that with the solved pose.
        equal_agreement: ratio from which on the limits below are `EQUAL_SLACK` times as wide. Starts from truth had
            0.99 (median of 33 sequences), those 1 degree and 1 mm off 0.70.
        agreement_sigma_px: nearness that counts as agreement.
        largest_shift_px: rms motion of the samples along their normals between the two poses, without its scale part.
        largest_scale: relative change of apparent size between the two poses.
        turn_deg: turns tried about the axes and diagonals when the start is not trusted.
        finalists: how many of the coarse solutions are refined.
    """

    agreement: float = 0.9
    equal_agreement: float = 0.97
    agreement_sigma_px: float = 1.2
    largest_shift_px: float = 0.85
    largest_scale: float = 0.025
    turn_deg: float = 4.0
    finalists: int = 3


EQUAL_SLACK = 1.4
SEARCH_LEVELS = (Level(20, 8.0), Level(16, 5.0), Level(10, 2.5), Level(6, 1.2))
# For judging and for learning: all samples, or as many as one search takes, near their expected places.
LOOK_LEVEL = Level(6, 1.0, samples=30_000)


def agreement(
    aligner: Aligner, patch: ImagePatch, camera: Camera, cam_T_obj: np.ndarray, region: int, sigma_px: float
) -> float:
    """In [0, 1]: mean over visible samples of the best candidate's score times its nearness to the pose (4, 4)."""
    seen = aligner.observe(patch, camera, cam_T_obj, region, Level(6, sigma_px), Stopwatch(), use_memory=False)
    if seen is None:
        return 0.0
    return float((seen.scores * np.exp(-0.5 * (seen.targets / sigma_px) ** 2)).max(1).mean())


def is_trusted(
    aligner: Aligner,
    patch: ImagePatch,
    camera: Camera,
    start: np.ndarray,
    solved: Alignment,
    region: int,
    config: StartConfig,
) -> bool:
    """Whether a start pose (4, 4) is exact but for the offsets of the edges themselves."""
    edges, ids = aligner.generator.edges, solved.observation.visible.ids
    points_obj = edges.points_obj[ids]
    before = camera.project(points_obj @ start[:3, :3].T + start[:3, 3])
    after = camera.project(points_obj @ solved.cam_T_obj[:3, :3].T + solved.cam_T_obj[:3, 3])
    arms, shift = before - before.mean(0), after - before
    # Biased edges mostly change the apparent size; a wrong pose also shifts and shears.
    scale = float((arms * shift).sum() / max(float((arms * arms).sum()), 1e-9))
    # Along the normals: sliding along the edges, such as a round part's roll, is no error that they could show.
    rest_px = float(np.sqrt((((shift - scale * arms) * solved.observation.normals).sum(1) ** 2).mean()))
    away = max(rest_px / config.largest_shift_px, abs(scale) / config.largest_scale)
    if away >= EQUAL_SLACK:
        return False
    sigma = config.agreement_sigma_px
    at_start = agreement(aligner, patch, camera, start, region, sigma)
    at_solved = agreement(aligner, patch, camera, solved.cam_T_obj, region, sigma)
    needed = config.agreement if away < 1.0 else config.equal_agreement
    return at_start > 0.0 and at_start >= needed * at_solved


def search_around(
    aligner: Aligner,
    patch: ImagePatch,
    camera: Camera,
    cam_T_obj: np.ndarray,
    region: int,
    config: StartConfig,
    use_memory: bool = False,
) -> Alignment | None:
    """The best alignment found from a pose (4, 4) and 14 poses turned about axes and diagonals; None if none fits."""
    clock, sigma = Stopwatch(), config.agreement_sigma_px
    coarse: list[tuple[float, np.ndarray]] = []
    for turn in _turns(np.radians(config.turn_deg)):
        start = move_pose(cam_T_obj, aligner.part.box_centre, np.concatenate([turn, np.zeros(3)]))
        solved = aligner.align(patch, camera, start, region, clock, SEARCH_LEVELS, use_memory)
        if solved is not None:
            pose = solved.cam_T_obj
            coarse.append((agreement(aligner, patch, camera, pose, region, sigma), pose))
    coarse.sort(key=lambda entry: -entry[0])
    best: tuple[float, Alignment] | None = None
    for _, pose in coarse[: config.finalists]:
        solved = aligner.align(patch, camera, pose, region, clock, use_memory=use_memory)
        if solved is None:
            continue
        fit = agreement(aligner, patch, camera, solved.cam_T_obj, region, sigma)
        if best is None or fit > best[0]:
            best = (fit, solved)
    return best[1] if best else None


def _turns(angle_rad: float) -> np.ndarray:
    """(15, 3) rotation vectors: none, about both senses of the three axes, about the four diagonals."""
    grid = np.array([[x, y, z] for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1)], np.float64)
    count = np.abs(grid).sum(1)
    axes = grid[(count == 1) | (count == 3)]
    return np.concatenate([np.zeros((1, 3)), angle_rad * axes / np.linalg.norm(axes, axis=1, keepdims=True)])
