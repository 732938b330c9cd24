"""Which misses are the edges' and which the tracker's."""

from __future__ import annotations

import numpy as np
import pytest

from acp_lab.studies.pose_bound import AllowedError, EdgeEvidence
from benchmarks.pose_bound import LIMIT, Told, row, stretches_before


def told(chance: float, shown: float) -> Told:
    return Told(AllowedError(0.01, {LIMIT: chance}), shown)


def test_a_miss_is_physics_or_shown_beside_or_the_trackers() -> None:
    errors = {"truth": np.array([0.01, 0.03, 0.03, 0.03, 0.02]), "off": np.array([[0.01] * 5, [0.05] * 5])}
    known = [told(0.1, 0.09), told(0.9, 0.05), told(0.2, 0.05), told(0.9, 0.01), told(0.6, 0.01)]
    found = row(errors, {"samples": known, "known": known, "open": known[::-1]})
    assert (found["frames"], found["missed"], found["physics"], found["shown beside"]) == (5, 4, 1, 1)
    assert found["@2 truth"] == pytest.approx(0.2)
    assert found["@2 off"] == pytest.approx(0.5)
    assert found["@2 known"] == pytest.approx(np.mean([0.1, 0.9, 0.2, 0.9, 0.6]))
    assert found["@2 known shown"] == pytest.approx(0.4)
    assert found["ADD known shown"] == pytest.approx(5.0)
    assert found["ADD truth"] == pytest.approx(3.0)


def test_a_stretch_of_the_first_frame_is_expected_where_it_was() -> None:
    def evidence(own_mm: list[float], first: int) -> EdgeEvidence:
        stretch = np.repeat(np.arange(first, first + len(own_mm)), 5)
        count = len(stretch)
        offsets = np.repeat(own_mm, 5)
        return EdgeEvidence(
            np.zeros((count, 6)), offsets, np.ones(count), np.ones(count, bool), stretch, np.zeros((count, 3))
        )

    before = evidence([-0.2, -0.1, 0.0, 0.1, 0.2], 0)
    # One stretch later, moved by little; the last one is new.
    now = evidence([-0.11, 0.0, 0.11, 0.2, 0.3], 1)
    shared = now.shared_mm[0] - before.shared_mm[0]
    expected, deviation = stretches_before(now, before)
    np.testing.assert_allclose(expected[:4], [-0.1, 0.0, 0.1, 0.2], atol=1e-12)
    assert expected[4] == 0.0
    assert shared == pytest.approx(0.11)
    assert (deviation[:4] < 0.5 * deviation[4]).all()
    expected, deviation = stretches_before(now, None)
    np.testing.assert_array_equal(expected, 0.0)
    np.testing.assert_allclose(deviation, now.spread_mm[0])
