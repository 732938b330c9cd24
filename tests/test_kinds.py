"""What a beginner hands over in place of the object that is wanted is told in one line, with the call that makes it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import acp_lab as acp
from acp_lab.display.widgets import LossLandscape, ManipulationExplorer, PoseAligner, TrackPlayer
from acp_lab.errors import AcpLabError
from acp_lab.sequences.frame import Frame
from tests.prepared_sample import sample_model, sample_scene

WRONG: dict[str, tuple[Any, str]] = {
    "Tracker": (lambda: acp.Tracker("parts/bracket"), "model is a str 'parts/bracket', .*acp.PreparedPart.load"),  # type: ignore[arg-type]
    "prepare": (lambda: acp.prepare(Path("bracket.ply")), r"part is a \w+Path 'bracket.ply', no Part: .*from_file"),  # type: ignore[arg-type]
    "start": (
        lambda: acp.Tracker(sample_model()).start(sample_scene().frame(0).image, np.eye(4)),  # type: ignore[union-attr]
        r"frame is a ndarray, no Frame: .*scene.frame\(0\)",
    ),
    "run": (
        lambda: acp.Tracker(sample_model()).run(sample_scene(), start="POSE.json"),  # type: ignore[arg-type]
        r"the start pose: no pose .*read_pose\('POSE.json'\)",
    ),
    "run of a path": (
        lambda: acp.Tracker(sample_model()).run("data/test/000001", start=np.eye(4)),  # type: ignore[arg-type]
        "data/test/000001: is a path, no sequence: give acp.open_sequence",
    ),
    "detect": (
        lambda: acp.detect(sample_model(), sample_scene().frame(0).image),  # type: ignore[union-attr]
        "frame is a ndarray, no Frame",
    ),
    "detect of a path": (
        lambda: acp.detect("parts/bracket", sample_scene().frame(0)),  # type: ignore[arg-type]
        "model is a str 'parts/bracket', no PreparedPart",
    ),
    "prepare as it is called": (lambda: acp.prepare(sample_model().part, "fast"), "options is a str 'fast'"),  # type: ignore[arg-type]
    "track": (lambda: _started().track(sample_scene().frame(1).image), r"frame is a ndarray, no Frame"),  # type: ignore[union-attr]
    "show": (lambda: acp.show("run.rrd"), "run is a str 'run.rrd', no TrackRun: .*acp-lab replay"),  # type: ignore[arg-type]
    "explain": (lambda: acp.explain("results.csv", 0), "run is a str 'results.csv', no TrackRun"),  # type: ignore[arg-type]
    "TrackPlayer": (lambda: TrackPlayer("results.csv"), "run is a str 'results.csv', no TrackRun"),  # type: ignore[arg-type]
    "PoseAligner": (
        lambda: PoseAligner(sample_model(), sample_scene().frame(0).image),  # type: ignore[union-attr]
        "frame is a ndarray, no Frame",
    ),
    "LossLandscape": (
        lambda: LossLandscape(sample_model(), sample_scene().frame(0).image, np.eye(4)),  # type: ignore[union-attr]
        "frame is a ndarray, no Frame",
    ),
    "ManipulationExplorer": (
        lambda: ManipulationExplorer(sample_model(), sample_scene().camera(0), sample_scene().first_pose[:3]),
        r"the reference pose: no pose of shape \(4, 4\)",
    ),
    "ManipulationExplorer of a part around the camera": (
        lambda: ManipulationExplorer(sample_model(), sample_scene().camera(0), np.eye(4)),
        "inside",
    ),
    "Replay": (lambda: acp.Replay("run.rrd", iterations="some"), "iterations = 'some': give one of off, failures, all"),  # type: ignore[arg-type]
    "open_images": (lambda: acp.open_images("frames", "CAMERA.json"), r"camera is a str .*Camera.from_json"),  # type: ignore[arg-type]
}


def _started() -> acp.Tracker:
    frame, tracker = sample_scene().frame(0), acp.Tracker(sample_model())
    assert isinstance(frame, Frame)
    tracker.start(frame, sample_scene().first_pose)
    return tracker


@pytest.mark.parametrize(("call", "told"), WRONG.values(), ids=WRONG.keys())
def test_another_kind_of_object_is_one_line(call: Any, told: str) -> None:
    with pytest.raises(AcpLabError, match=told) as caught:
        call()
    assert "\n" not in str(caught.value)
