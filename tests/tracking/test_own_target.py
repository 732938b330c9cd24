"""A target of somebody's own: what the tracker keeps beside it, and that it may learn."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

import numpy as np
import pytest

from acp_lab.errors import TrackingError
from acp_lab.prepared_part import PreparedPart
from acp_lab.tracking.frame_view import FrameView
from acp_lab.tracking.learning.knowledge import Off, SampleKnowledge, TargetLearning
from acp_lab.tracking.method import ACP, Method
from acp_lab.tracking.schedule import ShareSchedule
from acp_lab.tracking.sources.rigid import CadSamples
from acp_lab.tracking.targets.distance_map import DistanceMap
from acp_lab.tracking.targets.normals import NormalSearch
from acp_lab.tracking.tracker import Tracker
from tests.prepared_sample import sample_model, sample_scene


@dataclass(frozen=True)
class Counting(DistanceMap):
    """A distance map whose judgements say when they learn."""

    kind: ClassVar[str] = "counting"
    learns: ClassVar[bool] = True
    heard: list[bool] = field(default_factory=list)

    def memory(self, model: PreparedPart) -> Any:
        return _Memory(super().memory(model), self.heard)


class _Memory:
    def __init__(self, within: DistanceMap, heard: list[bool]) -> None:
        self._within, self._heard = within, heard

    def see(self, view: FrameView, knowledge: SampleKnowledge) -> Any:
        target, heard = self._within.see(view, knowledge), self._heard
        bind = target.bind

        def listening(*args: Any) -> Any:
            measure = bind(*args)
            judge = measure.judge

            def judged(*args: Any) -> Any:
                judgement = judge(*args)
                object.__setattr__(judgement, "learn", heard.append)
                return judgement

            measure.judge = judged  # type: ignore[method-assign]
            return measure

        target.bind = listening  # type: ignore[method-assign]
        return target


def own(target: DistanceMap, learning: TargetLearning | Off) -> Method:
    return replace(
        ACP, name="own", source=CadSamples("templates"), targets=(target,), schedule=ShareSchedule(),
        learning=learning, confidence=Off(),
    )  # fmt: skip


def test_a_target_that_learns_is_told_of_each_solved_frame() -> None:
    scene, target = sample_scene(), Counting()
    tracker = Tracker(sample_model(), own(target, TargetLearning()))  # type: ignore[arg-type]
    tracker.start(scene.frame(0), scene.first_pose)
    for number in range(1, 4):
        tracker.track(scene.frame(number))
        assert len(target.heard) == number + 1


def test_a_target_that_learns_and_a_learning_that_nobody_asks_for_are_told() -> None:
    with pytest.raises(TrackingError, match=r'targets.kind = "counting".*learning.kind = "targets"'):
        own(Counting(), Off())
    with pytest.raises(TrackingError, match="no target of this method learns"):
        own(DistanceMap(), TargetLearning())


@pytest.mark.parametrize("first", [DistanceMap(), NormalSearch()], ids=["distance map", "along normals"])
def test_without_learning_the_parts_last_picture_is_kept_all_the_same(first: Any) -> None:
    scene, method = sample_scene(), own(first, Off())
    tracker = Tracker(sample_model(), method)
    last = tracker.start(scene.frame(0), scene.first_pose)
    for number in range(1, 4):
        memory = tracker._pursuit.picture_memory
        assert memory is not None
        assert memory.kept is not None
        np.testing.assert_array_equal(memory.kept[1], last.cam_T_obj)
        last = tracker.track(scene.frame(number))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"control_points": "mine"}, "control_points = 'mine': give one of regressed, mid-section"),
        ({"control_points": np.zeros((4, 3))}, "control_points = array.*: give one of regressed"),
        ({"source": CadSamples("quick")}, "source.generator = 'quick': give one of best"),  # type: ignore[arg-type]
        ({"targets": (DistanceMap(abs),)}, "targets.loss = <built-in function abs>: give one of printed"),  # type: ignore[arg-type]
    ],
)
def test_a_word_that_is_none_of_a_settings_is_told(change: dict[str, Any], words: str) -> None:
    with pytest.raises(TrackingError, match=words):
        replace(own(DistanceMap(), Off()), **change)
