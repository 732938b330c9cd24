"""Commands that are printed for people to paste: whatever stands in them reaches the program as it was meant."""

from __future__ import annotations

import shlex
import subprocess
import sys


def quoted(word: object) -> str:
    """A path, or any other word, as one word of this system's shell: in quotes where it needs them.

    Example:
        >>> quoted("my clip.mp4")
        "'my clip.mp4'"
    """
    # Windows' shells know no single quotes as such, and a backslash needs none.
    return subprocess.list2cmdline([str(word)]) if sys.platform == "win32" else shlex.quote(str(word))
