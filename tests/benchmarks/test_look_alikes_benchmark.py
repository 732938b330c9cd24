"""The benchmark of parts like the tracked one around it."""

from __future__ import annotations

import numpy as np
import pytest

from acp_lab.tracking.method import ACP
from acp_lab.tracking.recovery import WayBack
from acp_lab.tracking.start import SecondOpinion, TrustedStart
from benchmarks.look_alikes import OFF, Asked, _rows, not_remembering
from benchmarks.recovery import Return


def test_not_remembering_is_the_method_but_for_two_settings() -> None:
    method = not_remembering(ACP)
    assert isinstance(method.way_back, WayBack)
    assert isinstance(method.start, TrustedStart)
    assert isinstance(method.start.second_opinion, SecondOpinion)
    assert method.way_back.remembered_frames == 0
    assert method.start.second_opinion.apart_below > 1.0  # no probability reaches it
    assert method.targets == ACP.targets
    assert method.learning == ACP.learning


def test_rows_tell_of_runs_of_starts_and_of_absences() -> None:
    def absence(kind: str, near: bool, back_after: int | None, false: int) -> Return:
        return Return(kind, near, back_after, false, (), (3.0,))

    asked = [
        Asked(
            {"truth": np.array([0.01, 0.04]), "5": np.array([0.4, 0.01])},
            {name: np.array([0.0, 0.05, 0.2, 0.5]) for name in OFF},
            (absence("hidden 5", True, 3, 0), absence("hidden 5", True, None, 40), absence("hidden 30", False, 50, 2)),
        )
    ]
    rows = _rows(asked)
    assert rows["followed from truth"] == {"@2": 0.5, "@5": 1.0, "lost": 0, "runs": 1}
    assert rows["followed from 5"]["lost"] == 1
    assert rows["begun 20 off"] == {"right": 0.5, "other": 0.25, "runs": 4}
    assert rows["hidden 5"] == {"right": pytest.approx(0.5), "other": 40, "runs": 2}
    assert rows["elsewhere"] == {"right": 1.0, "other": 2, "runs": 1}
    assert "hidden 1" not in rows
