"""Ctrl-C that cannot get lost.

Some libraries swallow KeyboardInterrupt while they are imported (`except BaseException` around optional
imports), so that a key pressed in the first second would do nothing. The handler here also remembers it,
and commands ask at every step.
"""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

_seen = threading.Event()


@contextmanager
def remembered() -> Iterator[None]:
    """Inside, Ctrl-C raises KeyboardInterrupt as always and is remembered for `check`."""
    _seen.clear()
    if threading.current_thread() is not threading.main_thread():  # only the main thread may set handlers
        yield
        return
    before = signal.signal(signal.SIGINT, _remember)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
        _seen.clear()


def check() -> None:
    """Raise KeyboardInterrupt if Ctrl-C was pressed and got lost."""
    if _seen.is_set():
        _seen.clear()
        raise KeyboardInterrupt


def _remember(number: int, frame: FrameType | None) -> None:
    _seen.set()
    raise KeyboardInterrupt
