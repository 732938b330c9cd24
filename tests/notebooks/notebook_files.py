"""How the notebooks are stored: no outputs, no counts, the least metadata, cells with ids of their own.

`python -m tests.notebooks.notebook_files` brings every notebook into this form after it was edited in JupyterLab;
a test compares.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import nbformat
from nbformat import NotebookNode

FOLDER = Path(__file__).resolve().parents[2] / "notebooks"
METADATA = {
    "kernelspec": {"display_name": "Python 3 (ipykernel)", "language": "python", "name": "python3"},
    "language_info": {"name": "python"},
}
KEPT_CELL_METADATA = ("tags",)
Run = Callable[[NotebookNode], NotebookNode]
"""Runs a notebook and returns it with its outputs."""


def lesson_paths() -> list[Path]:
    """The notebooks of the course, in their order."""
    return sorted(FOLDER.glob("[0-9][0-9]_*.ipynb"))


def solution_paths() -> list[Path]:
    """Those that solve their exercises."""
    return sorted((FOLDER / "solutions").glob("[0-9][0-9]_*.ipynb"))


def read(path: Path) -> NotebookNode:
    """A notebook as nbformat 4."""
    return nbformat.read(path, as_version=4)


def code_cells(notebook: NotebookNode) -> list[NotebookNode]:
    """Its code cells."""
    return [cell for cell in notebook.cells if cell.cell_type == "code"]


def normalised(notebook: NotebookNode) -> str:
    """The text of the file in the form in which it is stored."""
    cells = []
    for number, cell in enumerate(notebook.cells):
        kept = {key: cell.metadata[key] for key in KEPT_CELL_METADATA if key in cell.metadata}
        fields = {
            "cell_type": cell.cell_type,
            "id": cell.get("id", f"cell-{number:02d}"),
            "metadata": kept,
            "source": cell.source.strip("\n"),
        }
        if cell.cell_type == "code":
            fields |= {"execution_count": None, "outputs": []}
        cells.append(NotebookNode(fields))
    plain = NotebookNode({"cells": cells, "metadata": METADATA, "nbformat": 4, "nbformat_minor": 5})
    nbformat.validate(plain)
    return nbformat.writes(plain) + "\n"


def main() -> None:
    """Rewrite those that differ."""
    for path in (*lesson_paths(), *solution_paths()):
        text = normalised(read(path))
        if text != path.read_text(encoding="utf-8"):
            path.write_text(text, encoding="utf-8")
            print(f"{path}: outputs and metadata removed", file=sys.stderr)


if __name__ == "__main__":
    main()
