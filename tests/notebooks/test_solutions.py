"""The solutions pass; they are run here in this process, without a kernel, since they compute little."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from acp_lab import course
from tests.notebooks.notebook_files import code_cells, lesson_paths, read, solution_paths

SOLUTIONS = solution_paths()


def test_every_notebook_with_exercises_has_solutions() -> None:
    with_exercises = [path.name for path in lesson_paths() if course.exercises(path.stem[:2])]
    assert [path.name for path in SOLUTIONS] == with_exercises


@pytest.mark.slow
@pytest.mark.parametrize("path", SOLUTIONS, ids=lambda path: path.stem)
def test_solutions_pass(
    path: Path, course_files: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("ACP_LAB_COURSE", str(course_files))
    monkeypatch.setenv("MPLBACKEND", "agg")
    monkeypatch.chdir(tmp_path)
    verdicts: list[course.Verdict] = []
    grade = course.check

    def record(exercise: str, answer: Any) -> course.Verdict:
        verdicts.append(grade(exercise, answer))
        return verdicts[-1]

    monkeypatch.setattr(course, "check", record)
    names: dict[str, Any] = {"__name__": "__main__"}
    for cell in code_cells(read(path)):
        exec(compile(cell.source, f"{path.name}, cell {cell.id}", "exec"), names)
    failed = [str(verdict) for verdict in verdicts if not verdict]
    assert not failed, failed
    assert [verdict.exercise for verdict in verdicts] == list(course.exercises(path.stem[:2]))
