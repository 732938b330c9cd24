"""The examples in docstrings run as they stand; `model` is the prepared sample, since preparing it takes its time."""

from __future__ import annotations

import doctest
import importlib
from pathlib import Path

import pytest

import acp_lab as acp
from tests.prepared_sample import sample_model

PACKAGE = Path(acp.__file__).parent
OPTIONS = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE
MODULES = [
    ".".join(("acp_lab", *path.relative_to(PACKAGE).with_suffix("").parts))
    for path in sorted(PACKAGE.rglob("*.py"))
    if ">>> " in path.read_text(encoding="utf-8")
]


@pytest.mark.parametrize("name", MODULES)
def test_examples_run(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    module = importlib.import_module(name)
    model = sample_model() if "model" in Path(str(module.__file__)).read_text(encoding="utf-8") else None
    done = doctest.testmod(module, extraglobs={"model": model}, optionflags=OPTIONS)
    assert done.attempted > 0
    assert done.failed == 0


@pytest.mark.parametrize("name", ["Camera", "Part", "Tracker", "evaluate", "open_sequence", "snap"])
def test_what_a_reader_begins_with_has_an_example(name: str) -> None:
    assert "Example:" in str(getattr(acp, name).__doc__)


def test_a_wrong_example_is_seen() -> None:
    wrong = doctest.DocTestParser().get_doctest(">>> 1 + 1\n3\n", {}, "wrong", None, None)
    assert doctest.DocTestRunner(verbose=False).run(wrong, out=lambda text: None).failed == 1
