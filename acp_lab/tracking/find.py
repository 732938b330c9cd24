"""Find: the part in one frame, without a pose to start from.

The detector says where the part may be; here its best candidates are aligned as the tracker aligns a frame, and the
image is asked again what it says of the poses that come out.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from acp_lab.detection.config import DetectionConfig
from acp_lab.detection.detector import Candidate, Detector
from acp_lab.detection.pose_prior import PosePrior
from acp_lab.detection.work import Steps, finish
from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.pose import transform
from acp_lab.prepared_part import PreparedPart
from acp_lab.sequences.frame import Frame
from acp_lab.tracking.frame_solver import FrameSolver
from acp_lab.tracking.method import method_named
from acp_lab.tracking.search import WIDE_LEVELS
from acp_lab.tracking.stopwatch import Stopwatch

ACCEPTED = 0.9
"""From this score on a hypothesis counts as found."""
ALIGNED, ALIGNED_NEAR = 12, 4
ALIGN_WORK = 4500.0
_RIVALS = 8
_MARGIN_PX = 40.0
_SAME_SHARE = 0.1
"""Of the diameter: poses whose points are no further apart are one hypothesis."""


@dataclass(frozen=True, eq=False)
class Detection:
    """A hypothesis of where the part is.

    cam_T_obj: (4, 4) mm. score: in [0, 1], how likely the pose is right. view_obj: (3,) unit, from which side it is
    seen, object frame. is_accepted: the score is at least ACCEPTED.
    """

    cam_T_obj: FloatArray
    score: float
    view_obj: FloatArray

    @property
    def is_accepted(self) -> bool:
        """Whether this can be taken for found."""
        return self.score >= ACCEPTED


class Finder:
    """Finds one prepared part in frames."""

    def __init__(self, model: PreparedPart, config: DetectionConfig | None = None) -> None:
        """PreparationError when the part has neither templates nor visibility networks."""
        self.model = model
        self.detector = Detector(model.part, model.best_generator(), config, model.views)
        self._solver = FrameSolver(model, method_named("acp-edges"))
        vertices = model.part.vertices
        self._points_obj = vertices[:: max(1, len(vertices) // 200)]
        self._turns = model.part.symmetries.transforms()

    def prepare(self) -> None:
        """Make the templates now instead of at the first frame."""
        self.detector.prepare()

    def find(self, frame: Frame, top: int = 3, prior: PosePrior | None = None) -> tuple[Detection, ...]:
        """Up to `top` hypotheses that differ, the best first; () when nothing resembles the part.

        prior: looks near a pose only.
        """
        return finish(self.search(frame, top, prior))

    def search(self, frame: Frame, top: int = 3, prior: PosePrior | None = None) -> Steps[tuple[Detection, ...]]:
        """`find`, in slices."""
        look = yield from self.detector.search(frame.image, frame.camera, prior)
        aligned = list[Candidate]()
        for candidate in self._distinct(look.candidates, ALIGNED if prior is None else ALIGNED_NEAR):
            aligned.append(candidate)
            pose = self._align(frame, candidate.cam_T_obj)
            yield ALIGN_WORK
            evidence = None if pose is None else look.witness.look(pose)
            if pose is not None and evidence is not None:
                aligned.append(Candidate(pose, evidence))
        best = self._distinct(sorted(aligned, key=lambda c: -c.evidence.log_odds), max(top, _RIVALS))
        return tuple(
            Detection(c.cam_T_obj, score, c.view_obj) for c, score in zip(best[:top], shared_scores(best), strict=False)
        )

    def _align(self, frame: Frame, pose: FloatArray) -> FloatArray | None:
        """The pose that the tracker's solver makes of one; None where it left the part or saw too little."""
        region = self._solver.choose_region(pose)
        seen = self._solver.look(frame.image, frame.camera, pose, region, _MARGIN_PX)
        if seen is None:
            return None
        solution = self._solver.solve(seen, seen.view.at_pose(pose), Stopwatch(), WIDE_LEVELS[1:])
        if solution is None or not np.isfinite(solution.cam_T_obj).all():
            return None
        moved = transform(solution.cam_T_obj, self._points_obj) - transform(pose, self._points_obj)
        far = np.linalg.norm(moved, axis=1).mean() > 0.3 * self.model.part.diameter
        return None if far else solution.cam_T_obj

    def _distinct(self, candidates: Iterable[Candidate], most: int) -> list[Candidate]:
        """The best of those that are nearly the same, a symmetric part's equal poses included."""
        kept = list[Candidate]()
        places = list[FloatArray]()
        for candidate in candidates:
            if len(kept) == most:
                break
            alike = np.stack([transform(candidate.cam_T_obj @ turn, self._points_obj) for turn in self._turns])
            limit = _SAME_SHARE * self.model.part.diameter
            if all(np.linalg.norm(alike - place, axis=2).mean(1).min() > limit for place in places):
                kept.append(candidate)
                places.append(transform(candidate.cam_T_obj, self._points_obj))
        return kept


def shared_scores(candidates: Sequence[Candidate]) -> list[float]:
    """In [0, 1] each: the probability that this one is right and none of the others.

    The part is in one place only. Where two poses fit about equally, as with a part that looks nearly the same from
    the other side, neither is sure, however well it fits.
    """
    odds = np.exp([candidate.evidence.log_odds for candidate in candidates])
    return [float(one) for one in odds / (1.0 + odds.sum())]


def detect(
    model: PreparedPart, frame: Frame, top: int = 3, config: DetectionConfig | None = None
) -> tuple[Detection, ...]:
    """Where is the part in a frame? Up to `top` hypotheses, the best first; () when nothing resembles it.

    For several frames make one `Finder`: it keeps its templates.

    Raises:
        PreparationError: the part has neither templates nor visibility networks.
    """
    return Finder(model, config).find(frame, top)
