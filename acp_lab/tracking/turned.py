"""Is a part turned by a tooth? Gears, splines and bolt circles fit nearly as well after such a turn.

A wheel that turns by more than half a tooth from one frame to the next seems to turn the other way, as in a film. A
tooth off nearly all of its edges are found, and neither quality nor exactness tells. What tells is the few edges that
only one of two poses has: a keyway, a flat, one hole that is other than the rest. So a solved frame is looked at at the
part's near turns, too (`cad.near_turns`): at the smallest two where the part may have moved so, and at one of all, in
turn. Where more is found of what only that pose shows than of what only this one does, the frame is solved from there,
and compared again. (Not in the paper.)
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from acp_lab.compiled import kernel
from acp_lab.generator.base import GeneratedEdges
from acp_lab.geometry.arrays import BoolArray, FloatArray, IntArray, plain
from acp_lab.sequences.frame import Frame
from acp_lab.tracking.pursuit import Pursuit
from acp_lab.tracking.solution import SeenFrame, Solution
from acp_lab.tracking.start import LOOK_LEVEL
from acp_lab.tracking.stopwatch import Stopwatch
from acp_lab.tracking.turn_check import TurnCheck

_NEAREST = 2
"""The smallest turns, one to each side: those that a frame may have taken unseen."""
_IN_DOUBT = 4
"""So many others are looked at in a frame, instead of one, as long as nothing says that the last one was right."""
_REACH_PX = 4
_DIRECTIONS = 16
"""In half a round; edges that differ by less than two of them may be the same."""
_NOTHING = -math.inf, -math.inf


@dataclass(frozen=True, eq=False)
class Turned:
    """A frame solved at another turn of the part.

    is_leap: it may have been turned all along, so that nothing is known of how it moves.
    """

    solution: Solution
    is_leap: bool


class TurnChecker:
    """Of one tracked part; turns: (k, 4, 4), some, by rising angle, see `cad.near_turns`."""

    def __init__(self, turns: FloatArray, config: TurnCheck, pursuit: Pursuit) -> None:
        self._turns, self._config, self._pursuit = turns, config, pursuit
        self.forget()

    def forget(self) -> None:
        """A new track, whose start is taken for right."""
        self._is_sure, self._next = True, 0
        # The turn that no motion explains but what is found does, and how much says so by now.
        self._suspected, self._evidence = -1, 0.0

    def other(self, frame: Frame, solution: Solution, clock: Stopwatch) -> Turned | None:
        """What replaces a frame's solution; None where that is right, or nothing tells."""
        config, pursuit, pose = self._config, self._pursuit, solution.cam_T_obj
        suspected, was_sure, self._suspected, self._is_sure = self._suspected, self._is_sure, -1, False
        seen, innovation_of = pursuit.look(frame, pose, clock), pursuit.predictor.innovation_of
        here = None if seen is None else self._drawn(seen, pose, clock)
        if seen is None or here is None:
            return None
        most = config.may_move * max(innovation_of(pose), 1.0)
        tried = [turn for turn in range(min(_NEAREST, len(self._turns))) if innovation_of(self._at(pose, turn)) <= most]
        tried += [suspected] if suspected >= 0 else self._next_of_all(1 if was_sure else _IN_DOUBT)
        gains = {turn: self._gain(seen, self._at(pose, turn), here, clock)[0] for turn in tried}
        best = max(gains, key=lambda turn: gains[turn])
        if not gains[best] > config.tried_from:
            self._is_sure = gains[best] > -math.inf
            return None
        solved = pursuit.solve(frame, self._at(pose, best), clock)
        evidence = 0.0 if solved is None else self._gain(seen, solved.cam_T_obj, here, clock)[1]
        if solved is None or evidence < config.evidence:
            return None
        if was_sure and innovation_of(solved.cam_T_obj) <= most:
            self._is_sure = True
            return Turned(solved, is_leap=False)
        self._evidence = evidence + (self._evidence if best == suspected else 0.0)
        if self._evidence < config.leap_evidence:
            self._suspected = best
            return None
        return Turned(solved, is_leap=True)

    def _at(self, cam_T_obj: FloatArray, turn: int) -> FloatArray:
        """A pose (4, 4) after a turn of the part."""
        return np.asarray(cam_T_obj @ self._turns[turn])

    def _next_of_all(self, count: int) -> list[int]:
        count = min(count, len(self._turns))
        self._next += count
        return [turn % len(self._turns) for turn in range(self._next - count, self._next)]

    def _drawn(self, seen: SeenFrame, cam_T_obj: FloatArray, clock: Stopwatch) -> _Drawn | None:
        """The edges of a pose (4, 4); None where too few show."""
        solver, at = self._pursuit.solver, seen.view.at_pose(cam_T_obj)
        edges = solver.edges_at(at, LOOK_LEVEL.samples, clock)
        return None if edges is None else _Drawn(cam_T_obj, edges)

    def _gain(self, seen: SeenFrame, cam_T_obj: FloatArray, here: _Drawn, clock: Stopwatch) -> tuple[float, float]:
        """Gain and evidence of a pose (4, 4), see `TurnCheck`; both -infinity where nothing tells."""
        there = self._drawn(seen, cam_T_obj, clock)
        if there is None:
            return _NOTHING
        only_there, only_here = apart(there.edges, here.edges), apart(here.edges, there.edges)
        telling = np.count_nonzero(only_there), np.count_nonzero(only_here)
        if not all(telling):
            return _NOTHING
        found, missed = (
            self._pursuit.solver.found(seen, one.edges.take(only), seen.view.at_pose(one.cam_T_obj), LOOK_LEVEL)
            for one, only in ((there, only_there), (here, only_here))
        )
        clock.search_s += clock.lap()
        return found - missed, (found - missed) * math.sqrt(2.0 / (1.0 / telling[0] + 1.0 / telling[1]))


