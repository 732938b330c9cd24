"""Ctrl-C at every moment of a call where Python looks for it: as a function begins, and behind each call of C."""

from __future__ import annotations

import gc
import sys
import threading
from collections.abc import Callable
from types import FrameType
from typing import Any


def pressed_at(number: int, call: Callable[[], object]) -> bool:
    """Raise KeyboardInterrupt at the number-th moment of a call; whether it had that many.

    Moments are those of everything in Python that the call calls, such as the standard library's locks.
    """
    left = number + 1

    def look(frame: FrameType, event: str, _: Any) -> None:
        nonlocal left
        left -= event in ("call", "c_return")
        if left == 0:
            raise KeyboardInterrupt

    before = sys.getprofile()
    gc.disable()  # no __del__ in between: what is raised there goes nowhere
    sys.setprofile(look)
    try:
        call()
    except KeyboardInterrupt:
        return True
    finally:
        sys.setprofile(before)
        gc.enable()
    return False


def ends_within(seconds: float, call: Callable[[], object]) -> bool:
    """Whether a call comes back in time; it is made in a thread, so that nobody else waits for ever."""
    thread = threading.Thread(target=call, daemon=True)
    thread.start()
    thread.join(seconds)
    return not thread.is_alive()
