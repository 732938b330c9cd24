"""The graders of notebook 09."""

from __future__ import annotations

import numpy as np
import pytest

from acp_lab.course.lesson_09 import unlabelled_runs
from acp_lab.evaluation import add_mm
from acp_lab.tracking.result import TrackState
from acp_lab.tracking.states import StateConfig, StateMachine
from tests.course.grading import hints, passes
from tests.prepared_sample import sample_model, sample_scene

RIGHT = {"A": "occlusion", "B": "focal length", "C": "bad start"}


def states(qualities, config=StateConfig()):  # type: ignore[no-untyped-def]  # noqa: B008
    machine, found = StateMachine(config), []
    for quality in qualities:
        machine.update(quality)
        found.append(str(machine.state))
    return found


def above(limit: float) -> float:
    """A limit below which the limit itself lies, as <= would have it."""
    return float(np.nextafter(limit, 1.0))


def below(limit: float) -> float:
    """Likewise for >=."""
    return float(np.nextafter(limit, 0.0))


def test_states() -> None:
    passes("09.1", states)
    passes("09.1", lambda qualities: np.array(states(qualities)))


@pytest.mark.parametrize(
    ("wrong", "fragment"),
    [
        (lambda q: states(q, StateConfig(tracking_above=0.5)), "while the state is 'weak'"),
        (lambda q: states(q, StateConfig(patience=1)), "yours turns to 'lost'"),
        (lambda q: states(q, StateConfig(found_above=0.25)), "while the state is 'lost'"),
        (lambda q: states(q, StateConfig(proof=1)), "while the state is 'lost'"),
        (lambda q: states(q)[1:], "one word for each"),
        (lambda q: "tracking", "one word for each"),
        (lambda q: np.array(5), "one word for each"),
        (lambda q: (word for word in states(q)), "one word for each"),
        (lambda q: states(q, StateConfig(lost_below=above(0.25))), "yours turns to 'lost'"),
        (lambda q: states(q, StateConfig(found_above=below(0.5))), "while the state is 'lost'"),
        (lambda q: states(q, StateConfig(weak_below=above(0.5))), "yours turns to 'weak'"),
        (lambda q: states(q, StateConfig(tracking_above=below(0.6))), "while the state is 'weak'"),
        (lambda q: ["good"] * len(q), "one of these words"),
        (lambda q: [1 / 0], "ZeroDivisionError"),
        (["tracking"], "the function itself"),
    ],
)
def test_wrong_states(wrong, fragment: str) -> None:  # type: ignore[no-untyped-def]
    hints("09.1", wrong, fragment)


def test_causes() -> None:
    passes("09.2", RIGHT)
    passes("09.2", {"a": "Occlusion", "b": "focal  length", "C": "bad start"})
    for name, wrong, fragment in (
        ("A", "missing frames", "look at the picture"),
        ("B", "edge break", "last column"),
        ("C", "focal length", "very first frame"),
    ):
        said = hints("09.2", {**RIGHT, name: wrong}, f"Run {name}")
        assert fragment in said
        assert RIGHT[name] not in said
    hints("09.2", {"A": "occlusion"}, "Run B has no answer")
    hints("09.2", {**RIGHT, "C": "reflections"}, "one of these words")
    hints("09.2", ["occlusion", "focal length", "bad start"], "dictionary")


@pytest.mark.slow
def test_the_runs_show_what_the_hints_say() -> None:
    runs = {name: run.results[1] for name, run in unlabelled_runs(sample_model()).items()}
    quality = {name: np.array([result.quality for result in results]) for name, results in runs.items()}
    lowest = int(quality["A"].argmin())
    assert 14 < lowest < 34
    assert quality["A"][[10, 36]].min() > 1.25 * quality["A"][lowest]
    assert quality["B"][0] > 1.1 * quality["C"][0]
    assert quality["B"][0] == pytest.approx(quality["A"][0], abs=0.05)
    part, truth = sample_model().part, sample_scene().truth
    for result in runs["C"]:
        assert result.state is not TrackState.LOST
        assert add_mm(part.vertices, result.cam_T_obj, truth(result.frame_id, 1)) > 0.15 * part.diameter


class Truth:
    """A tracker that knows, for all that the grader asks of one."""

    def __init__(self, part, last=99):  # type: ignore[no-untyped-def]
        self.last = last

    def start(self, frame, cam_T_obj):  # type: ignore[no-untyped-def]
        return cam_T_obj

    def track(self, frame):  # type: ignore[no-untyped-def]
        return sample_scene().truth(min(frame.index, self.last), 1)


def test_a_small_tracker() -> None:
    assert "39 of 39 below 2%" in passes("09.3", Truth)


@pytest.mark.parametrize(
    ("wrong", "fragment"),
    [
        (Truth(None), "itself"),
        (lambda part: 5, "no method start"),
        (lambda part: Truth(part, last=0), "It held for"),
        (type("Jumps", (Truth,), {"track": lambda self, frame: np.eye(4)}), "Frame 1: ADD is"),
        (type("Short", (Truth,), {"track": lambda self, frame: np.eye(3)}), "(4, 4)"),
        (type("Ragged", (Truth,), {"track": lambda self, frame: [[1, 2], [3]]}), "(4, 4)"),
        (type("Words", (Truth,), {"track": lambda self, frame: [["a"] * 4] * 4}), "(4, 4)"),
        (type("Fails", (Truth,), {"track": lambda self, frame: 1 / 0}), "ZeroDivisionError"),
    ],
)
def test_wrong_trackers(wrong, fragment: str) -> None:  # type: ignore[no-untyped-def]
    hints("09.3", wrong, fragment)
