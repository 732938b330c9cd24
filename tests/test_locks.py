"""One writer at a time, and a killed one blocks nobody."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from filelock import FileLock

from acp_lab.errors import InputFileError
from acp_lab.files import write_whole
from acp_lab.locks import check_no_writer, only_writer

HOLDER = """
import sys, time
from pathlib import Path
from acp_lab.locks import only_writer
with only_writer(Path(sys.argv[1])):
    print("held", flush=True)
    time.sleep(60)
"""


@pytest.mark.skipif(not Path("/proc/self").exists(), reason="needs a place where no file can be made, such as /proc")
def test_a_place_where_no_file_can_be_made_has_no_other_writer() -> None:
    with pytest.raises(InputFileError, match="cannot be written"), only_writer(Path("/proc/results.csv")):
        pass


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_nothing_stays_behind(tmp_path: Path) -> None:
    path = tmp_path / "new" / "a.csv"
    with only_writer(path):
        write_whole(path, b"content")
        assert names(path.parent) == [".a.csv.lock", "a.csv"]
    assert names(path.parent) == ["a.csv"]


def test_a_second_one_is_refused_in_one_line_and_may_come_later(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    with only_writer(path, "these results"), pytest.raises(InputFileError) as caught, only_writer(path):
        pass
    assert str(caught.value).startswith(f"{path}: another acp-lab is writing")
    assert "\n" not in str(caught.value)
    with only_writer(path):
        pass


def test_other_files_are_not_locked(tmp_path: Path) -> None:
    with only_writer(tmp_path / "a.csv"), only_writer(tmp_path / "b.csv"):
        pass


def test_a_file_has_one_lock_whatever_links_lead_to_it(tmp_path: Path) -> None:
    path, link = tmp_path / "a.csv", tmp_path / "elsewhere" / "b.csv"
    path.write_bytes(b"rows")
    link.parent.mkdir()
    link.symlink_to(path)
    with only_writer(path), pytest.raises(InputFileError, match=r"b\.csv: another acp-lab"), only_writer(link):
        pass


def test_whoever_will_write_later_may_ask_before(tmp_path: Path) -> None:
    path = tmp_path / "new" / "a.csv"
    check_no_writer(path)
    assert not path.parent.exists()
    with only_writer(path), pytest.raises(InputFileError, match="another acp-lab is writing the replay"):
        check_no_writer(path, "the replay")
    check_no_writer(path)


def test_an_error_inside_ends_the_lock(tmp_path: Path) -> None:
    with pytest.raises(KeyboardInterrupt), only_writer(tmp_path / "a.csv"):
        raise KeyboardInterrupt
    with only_writer(tmp_path / "a.csv"):
        pass


def test_what_a_killed_writer_left_is_removed_and_nothing_else(tmp_path: Path) -> None:
    folder = tmp_path / "part"
    folder.mkdir()
    (folder / ".mesh.safetensors.123.tmp").write_bytes(b"half")
    (folder / "mesh.tmp").write_bytes(b"of somebody else")
    (tmp_path / ".part.123.tmp").write_bytes(b"of another output of that name")
    (tmp_path / ".a[1].csv.9.tmp").write_bytes(b"half")
    with only_writer(folder):
        pass
    with only_writer(tmp_path / "a[1].csv"):
        pass
    assert names(folder) == ["mesh.tmp"]
    assert names(tmp_path) == [".part.123.tmp", "part"]


@pytest.mark.skipif(os.name == "nt", reason="SIGKILL is of POSIX")
def test_a_killed_process_blocks_nobody(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    holder = subprocess.Popen([sys.executable, "-c", HOLDER, str(path)], stdout=subprocess.PIPE, text=True)
    try:
        assert holder.stdout is not None
        assert holder.stdout.readline() == "held\n"
        with pytest.raises(InputFileError, match="another acp-lab"), only_writer(path):
            pass
    finally:
        holder.send_signal(signal.SIGKILL)
        holder.wait()
    assert names(tmp_path) == [".a.csv.lock"]
    with only_writer(path):
        pass
    assert names(tmp_path) == []


def test_a_place_that_cannot_be_written_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(InputFileError, match="cannot be written"), only_writer(tmp_path / "file" / "a.csv"):
        pass


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no pipes in folders")
def test_a_pipe_is_no_place_to_write(tmp_path: Path) -> None:
    """Who opens it would wait for a reader."""
    os.mkfifo(tmp_path / "a.csv")
    with pytest.raises(InputFileError, match=r"a\.csv: is a pipe"), only_writer(tmp_path / "a.csv"):
        pass
    assert names(tmp_path) == ["a.csv"]


@pytest.mark.parametrize("error", [NotImplementedError("no flock"), OSError(37, "No locks available")])
def test_a_place_that_knows_no_locks_is_told_as_such(
    error: Exception, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(lock: FileLock) -> None:
        raise error

    monkeypatch.setattr(FileLock, "acquire", refuse)
    refused = pytest.raises(InputFileError, match=r"cannot be written .*: choose another place")
    with refused, only_writer(tmp_path / "a"):
        pass
