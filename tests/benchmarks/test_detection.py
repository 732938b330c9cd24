"""The detection table: what counts as right, the rows that a search counts in, and `--init auto` as an outcome."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from acp_lab.geometry.arrays import FloatArray
from acp_lab.sequences.frame import Frame
from acp_lab.tracking.find import ACCEPTED, Detection
from benchmarks.detection import (
    ABSENT,
    AUTO_FRAMES,
    PRIOR_DEG,
    Search,
    _append,
    _disturbed,
    _first_accepted,
    _read,
    _row,
    _search,
)
from tests.prepared_sample import sample_model, sample_scene

SIDE = np.array([0.0, 0.0, 1.0])


class Told:
    """Stands for a finder: accepts in one frame, at a pose `off_mm` beside the truth."""

    def __init__(self, frame_id: int, off_mm: float) -> None:
        self.model, self.frame_id, self.off_mm = sample_model(), frame_id, off_mm
        self.asked: list[int] = []

    def find(self, frame: Frame, top: int, prior: Any = None) -> tuple[Detection, ...]:
        self.asked.append(frame.index)
        pose = true_pose(frame.index).copy()
        pose[0, 3] += self.off_mm
        return (Detection(pose, ACCEPTED if frame.index == self.frame_id else 0.4, SIDE),)


def true_pose(frame_id: int) -> FloatArray:
    pose = sample_scene().truth(frame_id, 1)
    assert pose is not None
    return pose


@pytest.mark.parametrize(("off_share", "expected"), [(0.02, True), (0.2, False)])
def test_the_first_accepted_pose_decides(off_share: float, expected: bool) -> None:
    finder = Told(3, off_share * sample_model().part.diameter)
    assert _first_accepted(finder, sample_scene()) is expected  # type: ignore[arg-type]
    assert finder.asked == [0, 1, 2, 3]


def test_not_found_within_the_first_frames() -> None:
    finder = Told(AUTO_FRAMES, 0.0)
    assert _first_accepted(finder, sample_scene()) is None  # type: ignore[arg-type]
    assert len(finder.asked) == AUTO_FRAMES


def test_a_search_counts_in_its_rows() -> None:
    frame, scene = sample_scene().frame(0), sample_scene()
    assert isinstance(frame, Frame)
    size, finder = f"{frame.camera.width}x{frame.camera.height}", cast("Any", Told(0, 0.0))
    search = _search(finder, scene, frame)
    assert (search.right, search.accepted) == ((True,), True)
    assert {"all", size, f"{scene.dataset.name} 1", scene.dataset.name, "tuning"} < set(search.labels)
    assert _search(finder, scene, frame, with_prior=True).labels == (f"prior, {size}",)


def test_what_was_searched_is_kept_and_read_again(tmp_path: Path) -> None:
    searches = [Search((True, False), (0.9, 0.1), 1.5, ("all", "tuning")), Search((), (), 0.0, (ABSENT,))]
    assert _read(tmp_path / "none.jsonl") == {}
    for label in ("a 1", "a 2"):
        _append(tmp_path / "found.jsonl", label, searches)
    assert _read(tmp_path / "found.jsonl") == {"a 1": searches, "a 2": searches}


def test_the_prior_is_off_as_told() -> None:
    frame = sample_scene().frame(0)
    assert isinstance(frame, Frame)
    finder: Any = SimpleNamespace(model=sample_model())
    turned = _disturbed(finder, sample_scene(), frame)[:3, :3] @ true_pose(0)[:3, :3].T
    angle_deg = np.degrees(np.arccos(0.5 * (np.trace(turned) - 1.0)))
    assert angle_deg == pytest.approx(PRIOR_DEG, abs=0.1)


def test_a_row() -> None:
    row = _row([
        Search((True, False), (0.9, 0.1), 1.0, ()), Search((False, True), (0.5, 0.2), 2.0, ()), Search((), (), 4.0, ()),
        Search((False,), (ACCEPTED,), 3.0, ()),
    ])  # fmt: skip
    assert row == {
        "frames": 4, "first": 0.25, "best of 3": 0.5, "accepted": 0.5, "right": 0.5, "time": 2.5, "most": 4.0,
    }  # fmt: skip
