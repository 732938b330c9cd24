"""How likely is a pose right? The quality that is reported, as a probability.

A quality q says: of frames like this one a share q has an ADD below 5% of the diameter. Three things tell, in a
logistic regression. Agreement: the image edges near the generated ones look as they did before. Contrast: there are
more of them at the pose than a few px beside it, for on clutter edges are everywhere. Margin: colours change at the
outline.
Fitted to frames of made sequences, tracked and from disturbed poses, see `benchmarks/confidence.py` and
docs/benchmark.md.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from acp_lab.errors import TrackingError
from acp_lab.tracking.solution import Solution
from acp_lab.tracking.targets.normals import NormalJudgement


@dataclass(frozen=True)
class Confidence:
    """Configuration: the log-odds of a right pose are constant + agreement a + contrast c + margin m."""

    kind: ClassVar[str] = "logistic"
    constant: float = -3.11
    agreement: float = 4.82
    contrast: float = 12.86
    margin: float = 2.57

    def __post_init__(self) -> None:
        for name in ("constant", "agreement", "contrast", "margin"):
            if not abs(getattr(self, name)) <= 1e3:
                raise TrackingError(f"confidence.{name} = {getattr(self, name):g}: give -1000 to 1000")

    def of(self, solution: Solution) -> float:
        """In [0, 1]: the probability that a solution's pose is right.

        Raises TrackingError where the method's first target does not search along normals.
        """
        first, *others = solution.judgements
        if not isinstance(first, NormalJudgement):
            raise TrackingError('confidence: needs a first target that searches along "normals"')
        evidence = self.agreement * first.quality + self.contrast * first.contrast
        evidence += self.margin * sum(judgement.score for judgement in others)
        return float(1.0 / (1.0 + np.exp(-(self.constant + evidence))))


def weight_of_evidence(quality: float) -> float:
    """How much speaks for a pose of that quality, 0 or more: it grows in proportion to what is seen of the part.

    The log-odds beyond those of a frame that shows nothing; for a quality of 0.99 twice that of 0.6.
    """
    odds = np.clip(quality, 1e-4, 1.0 - 1e-4)
    return max(0.0, float(np.log(odds / (1.0 - odds))) - Confidence.constant)


EDGES_ALONE = Confidence(-2.75, 5.40, 16.32, 0.0)
"""For methods that see no colours."""
