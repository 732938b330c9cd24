"""`acp.show`: what would be shown, and time going both ways; the viewer itself is played by a stand-in."""

from __future__ import annotations

import builtins
import sys
from collections.abc import Callable
from dataclasses import replace
from types import ModuleType, SimpleNamespace
from typing import Any

import ipywidgets
import pytest
import traitlets

from acp_lab.display.replay import viewer
from acp_lab.display.replay.clock import Moment
from acp_lab.display.replay.images import ImageWriter
from acp_lab.display.replay.viewer import RunViewer, notebook_viewer, record, show
from acp_lab.display.widgets.keyboard_guard import KeyboardGuard
from acp_lab.display.widgets.telemetry_guard import TelemetryGuard
from acp_lab.errors import AcpLabError, SequenceError
from acp_lab.tracking.observer import SessionInfo, TrackedObject
from acp_lab.tracking.session import TrackRun
from tests.display.made_run import FRAME_IDS, STEPS, box, frames, recorded, true_pose


class Sequence:
    """The made frames as a sequence."""

    name, scene_id, object_ids, frame_ids = "made/test/000001", 1, (1,), FRAME_IDS

    def frames(self, max_frames: int | None = None) -> Any:
        return iter(list(frames())[:max_frames])


class Viewer:
    """Stands in for rerun's: takes down what it is told."""

    def __init__(self, **options: Any) -> None:
        self.options = options
        self.told: list[dict[str, Any]] = []
        self.callbacks: list[Callable[[Any], None]] = []

    def on_event(self, callback: Callable[[Any], None]) -> None:
        self.callbacks.append(callback)

    def set_time_ctrl(self, **told: Any) -> None:
        self.told.append(told)

    def _display_(self) -> ipywidgets.Widget:
        return ipywidgets.HTML("the picture")

    def say(self, kind: str, **values: Any) -> None:
        for callback in self.callbacks:
            callback(SimpleNamespace(type=kind, **values))


@pytest.fixture
def run() -> TrackRun:
    results = tuple(recorded(frame, 1) for frame in frames())
    session = SessionInfo("made/test/000001", 1, "acp", (TrackedObject(1, box()),), true_pose, len(FRAME_IDS))
    return TrackRun("made/test/000001", 1, "acp", {1: results}, Sequence(), session)  # type: ignore[arg-type]


@pytest.fixture
def shown(run: TrackRun, monkeypatch: pytest.MonkeyPatch) -> RunViewer:
    monkeypatch.setattr(viewer, "notebook_viewer", lambda: Viewer)
    return show(run)


def test_the_viewer_leads(shown: RunViewer) -> None:
    seen: list[int] = []
    shown.observe(lambda change: seen.append(change["new"]), "frame")
    shown.widget.say("time_update", time=2.4)
    assert shown.frame == 2
    shown.widget.say("timeline_change", timeline="step", time=0.0)
    shown.widget.say("time_update", time=STEPS + 2.0)  # inside the second frame
    assert shown.frame == 1
    shown.widget.say("timeline_change", timeline="time", time=0.0)
    shown.widget.say("time_update", time=3.2e9 / 30.0)
    assert shown.frame == 3
    shown.widget.say("timeline_change", timeline="log_time", time=1e18)  # nothing of ours
    shown.widget.say("play")
    assert shown.frame == 3
    assert seen == [2, 0, 1, 0, 3]
    assert shown.widget.told == []  # it is not told what it said


def test_the_viewer_follows(shown: RunViewer) -> None:
    class Player(traitlets.HasTraits):
        frame = traitlets.Int(0)

    player = Player()
    traitlets.link((player, "frame"), (shown, "frame"))
    player.frame = 3
    assert shown.widget.told == [{"sequence": 3, "timeline": "frame"}]
    shown.widget.say("time_update", time=1.0)
    assert player.frame == 1


def test_the_keyboard_is_guarded(shown: RunViewer, monkeypatch: pytest.MonkeyPatch) -> None:
    displayed: list[Any] = []
    monkeypatch.setattr("IPython.display.display", displayed.append)
    shown._ipython_display_()
    assert isinstance(displayed[0], TelemetryGuard)
    guard, picture = displayed[1].children  # the guard looks after its next sibling
    assert isinstance(guard, KeyboardGuard)
    assert picture.value == "the picture"


