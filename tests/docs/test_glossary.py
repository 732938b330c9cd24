"""The glossary sends to notebooks that speak of the term, and to modules that are there."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
ROW = re.compile(r"^\| \*\*(?P<bold>[^*]+)\*\*(?P<beside>[^|]*)\|.*\| (?P<where>[^|]+) \|$")
NOTEBOOKS = {path.name[:2]: path for path in sorted((ROOT / "notebooks").glob("[0-9][0-9]_*.ipynb"))}


def rows() -> list[tuple[str, str]]:
    lines = (ROOT / "docs" / "glossary.md").read_text(encoding="utf-8").splitlines()
    return [(found["bold"] + found["beside"], found["where"]) for found in map(ROW.match, lines) if found]


def words_of(notebook: str) -> str:
    cells = json.loads(NOTEBOOKS[notebook].read_text(encoding="utf-8"))["cells"]
    return " ".join("".join(cell["source"]) for cell in cells).lower()


@pytest.mark.parametrize(("term", "where"), rows(), ids=[term for term, _ in rows()])
def test_a_term_is_where_the_glossary_says(term: str, where: str) -> None:
    # The first letters of any of its words will do: "back-facing" is explained by faces that face away.
    stems = [word[:5].lower() for word in re.findall(r"[A-Za-z0-9_@]+", term)]
    for place in where.split(", "):
        link = re.fullmatch(r"\[[^]]+\]\(([^)#]+)(?:#[^)]*)?\)", place)
        if link is None:
            assert any(stem in words_of(place) for stem in stems), f"{place} does not speak of {term}"
        else:
            assert (ROOT / "docs" / link[1]).is_file()


def test_the_whole_glossary_is_read() -> None:
    assert len(rows()) > 60
