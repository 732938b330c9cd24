"""Loops over edge points as machine code: what every kernel of the per-frame path has in common.

Kernels are compiled by Numba when their module is first imported on a machine and kept on disk, so that no frame waits
for a compiler; where nothing can be written, at every start. Each has a plain NumPy twin in the tests. They let go of
Python's lock: trackers in several threads run side by side.
"""

from __future__ import annotations

import sys
import warnings
from collections.abc import Callable
from functools import lru_cache
from typing import Any, TypeVar, cast

import numba

NOT_KEPT = "compiled code cannot be kept, so it is compiled again at every start, which takes a minute or two"
HOW_TO_KEEP = "set NUMBA_CACHE_DIR to a folder that you can write"

Function = TypeVar("Function", bound=Callable[..., Any])


def kernel(*signatures: str, fastmath: frozenset[str] = frozenset()) -> Callable[[Function], Function]:
    """Decorator: compile a function for these signatures, such as "f8[:](f8[:, ::1], i8)".

    A division by 0 gives infinity or NaN, as in NumPy. A kernel that calls one of another module is compiled anew when
    its own file changes, not when that one does. fastmath: LLVM's flags for sums in another order and the like; none
    that forgets NaN, which marks what is not known.
    """

    def compiled(function: Function) -> Function:
        def made(cache: bool) -> Function:
            decorate = numba.njit(
                list(signatures), cache=cache, nogil=True, error_model="numpy", fastmath=set(fastmath)
            )
            return cast("Function", decorate(function))

        try:
            done = made(cache=True)
            if any(done.stats.cache_misses.values()):  # type: ignore[attr-defined]
                _say_what_takes_so_long()
            return done
        except RuntimeError as error:
            if not _says_that_nothing_can_be_kept(error):
                raise
            _say_that_nothing_is_kept()
            return made(cache=False)

    return compiled


def can_be_kept() -> bool:
    """Whether kernels stay on disk for the next start; nothing is compiled to find out."""

    def never_called() -> None:
        pass

    try:
        numba.njit(cache=True)(never_called)
    except RuntimeError as error:
        if not _says_that_nothing_can_be_kept(error):
            raise
        return False
    return True


def _says_that_nothing_can_be_kept(error: RuntimeError) -> bool:
    """Whether it is the one that Numba raises where neither the package nor the user's folder can be written."""
    return "cannot cache" in str(error)


@lru_cache(maxsize=1)
def _say_what_takes_so_long() -> None:
    """Where somebody watches: a program that is silent for a minute seems to hang."""
    if sys.stderr is not None and sys.stderr.isatty():
        warnings.warn("loops are compiled, once on this machine: a minute or less", UserWarning, stacklevel=2)


@lru_cache(maxsize=1)
def _say_that_nothing_is_kept() -> None:
    warnings.warn(f"{NOT_KEPT}: {HOW_TO_KEEP}", UserWarning, stacklevel=2)
