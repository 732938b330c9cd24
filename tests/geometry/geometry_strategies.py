"""Hypothesis strategies for rotations, poses and quads, dense where formulas break: 0, pi and flat."""

from __future__ import annotations

import math

import numpy as np
from hypothesis import strategies as st

from acp_lab.geometry import make_pose, so3_exp
from acp_lab.geometry.arrays import FloatArray

_PI = math.pi
_unit = st.floats(-1.0, 1.0)


@st.composite
def directions(draw: st.DrawFn) -> FloatArray:
    """Unit vectors (3,), coordinate axes among them."""
    v = np.array([draw(_unit), draw(_unit), draw(_unit)])
    length = float(np.linalg.norm(v))
    return v / length if length > 1e-3 else np.array([0.0, 0.0, 1.0])


def angles(largest: float) -> st.SearchStrategy[float]:
    """Angles from 0 to the largest, many of them tiny or just below it."""
    tiny = st.floats(-300.0, -1.0).map(lambda e: 10.0**e)
    return st.one_of(st.just(0.0), tiny, st.floats(0.0, largest), st.floats(1e-12, 0.1).map(lambda gap: largest - gap))


@st.composite
def rotation_vectors(draw: st.DrawFn, largest: float = _PI - 1e-12) -> FloatArray:
    return draw(angles(largest)) * draw(directions())


@st.composite
def twists(draw: st.DrawFn, largest: float = _PI - 1e-12) -> FloatArray:
    """Twists (6,): any rotation shorter than half a turn, translations up to 2 m."""
    shift = np.array([draw(st.floats(-2000.0, 2000.0)) for _ in range(3)])
    return np.concatenate([draw(rotation_vectors(largest)), shift])


@st.composite
def poses(draw: st.DrawFn) -> FloatArray:
    shift = [draw(st.floats(-2000.0, 2000.0)) for _ in range(3)]
    return make_pose(so3_exp(draw(rotation_vectors(_PI))), np.array(shift))


@st.composite
def convex_quads(draw: st.DrawFn, flattest: float = 0.02) -> FloatArray:
    """Convex quads (4, 2), px: a square, jittered, flattened down to a sliver, turned, scaled, moved."""
    corner = st.floats(-0.3, 0.3)
    quad = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    quad = quad + np.array([[draw(corner), draw(corner)] for _ in range(4)])
    quad[:, 1] *= draw(st.one_of(st.just(1.0), st.floats(flattest, 1.0)))
    turn = draw(st.floats(-_PI, _PI))
    c, s = math.cos(turn), math.sin(turn)
    quad = quad @ np.array([[c, s], [-s, c]]) * draw(st.floats(10.0, 300.0))
    return quad + np.array([draw(st.floats(0.0, 1224.0)), draw(st.floats(0.0, 1024.0))])
