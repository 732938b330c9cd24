"""Is a part turned by a tooth? Gears, splines and bolt circles fit nearly as well after such a turn.

A wheel that turns by more than half a tooth from one frame to the next seems to turn the other way, as in a film. A
tooth off nearly all of its edges are found, and neither quality nor exactness tells. What tells is the few edges that
only one of two poses has: a keyway, a flat, one hole that is other than the rest. So a solved frame is looked at at the
part's near turns, too (`cad.near_turns`): at the smallest two where the part may have moved so, and at one of all, in
turn. Where what only that pose shows is found as well as all else, and what only this one does is not, the frame is
solved from there, and compared again. A hand that covers the keyway makes this pose's edges missing, but none found at
another. (Not in the paper.)
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from acp_lab.compiled import kernel
from acp_lab.generator.base import GeneratedEdges
from acp_lab.geometry.arrays import BoolArray, FloatArray, IntArray, plain
from acp_lab.geometry.in_image import in_image
from acp_lab.sequences.frame import Frame
from acp_lab.tracking.frame_solver import FrameSolver
from acp_lab.tracking.learning.knowledge import Off
from acp_lab.tracking.pursuit import Pursuit
from acp_lab.tracking.solution import SeenFrame, Solution
from acp_lab.tracking.start import LOOK_LEVEL
from acp_lab.tracking.stopwatch import Stopwatch
from acp_lab.tracking.turn_check import TurnCheck

_NEAREST = 2
"""The smallest turns, one to each side: those that a frame may have taken unseen."""
_IN_DOUBT = 4
"""So many others are looked at in a frame, instead of one, as long as nothing says that the last one was right."""
_USUAL = 300
"""Edge points that both poses have, which are asked how well edges are found."""
_REACH_PX = 4
_DIRECTIONS = 16
"""In half a round; edges that differ by less than two of them may be the same."""
_TINY = 1e-6
TURNED = "turned: only there the edges that tell are found"
"""In the note of a frame that was solved at another turn."""


@dataclass(frozen=True, eq=False)
class Turned:
    """A frame solved at another turn of the part.

    is_leap: it may have been turned all along, so that nothing is known of how it moves.
    """

    solution: Solution
    is_leap: bool


class TurnChecker:
    """Of one tracked part; turns: (k, 4, 4) by rising angle, see `cad.near_turns`. Most parts have none."""

    def __init__(self, turns: FloatArray, config: TurnCheck | Off, pursuit: Pursuit) -> None:
        self._turns, self._config, self._pursuit = turns, TurnCheck(), pursuit
        if isinstance(config, Off):
            self._turns = turns[:0]
        else:
            self._config = config
        self.forget()

    def forget(self) -> None:
        """A new track."""
        self._next = 0
        self.interrupt()

    def interrupt(self) -> None:
        """A frame that is not asked: no row of them goes on, and whether the next one was right before is unknown."""
        self._is_sure = False
        # The turn that no motion explains but what is found does, and how much says so by now.
        self._suspected, self._evidence = -1, 0.0

    def at_start(self, frame: Frame, solution: Solution, clock: Stopwatch) -> FloatArray | None:
        """The pose (4, 4) that a first frame is begun with instead of a solution's; None where nothing tells of one.

        A pose that was found may be any number of teeth off. It is tilted a little, too, as that fits better: so the
        frame is solved at each turn before the two are compared, and once more where it is.
        """
        if not len(self._turns):
            return None
        again = self._pursuit.solve(frame, solution.cam_T_obj, clock)
        asked = self._ask(frame, solution if again is None or again.score < solution.score else again, clock)
        if asked is None:
            return None
        best = asked
        for turn in range(len(self._turns)):
            solved = self._pursuit.solve(frame, asked.at(turn), clock)
            there = NOTHING if solved is None else best.compare_pose(solved.cam_T_obj)
            if solved is not None and self._tells_of_start(there):
                best = self._ask(frame, solved, clock) or best
        return None if best is asked else best.pose

    def begin(self, frame: Frame, solution: Solution, clock: Stopwatch) -> None:
        """A first frame, whose pose stays: whether that is surely right."""
        asked = self._ask(frame, solution, clock)
        if asked is not None:
            told = [asked.compare(turn) for turn in range(min(_NEAREST, len(self._turns)))]
            self._is_sure = any(self._tells(one.swapped) for one in told)

    def other(self, frame: Frame, solution: Solution, clock: Stopwatch) -> Turned | None:
        """What replaces a frame's solution; None where that is right, or nothing tells."""
        config, pursuit, pose = self._config, self._pursuit, solution.cam_T_obj
        suspected, was_sure, evidence = self._suspected, self._is_sure, self._evidence
        self.interrupt()
        innovation_of, asked = pursuit.predictor.innovation_of, self._ask(frame, solution, clock)
        if asked is None:
            return None
        most = config.may_move * max(innovation_of(pose), 1.0)
        motions = [turn for turn in range(min(_NEAREST, len(self._turns))) if innovation_of(asked.at(turn)) <= most]
        others = [suspected] if suspected >= 0 else self._next_of_all(1 if was_sure else _IN_DOUBT)
        told = {turn: asked.compare(turn) for turn in dict.fromkeys((*motions, *others))}
        best = max(told, key=lambda turn: told[turn].gain)
        if told[best].gain < (config.motion_from if best in motions else config.leap_from):
            self._is_sure = any(self._tells(one.swapped) for one in told.values())
            return None
        solved = pursuit.solve(frame, asked.at(best), clock)
        there = NOTHING if solved is None else asked.compare_pose(solved.cam_T_obj)
        if solved is None or not self._tells(there):
            return None
        if innovation_of(solved.cam_T_obj) <= most:
            self._is_sure = True
            return Turned(solved, is_leap=not was_sure)
        evidence = there.evidence + (evidence if best == suspected else 0.0)
        if evidence < config.leap_evidence:
            self._suspected, self._evidence = best, evidence
            return None
        self._is_sure = True
        return Turned(solved, is_leap=True)

    def _tells(self, one: Compared) -> bool:
        """Whether enough says that the turned pose is the right one: of two wrong poses one is better, too."""
        return one.tells(self._config.found, self._config.missed, self._config.evidence)

    def _tells_of_start(self, one: Compared) -> bool:
        return one.tells(self._config.start_found, self._config.missed, self._config.start_evidence)

    def _next_of_all(self, count: int) -> list[int]:
        count = min(count, len(self._turns))
        self._next += count
        return [turn % len(self._turns) for turn in range(self._next - count, self._next)]

    def _ask(self, frame: Frame, solution: Solution, clock: Stopwatch) -> _Asked | None:
        if not len(self._turns):
            return None
        pose = solution.cam_T_obj
        seen = self._pursuit.look(frame, pose, clock)
        edges = None if seen is None else _drawn(self._pursuit.solver, seen, pose, clock)
        if seen is None or edges is None:
            return None
        return _Asked(self._pursuit.solver, seen, pose, edges, self._turns, clock)


