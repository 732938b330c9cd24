"""Commands that are printed for people to paste: whatever stands in them reaches the program as it was meant."""

from __future__ import annotations

import shlex
import sys


def quoted(word: object) -> str:
    """A path, or any other word, as one word of this system's shell: in quotes where it needs them.

    Example:
        >>> quoted("my clip.mp4")
        "'my clip.mp4'"
    """
    text = str(word)
    if sys.platform == "win32":  # whose shells know no single quotes as such; a backslash needs none
        return f'"{text}"' if " " in text or not text else text
    return shlex.quote(text)
