"""Every number in README, docs and notebooks comes from where its mark says, and none that looks measured lacks a mark.

How to mark one is told at the top of `benchmarks/quotes.py`; `python -m benchmarks.quotes --write` corrects digits.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks import measured
from benchmarks.quotes import check_file, documents

ENTRIES = measured.load()


@pytest.mark.parametrize("path", documents(), ids=lambda path: str(path.relative_to(measured.ROOT)))
def test_numbers_are_those_of_their_sources(path: Path) -> None:
    problems = check_file(path, ENTRIES)
    assert not problems, "\n" + "\n".join(map(str, problems))


@pytest.mark.parametrize("key", ENTRIES)
def test_entry_says_where_its_values_come_from(key: str) -> None:
    entry = ENTRIES[key]
    for field in ("about", "unit", "command", "data", "commit", "machine", "date"):
        assert getattr(entry, field), f"{field} is empty"
    rows = measured.rows_of(ENTRIES, key)
    assert all(unit for row in rows for _, unit in row), "a field has no unit"
    assert "/tmp" not in entry.command


def test_file_is_stored_as_it_is_written(tmp_path: Path) -> None:
    copy = tmp_path / "measured.json"
    measured.save(ENTRIES, copy)
    assert copy.read_text(encoding="utf-8") == measured.FILE.read_text(encoding="utf-8"), (
        "docs/measured.json: load and save it once with benchmarks.measured"
    )
