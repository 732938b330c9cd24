"""Writing a file whole or not at all, so that a run that is stopped leaves the old file or none, never half of one.

And never in place of one that somebody else made.
"""

from __future__ import annotations

import glob
import math
import os
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

from acp_lab.errors import InputFileError
from acp_lab.input_file import check_regular


@contextmanager
def replacing(path: Path, what: str = "the file") -> Iterator[Path]:
    """A temporary path beside `path` to write to: it replaces `path` when the context ends, and vanishes on an error.

    The folder is made if there is none, and goes again where nothing comes into it. The file gets the usual
    permissions: it is not a private one of `tempfile`. It is not forced to the disk (fsync): a crash of the program
    leaves it whole, one of the machine may not.

    Args:
        what: names the file's content in the message, such as "the picture".

    Raises:
        InputFileError: the file cannot be written (any OSError within the context).
    """
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    is_new_folder = not path.parent.exists()
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        yield temporary
        os.replace(temporary, path)
    except OSError as error:
        reason = error.strerror or type(error).__name__
        raise InputFileError(f"{path}: {what} cannot be written ({reason}): choose another place") from None
    finally:
        with suppress(OSError):
            temporary.unlink()
        if is_new_folder:
            with suppress(OSError):  # it holds something
                path.parent.rmdir()


def remove_leftovers(path: Path) -> None:
    """Remove what killed writers of a file left beside it, those of files in a folder in it. Nobody may be writing."""
    folder, name = (path, "*") if path.is_dir() else (path.parent, glob.escape(path.name))
    for leftover in folder.glob(f".{name}.*.tmp"):
        with suppress(OSError):
            leftover.unlink()


def write_whole(path: Path, content: bytes, what: str = "the file") -> None:
    """Write a file of that content; see `replacing`."""
    with replacing(path, what) as temporary:
        temporary.write_bytes(content)


def write_changed(path: Path, content: bytes, what: str = "the file") -> None:
    """Write a file of that content, unless it holds that very content already; see `replacing`."""
    if not _holds(path, content):
        write_whole(path, content, what)


@contextmanager
def staged(contents: Mapping[Path, bytes], what: str = "the file") -> Iterator[None]:
    """Files of these contents, which lie beside their places by then: they are put there, the first one last, when the
    context ends, and none is on an error, such as a full disk. What holds its content already is left alone.

    Raises:
        InputFileError: one of them cannot be written.
    """
    with ExitStack() as until_all_are_there:
        for path, content in contents.items():
            if not _holds(path, content):
                until_all_are_there.enter_context(replacing(path, what)).write_bytes(content)
        yield


def _holds(path: Path, content: bytes) -> bool:
    try:
        return path.read_bytes() == content
    except OSError:
        return False


def check_place(path: Path, writer: str) -> None:
    """Refuse a name that no file can have, and to wait for a pipe's reader.

    Args:
        writer: whoever would write there, such as "--out".

    Raises:
        InputFileError: that is no name of a file, or one of a pipe, a device or a socket.
    """
    try:
        is_there, is_name = path.exists(), bool(path.name) and "\0" not in str(path)
    except OSError:  # too long a name
        is_there = is_name = False
    if not is_name:
        shown = str(path).replace("\0", "?")
        raise InputFileError(f"{shown[:80]}: no file can have that name: choose another one for {writer}")
    if is_there:
        check_regular(path, f"give {writer} another place", math.inf)


def check_replaces_own(path: Path, beginning: bytes, writer: str, kind: str) -> None:
    """Refuse to replace what is not of this program, such as a data set's truth; and what `check_place` refuses.

    Args:
        beginning: bytes that files of this kind begin with; an empty file may be replaced, too.
        writer: whoever would replace it, such as "--out"; kind: such as "results".

    Raises:
        InputFileError: the file begins otherwise, or is none, or that is no name of a file.
    """
    check_place(path, writer)
    if not path.is_file():
        return
    with path.open("rb") as file:
        start = file.read(len(beginning))
    if start and start != beginning:
        raise InputFileError(f"{path}: {writer} would replace a file that is not {kind}: choose another name")
