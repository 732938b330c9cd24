"""Key frames under several runs: what is off is marked, and compared with the truth."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.collections import LineCollection
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure

import acp_lab as acp
from acp_lab.display.look import GENERATED, TRUTH, WRONG
from acp_lab.display.plots.key_frames import draw_key_frames
from acp_lab.errors import SequenceError
from acp_lab.sequences.altered import AlteredSequence
from acp_lab.sequences.frame import Frame, UnreadableFrame
from acp_lab.tracking.session import TrackRun
from tests.prepared_sample import sample_model, sample_scene


@pytest.fixture(scope="module")
def run() -> TrackRun:
    scene = sample_scene()
    short = AlteredSequence(scene, frame_ids=scene.frame_ids[:3])
    return acp.Tracker(sample_model(), "acp-edges").run(short, start=scene.first_pose)


class OneArray(AlteredSequence):
    """Writes every image into the array of the first one."""

    def frames(self, max_frames: int | None = None) -> Iterator[Frame | UnreadableFrame]:
        buffer = None
        for frame in super().frames(max_frames):
            assert isinstance(frame, Frame)
            buffer = frame.image.copy() if buffer is None else buffer
            np.copyto(buffer, frame.image)
            yield replace(frame, image=buffer)


def shifted(run: TrackRun, mm: float) -> TrackRun:
    moved = []
    for result in run.results[1]:
        cam_T_obj = result.cam_T_obj.copy()
        cam_T_obj[0, 3] += mm
        moved.append(replace(result, cam_T_obj=cam_T_obj))
    return replace(run, results={1: moved})


def test_each_run_has_a_row_and_what_is_off_is_marked(run: TrackRun) -> None:
    panels = Figure().subplots(2, 2).ravel()
    off_mm = 0.3 * run.parts[1].diameter
    draw_key_frames(panels, {"near": run, "off": shifted(run, off_mm)}, sample_scene(), (0, 2))
    assert [panel.get_ylabel() for panel in panels] == ["near", "", "off", ""]
    for panel, frame_id, colours in zip(panels, (0, 2, 0, 2), [[GENERATED]] * 2 + [[TRUTH, WRONG]] * 2, strict=True):
        drawn = [item for item in panel.collections if isinstance(item, LineCollection)]
        assert [to_rgb(item.get_colors()[0]) for item in drawn] == colours
        title = panel.get_title()
        assert title.startswith(f"frame {frame_id}, ")
        percent = float(title.split()[-1].rstrip("%"))
        assert percent == pytest.approx(30.0, abs=5.0) if TRUTH in colours else percent < 2.0
        assert np.ptp(panel.get_xlim()) < panel.images[0].get_array().shape[1]


def test_a_sequence_may_give_all_its_images_in_one_array(run: TrackRun) -> None:
    scene = sample_scene()
    expected, drawn = Figure().subplots(1, 2), Figure().subplots(1, 2)
    draw_key_frames(expected, {"near": run}, scene, (0, 2))
    draw_key_frames(drawn, {"near": run}, OneArray(scene), (0, 2))
    for one, other in zip(expected, drawn, strict=True):
        np.testing.assert_array_equal(one.images[0].get_array(), other.images[0].get_array())


@pytest.mark.parametrize(
    ("frames", "object_id", "fault"), [((5,), 1, "frame 5"), ((99,), 1, "frame 99"), ((0,), 7, "object 7")]
)
def test_what_was_not_tracked_is_refused(run: TrackRun, frames: tuple[int, ...], object_id: int, fault: str) -> None:
    with pytest.raises(SequenceError, match=fault):
        draw_key_frames(Figure().subplots(1, 1, squeeze=False).ravel(), {"a": run}, sample_scene(), frames, object_id)
