"""`acp-lab demo`, the first thing that a newcomer runs."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from acp_lab.commands.demo import _spread, open_sample
from acp_lab.display.replay.file import check_replay
from acp_lab.sequences import read_results
from tests.cli_runner import assert_one_error, run


def test_shown_frames_are_spread() -> None:
    assert _spread(tuple(range(0, 80, 2)), 4) == [0, 26, 52, 78]
    assert _spread((5,), 4) == [5]
    assert _spread((5, 6), 4) == [5, 6]


def test_a_file_where_the_folder_should_be(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    (tmp_path / "out").write_text("")
    assert_one_error(run(capsys, "demo", "--out", tmp_path / "out"), "out", "folder")


@pytest.mark.slow
def test_the_demo(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    outcome = run(capsys, "demo", "--out", tmp_path)
    assert outcome.status == 0, outcome
    frames = len(open_sample().frame_ids)
    assert len(read_results(tmp_path / "results.csv")) == frames
    assert json.loads((tmp_path / "results.run.json").read_text())["complete"] is True
    assert check_replay(tmp_path / "replay.rrd").is_complete
    assert (tmp_path / "summary.png").stat().st_size > 50_000
    for words in ("@2%", "ms per frame", "640 x 512", "one thread", "results.csv", "replay.rrd", "summary.png"):
        assert words in outcome.out, words

    # A second run takes up the prepared part.
    again = run(capsys, "demo", "--out", tmp_path)
    assert again.status == 0
    assert len(read_results(tmp_path / "results.csv")) == frames
