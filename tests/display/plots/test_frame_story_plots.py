"""Runs beside each other, and one frame taken apart."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.figure import Figure

from acp_lab.display.plots.frame_story import add_percents, draw_found, draw_memory, draw_runs
from acp_lab.errors import SequenceError
from acp_lab.sequences.altered import AlteredSequence
from acp_lab.studies.frame_story import frame_story
from acp_lab.tracking.result import TrackState
from acp_lab.tracking.session import TrackRun
from acp_lab.tracking.tracker import Tracker
from tests.prepared_sample import sample_model, sample_scene


@pytest.fixture(scope="module")
def run() -> TrackRun:
    sequence = AlteredSequence(sample_scene(), frame_ids=(0, 1, 2, 10, 11))
    run = Tracker(sample_model()).run(sequence, sequence.first_pose)
    results = list(run.results[1])
    results[3] = replace(results[3], state=TrackState.LOST)
    return replace(run, results={1: tuple(results)})


def test_add_is_that_of_the_frames(run: TrackRun) -> None:
    percents = add_percents(run)
    assert percents.shape == (5,)
    assert 0.0 <= percents[0] < 1.0
    assert run.session is not None
    blind = replace(run, session=replace(run.session, truth=None))
    assert np.isnan(add_percents(blind)).all()
    with pytest.raises(SequenceError, match="object 7"):
        add_percents(run, 7)


def test_lines_break_where_frames_are_missing_and_lost_frames_are_marked(run: TrackRun) -> None:
    error, quality = Figure().subplots(1, 2)
    draw_runs(error, quality, {"a": run, "b": run}, largest_percent=3.0)
    curve, lost = quality.lines[0], quality.lines[1]
    assert np.isnan(curve.get_ydata()).tolist() == [False, False, False, True, False, False]
    assert lost.get_xdata().tolist() == [10]
    assert max(np.nanmax(line.get_ydata()) for line in error.lines[:2]) <= 3.0
    assert [text.get_text() for text in quality.get_legend().get_texts()] == ["a", "b"]


@pytest.mark.filterwarnings("error")
def test_a_run_without_results_is_an_empty_curve(run: TrackRun) -> None:
    error, quality = Figure().subplots(1, 2)
    draw_runs(error, quality, {"a": replace(run, results={1: ()}), "b": run})
    assert [len(line.get_xdata()) for line in quality.lines[:4]] == [0, 0, 0, 6]
    assert [text.get_text() for text in quality.get_legend().get_texts()] == ["a", "b"]


def test_a_frame_taken_apart(run: TrackRun) -> None:
    story = frame_story(sample_model(), sample_scene(), 3)
    found, memory = Figure().subplots(1, 2)
    draw_found(found, story.observation, story.observation.scores)
    assert len(found.collections[-1].get_offsets()) == len(story.way_px)
    row = int(story.observation.candidates.scores.max(1).argmax())
    draw_memory(memory, story.observation, row, story.way_px[row])
    image, remembered = memory.lines[0].get_ydata(), memory.lines[1].get_ydata()
    assert len(image) >= 1
    assert (remembered <= image + 1e-6).all()
