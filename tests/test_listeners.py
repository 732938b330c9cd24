"""Nothing of this package listens on the network but what is known here, and that on 127.0.0.1 alone.

The commands themselves are looked at in tests/commands/test_replay_and_lab.py.
"""

from __future__ import annotations

import ast
from pathlib import Path

import acp_lab

PACKAGE = Path(acp_lab.__file__).parent
STARTS_PROGRAMS = {
    "bench/rapid/environment.py",  # venv and pip, when `bench --install-peers` asks for it
    "bench/rapid/tracker.py",  # its own worker in that environment, spoken to over a pipe
    "commands/doctor.py",  # rerun --version, a trial of OpenGL
    "commands/lab.py",  # JupyterLab, on 127.0.0.1 with its token
    "machine.py",  # sysctl, for the name of the processor
    "commands/replay.py",  # rerun's viewer, on 127.0.0.1
    "commands/replay_web.py",  # rerun's viewer for browsers, on 127.0.0.1
}
SPREADS = {"bench/workers.py"}
"""Runs over processes that dask starts, on ports of 127.0.0.1; tests/bench/test_spread.py looks at them."""
SERVERS = {"commands/replay_page.py"}
"""The page of rerun's web viewer once more, on 127.0.0.1; tests/commands/test_replay_and_lab.py looks at it."""
LISTENS = {"socket", "socketserver", "http", "asyncio", "wsgiref", "xmlrpc", "multiprocessing"}
SERVES = {"serve", "serve_web", "serve_grpc", "serve_web_viewer", "spawn", "connect_grpc"}
"""Of rerun."""


def parsed() -> dict[str, ast.Module]:
    return {
        path.relative_to(PACKAGE).as_posix(): ast.parse(path.read_text(encoding="utf-8"))
        for path in sorted(PACKAGE.rglob("*.py"))
    }


def imported(tree: ast.Module) -> set[str]:
    names = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names |= {alias.name.partition(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            names.add(node.module.partition(".")[0])
    return names


def test_programs_are_started_only_where_it_is_known() -> None:
    found = {name for name, tree in parsed().items() if "subprocess" in imported(tree)}
    assert found == STARTS_PROGRAMS


def test_nothing_listens() -> None:
    for name, tree in parsed().items():
        assert name in SERVERS or not imported(tree) & LISTENS, name
        assert name in SPREADS or not imported(tree) & {"dask", "distributed"}, name
        called = {node.attr for node in ast.walk(tree) if isinstance(node, ast.Attribute)}
        assert not called & SERVES, name


def test_html_is_made_only_where_it_is_escaped() -> None:
    """Names of parts and files must not become markup: ipywidgets' HTML in one place, where a test tries it."""
    makers = {
        name
        for name, tree in parsed().items()
        for node in ast.walk(tree)
        if isinstance(node, ast.Attribute | ast.Name)
        and (node.attr if isinstance(node, ast.Attribute) else node.id) in ("HTML", "HTMLMath", "Markdown")
    }
    widgets = ("live_window", "pose_aligner", "run_comparison")
    assert makers == {f"display/widgets/{name}.py" for name in widgets}
