"""Methods side by side: what is chosen is run once, and table, curves and film show the same moment of it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from acp_lab.bench import spread
from acp_lab.bench.protocol import SequenceKey, Task
from acp_lab.bench.workbench import Workbench
from acp_lab.course.side_by_side import workbench
from acp_lab.course.workshop import FOLDER_VARIABLE
from acp_lab.display.widgets.run_comparison import ADD_ROW, RunComparison, _around
from acp_lab.sequences.bop import open_sequence
from tests.bench.made_runs import made_run
from tests.display.open_widgets import open_widgets
from tests.prepared_sample import sample_scene

METHODS = ("acp", "region", "slet")
ERRORS = {"acp": 0.01, "region": 0.04, "slet": 0.6}
MOST_FRAMES: dict[SequenceKey, int] = {}


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[Task]:
    """Instead of runs: the truth, off by so much in name, of every second image of the scene."""
    tasks: list[Task] = []

    def new_runs(missing: list[Task], *_: object):  # type: ignore[no-untyped-def]
        for task in missing:
            tasks.append(task)
            ids = sample_scene().frame_ids[1 :: task.variant.step][: MOST_FRAMES.get(task.sequence)]
            made = made_run([ERRORS[task.method_name]] * len(ids), task.method_name, task.sequence, task.variant)
            poses = np.array([sample_scene().truth(frame_id, 1)[:3] for frame_id in ids]).reshape(-1, 3, 4)  # type: ignore[index]
            yield task, replace(made, frame_ids=ids, poses=poses, state=task.state)

    monkeypatch.setattr(spread, "_new_runs", new_runs)
    return tasks


@pytest.fixture
def bench(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Workbench:
    monkeypatch.setenv(FOLDER_VARIABLE, str(tmp_path))
    return workbench()


def test_what_is_chosen_is_run_once_and_shown(bench: Workbench, asked: list[Task]) -> None:
    shown = RunComparison(bench, METHODS)
    assert [task.method_name for task in asked] == ["acp", "region"]
    assert shown.report is not None
    assert "sample: every frame, from truth" in shown.table.value
    assert shown.table.value.count("<tr>") == 3
    assert [curve.label for curve in shown.errors.curves] == ["acp", "region"]
    np.testing.assert_allclose(shown.errors.curves[1].values, 4.0)
    at_5_percent = [float(curve.values[50]) for curve in shown.shares.curves]
    assert at_5_percent == [1.0, 1.0]
    shown.methods.value = ("region", "slet")
    shown.start.value = 2.0
    shown.go.click()
    # Two starts each, of which the film shows the first.
    assert [(task.method_name, task.variant.seed) for task in asked[2:]] == [
        ("region", 0), ("region", 1), ("slet", 0), ("slet", 1),
    ]  # fmt: skip
    assert "▼" in shown.table.value
    before = len(asked)
    shown.go.click()
    assert len(asked) == before


def test_pictures_of_methods_that_are_not_compared_any_more_are_closed(bench: Workbench, asked: list[Task]) -> None:
    shown = RunComparison(bench, METHODS)
    two, before = shown.canvases, len(open_widgets())
    for chosen in (METHODS, METHODS[:2]):
        shown.methods.value = chosen
        shown.go.click()
    assert len(shown.canvases) == 2
    assert len(open_widgets()) == before
    assert all(canvas.comm is None for canvas in two)


def test_the_film_and_the_curves_are_at_the_same_frame(bench: Workbench, asked: list[Task]) -> None:
    shown = RunComparison(bench, METHODS, METHODS)
    assert len(shown.canvases) == 3
    frames = sample_scene().frame_ids[1:]
    for place, move in enumerate(
        (
            lambda: None,
            lambda: setattr(shown, "frame", 1),
            lambda: shown.errors.set_state({"cursor": 2}),
            lambda: shown.slider.set_state({"value": 3}),
        )
    ):
        move()
        assert shown.frame == shown.slider.value == shown.play.value == shown.errors.cursor == place
        assert [canvas.title.partition(":")[0] for canvas in shown.canvases] == [
            f"{name}, image {frames[place]}" for name in METHODS
        ]
    truth, tracked = shown.canvases[0].overlays
    assert (truth.label, tracked.label) == ("the truth", "acp")
    np.testing.assert_allclose(truth.coordinates, tracked.coordinates)
    assert "60.0%" in shown.canvases[2].title
    assert shown.canvases[0].image == shown.canvases[2].image != b""
    assert float(max(shown.errors.curves[2].values)) == 20.0
    assert shown.errors.curves[2].row == ADD_ROW
    assert shown.errors.curves[2].most == 20.0


def test_another_sequence_is_another_film(bench: Workbench, asked: list[Task]) -> None:
    shown = RunComparison(bench, METHODS)
    shown.frame = 38
    first = shown.canvases[0].image
    shown.sequences.value = bench.sequences
    shown.step.value = 4
    shown.go.click()
    assert "all: 1 of 4 frames" in shown.table.value
    assert len(shown.film.options) == 2
    assert shown.frame == 9
    shown.film.value = bench.sequences[1]
    assert shown.canvases[0].image != first
    assert len(shown.canvases) == 2


def test_a_shorter_film_of_more_methods(bench: Workbench, asked: list[Task]) -> None:
    """The slider is moved back while the new pictures are not there yet."""
    shown = RunComparison(bench, METHODS)
    shown.methods.value = METHODS[:1]
    shown.go.click()
    shown.frame = 38
    shown.methods.value = METHODS
    shown.step.value = 4
    shown.compare()
    assert shown.frame == 9
    assert len(shown.canvases) == len(METHODS)


@pytest.mark.filterwarnings("error")
def test_a_film_without_a_frame_to_compare_shows_none(
    bench: Workbench, asked: list[Task], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of one image, in which the part was given, nothing is scored."""
    shown = RunComparison(bench, METHODS)
    assert shown.canvases[0].image != b""
    monkeypatch.setitem(MOST_FRAMES, bench.sequences[1], 0)
    shown.sequences.value = bench.sequences[1:]
    shown.go.click()
    assert [canvas.title for canvas in shown.canvases] == [f"{name}: no frame to compare" for name in METHODS[:2]]
    assert [(canvas.image, canvas.overlays, canvas.view) for canvas in shown.canvases] == [(b"", (), ())] * 2
    assert shown.shares.curves == ()
    shown.sequences.value = bench.sequences
    shown.go.click()
    assert len(shown.shares.curves) == 2
    assert shown.canvases[0].image == b"", "the film is still that of the second one"
    shown.film.value = bench.sequences[0]
    assert shown.canvases[0].image != b""


