"""Asking the graders of the course, for the tests of their lessons."""

from __future__ import annotations

from typing import Any

from acp_lab import course


def passes(exercise: str, answer: Any) -> str:
    """The praise for a right answer; fails with the hint when it is not taken for one."""
    verdict = course.check(exercise, answer)
    assert verdict.passed, verdict
    assert len(verdict.message) > 10
    assert not verdict.message.lower().startswith("right"), "the verdict says that already"
    return verdict.message


def hints(exercise: str, answer: Any, fragment: str = "") -> str:
    """The hint for a wrong answer, one helpful sentence or two, that holds a fragment (whatever its case)."""
    verdict = course.check(exercise, answer)
    assert not verdict.passed, verdict
    assert len(verdict.message) > 10
    assert "\n" not in verdict.message
    assert fragment.lower() in verdict.message.lower(), verdict.message
    return verdict.message
