"""A data set replaces an old data set and nothing else, and is there once it is complete."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import pytest

from acp_lab.errors import InputFileError
from data_recipes import bop_writer, metal_sequences
from data_recipes.bop_writer import TOP_LEVEL, check_out, new_dataset


def write(out: Path, content: str, force: bool = True) -> None:
    with new_dataset(out, force) as root:
        (root / "models").mkdir()
        (root / "models" / "models_info.json").write_text(content)


def read(out: Path) -> str:
    return (out / "models" / "models_info.json").read_text()


def _file(out: Path) -> None:
    out.write_text("precious")


def _link(out: Path) -> None:
    out.with_name("elsewhere").mkdir()
    out.symlink_to(out.with_name("elsewhere"))


def _link_to_nothing(out: Path) -> None:
    out.symlink_to(out.with_name("nothing"))


def _project(out: Path) -> None:
    write(out, "old")
    (out / "train.py").write_text("precious")


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (_file, "is no folder"),
        (_link, "is a link"),
        (_link_to_nothing, "is a link"),
        (_project, "holds train.py, which no recipe writes"),
    ],
)
def test_what_is_no_data_set_is_not_replaced(make: Callable[[Path], None], words: str, tmp_path: Path) -> None:
    out = tmp_path / "set"
    make(out)
    before = sorted(tmp_path.rglob("*"))
    with pytest.raises(InputFileError, match=words) as caught:
        write(out, "new")
    assert str(caught.value).startswith(f"{out}: ")
    assert str(caught.value).endswith(": --force replaces a data set only: give another --out")
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.parametrize("inside", [".", "models"])
def test_the_working_directory_is_not_replaced(inside: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    out = tmp_path / "set"
    write(out, "old")
    monkeypatch.chdir(out / inside)
    for name in (out, Path(os.path.relpath(out))):
        with pytest.raises(InputFileError, match="the working directory"):
            check_out(name, force=True)
    assert read(out) == "old"


def test_a_recipe_asks_before_it_makes_anything(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def plan(*_: object) -> None:
        raise AssertionError("planned before it was asked where to")

    monkeypatch.setattr(metal_sequences, "make_plans", plan)
    _project(tmp_path / "set")
    assert metal_sequences.main(["--out", str(tmp_path / "set"), "--force"]) == 2
    assert "holds train.py" in capsys.readouterr().err


def test_an_old_data_set_is_replaced_and_leaves_nothing(tmp_path: Path) -> None:
    out = tmp_path / "set"
    write(out, "old")
    (out / "CAMERA.json").write_text("{}")
    assert {path.name for path in out.iterdir()} < set(TOP_LEVEL)
    write(out, "new")
    assert read(out) == "new"
    assert not (out / "CAMERA.json").exists()
    assert list(tmp_path.iterdir()) == [out]


def test_an_empty_folder_is_replaced(tmp_path: Path) -> None:
    out = tmp_path / "set"
    out.mkdir()
    write(out, "new")
    assert read(out) == "new"
    assert list(tmp_path.iterdir()) == [out]


def test_an_old_one_that_cannot_be_removed_is_no_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def refused(path: Path, ignore_errors: bool = False) -> None:
        if not ignore_errors:
            raise PermissionError(13, "Permission denied", str(path))

    out = tmp_path / "set"
    write(out, "old")
    with monkeypatch.context() as patched:
        patched.setattr(bop_writer.shutil, "rmtree", refused)
        write(out, "new")
    assert read(out) == "new"
    (left,) = (path for path in tmp_path.iterdir() if path != out)
    assert left.name.startswith("set."), "is not hidden"
    assert read(left) == "old"
    assert f"warning: {left}: what is left of the old data set cannot be removed" in capsys.readouterr().err


def test_what_came_into_the_old_one_meanwhile_stays(tmp_path: Path) -> None:
    out = tmp_path / "set"
    write(out, "old")
    with new_dataset(out, force=True) as root:
        (root / "models").mkdir()
        (out / "notes.txt").write_text("precious")
    (left,) = (path for path in tmp_path.iterdir() if path != out)
    assert [path.name for path in left.iterdir()] == ["notes.txt"]
    assert not left.name.startswith(".")


def test_the_old_one_comes_back_where_the_new_one_cannot_come(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    out, replace = tmp_path / "set", os.replace
    write(out, "old")

    def stopped(source: Path, target: Path) -> None:
        if source.name.startswith("."):
            raise KeyboardInterrupt
        replace(source, target)

    monkeypatch.setattr(bop_writer.os, "replace", stopped)
    with pytest.raises(KeyboardInterrupt):
        write(out, "new")
    assert read(out) == "old"
    assert list(tmp_path.iterdir()) == [out]
