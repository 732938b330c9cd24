"""Files, modules and names that README, docs and notebooks mention exist."""

from __future__ import annotations

import importlib
import re
from collections.abc import Iterator
from pathlib import Path

import nbformat
import pytest

ROOT = Path(__file__).resolve().parents[2]
FOLDERS = (".", "docs", "benchmarks", "binder", "data_recipes", "notebooks")
PAGES = [
    *(path for folder in FOLDERS for path in sorted((ROOT / folder).glob("*.md"))),
    *(path for path in (ROOT / "notebooks").rglob("[0-9][0-9]_*.ipynb") if ".ipynb_checkpoints" not in path.parts),
]

CODE = re.compile(r"^```.*?^```|`[^`\n]+`", re.MULTILINE | re.DOTALL)
LINK = re.compile(r"\]\(([^)\s#]+)[^)]*\)")
FILE = re.compile(r"(?<![\w./-])((?:[\w.-]+/)+[\w-]+\.(?:py|md|ipynb|json|toml))\b")
FOLDER = re.compile(r"(?<![\w./-])((?:acp_lab|benchmarks|data_recipes|docs|notebooks|tests)(?:/[\w-]+)*)/(?![\w.-])")
DOTTED = re.compile(r"(?<![\w./-])((?:acp|acp_lab|benchmarks|data_recipes|tests)(?:\.[A-Za-z_]\w*)+)(?!\w|/)")
MODULE = re.compile(r"python -m ((?:acp_lab|benchmarks|data_recipes|tests)[.\w]*)")


def text_of(path: Path) -> str:
    if path.suffix == ".md":
        return path.read_text(encoding="utf-8")
    notebook = nbformat.read(path, as_version=4)
    return "\n\n".join(cell.source for cell in notebook.cells if cell.cell_type == "markdown")


def code_of(path: Path) -> str:
    return "\n".join(CODE.findall(text_of(path)))


def missing_files(path: Path) -> Iterator[str]:
    for link in LINK.findall(CODE.sub("", text_of(path))):
        if not OUTSIDE.match(link) and not (path.parent / link).exists():
            yield f"link {link}"
    code = code_of(path)
    for name in {*FILE.findall(code), *FOLDER.findall(code)}:
        bases = (ROOT, ROOT / "acp_lab", path.parent)
        if not MADE_UP.match(name) and not any((base / name).exists() for base in bases):
            yield name


OUTSIDE = re.compile(r"\w+://|\.\./\.\./actions/")
"""Links to elsewhere: addresses, and the page of the repository's checks, which is relative on its host."""

MADE_UP = re.compile(r"(dataset|path|parts|out|course_files|bench|models|test|lab/tree|acp_lab/course/lesson_NN)\b")
"""How paths in examples begin: the reader's own files, addresses, patterns."""


def resolves(dotted: str) -> bool:
    """Whether a dotted name can be imported; "acp" is the package's face."""
    words = ["acp_lab" if word == "acp" else word for word in dotted.split(".")]
    for count in range(len(words), 0, -1):
        try:
            found = importlib.import_module(".".join(words[:count]))
        except ModuleNotFoundError:
            continue
        for word in words[count:]:
            if word in getattr(found, "__dataclass_fields__", {}):
                return True
            if not hasattr(found, word):
                return False
            found = getattr(found, word)
        return True
    return False


@pytest.mark.parametrize("path", PAGES, ids=lambda path: str(path.relative_to(ROOT)))
def test_files_exist(path: Path) -> None:
    assert not sorted(missing_files(path))


@pytest.mark.parametrize("path", PAGES, ids=lambda path: str(path.relative_to(ROOT)))
def test_names_can_be_imported(path: Path) -> None:
    code = code_of(path)
    names = {*DOTTED.findall(code), *MODULE.findall(code)}
    assert not sorted(name for name in names if not name.endswith((".py", ".md")) and not resolves(name.rstrip(".")))


def test_a_name_that_is_gone_is_seen() -> None:
    assert resolves("acp.Tracker")
    assert resolves("acp_lab.tracking.states.StateConfig.weak_below")
    assert not resolves("acp_lab.tracking.paper.losses")
    assert not resolves("acp.Trucker")


def test_a_file_that_is_gone_is_seen(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text("`acp_lab/gone/losses.py` `tracking/method.py` [a](b.md) [c](page.md) `docs/` `acp_lab/none/`")
    assert sorted(missing_files(page)) == ["acp_lab/gone/losses.py", "acp_lab/none", "link b.md"]