@dataclass(frozen=True)
class Compared:
    """What two poses have apart: how well what only the turned one shows is found, and what only the other does.

    As shares of how well the edges are found that both have; count: edge points that tell.
    """

    found: float
    missed: float
    count: float

    @property
    def swapped(self) -> Compared:
        """What it says of the other pose."""
        return Compared(self.missed, self.found, self.count)

    def tells(self, found: float, missed: float, evidence: float) -> bool:
        """Whether it is for the turned pose: at least so much found and evidence, and no more missed."""
        return self.found >= found and self.missed <= missed and self.evidence >= evidence

    @property
    def gain(self) -> float:
        """See `TurnCheck`."""
        return self.found - self.missed

    @property
    def evidence(self) -> float:
        """See `TurnCheck`."""
        return self.gain * math.sqrt(self.count)


NOTHING = Compared(0.0, 1.0, 0.0)
"""Where nothing tells."""


@dataclass(frozen=True, eq=False)
class _Asked:
    """A frame that was solved for a pose (4, 4), whose edges are these, and is asked about others."""

    solver: FrameSolver
    seen: SeenFrame
    pose: FloatArray
    edges: GeneratedEdges
    turns: FloatArray
    clock: Stopwatch

    def at(self, turn: int) -> FloatArray:
        """The pose (4, 4) after a turn of the part."""
        return np.asarray(self.pose @ self.turns[turn])

    def compare(self, turn: int) -> Compared:
        """The pose after a turn with the frame's own."""
        return self.compare_pose(self.at(turn))

    def compare_pose(self, cam_T_obj: FloatArray) -> Compared:
        """Another pose (4, 4) with the frame's own."""
        edges = _drawn(self.solver, self.seen, cam_T_obj, self.clock)
        if edges is None:
            return NOTHING
        # Beyond the image nothing can be found, and a part next to the lens reaches far beyond.
        shown, own = (drawn.take(in_image(drawn.points, self.seen.view.camera)) for drawn in (edges, self.edges))
        only_there, only_here = apart(shown, self.edges), apart(own, edges)
        there, here, both = (np.flatnonzero(rows) for rows in (only_there, only_here, ~only_here))
        if not (len(there) and len(here) and len(both)):
            return NOTHING
        usual = max(self._found(own, both[:: len(both) // _USUAL + 1], self.pose), _TINY)
        found, missed = self._found(shown, there, cam_T_obj), self._found(own, here, self.pose)
        self.clock.search_s += self.clock.lap()
        return Compared(found / usual, missed / usual, 2.0 / (1.0 / len(there) + 1.0 / len(here)))

    def _found(self, edges: GeneratedEdges, rows: IntArray, cam_T_obj: FloatArray) -> float:
        return self.solver.found(self.seen, edges.take(rows), self.seen.view.at_pose(cam_T_obj), LOOK_LEVEL)


def _drawn(solver: FrameSolver, seen: SeenFrame, cam_T_obj: FloatArray, clock: Stopwatch) -> GeneratedEdges | None:
    """The edges of a pose (4, 4); None where too few show."""
    return solver.edges_at(seen.view.at_pose(cam_T_obj), LOOK_LEVEL.samples, clock)


def apart(edges: GeneratedEdges, others: GeneratedEdges) -> BoolArray:
    """(n,) which edge points lie on none of other edges' points of their direction."""
    is_apart = np.ones(len(edges), bool)
    if len(edges) and len(others):
        _apart(plain(edges.points), _numbers(edges), plain(others.points), _numbers(others), is_apart)
    return is_apart


def _numbers(edges: GeneratedEdges) -> IntArray:
    """(n,) of the direction that each edge has, of `_DIRECTIONS`."""
    angle = np.arctan2(edges.tangents[:, 1], edges.tangents[:, 0])
    return np.floor(angle * (_DIRECTIONS / np.pi)).astype(np.int64) % _DIRECTIONS


@kernel("UniTuple(f8, 4)(f8[:, ::1])")
def _bounds(points: FloatArray) -> tuple[float, float, float, float]:
    """Left, top, right and bottom of the whole pixels that points (n, 2) px lie in; n is 1 or more."""
    left, top = points[0, 0], points[0, 1]
    right, bottom = left, top
    for i in range(1, len(points)):
        left, right = min(left, points[i, 0]), max(right, points[i, 0])
        top, bottom = min(top, points[i, 1]), max(bottom, points[i, 1])
    return np.floor(left), np.floor(top), np.floor(right), np.floor(bottom)


@kernel("void(f8[:, ::1], i8[::1], f8[:, ::1], i8[::1], b1[::1])")
def _apart(
    points: FloatArray, numbers: IntArray, others: FloatArray, other_numbers: np.ndarray, is_apart: np.ndarray
) -> None:
    """Clear is_apart (n,) of points (n, 2) px within `_REACH_PX` of others (m, 2) px of about their direction.

    Drawn as bits, one for each direction, around the whole pixels where the others lie, as far as there are points.
    """
    left, top, right, bottom = _bounds(points)
    others_left, others_top, others_right, others_bottom = _bounds(others)
    x0, y0 = max(left, others_left - _REACH_PX), max(top, others_top - _REACH_PX)
    width = int(min(right, others_right + _REACH_PX) - x0) + 1
    height = int(min(bottom, others_bottom + _REACH_PX) - y0) + 1
    if width <= 0 or height <= 0:
        return
    drawn = np.zeros((height, width), np.uint32)
    for i in range(len(others)):
        x, y = np.floor(others[i, 0]) - x0, np.floor(others[i, 1]) - y0
        if not (-_REACH_PX <= x < width + _REACH_PX and -_REACH_PX <= y < height + _REACH_PX):
            continue
        bits, column, row = 0, int(x), int(y)
        for turn in range(-2, 3):
            bits |= 1 << ((other_numbers[i] + turn) % _DIRECTIONS)
        for v in range(max(-_REACH_PX, -row), min(_REACH_PX + 1, height - row)):
            for u in range(max(-_REACH_PX, -column), min(_REACH_PX + 1, width - column)):
                if u * u + v * v <= _REACH_PX * _REACH_PX:
                    drawn[row + v, column + u] |= np.uint32(bits)
    for i in range(len(points)):
        x, y = np.floor(points[i, 0]) - x0, np.floor(points[i, 1]) - y0
        if 0 <= x < width and 0 <= y < height and (drawn[int(y), int(x)] >> np.uint32(numbers[i])) & np.uint32(1):
            is_apart[i] = False