def test_what_cannot_be_run_is_told(bench: Workbench, asked: list[Task]) -> None:
    shown = RunComparison(bench, METHODS)
    table = shown.table.value
    shown.methods.value = ()
    shown.go.click()
    assert "choose one or more" in shown.told.value
    assert not shown.go.disabled
    assert shown.table.value == table


def test_a_comparison_that_fails_says_what_is_still_shown(
    bench: Workbench, asked: list[Task], monkeypatch: pytest.MonkeyPatch
) -> None:
    shown = RunComparison(bench, (*METHODS, "cv2"))
    shown.methods.value = ("cv2", "acp")
    shown.go.click()
    assert shown.told.value.startswith("method cv2: no such method: there are acp, ")
    assert "--" not in shown.told.value
    assert shown.told.value.endswith("(below: acp and region, compared before)")

    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(Workbench, "compare", interrupted)
    with pytest.raises(KeyboardInterrupt):
        shown.compare()
    assert "interrupted" in shown.told.value
    assert shown.told.value.endswith("(below: acp and region, compared before)")
    assert not shown.go.disabled


def test_the_sample_backwards_is_the_sample_from_its_end(bench: Workbench) -> None:
    assert bench.sequences == (SequenceKey("sample", 1, 1), SequenceKey("backwards", 1, 1))
    turned, scene = open_sequence(bench.roots["backwards"]), sample_scene()
    assert turned.frame_ids == scene.frame_ids
    first, last = scene.frame_ids[0], scene.frame_ids[-1]
    np.testing.assert_array_equal(turned.truth(first, 1), scene.truth(last, 1))
    assert turned.image_paths[first].read_bytes() == scene.image_paths[last].read_bytes()
    written = turned.image_paths[first].stat().st_mtime_ns
    assert workbench().roots["backwards"] == bench.roots["backwards"]
    assert turned.image_paths[first].stat().st_mtime_ns == written


@pytest.mark.parametrize("size", [(640, 480), (480, 640), (480, 480)])
@pytest.mark.parametrize("extent", [(100.0, 40.0), (40.0, 100.0), (400.0, 60.0)])
def test_the_film_shows_the_whole_part(size: tuple[int, int], extent: tuple[float, float]) -> None:
    """Also where the image stands upright."""
    middle = 0.5 * np.array(size)
    corners = np.array([middle - 0.5 * np.array(extent), middle + 0.5 * np.array(extent)])
    left, top, width, height = _around(corners[None], size)
    assert (corners > (left, top)).all()
    assert (corners < (left + width, top + height)).all()
    assert width / height == pytest.approx(size[0] / size[1])
    assert width <= size[0]
