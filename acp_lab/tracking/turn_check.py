"""The settings of the check by which tooth a part is turned; see `turned`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from acp_lab.errors import TrackingError


@dataclass(frozen=True)
class TurnCheck:
    """Configuration.

    Of two poses each has edges that the other lacks. How well they are found is told as a share of how well those are
    found that both have. A gain is how much better those of the turned pose are found than those of the other; the
    evidence is the gain times the square root of how many edge points tell (their harmonic mean).

    Attributes:
        motion_from, leap_from: from this gain on a turn is worth solving the frame from there, where the part may have
            moved so, and where it may not.
        found, missed: how well the edges that only the turned pose has must be found, once the frame is solved from
            there, and those that only the other has may be, for it to replace the other.
        evidence: how much there must be of it; all of it the other way round, and the frame was surely right.
        may_move: so many times the innovation of the other it may take, see `PoseKalman.innovation_of`, or so much.
        leap_evidence: how much there must be, added up over frames in a row, where the part cannot have moved so.
        start_found, start_evidence: the same of a first frame, which is solved at every turn, so that the right one
            stands out.
    """

    kind: ClassVar[str] = "edges-apart"
    motion_from: float = -0.2
    leap_from: float = 0.2
    found: float = 0.7
    missed: float = 0.4
    evidence: float = 1.5
    may_move: float = 5.0
    leap_evidence: float = 6.0
    start_found: float = 0.6
    start_evidence: float = 3.0

    def __post_init__(self) -> None:
        for name in ("motion_from", "leap_from"):
            if not -1.0 <= getattr(self, name) <= 1.0:
                raise TrackingError(f"turns.{name} = {getattr(self, name):g}: give -1 to 1")
        for name in ("found", "missed", "evidence", "may_move", "leap_evidence", "start_found", "start_evidence"):
            limit = 1.0 if name == "may_move" else 0.0
            if not limit <= getattr(self, name) < float("inf"):
                raise TrackingError(f"turns.{name} = {getattr(self, name):g}: give {limit:g} or more")