@dataclass(frozen=True, eq=False)
class _Drawn:
    """The edges of a pose (4, 4)."""

    cam_T_obj: FloatArray
    edges: GeneratedEdges


def apart(edges: GeneratedEdges, others: GeneratedEdges) -> BoolArray:
    """(n,) which edge points lie on none of other edges' points of their direction."""
    is_apart = np.ones(len(edges), bool)
    if len(others):
        _apart(plain(edges.points), _numbers(edges), plain(others.points), _numbers(others), is_apart)
    return is_apart


def _numbers(edges: GeneratedEdges) -> IntArray:
    """(n,) of the direction that each edge has, of `_DIRECTIONS`."""
    angle = np.arctan2(edges.tangents[:, 1], edges.tangents[:, 0])
    return np.floor(angle * (_DIRECTIONS / np.pi)).astype(np.int64) % _DIRECTIONS


@kernel("void(f8[:, ::1], i8[::1], f8[:, ::1], i8[::1], b1[::1])")
def _apart(
    points: FloatArray, numbers: IntArray, others: FloatArray, other_numbers: np.ndarray, is_apart: np.ndarray
) -> None:
    """Clear is_apart (n,) of points (n, 2) px within `_REACH_PX` of others (m, 2) px of about their direction.

    Drawn as bits, one for each direction, around the whole pixels where the others lie.
    """
    left, top = others[0, 0], others[0, 1]
    right, bottom = left, top
    for i in range(1, len(others)):
        left, right = min(left, others[i, 0]), max(right, others[i, 0])
        top, bottom = min(top, others[i, 1]), max(bottom, others[i, 1])
    x0, y0 = int(np.floor(left)) - _REACH_PX, int(np.floor(top)) - _REACH_PX
    width, height = int(np.floor(right)) + _REACH_PX + 1 - x0, int(np.floor(bottom)) + _REACH_PX + 1 - y0
    drawn = np.zeros((height, width), np.uint32)
    for i in range(len(others)):
        bits, x, y = 0, int(np.floor(others[i, 0])) - x0, int(np.floor(others[i, 1])) - y0
        for turn in range(-2, 3):
            bits |= 1 << ((other_numbers[i] + turn) % _DIRECTIONS)
        for v in range(-_REACH_PX, _REACH_PX + 1):
            for u in range(-_REACH_PX, _REACH_PX + 1):
                if u * u + v * v <= _REACH_PX * _REACH_PX:
                    drawn[y + v, x + u] |= np.uint32(bits)
    for i in range(len(points)):
        x, y = int(np.floor(points[i, 0])) - x0, int(np.floor(points[i, 1])) - y0
        if 0 <= x < width and 0 <= y < height and (drawn[y, x] >> np.uint32(numbers[i])) & np.uint32(1):
            is_apart[i] = False
