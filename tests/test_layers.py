"""A module imports only from layers below its own; read from the source, so that late imports count too."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

import acp_lab

PACKAGE = Path(acp_lab.__file__).parent

# From the bottom up; names in one row may import each other.
LAYERS = (
    ("errors",),
    ("compiled", "files", "input_file", "locks", "machine", "pasted", "quiet"),
    ("sample",),
    ("geometry",),
    ("imaging",),
    ("cad",),
    ("sequences",),
    ("control_points",),
    ("generator",),
    ("detection",),
    ("prepared_part",),
    ("preparation",),
    ("tracking",),
    ("evaluation",),
    ("bench",),
    ("diagnosis",),
    ("studies",),
    ("display",),
    ("course",),
    ("commands", "cli", "__main__"),
)
# Scores must not depend on what made the poses, so evaluation sees the part and the files and nothing else.
ONLY = {"evaluation": {"errors", "geometry", "cad", "sequences", "evaluation"}}
HEIGHT = {name: height for height, names in enumerate(LAYERS) for name in names}

MODULES = sorted(path for path in PACKAGE.rglob("*.py") if path != PACKAGE / "__init__.py" and "data" not in path.parts)


def layer(path: Path) -> str:
    return path.relative_to(PACKAGE).parts[0].removesuffix(".py")


def imported_layers(path: Path) -> Iterator[str]:
    """The layers of acp_lab that a module imports from, wherever in the file it does so."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path.name} imports relatively: write acp_lab.… in full"
            module = node.module or ""
            names = [module] if module != "acp_lab" else [f"acp_lab.{a.name}" for a in node.names]
        elif isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        else:
            continue
        for name in names:
            words = name.split(".")
            if words[0] == "acp_lab" and len(words) > 1 and words[1] != "__version__":
                # A name that the package offers at its top, such as Tracker, lives in some layer below.
                yield words[1] if words[1] in HEIGHT else acp_lab._HOME[words[1]].split(".")[1]


@pytest.mark.parametrize("path", MODULES, ids=lambda path: str(path.relative_to(PACKAGE)))
def test_imports_point_down(path: Path) -> None:
    own = layer(path)
    assert own in HEIGHT, f"{own} is in no layer: add it to LAYERS"
    upward = {name for name in imported_layers(path) if HEIGHT[name] > HEIGHT[own]}
    assert not upward, f"{path.name} of layer {own} imports from {', '.join(sorted(upward))} above it"


@pytest.mark.parametrize("room", ONLY)
def test_a_room_with_few_needs_imports_nothing_else(room: str) -> None:
    modules = [path for path in MODULES if layer(path) == room]
    assert modules, f"{room} is gone: take it out of ONLY"
    for path in modules:
        further = set(imported_layers(path)) - ONLY[room]
        assert not further, f"{path.name} of {room} imports from {', '.join(sorted(further))}"


def test_every_folder_of_code_is_a_package() -> None:
    """setuptools would leave the others out of the wheel without a word."""
    folders = {path.parent for path in PACKAGE.rglob("*.py")}
    assert not [str(folder) for folder in folders if not (folder / "__init__.py").is_file()]
