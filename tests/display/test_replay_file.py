"""Replays that were killed, torn or are something else; and two replays as one."""

from __future__ import annotations

import dataclasses
import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from acp_lab.display.replay.file import check_replay, merge_replays, read_replay, readable
from acp_lab.display.replay.recorder import Replay
from acp_lab.errors import InputFileError
from tests.display.made_run import FRAME_IDS, play, recorded
from tests.display.recording import Recording

KILLED = """
import os, signal, sys
from pathlib import Path
from acp_lab.display.replay.recorder import Replay
from tests.display.made_run import play
replay = Replay(Path(sys.argv[1]), sessions=2)
play([replay])
replay._recording.flush()
os.kill(os.getpid(), signal.SIGKILL)
"""


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("replay") / "run.rrd"
    play([Replay(path)], results=recorded)
    return path


def test_a_whole_file(path: Path) -> None:
    replay = check_replay(path)
    assert replay.is_complete
    with readable(replay) as same:
        assert same == path
    content = read_replay(replay)
    assert content.loss == ""
    assert content.last_frame == len(FRAME_IDS) - 1
    assert content.announced == (len(FRAME_IDS),)
    assert content.scenes == ("made/test/000001",)
    assert content.objects == ("obj_000001",)
    np.testing.assert_allclose(content.spot.centre, [1.0, 10.0, 200.0])


def test_only_a_replay_is_replaced(path: Path, tmp_path: Path) -> None:
    Replay(path)
    pose = tmp_path / "POSE.json"
    pose.write_text("{}")
    with pytest.raises(InputFileError, match=r"POSE\.json: the replay would replace a file that is not a replay"):
        Replay(pose)
    assert pose.read_text() == "{}"


def test_a_name_that_is_no_utf_8_is_written_as_far_as_it_goes(tmp_path: Path) -> None:
    replay = Replay(tmp_path / "run.rrd")
    start = replay.on_start
    replay.on_start = lambda session: start(dataclasses.replace(session, name="d\udcff/test/000001"))  # type: ignore[method-assign]
    play([replay])
    assert read_replay(check_replay(tmp_path / "run.rrd")).scenes == ("d?/test/000001",)


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="this system has no SIGKILL")
def test_a_killed_run_leaves_what_it_had(tmp_path: Path) -> None:
    path = tmp_path / "killed.rrd"
    command = [sys.executable, "-c", KILLED, str(path)]
    done = subprocess.run(command, check=False, capture_output=True, env={**os.environ, "PYTHONPATH": os.getcwd()})
    assert done.returncode == -signal.SIGKILL, done.stderr
    replay = check_replay(path)
    assert not replay.is_complete
    content = read_replay(replay)
    assert content.last_frame == len(FRAME_IDS) - 1
    assert "/camera/image" in Recording(content.chunks).entities
    assert "killed.rrd: the run did not close this replay" in content.loss
    assert f"all {len(FRAME_IDS)} frames can be seen" in content.loss


@pytest.mark.parametrize("share", [0.8, 0.95, 1.2])
def test_a_torn_tail_is_left_out(path: Path, tmp_path: Path, share: float) -> None:
    """Of the messages, or of the index that closes the file."""
    torn = tmp_path / "torn.rrd"
    whole = path.read_bytes()
    torn.write_bytes(whole[: int(share * check_replay(path).whole_bytes)])
    replay = check_replay(torn)
    assert not replay.is_complete
    assert 0 < replay.whole_bytes <= torn.stat().st_size
    before = torn.read_bytes()
    content = read_replay(replay)
    assert content.chunks
    assert "can be seen" in content.loss
    with readable(replay) as cut:
        assert cut != torn
        assert cut.stat().st_size == replay.whole_bytes
    assert not cut.exists()
    assert torn.read_bytes() == before


def test_what_is_no_replay(path: Path, tmp_path: Path) -> None:
    cases = {
        "none.rrd": (None, "no such replay"),
        "empty.rrd": (b"", "is empty"),
        "other.rrd": (b"hello world", "is no replay"),
        "old.rrd": (b"RRF1" + bytes(40), "rerun rrd migrate"),
        "short.rrd": (path.read_bytes()[:20], "cut off"),
    }
    for name, (content, message) in cases.items():
        if content is not None:
            (tmp_path / name).write_bytes(content)
        with pytest.raises(InputFileError, match=rf"{name}.*{message}"):
            check_replay(tmp_path / name)
    with pytest.raises(InputFileError, match="cannot be read"):
        check_replay(tmp_path)


def test_a_file_damaged_inside(path: Path, tmp_path: Path) -> None:
    damaged = tmp_path / "damaged.rrd"
    whole = bytearray(path.read_bytes())
    middle = len(whole) // 2
    whole[middle : middle + 2000] = bytes(2000)
    damaged.write_bytes(bytes(whole))
    with pytest.raises(InputFileError, match=r"damaged\.rrd") as error:
        read_replay(check_replay(damaged))
    assert "\n" not in str(error.value)


def test_a_recording_of_another_program(tmp_path: Path) -> None:
    import rerun as rr

    stream = rr.RecordingStream("other")
    stream.save(tmp_path / "other.rrd")
    stream.log("a", rr.Scalars(1.0))
    stream.flush()
    stream.disconnect()
    with pytest.raises(InputFileError, match="was not written by acp_lab"):
        read_replay(check_replay(tmp_path / "other.rrd"))


def test_two_replays_as_one(path: Path, tmp_path: Path) -> None:
    other = tmp_path / "other.rrd"
    play([Replay(other)], with_truth=False)
    both = tmp_path / "both.rrd"
    merge_replays({"a": read_replay(check_replay(path)), "b": read_replay(check_replay(other))}, both)
    command = [sys.executable, "-m", "rerun", "rrd", "verify", str(both)]
    assert subprocess.run(command, capture_output=True, check=False).returncode == 0
    recording, single = Recording.read(both), Recording.read(path)
    quality = "curves/quality/obj_000001"
    for root in "ab":
        rows = recording.on_frames(f"/{root}/{quality}", "scalars")
        assert [row.frame for row in rows] == list(range(len(FRAME_IDS)))
    before = single.on_frames(f"/{quality}", "scalars")
    assert [row.value for row in recording.on_frames(f"/a/{quality}", "scalars")] == [row.value for row in before]
    assert "/a/truth/obj_000001" in recording.entities
    assert "/b/truth/obj_000001" not in recording.entities
    # Their curves can be told apart.
    colours = [recording.of(f"/{root}/{quality}", "colors")[-1].value for root in "ab"]
    assert colours[0] != colours[1]
    assert [recording.of(f"/{root}/{quality}", "names")[-1].value for root in "ab"] == [["A"], ["B"]]
