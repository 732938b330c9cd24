"""The quick rows of the table of faults; `make faults` tries all of them."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from tests.faults.__main__ import make_source
from tests.faults.table import PROJECT, ROWS, Row, Workplace

pytestmark = pytest.mark.skipif(os.name == "nt", reason="pipes in folders, limits of files and kill -9 are of POSIX")

QUICK = [found for found in ROWS if found.quick]


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_source(tmp_path_factory.mktemp("faults"))


@pytest.mark.parametrize("found", QUICK, ids=lambda found: found.check.__name__)
def test_what_must_happen_does(found: Row, source: Path, tmp_path: Path) -> None:
    assert found.check(Workplace.made(tmp_path, source))


def test_the_page_has_every_row_of_the_table() -> None:
    page = (PROJECT / "docs" / "faults.md").read_text(encoding="utf-8")
    rows = [found for found in ROWS if not found.is_long]
    assert len(rows) >= 60
    assert page.count("\n| ") == len(rows) + page.count("\n| cause |")
    assert "FAILED" not in page


def test_functions_of_rows_have_names_of_their_own() -> None:
    names = [found.check.__name__ for found in ROWS]
    assert len(set(names)) == len(names)