def test_what_is_recorded_is_the_run(run: TrackRun) -> None:
    recording, moments = record({"": run})
    assert [moment.frame for moment in moments] == list(range(len(FRAME_IDS)))
    assert [moment.step for moment in moments] == [0, STEPS + 1, 2 * STEPS + 2, 2 * STEPS + 3]
    memory = recording.memory_recording()
    assert memory.num_msgs() > 20


def test_two_runs_go_below_two_roots(run: TrackRun, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(viewer, "notebook_viewer", lambda: Viewer)
    both = show(run, replace(run, method="acp-paper"))
    assert both.frame_at("frame", 2.0) == 2


def test_results_with_gaps_go_with_their_own_images(run: TrackRun, monkeypatch: pytest.MonkeyPatch) -> None:
    put: list[tuple[int, int]] = []
    whole = ImageWriter.put

    def watched(writer: ImageWriter, moment: Any, entity: str, image: Any, *rest: Any, **more: Any) -> None:
        if entity == "camera/image":
            put.append((moment.frame, int(image[0, 0, 0])))
        whole(writer, moment, entity, image, *rest, **more)

    monkeypatch.setattr(ImageWriter, "put", watched)
    _, moments = record({"": replace(run, results={1: (run.results[1][1], run.results[1][3])})})
    assert [moment.frame for moment in moments] == [0, 1]
    assert put == [(0, 30 * FRAME_IDS[1]), (1, 30 * FRAME_IDS[3])]


@pytest.mark.parametrize("late", ["a", "b"])
def test_two_runs_show_the_same_image_at_the_same_moment(
    run: TrackRun, monkeypatch: pytest.MonkeyPatch, late: str
) -> None:
    """One of them begins later."""
    shown: dict[str, dict[Moment, int]] = {"a": {}, "b": {}}
    whole = ImageWriter.put

    def watched(writer: ImageWriter, moment: Moment, entity: str, image: Any, *rest: Any, **more: Any) -> None:
        if entity.endswith("camera/image"):
            shown[entity[0]][replace(moment, step=0)] = int(image[0, 0, 0])
        whole(writer, moment, entity, image, *rest, **more)

    monkeypatch.setattr(ImageWriter, "put", watched)
    runs = {"a": run, "b": run, late: replace(run, results={1: run.results[1][1:]})}
    assert len(record(runs)[1]) == len(FRAME_IDS)
    first, second = shown[late], shown["ba"[late == "b"]]
    assert len(first) == 2
    assert first.items() < second.items()


def test_an_object_without_results_is_left_out_and_a_run_without_any_refused(run: TrackRun) -> None:
    assert len(record({"": replace(run, results={2: (), **run.results})})[1]) == len(FRAME_IDS)
    with pytest.raises(SequenceError, match="no results"):
        record({"": replace(run, results={1: ()})})


def test_of_two_runs_the_longer_one_is_shown_to_its_end(run: TrackRun) -> None:
    short = replace(run, results={1: run.results[1][:2]})
    for runs in ({"a": run, "b": short}, {"a": short, "b": run}):
        assert len(record(runs)[1]) == len(FRAME_IDS)


def test_a_run_whose_images_are_gone(run: TrackRun) -> None:
    for gone in (replace(run, sequence=None), replace(run, session=None)):
        with pytest.raises(SequenceError, match="cannot be read again"):
            record({"": gone})


def test_without_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    usual = builtins.__import__

    def missing(name: str, *rest: Any) -> ModuleType:
        if name == "rerun_notebook":
            raise ImportError(name)
        return usual(name, *rest)

    monkeypatch.delitem(sys.modules, "rerun_notebook", raising=False)
    monkeypatch.setattr(builtins, "__import__", missing)
    with pytest.raises(AcpLabError, match="make lab does"):
        notebook_viewer()


def test_imported_before_it_could_be_kept_off_the_net(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "rerun_notebook", SimpleNamespace(ASSET_IS_URL=True))  # type: ignore[misc]
    monkeypatch.delenv("RERUN_NOTEBOOK_ASSET", raising=False)
    with pytest.raises(AcpLabError, match="restart the kernel"):
        notebook_viewer()
