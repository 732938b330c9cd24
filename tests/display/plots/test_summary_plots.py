"""The summary picture."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from acp_lab.display.plots import summary
from acp_lab.display.plots.summary import SummaryPicture
from acp_lab.errors import InputFileError
from acp_lab.sequences.frame import Frame
from acp_lab.tracking.observer import SessionInfo, TrackedObject
from tests.display.made_run import CAMERA, box, frames, play, result


@pytest.mark.parametrize(("object_ids", "with_truth"), [((1,), True), ((1, 2), False)])
def test_the_picture_is_written(tmp_path: Path, object_ids: tuple[int, ...], with_truth: bool) -> None:
    path = tmp_path / "new" / "summary.png"
    # The frame that cannot be read is asked for too: it is left out.
    play([SummaryPicture(path, [0, 3, 4])], object_ids, with_truth)
    image = cv2.imread(str(path))
    assert image is not None
    assert min(image.shape[:2]) > 300
    # Something was drawn: not one colour only.
    assert len(np.unique(image.reshape(-1, 3), axis=0)) > 50
    assert [file.name for file in path.parent.iterdir()] == ["summary.png"]


def test_an_object_has_one_colour_in_frames_and_curves(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """That of its place among the ids, whatever order the session has."""
    shown, curves = [], []
    monkeypatch.setattr(summary, "draw_frame", lambda axes, image, results, title: shown.append(results))
    monkeypatch.setattr(summary, "draw_curves", lambda axes, objects: curves.extend(one.name for one in objects))
    play([SummaryPicture(tmp_path / "summary.png", [0])], (2, 1))
    first = next(iter(frames()))
    assert curves == ["box (obj_000001)", "box (obj_000002)"]
    quads = [result(first, object_id).control_points for object_id in (1, 2)]
    np.testing.assert_array_equal([one.control_points for one in shown[0]], quads)


def test_a_sequence_may_give_all_its_images_in_one_array(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shown = []
    monkeypatch.setattr(summary, "draw_frame", lambda axes, image, results, title: shown.append(image))
    picture = SummaryPicture(tmp_path / "summary.png", [0, 4])
    picture.on_start(SessionInfo("clip", 1, "acp", (TrackedObject(1, box()),)))
    buffer = np.zeros((CAMERA.height, CAMERA.width, 3), np.uint8)
    readable = [frame for frame in frames() if isinstance(frame, Frame)]
    for frame in readable:
        np.copyto(buffer, frame.image)
        picture.on_frame(Frame(frame.index, buffer, CAMERA), {1: result(frame, 1)})
    picture.on_end()
    np.testing.assert_array_equal(shown, [readable[0].image, readable[-1].image])


def test_a_place_that_cannot_be_written(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(InputFileError, match=r"summary\.png.*cannot be written"):
        play([SummaryPicture(tmp_path / "file" / "summary.png", [0])])
