"""Random moments, long runs, large meshes."""

from __future__ import annotations

import random
import signal
import time
from collections import Counter

import numpy as np
import trimesh

from acp_lab.prepared_part import PreparedPart
from acp_lab.sequences.results_csv import rows_with_ends
from tests.commands.conftest import FRAME_IDS, OBJECT_IDS
from tests.faults.table import Outcome, Workplace, row

MOMENTS = 50
FRAMES = 20_000
SETTLED = 500
"""Frames after which memory and time must stay; a replay sends more and more frames together until twice as many."""
ALL_ROWS = len(FRAME_IDS) * len(OBJECT_IDS)
PACED = """
import time
from acp_lab.sequences.bop import BopScene
really = BopScene.frame
def frame(self, frame_id):
    time.sleep(0.1)
    return really(self, frame_id)
BopScene.frame = frame
"""
LONG_RUN = """
import sys, time
from dataclasses import replace
import numpy as np
from acp_lab.display.replay.recorder import Replay
from acp_lab.tracking.results_file import ResultsFile
from acp_lab.tracking.session import follow_sequence
from acp_lab.tracking.tracker import Tracker
from tests.prepared_sample import sample_model, sample_scene

count, results = int(sys.argv[1]), sys.argv[2]
frames = list(sample_scene().frames())

class There:
    name, scene_id, frame_ids, object_ids = "there and back", 1, tuple(range(count)), (1,)
    def truth(self, frame_id, object_id):
        return None
    def frames(self, most=None):
        period = 2 * len(frames) - 2
        for index in range(count):
            at = index % period
            yield replace(frames[min(at, period - at)], index=index)

class Gauge:
    def on_start(self, session):
        self.before_s = time.process_time()
    def on_frame(self, frame, found):
        if frame.index % 500 == 499:
            now_s = time.process_time()
            pages = int(open("/proc/self/statm").read().split()[1])
            print(frame.index + 1, pages * 4096 / 1e6, now_s - self.before_s, found[1].state, flush=True)
            self.before_s = now_s
    def on_end(self):
        pass

listening = [ResultsFile(results), Gauge()] + [Replay(path) for path in sys.argv[3:]]
follow_sequence({1: Tracker(sample_model())}, There(), {1: sample_scene().first_pose}, listening)
"""


def whole_command_s(at: Workplace, code: str, words: tuple[object, ...]) -> float:
    """How long a command takes that nobody disturbs."""
    begin = time.monotonic()
    assert at.finish(at.start(*words, code=code)).status == 0  # type: ignore[arg-type]
    return time.monotonic() - begin


def stopped_at(at: Workplace, code: str, words: tuple[object, ...], moment_s: float, how: signal.Signals) -> Outcome:
    """A command that gets a signal at a moment."""
    process = at.start(*words, code=code)  # type: ignore[arg-type]
    time.sleep(moment_s)
    process.send_signal(how)
    return at.finish(process)


@row(
    f"`prepare` is killed (kill -9) at {MOMENTS} random moments",
    "each time whole or absent; run again, it is whole",
    is_long=True,
)
def killed_prepares(at: Workplace) -> str:
    rng, folder = random.Random(1), at.folder / "new" / "block"
    words = ("prepare", at.mesh, "--out", at.folder / "new", "--generator", "templates", "--no-resume")
    whole_s = whole_command_s(at, "", words)
    states: Counter[str] = Counter()
    for _ in range(MOMENTS):
        # Rather late than early: the first two thirds are imports.
        stopped_at(at, "", words, whole_s * rng.uniform(0.3, 1.1), signal.SIGKILL)
        if (folder / "part.json").exists():
            PreparedPart.load(folder)
            states["whole"] += 1
        else:
            states["absent"] += 1
        assert at.prepare().status == 0
        assert PreparedPart.load(folder).generator_names == ("templates",)
        assert not list(folder.glob(".*"))
    assert [path.name for path in folder.parent.iterdir()] == ["block"]
    assert sum(states.values()) == MOMENTS
    return "each time whole or absent, then whole"


@row(
    f"`track` is killed (kill -9) at {MOMENTS} random moments",
    "each time the rows are whole, and `--resume` completes them",
    is_long=True,
)
def killed_runs(at: Workplace) -> str:
    rng = random.Random(2)
    words = ("track", at.data, "--parts", at.parts, "--out", at.out)
    whole_s = whole_command_s(at, PACED, words)
    for _ in range(MOMENTS):
        for path in at.folder.glob("results.*"):
            path.unlink()
        stopped_at(at, PACED, words, whole_s * rng.uniform(0.3, 1.05), signal.SIGKILL)
        if at.out.exists() and at.out.stat().st_size:
            rows_with_ends(at.out)
        outcome = at.track("--resume")
        assert outcome.status == 0, outcome
        assert len(at.rows()) == ALL_ROWS
        assert not list(at.folder.glob(".*"))
    return "each time completed"


