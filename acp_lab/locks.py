"""One writer at a time: two programs that write one output would tear it, or one would lose its work without a word.

The lock is one of the operating system (flock, or what Windows has for it), on a small hidden file beside the output.
It ends with the process that holds it, however that ends, so a file left by a killed process blocks nobody.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from filelock import FileLock, Timeout

from acp_lab.errors import InputFileError
from acp_lab.files import remove_leftovers
from acp_lab.input_file import check_regular


def check_no_writer(path: Path, what: str = "the file") -> None:
    """InputFileError where another process writes `path` now: for those who will write several files, or none."""
    lock = _lock_of(path)
    if Path(lock.lock_file).exists():
        with only_writer(path, what):
            pass


def _lock_of(path: Path) -> FileLock:
    """Beside the file itself: several links to it may have names elsewhere."""
    file = path.resolve()
    return FileLock(file.with_name(f".{file.name}.lock"), blocking=False)


@contextmanager
def only_writer(path: Path, what: str = "the file") -> Iterator[None]:
    """Inside, no other process that asks here writes `path`, a file or a folder; its own folder is made.

    What a killed writer left half-written beside `path`, or in it, is removed.

    Args:
        what: names the content in the message, such as "the results".

    Raises:
        InputFileError: another one is writing it, or the place cannot be written, such as a pipe.
    """
    if path.exists():
        check_regular(path, "choose another place", math.inf)
    lock = _lock_of(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        lock.acquire()
    except Timeout:
        if not Path(lock.lock_file).exists():  # as in /proc, where no file can be made
            raise InputFileError(f"{path}: {what} cannot be written there: choose another place") from None
        raise InputFileError(
            f"{path}: another acp-lab is writing {what}: wait until it is done, or choose another place"
        ) from None
    except (OSError, NotImplementedError) as error:  # the second from file systems that know no locks
        reason = getattr(error, "strerror", None) or type(error).__name__
        raise InputFileError(f"{path}: {what} cannot be written ({reason}): choose another place") from None
    try:
        remove_leftovers(path)
        yield
    finally:
        # Before it is released: whoever has it open already notices that it is gone, and makes a new one.
        with suppress(OSError):  # Windows removes it itself
            Path(lock.lock_file).unlink()
        lock.release()
