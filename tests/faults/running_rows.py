"""Runs that are stopped, starved or killed."""

from __future__ import annotations

import json
import re
import signal
import time

from acp_lab.display.replay.file import check_replay
from acp_lab.prepared_part import PreparedPart
from tests.commands.conftest import FRAME_IDS, OBJECT_IDS
from tests.faults.table import Workplace, row

ALL_ROWS = len(FRAME_IDS) * len(OBJECT_IDS)
SLOW_FRAMES = """
import time
from acp_lab.sequences.bop import BopScene
really = BopScene.frame
def frame(self, frame_id):
    time.sleep(0.3)
    return really(self, frame_id)
BopScene.frame = frame
"""


def no_file_beyond(most_bytes: int) -> str:
    """Code: the disk is full for every file of that size."""
    return f"import resource\nresource.setrlimit(resource.RLIMIT_FSIZE, ({most_bytes}, {most_bytes}))"


def pressed_at(module: str) -> str:
    """Code: Ctrl-C while a module is imported."""
    return f"""
import signal, sys
class Press:
    def find_spec(self, name, path=None, target=None):
        if name == {module!r}:
            sys.meta_path.remove(self)
            signal.raise_signal(signal.SIGINT)
sys.meta_path.insert(0, Press())
"""


@row("the disk is full while a replay is written", "one error line after the run; the results are whole", quick=True)
def full_replay(at: Workplace) -> str:
    words = ("track", at.data, "--parts", at.parts, "--out", at.out, "--replay", at.folder / "run.rrd")
    said = at.refused(at.finish(at.start(*words, code=no_file_beyond(60_000))), "run.rrd", "room on the disk")
    assert len(at.rows()) == ALL_ROWS
    assert not check_replay(at.folder / "run.rrd").is_complete
    return re.sub(r" \(.*?\)", "", said)  # rerun's words for it differ from time to time


@row("the disk is full while a part is prepared", "one error line, no part, no leftovers")
def full_part(at: Workplace) -> str:
    words = ("prepare", at.mesh, "--out", at.folder / "new", "--generator", "templates")
    said = at.refused(at.finish(at.start(*words, code=no_file_beyond(2_000))), "cannot be written")
    assert not (at.folder / "new" / "block" / "part.json").exists()
    assert not list((at.folder / "new").rglob("*.tmp"))
    return said


@row("the disk is full when results are written", "one error line, no half row")
def full_results(at: Workplace) -> str:
    words = ("track", at.data, "--parts", at.parts, "--out", at.out)
    said = at.refused(at.finish(at.start(*words, code=no_file_beyond(1_000))), "cannot be written")
    assert not at.out.exists() or at.out.read_bytes().endswith(b"\n")
    return said


def interrupted(at: Workplace, code: str) -> str:
    words = ("track", at.data, "--parts", at.parts, "--out", at.out, "--replay", at.folder / "run.rrd")
    outcome = at.finish(at.start(*words, code=code))
    assert (outcome.status, outcome.err) == (130, "note: interrupted\n"), outcome
    return "exit status 130, note: interrupted"


@row("Ctrl-C while the command line is imported", "exit status 130, one line")
def key_at_start(at: Workplace) -> str:
    return interrupted(at, pressed_at("typer"))


@row("Ctrl-C while NumPy is imported", "exit status 130, one line", quick=True)
def key_in_numpy(at: Workplace) -> str:
    return interrupted(at, pressed_at("numpy"))


@row("Ctrl-C while OpenCV is imported", "exit status 130, one line")
def key_in_cv2(at: Workplace) -> str:
    return interrupted(at, pressed_at("cv2"))


@row("Ctrl-C while rerun is imported", "exit status 130, one line")
def key_in_rerun(at: Workplace) -> str:
    return interrupted(at, pressed_at("rerun"))


def started_slowly(at: Workplace, rows: int):  # type: ignore[no-untyped-def]
    """A slow run that has written at least so many rows."""
    words = ("track", at.data, "--parts", at.parts, "--out", at.out, "--replay", at.folder / "run.rrd")
    process = at.start(*words, code=SLOW_FRAMES)
    begin = time.monotonic()
    while not (at.out.exists() and at.out.read_bytes().count(b"\n") > rows):
        assert time.monotonic() < begin + 60.0
        assert process.poll() is None
        time.sleep(0.01)
    return process


@row("Ctrl-C while frames are tracked", "exit status 130, one line, the rows are kept, the replay is complete")
def key_while_tracking(at: Workplace) -> str:
    process = started_slowly(at, 4)
    process.send_signal(signal.SIGINT)
    outcome = at.finish(process)
    assert (outcome.status, outcome.err) == (130, "note: interrupted\n"), outcome
    rows = at.rows()
    assert 0 < len(rows) < ALL_ROWS
    assert json.loads(at.out.with_suffix(".run.json").read_text())["complete"] is False
    assert check_replay(at.folder / "run.rrd").is_complete
    return "exit status 130, rows kept, replay complete"


@row("a run is killed (kill -9), then `--resume`", "the rows are whole, the rest is tracked")
def killed_run(at: Workplace) -> str:
    process = started_slowly(at, 4)
    process.kill()
    process.communicate()
    assert at.out.read_bytes().count(b"\n") < 1 + ALL_ROWS
    (at.folder / "run.rrd").rename(at.folder / "first.rrd")
    said = at.went_on(at.track("--resume"), "goes on behind")
    assert [path.name for path in at.folder.glob(".*")] in ([], [".run.rrd.lock"])  # of the replay, which blocks nobody
    return said


@row("a run is killed (kill -9) while it writes a replay", "`acp-lab replay` opens what there is")
def killed_replay(at: Workplace) -> str:
    process = started_slowly(at, 6)
    process.kill()
    process.communicate()
    replay = check_replay(at.folder / "run.rrd")
    assert not replay.is_complete
    return "opened, and said to be incomplete"


@row("`prepare` is killed (kill -9), then run again", "each stage whole or absent; the second run completes it")
def killed_prepare(at: Workplace) -> str:
    words = ("prepare", at.mesh, "--out", at.folder / "new", "--generator", "templates")
    process = at.start(*words)
    folder, begin = at.folder / "new" / "block", time.monotonic()
    while not list(folder.glob("*")):
        assert time.monotonic() < begin + 60.0
        assert process.poll() is None
        time.sleep(0.001)
    process.kill()
    process.communicate()
    if (folder / "part.json").exists():
        PreparedPart.load(folder)
    assert at.prepare().status == 0
    assert PreparedPart.load(folder).generator_names == ("templates",)
    assert not list(folder.glob(".*"))
    assert [path.name for path in folder.parent.iterdir()] == ["block"]
    return "completed"


@row("a replay that must stay below N MB", "images are dropped before data; the file and the summary say so")
def small_replay(at: Workplace) -> str:
    from tests.display.test_replay_budget import record

    replay = record(at.folder / "small.rrd", 2.0)
    assert (at.folder / "small.rrd").stat().st_size < 2e6
    assert replay.lacks.startswith("has no images")
    return "smaller than that, without the last images"
