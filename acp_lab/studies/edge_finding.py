"""How often does a generated edge point find *its* image edge, and not another one? Measured where the truth is known.

From a pose that is a little off, every edge point has a known displacement: along its normal, to where the true pose
puts it. Each rule of searching the image proposes one; it is right when it ends within a tolerance of the true
place. Rules, from the paper's (section IV-B) to the one of `acp`:

- nearest edge: the nearest Canny pixel, to which a distance map leads;
- nearest of its direction: the nearest Canny pixel whose gradient is within 30 degrees of the normal;
- strongest along the normal: the best peak of a search along the normal;
- strongest that looks familiar: the same, weighted by a memory of how the sample looked one frame before;
- among the candidates: any of the search's peaks; the limit of a perfect choice.

Convention: px, along the edge's normal.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from acp_lab.errors import SequenceError
from acp_lab.generator.base import GeneratedEdges
from acp_lab.geometry.arrays import BoolArray, ByteImage, FloatArray
from acp_lab.geometry.pose import disturb_pose
from acp_lab.imaging.canny import CannyConfig, blur, canny, to_grey
from acp_lab.imaging.distance import distance_map, nearest_edges
from acp_lab.imaging.edge_search import Candidates, ImagePatch, SearchConfig, image_patch, search_along_normals
from acp_lab.sequences.bop import BopScene
from acp_lab.sequences.frame import Frame, UnreadableFrame
from acp_lab.studies.true_edges import TrueEdges
from acp_lab.tracking.learning.edge_memory import EdgeMemory, MemoryConfig

RULES = (
    "nearest edge",
    "nearest of its direction",
    "strongest along the normal",
    "strongest that looks familiar",
    "among the candidates",
)
SAME_DIRECTION_DEG = 30.0
DIRECTIONS = 12


@dataclass(frozen=True)
class FindingConfig:
    """What is tried.

    Attributes:
        turn_deg, shift_mm: how far the start pose is off, in random directions.
        trials: starts per frame.
        reach_px: of the search along normals.
        tolerance_px: a way counts as right when it ends that near the true place; edges of real parts are broken,
            so their image lies up to half a pixel beside the model's.
    """

    turn_deg: float = 3.0
    shift_mm: float = 4.0
    trials: int = 3
    reach_px: int = 12
    tolerance_px: float = 1.5


@dataclass(frozen=True)
class FindingStudy:
    """Shares of right ways per rule, means over all trials. Prints as a table.

    way_px: how far, on average, the points had to go.
    """

    rules: tuple[str, ...]
    shares: tuple[float, ...]
    way_px: float
    trials: int

    def __getitem__(self, rule: str) -> float:
        """The share of a rule."""
        return self.shares[self.rules.index(rule)]

    def __str__(self) -> str:
        width = max(map(len, self.rules))
        lines = [f"{rule.ljust(width)}  {share:.2f}" for rule, share in zip(self.rules, self.shares, strict=True)]
        lines.append(f"share of edge points led to their own edge; {self.way_px:.1f} px to go, {self.trials} trials")
        return "\n".join(lines)


@dataclass(frozen=True)
class DetectorCounts:
    """How an edge detector does on a part whose true edges are known.

    Attributes:
        found: share of the part's edge points with an edge pixel within the tolerance.
        clutter: share of the edge pixels around the part that belong to none of its edges.
    """

    found: float
    clutter: float


def detector_counts(
    image: ByteImage, own: GeneratedEdges, config: CannyConfig, tolerance_px: float = 1.5, margin_px: int = 20
) -> DetectorCounts:
    """Count for Canny's detector; clutter in the box of the part's true edges `own`, widened by a margin."""
    edges = canny(image, config)
    height, width = edges.shape
    x, y = np.clip(np.round(own.points).astype(int), 0, (width - 1, height - 1)).T
    found = float((distance_map(edges)[y, x] <= tolerance_px).mean())
    drawn = np.zeros_like(edges)
    drawn[y, x] = True
    far = distance_map(drawn) > tolerance_px
    window = np.zeros_like(edges)
    window[max(y.min() - margin_px, 0) : y.max() + margin_px, max(x.min() - margin_px, 0) : x.max() + margin_px] = True
    near = edges & window
    return DetectorCounts(found, float((near & far).sum() / max(near.sum(), 1)))


def finding_study(
    truth: TrueEdges,
    scene: BopScene,
    object_id: int,
    frame_ids: Sequence[int],
    config: FindingConfig = FindingConfig(),
    seed: int = 0,
) -> FindingStudy:
    """Try all rules in frames of a scene, each with memories of the frame before it (so not in the first).

    Raises SequenceError for a frame that cannot be read, has no truth, or none before it.
    """
    rng = np.random.default_rng([seed, 5])
    shares, ways = [], []
    for frame_id in frame_ids:
        before, now = _frame(scene, _previous(scene, frame_id)), _frame(scene, frame_id)
        memory = EdgeMemory(len(truth.edges), MemoryConfig())
        _remember(memory, truth, before, _pose(scene, before.index, object_id), config)
        true_pose, looked = _pose(scene, frame_id, object_id), _Looked.at(now)
        for _ in range(config.trials):
            start = disturb_pose(true_pose, truth.part.box_centre, config.turn_deg, config.shift_mm, rng)
            rows = truth.rows(start)
            at, goal = truth.project(rows, start, now.camera), truth.project(rows, true_pose, now.camera)
            way = ((goal.points - at.points) * at.normals).sum(1)
            found = _proposals(looked, at, memory, rows, config)
            shares.append([_share_right(proposed, way, config.tolerance_px) for proposed in found])
            ways.append(np.abs(way).mean())
    return FindingStudy(RULES, tuple(np.mean(shares, axis=0).tolist()), float(np.mean(ways)), len(shares))


@dataclass(frozen=True, eq=False)
class _Looked:
    """A frame with what the rules read: Canny's nearest pixels, over all and per direction, and gradients."""

    patch: ImagePatch
    nearest: FloatArray
    nearest_of_direction: tuple[FloatArray | None, ...]

    @classmethod
    def at(cls, frame: Frame) -> _Looked:
        height, width = frame.image.shape[:2]
        edges = canny(frame.image)
        angles = _gradient_angles(frame.image)
        per_direction = [_nearest(edges & _similar(angles, k * np.pi / DIRECTIONS)) for k in range(DIRECTIONS)]
        everywhere = _nearest(edges)
        if everywhere is None:
            raise SequenceError(f"frame {frame.index}: no edge in the whole image: choose another frame")
        return cls(image_patch(frame.image, (0, 0, width, height)), everywhere, tuple(per_direction))


