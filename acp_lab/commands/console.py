"""What commands say beside their results: one error line, warnings, notes, progress. All of it on stderr.

A command that fails on bad input prints exactly one line, so notes (things worth knowing, such as which
generator is in use) are held back until it has succeeded, unless somebody is watching a terminal. Most warnings
are said at once.
"""

from __future__ import annotations

import os
import sys
import time
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TextIO

_PACKAGE = Path(__file__).resolve().parents[1]
_held: list[tuple[str, str]] = []


def watched() -> bool:
    """True when stderr is a terminal."""
    return bool(getattr(sys.stderr, "isatty", lambda: False)())


def debugging() -> bool:
    """True with ACP_LAB_DEBUG=1: tracebacks are shown, and libraries may write to stderr."""
    return os.environ.get("ACP_LAB_DEBUG", "") not in ("", "0")


def say(kind: str, message: str) -> None:
    """Print `kind: message` on stderr as exactly one line; where that is closed, nowhere: stdout is for results."""
    if sys.stderr is not None:
        print(f"{kind}: {one_line(message)}", file=sys.stderr, flush=True)


def warn(message: str) -> None:
    """Print a warning now."""
    say("warning", message)


def note(message: str) -> None:
    """Print a note now on a terminal, else when the command has succeeded."""
    _say_or_hold("note", message)


def warn_on_success(message: str) -> None:
    """The same for a warning of something that may be why a command fails: then its error says so."""
    _say_or_hold("warning", message)


def _say_or_hold(kind: str, message: str) -> None:
    if watched():
        say(kind, message)
    else:
        _held.append((kind, message))


def release_notes() -> None:
    """Print what was held back."""
    while _held:
        say(*_held.pop(0))


def drop_notes() -> None:
    """Forget what was held back."""
    _held.clear()


def one_line(message: str) -> str:
    """The message with all white space between words, line breaks too, made single spaces."""
    return " ".join(str(message).split())


@contextmanager
def warnings_as_notes() -> Iterator[None]:
    """Turn Python warnings raised on purpose in this package into notes; drop those of other packages."""

    def show(
        message: Warning | str,
        category: type[Warning],
        filename: str,
        lineno: int,
        file: TextIO | None = None,
        line: str | None = None,
    ) -> None:
        # NumPy's floating-point warnings come from our lines too, but nobody meant them for the user.
        if Path(filename).resolve().is_relative_to(_PACKAGE) and "encountered in" not in str(message):
            note(str(message))

    with warnings.catch_warnings():
        if not debugging():
            warnings.simplefilter("ignore")
            warnings.filterwarnings("default", category=UserWarning)
            warnings.filterwarnings("default", category=RuntimeWarning)
            warnings.showwarning = show
        yield


@contextmanager
def native_code_silenced() -> Iterator[None]:
    """Keep what C and Rust libraries print off file descriptor 2, while Python's stderr goes on working.

    An image decoder or a file writer that grumbles on its own would break the promise of one error line.
    Does nothing where stderr is not the process's own (in tests, in notebooks) and while debugging.
    """
    stderr = sys.stderr
    if debugging() or not _is_process_stderr(stderr):
        yield
        return
    kept = os.dup(2)
    with (
        open(os.devnull, "w") as nowhere,
        os.fdopen(kept, "w", buffering=1, errors="backslashreplace") as ours,
    ):
        stderr.flush()
        os.dup2(nowhere.fileno(), 2)
        sys.stderr = ours
        try:
            yield
        finally:
            sys.stderr = stderr
            os.dup2(kept, 2)


def _is_process_stderr(stream: TextIO | None) -> bool:
    try:
        return stream is sys.__stderr__ and stream is not None and stream.fileno() == 2
    except (OSError, ValueError):
        return False


class Progress:
    """A progress line on stderr; silent when nobody watches. Calls: progress(what, done, total)."""

    _WIDTH = 24

    def __init__(self, prefix: str = "") -> None:
        self._prefix = prefix
        self._watched = watched()
        self._next_s = 0.0
        self._shown = False

    def __call__(self, what: str, done: int, total: int) -> None:
        """Show `done` of `total` (0 when unknown), at most ten times a second."""
        now = time.monotonic()
        if not self._watched or (now < self._next_s and done != total):
            return
        self._next_s = now + 0.1
        count = f"{done}/{total}" if total else str(done)
        filled = round(self._WIDTH * min(1.0, done / total)) if total else 0
        bar = "#" * filled + "." * (self._WIDTH - filled)
        sys.stderr.write(f"\r\x1b[K{self._prefix}{what} [{bar}] {count}")
        sys.stderr.flush()
        self._shown = True

    def close(self) -> None:
        """Wipe the line."""
        if self._shown:
            sys.stderr.write("\r\x1b[K")
            sys.stderr.flush()
            self._shown = False

    def __enter__(self) -> Progress:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
