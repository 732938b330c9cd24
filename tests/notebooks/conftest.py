"""Notebooks are run in a kernel of their own, in an empty folder, without a network, on one prepared sample."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from nbclient import NotebookClient
from nbformat import NotebookNode

from tests.notebooks.notebook_files import Run

PROJECT = Path(__file__).resolve().parents[2]
LONGEST_CELL_S = 600
# Whoever fetches something finds nobody there.
NOWHERE = "http://127.0.0.1:9"


@pytest.fixture(scope="session")
def course_files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What the first notebook prepares is there for the others, as in JupyterLab."""
    return tmp_path_factory.mktemp("course")


@pytest.fixture
def run_notebook(course_files: Path, tmp_path: Path) -> Run:
    """Runs all cells of a notebook; fails with the cell and its traceback when one of them does."""
    environment = {
        **os.environ,
        "PYTHONPATH": os.pathsep.join(filter(None, (str(PROJECT), os.environ.get("PYTHONPATH")))),
        "ACP_LAB_COURSE": str(course_files),
        "IPYTHONDIR": str(tmp_path / "ipython"),
        "OMP_NUM_THREADS": "1",
        "http_proxy": NOWHERE,
        "https_proxy": NOWHERE,
        "no_proxy": "127.0.0.1,localhost",
    }

    def run(notebook: NotebookNode) -> NotebookNode:
        folder = tmp_path / "here"
        folder.mkdir()
        client = NotebookClient(
            notebook,
            timeout=LONGEST_CELL_S,
            kernel_name="python3",
            resources={"metadata": {"path": str(folder)}},
        )
        # nbclient stands in for output widgets by writing to the very socket on which it waits for the cell's reply; a
        # reply that arrives just then goes unnoticed until the time is up. Without it, their output lands in the cell.
        client.widget_registry.clear()
        return client.execute(env=environment)

    return run
