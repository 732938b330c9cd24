"""Without the extras the commands still say what they can do, and name what is missing."""

from __future__ import annotations

import argparse
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from data_recipes.command import EXTRAS, Parser, run

ROOT = Path(__file__).resolve().parents[2]
RECIPES = (
    "metal_sequences", "edge_profiles", "rt_less", "t_less", "bcot", "rbot", "own_video", "contact_sheet",
    "other_cameras",
)  # fmt: skip
HIDING = """
import runpy, sys
for name in {names}:
    sys.modules[name] = None
sys.argv = ["recipe", *{options}]
runpy.run_module("data_recipes.{recipe}", run_name="__main__")
"""


def without_extras(recipe: str, *options: str) -> subprocess.CompletedProcess[str]:
    code = HIDING.format(names=tuple(EXTRAS), options=options, recipe=recipe)
    return subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, timeout=120, check=False
    )


def test_every_recipe_is_looked_at() -> None:
    commands = {path.stem for path in (ROOT / "data_recipes").glob("*.py") if "__main__" in path.read_text("utf-8")}
    assert commands == set(RECIPES)


@pytest.mark.parametrize("recipe", RECIPES)
def test_help_needs_no_extra(recipe: str) -> None:
    done = without_extras(recipe, "--help")
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith(f"usage: python -m data_recipes.{recipe}")


def test_the_missing_extra_is_named_in_one_line(tmp_path: Path) -> None:
    done = without_extras("metal_sequences", "--out", str(tmp_path / "set"), "--frames", "2")
    assert done.returncode == 2
    assert done.stderr == 'error: manifold3d is not installed: pip install -e ".[recipes]"\n'
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(("module", "extra"), EXTRAS.items())
def test_each_missing_module_names_its_extra(module: str, extra: str, capsys: pytest.CaptureFixture[str]) -> None:
    def recipe(_: argparse.Namespace) -> None:
        raise ModuleNotFoundError(name=f"{module}.inner")

    assert run(recipe, Parser(prog="made"), []) == 2
    assert capsys.readouterr().err == f'error: {module} is not installed: pip install -e ".[{extra}]"\n'


def test_any_other_missing_module_is_a_fault_of_ours() -> None:
    def recipe(_: argparse.Namespace) -> None:
        raise ModuleNotFoundError(name="data_recipes.gone")

    with pytest.raises(ModuleNotFoundError):
        run(recipe, Parser(prog="made"), [])


def test_the_extras_install_what_they_are_named_for() -> None:
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]["optional-dependencies"]
    for module, extra in EXTRAS.items():
        package = {"yaml": "pyyaml"}.get(module, module)
        assert any(requirement.lower().startswith(package) for requirement in extras[extra]), module
