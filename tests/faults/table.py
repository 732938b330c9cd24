"""The table of faults: what may go wrong, what must happen then, and the rows that try it.

A row is one small function. It gets a `Workplace` of its own, makes the fault, asserts what must happen, and returns
in a few words what happened.

    @row("a mesh file is empty", "refused, with the file's name")
    def empty_mesh(at: Workplace) -> str:
        at.mesh.write_bytes(b"")
        return at.refused(at.prepare(), "block.ply", "empty")
"""

from __future__ import annotations

import contextlib
import io
import os
import shutil
import subprocess
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from acp_lab.cli import main
from acp_lab.sequences import read_results
from acp_lab.sequences.results_csv import ResultRow
from tests.commands.conftest import FRAME_IDS, OBJECT_IDS

PROJECT = Path(__file__).resolve().parents[2]


@dataclass(frozen=True)
class Outcome:
    """What a command did: its exit status, and what it printed."""

    status: int
    out: str
    err: str


@dataclass(frozen=True)
class Row:
    """One row of the table.

    Attributes:
        group: the heading that it stands under.
        cause, must: what goes wrong, and what must happen then.
        check: raises when that does not happen; else says what did.
        quick: part of `make test`; is_long: only of `make faults-long`.
    """

    group: str
    cause: str
    must: str
    check: Callable[[Workplace], str]
    quick: bool
    is_long: bool


ROWS: list[Row] = []


def row(
    cause: str, must: str, *, quick: bool = False, is_long: bool = False
) -> Callable[[Callable[[Workplace], str]], Callable[[Workplace], str]]:
    """Put a function into the table, under the first line of its module's text."""

    def add(check: Callable[[Workplace], str]) -> Callable[[Workplace], str]:
        ROWS.append(Row(group_of(check.__module__), cause, must, check, quick, is_long))
        return check

    return add


def group_of(module: str) -> str:
    """The heading of a module's rows: the first line of its text."""
    return (sys.modules[module].__doc__ or "").splitlines()[0].rstrip(".")


@dataclass(frozen=True)
class Workplace:
    """A folder with a data set of two drawn boxes, their prepared parts and a mesh; the row may damage all of it."""

    folder: Path

    @classmethod
    def made(cls, folder: Path, source: Path) -> Workplace:
        """A copy of `source`, which holds `data` and `parts`."""
        for name in ("data", "parts"):
            shutil.copytree(source / name, folder / name)
        shutil.copy(folder / "data" / "models" / "obj_000001.ply", folder / "block.ply")
        return cls(folder)

    @property
    def data(self) -> Path:
        return self.folder / "data"

    @property
    def scene(self) -> Path:
        return self.data / "test" / "000001"

    @property
    def parts(self) -> Path:
        return self.folder / "parts"

    @property
    def part(self) -> Path:
        """The folder of the first prepared part."""
        return self.parts / "obj_000001"

    @property
    def mesh(self) -> Path:
        """A mesh that is not prepared yet."""
        return self.folder / "block.ply"

    @property
    def out(self) -> Path:
        return self.folder / "results.csv"

    def image(self, frame_id: int) -> Path:
        return self.scene / "rgb" / f"{frame_id:06d}.png"

    def run(self, *words: str | Path) -> Outcome:
        """A command, inside this process."""
        variables = dict(os.environ)
        out, err = io.StringIO(), io.StringIO()
        try:
            with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
                status = main([str(word) for word in words])
        finally:
            os.environ.clear()
            os.environ.update(variables)
        return Outcome(status, out.getvalue(), err.getvalue())

    def prepare(self, *words: str | Path, mesh: Path | None = None) -> Outcome:
        """`acp-lab prepare` of the mesh into `new`."""
        to = ("--out", self.folder / "new", "--generator", "templates", "--regions", "0")
        return self.run("prepare", mesh or self.mesh, *to, *words)

    def track(self, *words: str | Path) -> Outcome:
        """`acp-lab track` of the data set."""
        return self.run("track", self.data, "--parts", self.parts, "--out", self.out, *words)

    def start(self, *words: str | Path, code: str = "", **variables: str) -> subprocess.Popen[str]:
        """A command in a process of its own; code: that runs before it."""
        text = f"{code}\nimport sys\nfrom acp_lab.__main__ import run\nsys.exit(run())"
        return subprocess.Popen(
            [sys.executable, "-c", text, *map(str, words)],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env={**os.environ, "PYTHONPATH": str(PROJECT), **variables},
        )

    def finish(self, process: subprocess.Popen[str], timeout_s: float = 120.0) -> Outcome:
        """Wait for a process."""
        out, err = process.communicate(timeout=timeout_s)
        return Outcome(process.returncode, out, err)

    def rows(self, path: Path | None = None) -> tuple[ResultRow, ...]:
        return read_results(path or self.out)

    def refused(self, outcome: Outcome, *words: str) -> str:
        """Assert one line `error: …`, exit status 2, nothing written over older results; the line."""
        assert outcome.status == 2, outcome
        assert outcome.err.startswith("error: "), outcome.err
        assert outcome.err.count("\n") == 1, outcome.err
        for word in words:
            assert word in outcome.err, (word, outcome.err)
        return f"refused: {self.told(outcome.err.removeprefix('error: '))}"

    def went_on(self, outcome: Outcome, *words: str) -> str:
        """Assert exit status 0, a row for every frame and object, and that stderr holds the words; its warnings."""
        assert outcome.status == 0, outcome
        assert "Traceback" not in outcome.err
        for word in words:
            assert word in outcome.err + outcome.out, (word, outcome)
        assert len(self.rows()) == len(FRAME_IDS) * len(OBJECT_IDS)
        warnings = [line for line in outcome.err.splitlines() if not line.startswith("note: generator")]
        return f"done, {self.told(warnings[0])}" if warnings else "done"

    def told(self, text: str) -> str:
        """Words as the table shows them: without this folder, on one line, not too long."""
        line = " ".join(text.replace(f"{self.folder}{os.sep}", "").replace(str(self.folder), ".").split())
        return line if len(line) <= 140 else line[:137] + "…"


def chosen(is_long: bool, word: str = "") -> tuple[Row, ...]:
    """The rows of the table, or the long ones; word: that cause, promise or the function's name hold."""
    rows = [found for found in ROWS if found.is_long == is_long]
    return tuple(
        found for found in rows if word.lower() in f"{found.cause} {found.must} {found.check.__name__}".lower()
    )


def as_markdown(happened: Mapping[str, list[tuple[Row, str]]]) -> str:
    """Tables by group: cause, what must happen, what happened."""
    lines = []
    for group, results in happened.items():
        lines += ["", f"## {group}", "", "<!-- not measured: definition -->", ""]
        lines += ["| cause | must | happened |", "|---|---|---|"]
        for found, text in results:
            cells = (found.cause, found.must, text)
            lines.append("| " + " | ".join(_cell(cell) for cell in cells) + " |")
    return "\n".join(lines) + "\n"


def _cell(text: str) -> str:
    return text.replace("|", "\\|").replace("<", "&lt;").replace("*", "\\*").replace("_", "\\_")
