"""From quality to state: tracking, weak or lost, with hysteresis."""

from __future__ import annotations

from dataclasses import dataclass

from acp_lab.errors import TrackingError
from acp_lab.tracking.result import TrackState


@dataclass(frozen=True)
class StateConfig:
    """Thresholds on the quality in [0, 1].

    Attributes:
        weak_below, tracking_above: tracking becomes weak below the first, weak becomes tracking above the second.
        lost_below, found_above: likewise for lost.
        patience: frames in a row below `lost_below` before a part counts as lost.
        proof: frames in a row above `found_above` before a lost one counts as found.
    """

    weak_below: float = 0.5
    tracking_above: float = 0.6
    lost_below: float = 0.25
    found_above: float = 0.5
    patience: int = 2
    proof: int = 2

    def __post_init__(self) -> None:
        if self.patience < 1 or self.proof < 1:
            raise TrackingError(f"states: patience = {self.patience}, proof = {self.proof}: give 1 or more")
        pairs = ("weak_below", "tracking_above"), ("lost_below", "found_above"), ("lost_below", "weak_below")
        for low, high in pairs:
            below, above = getattr(self, low), getattr(self, high)
            if not 0.0 <= below <= above:
                raise TrackingError(
                    f"states: {low} = {below:g}, {high} = {above:g}: give 0 or more, the first no more than the second"
                )


class StateMachine:
    """The state of one tracked part.

    doubted: whether something speaks against its place; then it is weak at best.
    """

    def __init__(self, config: StateConfig) -> None:
        self.config = config
        self.state = TrackState.TRACKING
        self.doubted = False
        self._low = self._high = 0
        self._lost = 0
        self._has_begun = False

    def is_time_to_search(self) -> bool:
        """While lost: in the 1st, 2nd, 4th, 8th ... lost frame; a wide search takes as long as many frames.

        For methods that have no `way_back`.
        """
        return self._lost > 0 and self._lost & (self._lost - 1) == 0

    def begin(self, quality: float) -> str:
        """Take in the first frame's quality: nothing spoke for the part before, so no patience; as `update`."""
        self._low, self._has_begun = self.config.patience - 1, True
        return self.update(quality)

    def replay(self, quality: float) -> str:
        """Take in the next quality of a run that was written down, from the first one on; as `update`."""
        return self.update(quality) if self._has_begun else self.begin(quality)

    def may_begin_to_track(self, quality: float) -> bool:
        """Whether a frame of that quality may make a part that is lost, or weak and not doubted yet, a tracked one."""
        if self.state is TrackState.LOST:
            return True
        return self.state is TrackState.WEAK and not self.doubted and quality > self.config.tracking_above

    def lose(self, reason: str) -> str:
        """The part is somewhere else, however well the last frame fitted; the change and its reason."""
        before, self.state, self._lost, self._high = self.state, TrackState.LOST, 1, 0
        self.doubted = False
        return f"{before} -> {self.state}: {reason}"

    def update(self, quality: float) -> str:
        """Take in a frame's quality, 0 where nothing was seen; the reason when the state changed, else empty."""
        config, before = self.config, self.state
        self._low = self._low + 1 if quality < config.lost_below else 0
        self._high = self._high + 1 if quality > config.found_above else 0
        if self._low >= config.patience:
            self.state = TrackState.LOST
        elif before is TrackState.LOST:
            if self._high >= config.proof:
                self.state = TrackState.TRACKING if quality > config.tracking_above else TrackState.WEAK
        elif quality < config.weak_below:
            self.state = TrackState.WEAK
        elif quality > config.tracking_above:
            self.state = TrackState.TRACKING
        if self.doubted and self.state is TrackState.TRACKING:
            self.state = TrackState.WEAK
        self._lost = self._lost + 1 if self.state is TrackState.LOST else 0
        return "" if self.state is before else f"{before} -> {self.state}: quality {quality:.2f}"
