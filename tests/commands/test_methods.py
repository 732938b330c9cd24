"""`acp-lab methods`: all of them on a line each, and one of them as a file that says the same."""

from __future__ import annotations

from pathlib import Path

import pytest

from acp_lab.tracking.method import METHODS
from acp_lab.tracking.method_file import read_method
from tests.cli_runner import assert_one_error, run


def test_every_method_has_a_line(capsys: pytest.CaptureFixture[str]) -> None:
    outcome = run(capsys, "methods")
    assert (outcome.status, outcome.err) == (0, "")
    listed = dict(line.split(maxsplit=1) for line in outcome.out.splitlines())
    assert listed == {name: method.summary for name, method in METHODS.items()}
    assert all(listed.values())


@pytest.mark.parametrize("name", METHODS)
def test_what_is_printed_is_the_method(capsys: pytest.CaptureFixture[str], tmp_path: Path, name: str) -> None:
    outcome = run(capsys, "methods", name)
    assert (outcome.status, outcome.err) == (0, "")
    # A file says what differs from its base: another base must not show through.
    for base in ("acp", "acp-paper"):
        path = tmp_path / f"{base}.toml"
        path.write_text(f'base = "{base}"\n{outcome.out}', encoding="utf-8")
        assert read_method(path) == METHODS[name]


def test_an_unknown_method_is_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    outcome = run(capsys, "methods", "magic")
    assert_one_error(outcome, "magic", *METHODS)
    assert outcome.out == ""
