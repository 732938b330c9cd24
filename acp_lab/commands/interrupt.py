"""Ctrl-C that cannot get lost.

Some libraries swallow KeyboardInterrupt while they are imported (`except BaseException` around optional
imports), turn it into another error, or crash later because half of a module is there. So while something is imported
the handler here waits until that is done; it remembers the key, and commands ask at every step.

The handler may itself be interrupted, by the next key: it sets plain flags, and takes no lock.
"""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from types import FrameType
from typing import Any

EXIT_STATUS = 130

_AGAIN_S = 0.05


@dataclass
class _Key:
    """What became of Ctrl-C: pressed, raised as KeyboardInterrupt, told to the user."""

    seen: bool = False
    raised: bool = False
    told: bool = False


_key = _Key()


def listen() -> None:
    """From now on Ctrl-C raises KeyboardInterrupt as always, and is remembered for `check` and `pressed`."""
    _forget()
    signal.signal(signal.SIGINT, _remember)
    sys.unraisablehook = _tell_unraisable


def ignore() -> None:
    """From now on Ctrl-C does nothing."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


@contextmanager
def remembered() -> Iterator[None]:
    """Inside, as after `listen`, if that was not called."""
    is_main = threading.current_thread() is threading.main_thread()  # only the main thread may set handlers
    if not is_main or signal.getsignal(signal.SIGINT) is _remember:
        yield
        return
    _forget()
    before = signal.signal(signal.SIGINT, _remember)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
        _forget()


def pressed() -> bool:
    """Whether Ctrl-C was pressed since the listening began."""
    return _key.seen


def tell() -> int:
    """Say, once, that the command was interrupted; the exit status for that."""
    if not _key.told:
        _key.told = True
        print("note: interrupted", file=sys.stderr, flush=True)
    return EXIT_STATUS


def check() -> None:
    """Raise KeyboardInterrupt if Ctrl-C was pressed and got lost."""
    if pressed():
        raise KeyboardInterrupt


def _forget() -> None:
    _key.seen = _key.raised = _key.told = False


def _remember(number: int, frame: FrameType | None) -> None:
    _key.seen = True
    if not _is_importing(frame):
        _key.raised = True
        raise KeyboardInterrupt
    again = threading.Timer(_AGAIN_S, _press)
    again.daemon = True
    again.start()


def _press() -> None:
    """Ctrl-C once more, to the main thread, which may be waiting for something; unless another one got through."""
    if _key.raised:
        return
    if hasattr(signal, "pthread_kill"):
        signal.pthread_kill(threading.main_thread().ident or 0, signal.SIGINT)
    else:
        signal.raise_signal(signal.SIGINT)


def _is_importing(frame: FrameType | None) -> bool:
    while frame is not None:
        if frame.f_code.co_filename == "<frozen importlib._bootstrap>":
            return True
        frame = frame.f_back
    return False


def _tell_unraisable(unraisable: Any) -> None:
    """As Python does, but for a KeyboardInterrupt that came while an object was taken down: it is remembered."""
    if unraisable.exc_type is not KeyboardInterrupt:
        sys.__unraisablehook__(unraisable)
