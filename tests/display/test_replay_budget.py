"""A replay that must stay small drops images first, then data, and says so in the file."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from acp_lab.display.replay.budget import SizeBudget
from acp_lab.display.replay.columns import frames_together
from acp_lab.display.replay.file import check_replay, read_replay
from acp_lab.display.replay.recorder import Replay
from acp_lab.errors import InputFileError
from acp_lab.sequences.frame import Frame
from acp_lab.tracking.observer import SessionInfo, TrackedObject
from tests.display.made_run import CAMERA, result
from tests.display.recording import Recording
from tests.made_parts import box

KB = 1000.0


def ends(most_kb: float, image_kb: float, data_kb: float, frames: int, known: bool = True) -> tuple[int | None, ...]:
    """When images and data end, in a run of that many frames that are sent one by one."""
    budget = SizeBudget(KB * most_kb)
    images_kb = 0.0
    for frame in range(1, frames + 1):
        images_kb += image_kb if budget.images_end is None else 0.0
        left = frames - frame if known else None
        budget.spend(frame, frame, KB * (50.0 + data_kb * frame), KB * images_kb, left)
        if budget.data_end is not None:
            break
    return budget.images_end, budget.data_end


def test_what_fits_is_kept() -> None:
    assert ends(10_000.0, image_kb=10.0, data_kb=5.0, frames=500) == (None, None)
    assert SizeBudget(1e6).told == ""


def test_images_go_first_and_leave_room_for_all_data() -> None:
    images_end, data_end = ends(5_000.0, image_kb=10.0, data_kb=5.0, frames=600)
    assert data_end is None
    assert images_end is not None
    # 95% of 5 MB, less the data of 600 frames and a tenth of those to come, are images.
    to_come = 600 - images_end
    assert images_end == pytest.approx((0.95 * 5_000.0 - 50.0 - (600 + 0.1 * to_come) * 5.0) / 10.0, abs=4)


def test_data_end_where_they_alone_are_too_much() -> None:
    images_end, data_end = ends(1_000.0, image_kb=10.0, data_kb=5.0, frames=600)
    assert images_end is not None
    assert images_end <= 2
    assert data_end is not None
    assert 50.0 + 5.0 * (data_end + frames_together(data_end)) <= 1_000.0


def test_large_images_neither_pass_the_limit_nor_take_the_room_of_data() -> None:
    """Of 1500 kB each in a file of 5 MB; data are sent ten frames together, and known from then on."""
    budget, images, sent_kb = SizeBudget(5e6), 0, 50.0
    for frame in range(1, 31):
        images += budget.images_end is None
        sent = frame // 10 * 10
        sent_kb = 50.0 + 60.0 * sent
        budget.spend(frame, sent, KB * sent_kb, KB * 1500.0 * images, 30 - frame)
        assert sent_kb + 1500.0 * images < 5_000.0
    assert images == budget.images_end == 1
    assert budget.data_end is None


def test_half_the_room_where_nobody_knows_how_many_come() -> None:
    images_end, data_end = ends(3_000.0, image_kb=10.0, data_kb=5.0, frames=10_000, known=False)
    assert images_end is not None
    assert (10.0 + 5.0) * images_end == pytest.approx(1_300.0, rel=0.1)
    assert data_end is not None
    assert data_end > images_end


def test_longer_runs_send_more_together() -> None:
    together = [frames_together(frames) for frames in range(0, 20_000, 7)]
    assert together[0] == 10
    assert together == sorted(together)
    assert together[-1] == 100


def record(path: Path, most_mb: float, count: int = 300) -> Replay:
    """A session of noisy frames, some 16 kB each as JPEG."""
    rng = np.random.default_rng(3)
    replay = Replay(path, most_mb=most_mb)
    replay.on_start(SessionInfo("made", 1, "acp", (TrackedObject(1, box()),), frame_count=count))
    for index in range(count):
        image = rng.integers(0, 256, (CAMERA.height, CAMERA.width, 3), np.uint8)
        frame = Frame(index, image, CAMERA)
        replay.on_frame(frame, {1: replace(result(frame, 1), frame_id=index)})
    replay.on_end()
    return replay


def test_the_file_stays_below_the_limit_and_says_what_it_lacks(tmp_path: Path) -> None:
    whole = record(tmp_path / "whole.rrd", float("inf"))
    size_mb = (tmp_path / "whole.rrd").stat().st_size / 1e6
    assert whole.lacks == ""
    most_mb = 0.75 * size_mb
    path = tmp_path / "small.rrd"
    replay = record(path, most_mb)
    assert path.stat().st_size < 1e6 * most_mb
    assert replay.lacks.startswith("has no images from frame ")
    first_without = int(replay.lacks.split()[5])
    made = Recording.read(path)
    assert len(made.on_frames("/camera/image", "blob")) == first_without
    assert len(made.on_frames("/curves/quality/obj_000001", "scalars")) == 300
    assert [row.value[0] for row in made.of("/notes", "text")] == [f"The replay {replay.lacks}."]
    assert read_replay(check_replay(path)).last_frame == 299


def test_two_replays_into_one_file(tmp_path: Path) -> None:
    path = tmp_path / "run.rrd"
    first, second = Replay(path), Replay(path)
    frame = Frame(0, np.zeros((CAMERA.height, CAMERA.width, 3), np.uint8), CAMERA)
    session = SessionInfo("made", 1, "acp", (TrackedObject(1, box()),))
    first.on_start(session)
    first.on_frame(frame, {1: result(frame, 1)})
    second.on_start(session)
    with pytest.raises(InputFileError, match=r"run\.rrd: another acp-lab is writing the replay"):
        second.on_frame(frame, {1: result(frame, 1)})
    second.on_end()
    first.on_end()
    assert check_replay(path).is_complete
    assert [entry.name for entry in tmp_path.iterdir()] == ["run.rrd"]
