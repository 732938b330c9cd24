"""One module offers all that only draws."""

from __future__ import annotations

import ast
from pathlib import Path

import numpy as np
import pytest

import acp_lab.display
from acp_lab.display import draw

FOLDER = Path(acp_lab.display.__file__).parent
SOURCES = [FOLDER / f"{name}.py" for name in ("pictures", "film", "scene_3d")]
SOURCES += [path for path in (FOLDER / "plots").glob("*.py") if path.stem != "__init__"]


def public(path: Path) -> list[str]:
    """Functions and classes that a module defines."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    return [n.name for n in tree.body if isinstance(n, ast.FunctionDef | ast.ClassDef) and not n.name.startswith("_")]


@pytest.mark.parametrize("path", SOURCES, ids=lambda path: path.stem)
def test_everything_that_draws_is_offered(path: Path) -> None:
    module = str(path.relative_to(FOLDER).with_suffix("")).replace("/", ".")
    assert sorted(draw._OFFERED[module]) == sorted(public(path))
    for name in public(path):
        assert getattr(draw, name).__module__ == f"acp_lab.display.{module}"


def test_no_name_is_offered_twice() -> None:
    names = [name for of_module in draw._OFFERED.values() for name in of_module]
    assert sorted(names) == sorted(set(names))
    assert set(names) <= set(dir(draw))
    with pytest.raises(AttributeError, match="no attribute 'draw_nothing'"):
        _ = draw.draw_nothing


def test_white_ground_becomes_transparent() -> None:
    picture = np.full((4, 4, 3), 255, np.uint8)
    picture[1:3, 1:3] = (255, 255, 254)
    alpha = draw.without_ground(picture)[..., 3]
    assert (alpha[1:3, 1:3] == 255).all()
    assert alpha.sum() == 4 * 255