@row(
    f"Ctrl-C at {MOMENTS} random moments of `track`", "exit status 130 and one line, or the run was over", is_long=True
)
def keys(at: Workplace) -> str:
    rng = random.Random(3)
    words = ("track", at.data, "--parts", at.parts, "--out", at.out, "--replay", at.folder / "run.rrd")
    code = PACED + "from acp_lab.commands import interrupt\ninterrupt.listen()\nprint('up', flush=True)\n"
    whole_s = whole_command_s(at, code, words)
    for _ in range(MOMENTS):
        process = at.start(*words, code=code)
        assert process.stdout is not None
        assert process.stdout.readline() == "up\n"  # before that Python itself is still starting
        time.sleep(whole_s * rng.uniform(0.0, 1.0))
        process.send_signal(signal.SIGINT)
        outcome = at.finish(process)
        assert outcome.status in (0, 130), outcome
        if outcome.status == 130:
            assert outcome.err == "note: interrupted\n", outcome
    return "each time"


def gauged(at: Workplace, *replays: object) -> tuple[np.ndarray, np.ndarray]:
    """MB and CPU seconds of each 500 frames of a long run."""
    words = (str(FRAMES), at.folder / "long.csv", *replays)
    process = at.start(*words, code=f"{LONG_RUN}\nsys.exit()")  # type: ignore[arg-type]
    outcome = at.finish(process, timeout_s=3600.0)
    assert outcome.status == 0, outcome.err[-2000:]
    lines = [line.split() for line in outcome.out.splitlines()]
    assert len(lines) == FRAMES // 500
    assert {line[3] for line in lines} == {"tracking"}
    assert len(at.rows(at.folder / "long.csv")) == FRAMES
    return np.array([float(line[1]) for line in lines]), np.array([float(line[2]) for line in lines])


@row(
    f"{FRAMES} frames",
    f"memory within 5% of that after {SETTLED} frames, time per frame as in the beginning",
    is_long=True,
)
def long_run(at: Workplace) -> str:
    memory_mb, cpu_s = gauged(at)
    assert memory_mb.max() < 1.05 * memory_mb[0], memory_mb
    assert np.median(cpu_s[-8:]) < 1.25 * np.median(cpu_s[:8]), cpu_s  # clocks of a shared machine
    return "memory within 5%, time flat"


@row(f"{FRAMES} frames with a replay", f"memory within a tenth of that after {2 * SETTLED} frames", is_long=True)
def long_replay(at: Workplace) -> str:
    memory_mb, _ = gauged(at, at.folder / "long.rrd")
    assert memory_mb[1:].max() < 1.1 * memory_mb[1], memory_mb
    return "memory within a tenth"


@row("a million loose triangles", "prepared, in less than a gigabyte", is_long=True)
def million_triangles(at: Workplace) -> str:
    rng = np.random.default_rng(0)
    corners = rng.uniform(-50.0, 50.0, (1_000_000, 1, 3)) + rng.uniform(-1.0, 1.0, (1_000_000, 3, 3))
    mesh = at.folder / "heap.ply"
    faces = np.arange(3_000_000).reshape(-1, 3)
    trimesh.Trimesh(corners.reshape(-1, 3), faces, process=False).export(mesh)
    return prepared_within(at, mesh, 1000.0)


@row("20,480 rough faces", "prepared, in less than half a gigabyte", is_long=True)
def rough_ball(at: Workplace) -> str:
    ball = trimesh.creation.icosphere(subdivisions=5, radius=50.0)
    rough = 1.0 + 0.05 * np.random.default_rng(0).standard_normal((len(ball.vertices), 1))
    mesh = at.folder / "rough.ply"
    trimesh.Trimesh(ball.vertices * rough, ball.faces, process=False).export(mesh)
    return prepared_within(at, mesh, 500.0)


def prepared_within(at: Workplace, mesh: object, most_mb: float) -> str:
    """Prepare a mesh in a process of its own, and assert how much memory that took."""
    code = (
        "import atexit, resource, sys\n"
        "atexit.register(lambda: print('MB', resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3))\n"
    )
    words = ("prepare", mesh, "--out", at.folder / "new", "--generator", "templates")
    outcome = at.finish(at.start(*words, code=code), timeout_s=900.0)  # type: ignore[arg-type]
    assert outcome.status == 0, outcome
    assert "are taken" in outcome.err
    peak_mb = float(outcome.out.split("MB")[-1])
    assert peak_mb < most_mb, peak_mb
    return "prepared, with a note"
