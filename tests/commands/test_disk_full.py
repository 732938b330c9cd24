"""A disk that is full: one line, and everything that was written before stays. Limits of the process stand for it."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from acp_lab.display.replay.file import check_replay
from acp_lab.sequences import read_results
from tests.commands.conftest import FRAME_IDS, OBJECT_IDS

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="limits of file sizes are of POSIX")

LIMITED = """
import resource, sys
limit = int(sys.argv.pop(1))
resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))
from acp_lab.__main__ import run
sys.exit(run())
"""


def limited(most_bytes: int, *words: str | Path) -> subprocess.CompletedProcess[str]:
    """`acp-lab` in a process in which no file may grow beyond that size."""
    command = [sys.executable, "-c", LIMITED, str(most_bytes), *map(str, words)]
    return subprocess.run(command, check=False, capture_output=True, text=True, timeout=120)


def test_a_replay_that_does_not_fit_costs_no_results(dataset: Path, parts: Path, tmp_path: Path) -> None:
    out, replay = tmp_path / "results.csv", tmp_path / "run.rrd"
    done = limited(60_000, "track", dataset, "--parts", parts, "--out", out, "--replay", replay)
    assert done.returncode == 2, done
    assert done.stderr.count("\n") == 1, done.stderr
    assert done.stderr.startswith(f"error: {replay}: the replay could not be written to its end")
    assert len(read_results(out)) == len(FRAME_IDS) * len(OBJECT_IDS)
    assert json.loads(out.with_suffix(".run.json").read_text())["complete"] is True
    assert not check_replay(replay).is_complete


WRITES_ROWS = """
import resource, sys
import numpy as np
from acp_lab.errors import InputFileError
from acp_lab.sequences.results_csv import ResultRow, ResultsWriter
resource.setrlimit(resource.RLIMIT_FSIZE, (1_500, 1_500))
with ResultsWriter(sys.argv[1]) as results:
    for im_id in range(100):
        try:
            results.append(ResultRow(1, im_id, 1, 0.5, np.eye(4), 0.01))
        except InputFileError as error:
            print(im_id, error)
            break
"""


def test_results_that_do_not_fit_end_with_a_whole_row(tmp_path: Path) -> None:
    out = tmp_path / "results.csv"
    done = subprocess.run([sys.executable, "-c", WRITES_ROWS, str(out)], check=True, capture_output=True, text=True)
    count, _, message = done.stdout.partition(" ")
    assert message == f"{out}: cannot be written (File too large): choose another place\n"
    assert [row.im_id for row in read_results(out)] == list(range(int(count)))
    assert int(count) > 5


def test_a_part_that_does_not_fit_is_absent(dataset: Path, tmp_path: Path) -> None:
    mesh = dataset / "models" / "obj_000001.ply"
    done = limited(2_000, "prepare", mesh, "--out", tmp_path / "new", "--generator", "templates")
    assert done.returncode == 2, done
    assert done.stderr.count("\n") == 1, done.stderr
    assert "cannot be written" in done.stderr
    assert not (tmp_path / "new" / "obj_000001" / "part.json").exists()
    assert not list((tmp_path / "new").glob("**/*.tmp"))
