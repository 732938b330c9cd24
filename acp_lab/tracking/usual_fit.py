"""How well frames have fitted so far: what a new frame's fit is compared with."""

from __future__ import annotations

from acp_lab.tracking.solution import Solution

# Share of a new frame in the running mean of the quality, with which learning and `recovery.SecondTries` compare.
_QUALITY_RATE = 0.5
# The same of the score, with which `pursuit` and `recovery.Alternatives` compare; in the first frames it is the mean of
# all: the very first fits better than any other, as what its edges look like was learnt from it.
_SCORE_RATE = 0.1


class UsualFit:
    """Of the frames of one tracked part.

    Attributes:
        mean_quality: running mean of the first target's quality.
        mean_score, last_score: running mean, and of the last frame, of what solutions are compared by.
    """

    def __init__(self) -> None:
        self.mean_quality = self.mean_score = self.last_score = 0.0
        self._frames = 0

    def begin(self, quality: float, score: float) -> None:
        """With what the first frame says; score: 0 for methods that compare no scores."""
        self.mean_quality, self.mean_score, self.last_score = quality, score, score
        self._frames = 1

    def take_in(self, solution: Solution) -> None:
        """Update all three with a solved frame."""
        self.mean_quality += _QUALITY_RATE * (solution.judgement.quality - self.mean_quality)
        self._frames += 1
        self.mean_score += max(_SCORE_RATE, 1.0 / self._frames) * (solution.score - self.mean_score)
        self.last_score = solution.score

    def reached(self, found: Solution | None, share: float) -> bool:
        """Whether a solution scores that share of the last score, or of the running mean where that is less."""
        return found is not None and found.score >= share * min(self.mean_score, self.last_score)
