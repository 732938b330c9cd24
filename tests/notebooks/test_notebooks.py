"""Each notebook runs from its first cell to its last, offline, and is stored as it should be."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import nbformat
import pytest
from nbclient.exceptions import CellExecutionError
from nbformat import NotebookNode

from acp_lab import course
from tests.notebooks.notebook_files import FOLDER, Run, code_cells, lesson_paths, normalised, read, solution_paths

LESSONS = lesson_paths()
ALL = [*LESSONS, *solution_paths()]
SHORT_LINES = 25


def name(path: Path) -> str:
    return path.stem


def checked(notebook: NotebookNode) -> list[str]:
    """The exercises that a notebook asks the grader about, in their order."""
    calls = [node for cell in code_cells(notebook) for node in ast.walk(ast.parse(cell.source))]
    return [
        str(call.args[0].value)
        for call in calls
        if isinstance(call, ast.Call)
        and isinstance(call.func, ast.Attribute)
        and call.func.attr == "check"
        and isinstance(call.args[0], ast.Constant)
    ]


def answers(notebook: NotebookNode) -> str:
    """All that the code cells printed or showed."""
    texts = []
    for cell in code_cells(notebook):
        for output in cell.outputs:
            texts.append(output.get("text", ""))
            texts.append(output.get("data", {}).get("text/plain", ""))
    return "\n".join(texts)


@pytest.mark.slow
@pytest.mark.parametrize("path", LESSONS, ids=name)
def test_notebook_runs(path: Path, run_notebook: Run) -> None:
    done = run_notebook(read(path))
    said = answers(done)
    for exercise in checked(done):
        assert f"Exercise {exercise}: not yet" in said, "an exercise must wait for its reader"


@pytest.mark.slow
def test_an_error_in_one_line_stops_the_notebook_all_the_same(run_notebook: Run) -> None:
    cells = ["from acp_lab import course; course.start()", "course.check('99.9', 1)", "print('went on')"]
    notebook = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell(cell) for cell in cells])
    with pytest.raises(CellExecutionError, match=r"99\.9"):
        run_notebook(notebook)
    (error,) = notebook.cells[1].outputs
    assert error.output_type == "error"
    assert len(error.traceback) == 1
    assert "\n" not in error.traceback[0]
    assert not notebook.cells[2].outputs


@pytest.mark.parametrize("path", ALL, ids=name)
def test_notebook_is_stored_without_outputs(path: Path) -> None:
    assert path.read_text(encoding="utf-8") == normalised(read(path)), (
        f"{path.name}: run python -m tests.notebooks.notebook_files"
    )


@pytest.mark.parametrize("path", LESSONS, ids=name)
def test_quick_is_set_at_the_top_and_honoured(path: Path) -> None:
    cells = [ast.parse(cell.source) for cell in code_cells(read(path))]
    first = cells[0].body[0]
    assert isinstance(first, ast.Assign)
    assert ast.unparse(first) == "QUICK = True"
    used = [node for cell in cells for node in ast.walk(cell) if isinstance(node, ast.Name) and node.id == "QUICK"]
    assert any(isinstance(node.ctx, ast.Load) for node in used), "QUICK changes nothing"


@pytest.mark.parametrize("path", LESSONS, ids=name)
def test_notebook_begins_with_its_goal(path: Path) -> None:
    first = read(path).cells[0]
    assert first.cell_type == "markdown"
    assert first.source.startswith(f"# {path.stem[:2]} ")
    assert "**Goal.**" in first.source


@pytest.mark.parametrize("path", LESSONS, ids=name)
def test_code_of_substance_lives_in_the_package(path: Path) -> None:
    for cell in code_cells(read(path)):
        tree = ast.parse(cell.source)
        assert not [node for node in ast.walk(tree) if isinstance(node, ast.ClassDef)]
        imports = [node for node in tree.body if isinstance(node, ast.Import | ast.ImportFrom)]
        lines = len(cell.source.splitlines()) - sum((node.end_lineno or 0) - node.lineno + 1 for node in imports)
        assert lines <= SHORT_LINES, f"cell {cell.id} is long: move it into acp_lab"


@pytest.mark.parametrize("path", [*LESSONS, FOLDER / "README.md"], ids=name)
def test_links_between_notebooks_name_their_files(path: Path) -> None:
    files = {lesson.name[:2]: lesson.name for lesson in LESSONS}
    for number, rest in re.findall(r"\]\((\d\d)(_\w*\.ipynb)\)", path.read_text(encoding="utf-8")):
        assert files.get(number, number + rest) == number + rest


@pytest.mark.parametrize("path", LESSONS, ids=name)
def test_exercises_are_those_that_the_course_grades(path: Path) -> None:
    number = path.stem[:2]
    assert checked(read(path)) == list(course.exercises(number))
    assert bool(course.exercises(number)) == (number != "00")
