"""Running the command line inside the test's own process, which is much faster than starting Python anew."""

from __future__ import annotations

import os
import sys
from dataclasses import dataclass
from pathlib import Path

import cv2
import pytest

from acp_lab.cli import main


@dataclass(frozen=True)
class Outcome:
    """Exit status and what was printed."""

    status: int
    out: str
    err: str


def run(capsys: pytest.CaptureFixture[str], *words: str | Path) -> Outcome:
    """One `acp-lab` command; the thread limits that it sets are undone."""
    capsys.readouterr()
    variables, cv2_threads = dict(os.environ), cv2.getNumThreads()
    torch = sys.modules.get("torch")
    torch_threads = torch.get_num_threads() if torch else None
    try:
        status = main([str(word) for word in words])
    finally:
        os.environ.clear()
        os.environ.update(variables)
        cv2.setNumThreads(cv2_threads)
        if torch and torch_threads:
            torch.set_num_threads(torch_threads)
    printed = capsys.readouterr()
    return Outcome(status, printed.out, printed.err)


def assert_one_error(outcome: Outcome, *words: str | Path) -> None:
    """Exit 2 and exactly one line `error: …` on stderr that holds all the words."""
    assert outcome.status == 2, outcome
    assert outcome.err.startswith("error: "), outcome.err
    assert outcome.err.count("\n") == 1, outcome.err
    assert outcome.err.endswith("\n")
    assert "Traceback" not in outcome.err
    for word in words:
        assert str(word) in outcome.err, outcome.err
