"""View regions as words of the command line."""

from __future__ import annotations

from acp_lab.errors import InputFileError


def joined_regions(words: list[str]) -> list[str]:
    """`--regions 0 2 5` as `--regions 0,2,5`: an option of typer takes one word."""
    if "--regions" not in words:
        return words
    start = words.index("--regions") + 1
    end = start
    while end < len(words) and words[end].strip(",").replace(",", "").isdigit():
        end += 1
    return [*words[:start], ",".join(words[start:end]), *words[end:]] if end > start else words


def regions_of(text: str) -> tuple[int, ...] | None:
    """View regions of `--regions`: None for all; InputFileError for anything but 0 to 5."""
    if text.strip().lower() == "all":
        return None
    words = text.replace(",", " ").split()
    if not words or not all(word in "012345" and len(word) == 1 for word in words):
        raise InputFileError(f"--regions {text}: give all, or some of the view regions 0 1 2 3 4 5")
    return tuple(sorted({int(word) for word in words}))
