"""How likely is a pose right, its ADD below 5% of the diameter? Two things have to be so.

The part is there: the quality, a probability. Three things tell, in a logistic regression. Agreement: the image edges
near the generated ones look as they did before. Contrast: there are more of them at the pose than a few px beside it,
for on clutter edges are everywhere. Margin: colours change at the outline.

And what is seen of it fixes its pose: the exactness, another one. A plate of which hardly more than the rim shows may
fit at many distances, each as well as the others; its covariance says so (`uncertainty`).

Fitted to frames of made sequences, tracked and from disturbed poses, see `benchmarks/confidence.py` and
docs/benchmark.md.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from acp_lab.errors import TrackingError
from acp_lab.tracking.solution import Solution
from acp_lab.tracking.targets.normals import NormalJudgement

RIGHT_SHARE = 0.05
"""Of the diameter: a pose with less ADD is right."""


@dataclass(frozen=True)
class Confidence:
    """Configuration: the log-odds of the part being there are constant + agreement a + contrast c + margin m.

    spread: share of the covariance's standard deviations that counts; its 95% regions are wide.
    """

    kind: ClassVar[str] = "logistic"
    constant: float = -3.11
    agreement: float = 4.82
    contrast: float = 12.86
    margin: float = 2.57
    spread: float = 0.74

    def __post_init__(self) -> None:
        for name in ("constant", "agreement", "contrast", "margin"):
            if not abs(getattr(self, name)) <= 1e3:
                raise TrackingError(f"confidence.{name} = {getattr(self, name):g}: give -1000 to 1000")
        if not 0.0 <= self.spread <= 1e3:
            raise TrackingError(f"confidence.spread = {self.spread:g}: give 0 to 1000")

    def of(self, solution: Solution) -> float:
        """In [0, 1]: the probability that the part is there, where a solution has it.

        Raises TrackingError where the method's first target does not search along normals.
        """
        first, *others = solution.judgements
        if not isinstance(first, NormalJudgement):
            raise TrackingError('confidence: needs a first target that searches along "normals"')
        evidence = self.agreement * first.quality + self.contrast * first.contrast
        evidence += self.margin * sum(judgement.score for judgement in others)
        return float(1.0 / (1.0 + np.exp(-(self.constant + evidence))))

    def exactness(self, expected_error: float) -> float:
        """In [0, 1]: the probability that the pose of a part that is there is right, by the ADD to be expected.

        expected_error: root mean square, as a share of the diameter. As if it lay in one direction, which it mostly
        does: the distance. Where it is no number, nothing is known of the pose: 0.
        """
        deviation = self.spread * expected_error
        if math.isnan(deviation):
            return 0.0
        return math.erf(RIGHT_SHARE / (math.sqrt(2.0) * deviation)) if deviation > 0.0 else 1.0


def weight_of_evidence(quality: float) -> float:
    """How much speaks for a pose of that quality, 0 or more: it grows in proportion to what is seen of the part.

    The log-odds beyond those of a frame that shows nothing; for a quality of 0.99 twice that of 0.6.
    """
    odds = np.clip(quality, 1e-4, 1.0 - 1e-4)
    return max(0.0, float(np.log(odds / (1.0 - odds))) - Confidence.constant)


EDGES_ALONE = Confidence(-2.75, 5.40, 16.32, 0.0)
"""For methods that see no colours."""
