"""Run the table of faults: `python -m tests.faults [--long] [--only WORD] [--write]`; `make faults` does.

Prints each row as it is tried. Exit status 1 when what must happen did not. --write: docs/faults.md, if all went well.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
import traceback
import warnings
from collections import defaultdict
from pathlib import Path

from acp_lab.cad.part import Part
from acp_lab.preparation import prepare
from acp_lab.prepared_part import PrepareOptions
from tests.commands.conftest import OBJECT_IDS, write_dataset
from tests.faults import frame_rows, input_rows, integrity_rows, long_rows, running_rows
from tests.faults.table import PROJECT, Row, Workplace, as_markdown, chosen, group_of

MODULES = (input_rows, integrity_rows, running_rows, frame_rows, long_rows)
"""Importing them fills the table; their order is that of the page."""
BEGIN = """# Faults: what happens when something goes wrong

Written by `make faults`, which tries every row and stops with an error when what must happen did not.
`make faults-long` tries the long ones: random moments, long runs, fuzzing. A share is in `make test`.
Each row is a small function in `tests/faults/`. What each input may hold: [inputs.md](inputs.md). What an integrator
may count on: [integration.md](integration.md).
"""


def make_source(folder: Path) -> Path:
    """The data set and the parts that every workplace is a copy of."""
    write_dataset(folder / "data")
    for object_id in OBJECT_IDS:
        part = Part.from_file(folder / "data" / "models" / f"obj_{object_id:06d}.ply")
        prepare(part, PrepareOptions(generator="templates", fast=True), out=folder / "parts")
    return folder


def tried(found: Row, source: Path) -> str:
    """Try one row in a workplace of its own; what happened."""
    with tempfile.TemporaryDirectory(prefix="fault_") as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return found.check(Workplace.made(Path(folder), source))


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--long", action="store_true", help="the long rows instead")
    parser.add_argument("--only", default="", help="rows that hold this word", metavar="WORD")
    parser.add_argument("--write", action="store_true", help="write docs/faults.md")
    wanted = parser.parse_args()
    begin, failed = time.perf_counter(), 0
    happened: dict[str, list[tuple[Row, str]]] = defaultdict(list)
    order = [group_of(module.__name__) for module in MODULES]
    rows = sorted(chosen(wanted.long, wanted.only), key=lambda found: order.index(found.group))
    with tempfile.TemporaryDirectory(prefix="faults_") as folder:
        source = make_source(Path(folder))
        for number, found in enumerate(rows, 1):
            start = time.perf_counter()
            try:
                text = tried(found, source)
                happened[found.group].append((found, text))
            except Exception as error:  # a row that fails in any way is what this table is for
                failed += 1
                frame = traceback.extract_tb(error.__traceback__)[-1]
                text = f"FAILED: {type(error).__name__} in {frame.name}:{frame.lineno}: {str(error)[:600]}"
            seconds = time.perf_counter() - start
            print(f"{number:3d}/{len(rows)} {seconds:5.1f} s  {found.cause}: {text}", flush=True)
    print(f"{len(rows) - failed} of {len(rows)} rows as they must be, {time.perf_counter() - begin:.0f} s")
    if wanted.write and not failed and not wanted.only and not wanted.long:
        (PROJECT / "docs" / "faults.md").write_text(BEGIN + as_markdown(happened), encoding="utf-8")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
