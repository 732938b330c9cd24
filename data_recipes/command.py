"""What the recipes' command lines share: the error line, notes on stderr, types of options.

Convention as in `acp-lab`: exit status 0 done, 2 bad input or bad usage with exactly one line `error: …` on stderr,
130 after Ctrl-C. A recipe is a function of its parsed options; `run` does the rest.
"""

from __future__ import annotations

import argparse
import math
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import NoReturn, TypeVar

from acp_lab.errors import AcpLabError

Number = TypeVar("Number", int, float)

EXTRAS = {"manifold3d": "recipes", "yaml": "recipes", "mitsuba": "path-traced"}
"""Modules that a plain installation lacks, and the extra that brings them."""


class Parser(argparse.ArgumentParser):
    """Bad usage is one line on stderr and exit status 2."""

    def error(self, message: str) -> NoReturn:
        print(f"error: {one_line(message)}: see {self.prog} --help", file=sys.stderr)
        raise SystemExit(2)


def run(recipe: Callable[[argparse.Namespace], None], parser: Parser, argv: Sequence[str] | None) -> int:
    """Parse the options and carry out the recipe; returns the exit status. argv: without the program's name."""
    args = parser.parse_args(argv)
    try:
        with _stop_is_an_exception():
            recipe(args)
    except AcpLabError as error:
        print(f"error: {one_line(str(error))}", file=sys.stderr)
        return 2
    except OSError as error:
        where = f"{error.filename}: " if error.filename else ""
        print(f"error: {where}{error.strerror or error}: check the path, its rights and the disk", file=sys.stderr)
        return 2
    except MemoryError as error:
        told = one_line(str(error)) or "nothing is told of it"
        print(f"error: out of memory ({told}): ask for smaller or fewer pictures", file=sys.stderr)
        return 2
    except ModuleNotFoundError as error:
        module = (error.name or "").partition(".")[0]
        extra = EXTRAS.get(module)
        if extra is None:
            raise
        print(f'error: {module} is not installed: pip install -e ".[{extra}]"', file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return 130
    return 0


@contextmanager
def _stop_is_an_exception() -> Iterator[None]:
    """Let SIGTERM unwind the stack as Ctrl-C does, so that temporary folders are removed."""
    if threading.current_thread() is not threading.main_thread():  # elsewhere Python allows no handlers
        yield
        return

    def stop(*_: object) -> NoReturn:
        raise SystemExit(128 + signal.SIGTERM)

    before = signal.signal(signal.SIGTERM, stop)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def note(message: str) -> None:
    """Print information on stderr."""
    print(f"note: {one_line(message)}", file=sys.stderr, flush=True)


def warn(message: str) -> None:
    """Print on stderr what may spoil the result."""
    print(f"warning: {one_line(message)}", file=sys.stderr, flush=True)


def one_line(message: str) -> str:
    """The text on one line."""
    return " ".join(message.split())


def whole(text: str) -> int:
    """A whole number, 0 or more."""
    if not _is_whole(text):
        raise argparse.ArgumentTypeError(f"{text[:40]!r}; give a whole number, 0 or more")
    return int(text)


def count(text: str) -> int:
    """A whole number above 0."""
    if not (_is_whole(text) and int(text) > 0):
        raise argparse.ArgumentTypeError(f"{text[:40]!r}; give a whole number above 0")
    return int(text)


def positive(text: str) -> float:
    """A finite number above 0."""
    value = _number(text)
    if not 0 < value < math.inf:
        raise argparse.ArgumentTypeError(f"{text!r}; give a number above 0")
    return value


def at_most(most: Number, read: Callable[[str], Number]) -> Callable[[str], Number]:
    """The type of an option whose number `read` reads, such as `count`, and beyond `most` refuses."""

    def bounded(text: str) -> Number:
        value = read(text)
        if value > most:
            raise argparse.ArgumentTypeError(f"{text[:40]!r}; give {most} at most")
        return value

    return bounded


def share(text: str) -> float:
    """A number from 0 to 1."""
    value = _number(text)
    if not 0 <= value <= 1:
        raise argparse.ArgumentTypeError(f"{text!r}; give a number from 0 to 1")
    return value


def pair(text: str) -> tuple[int, int]:
    """Two whole numbers from 1 to 100, as in 9x6."""
    first, _, second = text.partition("x")
    if not all(_is_whole(word) and 1 <= int(word) <= 100 for word in (first, second)):
        raise argparse.ArgumentTypeError(f"{text[:40]!r}; give two whole numbers up to 100, such as 9x6")
    return int(first), int(second)


def ids(text: str) -> tuple[int, ...]:
    """Ids, as in 1,2,5."""
    return tuple(whole(word) for word in _words(text))


def names(text: str) -> tuple[str, ...]:
    """Names, as in ape,cat."""
    return tuple(_words(text))


def names_of(known: Sequence[str], what: str) -> Callable[[str], list[str]]:
    """The type of an option that takes some of the `known` names."""

    def read(text: str) -> list[str]:
        found = _words(text)
        wrong = [name for name in found if name not in known]
        if wrong:
            raise argparse.ArgumentTypeError(f"unknown {what} {', '.join(wrong)}; known: {', '.join(known)}")
        return found

    return read


def _words(text: str) -> list[str]:
    found = [word.strip() for word in text.split(",") if word.strip()]
    if not found:
        raise argparse.ArgumentTypeError(f"{text!r}; give one or more, separated by commas")
    return found


def _is_whole(text: str) -> bool:
    """Whether it is a whole number, of no more digits than Python reads."""
    return text.isascii() and text.isdigit() and len(text) < 1000


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return math.nan