def _proposals(
    looked: _Looked, at: GeneratedEdges, memory: EdgeMemory, rows: np.ndarray, config: FindingConfig
) -> list[FloatArray]:
    """One array of ways per rule: (n, 1), or (n, m) where any of m will do; NaN where there is none."""
    height, width = looked.nearest.shape[:2]
    x, y = np.clip(np.round(at.points).astype(int), 0, (width - 1, height - 1)).T
    bins = np.round(np.arctan2(at.normals[:, 1], at.normals[:, 0]) * DIRECTIONS / np.pi).astype(int) % DIRECTIONS
    same_direction = np.full((len(at), 2), np.nan)
    for number, nearest in enumerate(looked.nearest_of_direction):
        if nearest is not None:
            same_direction[bins == number] = nearest[y, x][bins == number]
    candidates = search_along_normals(looked.patch, at.points, at.normals, config.reach_px, SearchConfig())
    familiar = candidates.scores * memory.factors(rows, candidates)
    return [
        _along(looked.nearest[y, x], at),
        _along(same_direction, at),
        _best(candidates, candidates.scores),
        _best(candidates, familiar),
        np.where(candidates.scores > 0.0, candidates.offsets, np.nan),
    ]


def _share_right(proposed: FloatArray, way: FloatArray, tolerance_px: float) -> float:
    with np.errstate(invalid="ignore"):
        return float((np.abs(proposed - way[:, None]) < tolerance_px).any(1).mean())


def _along(targets: FloatArray, at: GeneratedEdges) -> FloatArray:
    return ((targets - at.points) * at.normals).sum(1)[:, None]


def _best(candidates: Candidates, scores: FloatArray) -> FloatArray:
    best = scores.argmax(1)[:, None]
    way: FloatArray = np.take_along_axis(candidates.offsets, best, 1)
    return np.where(np.take_along_axis(scores, best, 1) > 0.0, way, np.nan)


def _remember(
    memory: EdgeMemory, truth: TrueEdges, frame: Frame, cam_T_obj: FloatArray, config: FindingConfig
) -> None:
    """Learn at the true pose, as a tracker that tracked well would have."""
    rows = truth.rows(cam_T_obj)
    at = truth.project(rows, cam_T_obj, frame.camera)
    height, width = frame.image.shape[:2]
    patch = image_patch(frame.image, (0, 0, width, height))
    candidates = search_along_normals(patch, at.points, at.normals, config.reach_px, SearchConfig())
    near = np.where(np.abs(candidates.offsets) < config.tolerance_px, candidates.scores, -1.0)
    chosen = near.argmax(1)
    found = np.take_along_axis(near, chosen[:, None], 1)[:, 0] > 0.0
    distance = np.take_along_axis(candidates.offsets, chosen[:, None], 1)[:, 0]
    memory.learn(rows, candidates, chosen, np.where(found, distance, np.inf))


def _gradient_angles(image: ByteImage) -> FloatArray:
    """(h, w) direction of the gradient in [0, pi): an edge has no front."""
    smooth = blur(to_grey(image), 1.0).astype(np.float64)
    dy, dx = np.gradient(smooth)
    return np.asarray(np.arctan2(dy, dx) % np.pi)


def _similar(angles: FloatArray, angle: float) -> BoolArray:
    apart = np.abs(angles - angle)
    return np.minimum(apart, np.pi - apart) < np.radians(SAME_DIRECTION_DEG)


def _nearest(edges: BoolArray) -> FloatArray | None:
    return nearest_edges(edges).astype(np.float64) if edges.any() else None


def _frame(scene: BopScene, frame_id: int) -> Frame:
    frame = scene.frame(frame_id)
    if isinstance(frame, UnreadableFrame):
        raise SequenceError(f"{frame.reason}: choose a frame that can be read")
    return frame


def _previous(scene: BopScene, frame_id: int) -> int:
    earlier = [known for known in scene.frame_ids if known < frame_id]
    if not earlier:
        raise SequenceError(f"{scene.name}: frame {frame_id} has none before it: choose a later one")
    return earlier[-1]


def _pose(scene: BopScene, frame_id: int, object_id: int) -> FloatArray:
    pose = scene.truth(frame_id, object_id)
    if pose is None:
        raise SequenceError(f"{scene.name}: no truth for object {object_id} in frame {frame_id}: choose another one")
    return pose
