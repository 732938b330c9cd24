"""The one home of measured numbers: docs/measured.json. Benchmarks write to it; documents and notebooks quote it.

An entry is one measurement under a key such as "acp.metal_public":

    about     what was measured, in a sentence
    unit      of the values: one for all, or one per field ("@*" for the fields "@2", "@5", "@10")
    command   how to measure it again
    data      on what
    commit    the last one that changed acp_lab; "+" behind it: with changes that were not committed
    machine   processor, cores, threads; for times this matters
    date      year-month-day
    values    numbers, lists of numbers or rows of named fields, by name

How a text quotes an entry is in `quotes`.
"""

from __future__ import annotations

import datetime
import json
import os
import subprocess
import sys
from dataclasses import asdict, dataclass, fields
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

from acp_lab.commands import machine
from acp_lab.errors import AcpLabError

ROOT = Path(__file__).resolve().parents[1]
FILE = ROOT / "docs" / "measured.json"


class MeasuredError(AcpLabError):
    """The file of measured numbers lacks something, or holds what it should not."""


@dataclass(frozen=True)
class Entry:
    """One measurement; see the module for the fields."""

    about: str
    unit: str | dict[str, str]
    command: str
    data: str
    commit: str
    machine: str
    date: str
    values: dict[str, Any]

    def unit_of(self, name: str) -> str:
        """The unit of the field called `name`."""
        if isinstance(self.unit, str):
            return self.unit
        return next((unit for pattern, unit in self.unit.items() if fnmatchcase(name, pattern)), "")


def load(path: Path = FILE) -> dict[str, Entry]:
    """All entries by key. Raises MeasuredError for a key with missing or unknown fields."""
    names = {field.name for field in fields(Entry)}
    entries = {}
    for key, stored in json.loads(path.read_text(encoding="utf-8")).items():
        if set(stored) != names:
            raise MeasuredError(f"{path.name}: {key}: fields {sorted(stored)}: give exactly {sorted(names)}")
        entries[key] = Entry(**stored)
    return entries


def save(entries: dict[str, Entry], path: Path = FILE) -> None:
    """Write all entries, sorted by key, one row of values on one line, so that changes are easy to read."""
    blocks = []
    for key in sorted(entries):
        stored = asdict(entries[key])
        values = stored.pop("values")
        lines = [f"    {_text(name)}: {_text(value)}," for name, value in stored.items()]
        rows = ",\n".join(f"      {_text(name)}: {_text(row)}" for name, row in values.items())
        blocks.append("\n".join([f"  {_text(key)}: {{", *lines, '    "values": {', rows, "    }", "  }"]))
    written = path.with_suffix(".new")
    written.write_text("{\n" + ",\n".join(blocks) + "\n}\n", encoding="utf-8")
    os.replace(written, path)


def record(
    key: str, about: str, unit: str | dict[str, str], data: str, values: dict[str, Any], path: Path = FILE
) -> None:
    """Store what the running benchmark measured; command, commit, machine and date are those of this process."""
    entries = load(path) if path.exists() else {}
    entries[key] = Entry(
        about=about,
        unit=unit,
        command=_command(),
        data=data,
        commit=_commit(),
        machine=_machine(),
        date=datetime.date.today().isoformat(),
        values=_rounded(values),
    )
    save(entries, path)
    print(f"recorded: {key} in {path.name}; then: python -m benchmarks.quotes --write", file=sys.stderr)


def rows_of(entries: dict[str, Entry], path: str) -> list[list[tuple[float, str]]]:
    """Rows of (value, unit) at "key", "key/row" or "key/row/field+field".

    Row and field may hold * and ?; several fields come in the order in which they are asked for. Raises MeasuredError
    where nothing is found.
    """
    key, _, rest = path.partition("/")
    row_pattern, _, field_patterns = rest.partition("/")
    if key not in entries:
        raise MeasuredError(f"{path}: no entry {key!r} in {FILE.name}")
    entry = entries[key]
    rows = []
    for name, row in entry.values.items():
        if not fnmatchcase(name, row_pattern or "*"):
            continue
        named = row if isinstance(row, dict) else {name: row}
        patterns = field_patterns.split("+") if field_patterns and isinstance(row, dict) else ["*"]
        for pattern in patterns:
            if not any(fnmatchcase(field, pattern) for field in named):
                raise MeasuredError(f"{path}: {name!r} of {key!r} has no field {pattern!r}")
        rows.append(
            [
                (float(value), entry.unit_of(field))
                for pattern in patterns
                for field, values in named.items()
                if fnmatchcase(field, pattern)
                for value in (values if isinstance(values, list) else [values])
            ]
        )
    if not rows:
        raise MeasuredError(f"{path}: {key!r} has no row {row_pattern!r}")
    return rows


def _text(value: Any) -> str:
    return json.dumps(value, ensure_ascii=False)


def _rounded(value: Any) -> Any:
    """Five significant digits: more than any text prints, few enough to read."""
    if isinstance(value, dict):
        return {name: _rounded(item) for name, item in value.items()}
    if isinstance(value, list | tuple):
        return [_rounded(item) for item in value]
    return value if isinstance(value, int) else float(f"{value:.5g}")


def _command() -> str:
    """The command line as it may be typed elsewhere: paths without the folders of this machine."""
    main = sys.modules["__main__"]
    name = main.__spec__.name if main.__spec__ else Path(sys.argv[0]).name
    return " ".join(["python -m", name, *(_portable(word) for word in sys.argv[1:])])


def _portable(word: str) -> str:
    """A path without the folders of this machine; within the project as seen from its root."""
    if os.sep not in word:
        return word
    path = Path(word).resolve()
    return str(path.relative_to(ROOT)) if path.is_relative_to(ROOT) else path.name


def _commit() -> str:
    """The last commit that changed the package."""

    def git(*words: str) -> str:
        return subprocess.run(["git", *words], cwd=ROOT, capture_output=True, text=True, check=True).stdout.strip()

    try:
        last = git("log", "-1", "--format=%h", "--", "acp_lab")
        return last + ("+" if git("status", "--porcelain", "acp_lab") else "")
    except (OSError, subprocess.SubprocessError):
        return "unknown"


def _machine() -> str:
    threads = os.environ.get("OMP_NUM_THREADS", "")
    used = {"": "threads not limited", "1": "one thread"}.get(threads, f"{threads} threads")
    return f"{machine.cpu_model()}, {machine.cores()} cores, {used}"
