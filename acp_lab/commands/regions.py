"""View regions as words of the command line."""

from __future__ import annotations

from acp_lab.errors import InputFileError

OPTION = "--regions"


def joined_regions(words: list[str]) -> list[str]:
    """`--regions 0 2 --regions 5` as `--regions 0,2,5`: an option of typer takes one word, and of two the last."""
    rest = [part for word in words for part in (word.split("=", 1) if word.startswith(f"{OPTION}=") else [word])]
    first, regions = None, list[str]()
    while OPTION in rest[:-1]:
        start = rest.index(OPTION)
        first = start if first is None else first
        end = start + 2
        while end < len(rest) and rest[end].strip(",").replace(",", "").isdigit():
            end += 1
        regions += rest[start + 1 : end]
        del rest[start:end]
    return rest if first is None else [*rest[:first], OPTION, ",".join(regions), *rest[first:]]


def regions_of(text: str) -> tuple[int, ...] | None:
    """View regions of `--regions`: None for all; InputFileError for anything but 0 to 5."""
    if text.strip().lower() == "all":
        return None
    words = text.replace(",", " ").split()
    if not words or not all(word in "012345" and len(word) == 1 for word in words):
        raise InputFileError(f"--regions {text}: give all, or some of the view regions 0 1 2 3 4 5")
    return tuple(sorted({int(word) for word in words}))
