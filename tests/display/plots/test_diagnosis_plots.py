"""`acp.explain`: words and picture hang together, and the picture shows what was measured."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

import acp_lab
from acp_lab.display.plots.diagnosis import Explanation, explain
from acp_lab.errors import InputFileError, SequenceError
from acp_lab.tracking.session import TrackRun
from acp_lab.tracking.tracker import Tracker
from tests.made_parts import bracket, looking_at
from tests.tracking.rendered import MadeSequence, draw, poses, prepared

FRAMES = 4


@pytest.fixture(scope="module")
def run() -> TrackRun:
    part = bracket()
    truth = poses(part, looking_at(part, np.array([0.8, 0.6, 1.0]), 250.0, 0.3), FRAMES)
    images = [draw([(part, pose)], seed) for seed, pose in enumerate(truth)]
    covered = images[-1].copy()
    covered[:, 90:] = (230, 150, 40)
    sequence = MadeSequence([*images[:-2], covered, None], {1: truth})
    return Tracker(prepared(part)).run(sequence, truth[0])


@pytest.fixture(scope="module")
def hidden(run: TrackRun) -> Explanation:
    return explain(run, 2)


def test_a_run_without_results_is_told_from_one_of_other_objects(run: TrackRun) -> None:
    for results in ({}, {1: ()}):
        with pytest.raises(SequenceError, match="has no results"):
            explain(replace(run, results=results), 0)
    with pytest.raises(SequenceError, match=r"object 2 was not tracked: there are \[1\]"):
        explain(replace(run, results={2: (), **run.results}), 0, 2)
    assert explain(replace(run, results={2: (), **run.results}), 0).diagnosis.object_id == 1


def pixels(png: bytes) -> np.ndarray:
    image = cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR)
    assert image is not None
    return image[..., ::-1]


def count_near(image: np.ndarray, colour: tuple[int, int, int]) -> int:
    return int((np.abs(image.astype(int) - colour).max(2) < 12).sum())


def test_it_is_one_of_the_names_of_the_package() -> None:
    assert acp_lab.explain is explain


def test_words_and_html_say_the_same(hidden: Explanation) -> None:
    assert "occlusion" in str(hidden)
    page = hidden._repr_html_()
    for finding in hidden.diagnosis.findings:
        assert str(finding.cause) in page
    assert 'src="data:image/png;base64,' in page


def test_the_picture_shows_what_is_hidden(run: TrackRun, hidden: Explanation) -> None:
    vermillion, image_half = (213, 94, 0), slice(0, 600)  # the other half marks the frame with it
    assert count_near(pixels(hidden.picture())[:, image_half], vermillion) > 100
    good = explain(run, 1)
    assert count_near(pixels(good.picture())[:, image_half], vermillion) < 20
    assert "Nothing stands out" in good._repr_html_()


def test_a_frame_without_an_image_has_a_picture_too(run: TrackRun) -> None:
    assert pixels(explain(run, 3).picture()).shape[1] > 800


def test_it_can_be_saved(hidden: Explanation, tmp_path: Path) -> None:
    path = tmp_path / "new" / "why.png"
    hidden.save(path)
    assert pixels(path.read_bytes()).shape[2] == 3
    assert [file.name for file in path.parent.iterdir()] == ["why.png"]
    (tmp_path / "file").write_text("")
    with pytest.raises(InputFileError, match=r"why\.png.*cannot be written"):
        hidden.save(tmp_path / "file" / "why.png")
