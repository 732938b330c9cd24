"""The settings of the check by which tooth a part is turned; see `turned`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from acp_lab.errors import TrackingError


@dataclass(frozen=True)
class TurnCheck:
    """Configuration.

    Attributes:
        tried_from: from this gain on a turn is worth solving the frame from there. A gain is how much more is found, as
            a share of them, of the edges that only the turned pose has than of those that only the other has.
        evidence: gain times the square root of how many edge points tell (their harmonic mean), from which on the
            turned pose, solved, replaces the other where the part may have moved so, from a frame that was right.
        may_move: so many times the innovation of the other it may take, see `PoseKalman.innovation_of`, or so much.
        leap_evidence: the same, added up over frames in a row, where it was turned all along for all that is known.
    """

    kind: ClassVar[str] = "edges-apart"
    tried_from: float = -0.1
    evidence: float = 1.0
    may_move: float = 5.0
    leap_evidence: float = 4.0

    def __post_init__(self) -> None:
        if not -1.0 <= self.tried_from <= 1.0:
            raise TrackingError(f"turns.tried_from = {self.tried_from:g}: give -1 to 1")
        for name, least in (("evidence", 0.0), ("may_move", 1.0), ("leap_evidence", 0.0)):
            if not least <= getattr(self, name) < float("inf"):
                raise TrackingError(f"turns.{name} = {getattr(self, name):g}: give {least:g} or more")
