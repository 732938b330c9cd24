"""Files are written whole or not at all."""

from __future__ import annotations

import errno
import os
import stat
from pathlib import Path

import pytest

from acp_lab.errors import InputFileError
from acp_lab.files import check_replaces_own, remove_leftovers, replacing, staged, write_changed, write_whole


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_a_file_is_made_with_its_folder_and_then_replaced(tmp_path: Path) -> None:
    path = tmp_path / "new" / "folder" / "a.bin"
    write_whole(path, b"first")
    write_whole(path, b"then")
    assert path.read_bytes() == b"then"
    assert names(path.parent) == ["a.bin"]


@pytest.mark.parametrize("name", ["", "a" * 300, "a\0b"])
def test_what_is_no_name_of_a_file_is_told(name: str) -> None:
    with pytest.raises(InputFileError, match="no file can have that name") as error:
        check_replaces_own(Path(name), b"", "the results", "results")
    assert "\n" not in str(error.value)
    assert len(str(error.value)) < 200


def test_a_folder_that_was_made_for_nothing_goes_again(tmp_path: Path) -> None:
    def write(path: Path, full: bool) -> None:
        with replacing(path) as temporary:
            temporary.write_bytes(b"some")
            if full:
                raise OSError(errno.ENOSPC, "No space left on device")

    (tmp_path / "there").mkdir()
    for folder in ("new", "there"):
        with pytest.raises(InputFileError, match="No space left"):
            write(tmp_path / folder / "a.bin", full=True)
    assert names(tmp_path) == ["there"]
    write(tmp_path / "new" / "a.bin", full=False)
    assert names(tmp_path / "new") == ["a.bin"]


def test_the_old_file_stays_until_the_end(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    path.write_text("old")
    with replacing(path) as temporary:
        temporary.write_text("new")
        assert temporary.parent == path.parent
        assert path.read_text() == "old"
    assert path.read_text() == "new"
    assert names(tmp_path) == ["a.txt"]


@pytest.mark.parametrize("error", [KeyboardInterrupt, ValueError, OSError], ids=lambda kind: kind.__name__)
def test_an_error_leaves_the_old_file_alone(tmp_path: Path, error: type[BaseException]) -> None:
    path = tmp_path / "a.txt"
    path.write_text("old")
    expected = InputFileError if error is OSError else error

    def write_half() -> None:
        with replacing(path) as temporary:
            temporary.write_text("half")
            raise error

    with pytest.raises(expected):
        write_half()
    assert path.read_text() == "old"
    assert names(tmp_path) == ["a.txt"]


def test_ctrl_c_while_it_is_put_in_place_leaves_nothing_behind(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def stop(source: Path, target: Path) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(os, "replace", stop)
    with pytest.raises(KeyboardInterrupt):
        write_whole(tmp_path / "a.bin", b"content")
    assert names(tmp_path) == []


def test_a_place_that_cannot_be_written_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    (tmp_path / "folder").mkdir()
    for path in (tmp_path / "file" / "a.png", tmp_path / "folder"):
        with pytest.raises(InputFileError, match=r"the picture cannot be written \(.+\): choose another place") as told:
            write_whole(path, b"content", "the picture")
        assert str(told.value).startswith(f"{path}: ")
        assert "\n" not in str(told.value)
    assert names(tmp_path) == ["file", "folder"]


@pytest.mark.skipif(os.name == "nt", reason="permissions are those of POSIX")
def test_others_may_read_the_file_as_far_as_the_umask_says(tmp_path: Path) -> None:
    before = os.umask(0o022)
    try:
        write_whole(tmp_path / "a.bin", b"content")
    finally:
        os.umask(before)
    assert stat.S_IMODE((tmp_path / "a.bin").stat().st_mode) == 0o644


def test_the_same_content_is_not_written_again(tmp_path: Path) -> None:
    path = tmp_path / "a.bin"
    write_changed(path, b"first")
    os.utime(path, (1.0, 1.0))
    write_changed(path, b"first")
    assert path.stat().st_mtime == 1.0
    write_changed(path, b"then")
    assert path.stat().st_mtime > 1.0
    assert path.read_bytes() == b"then"


def test_leftovers_of_a_file_and_of_a_folder(tmp_path: Path) -> None:
    for name in (".a.csv.1.tmp", ".a.csv.run.2.tmp", ".b.csv.1.tmp", "a.csv", "a.csv.tmp"):
        (tmp_path / name).write_bytes(b"")
    remove_leftovers(tmp_path / "a.csv")
    assert names(tmp_path) == [".b.csv.1.tmp", "a.csv", "a.csv.tmp"]
    remove_leftovers(tmp_path)
    assert names(tmp_path) == ["a.csv", "a.csv.tmp"]


def test_staged_files_are_put_in_place_together_or_not_at_all(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "a.bin").write_bytes(b"old")
    (tmp_path / "same.bin").write_bytes(b"same")
    os.utime(tmp_path / "same.bin", (1.0, 1.0))
    contents = {
        tmp_path / name: content for name, content in (("a.bin", b"new"), ("same.bin", b"same"), ("b.bin", b"b"))
    }
    with staged(contents):
        assert (tmp_path / "a.bin").read_bytes() == b"old"
    assert [path.read_bytes() for path in contents] == [b"new", b"same", b"b"]
    assert (tmp_path / "same.bin").stat().st_mtime == 1.0
    really = Path.write_bytes

    def full_at_the_last(path: Path, content: bytes) -> int:
        if content == b"newest b":
            raise OSError(errno.ENOSPC, "No space left on device")
        return really(path, content)

    monkeypatch.setattr(Path, "write_bytes", full_at_the_last)
    newest = {path: b"newest " + content for path, content in contents.items()}
    with pytest.raises(InputFileError, match=r"b\.bin: the file cannot be written"), staged(newest):
        raise AssertionError("not all of them could be written")
    assert [path.read_bytes() for path in contents] == [b"new", b"same", b"b"]
    assert names(tmp_path) == ["a.bin", "b.bin", "same.bin"]
