"""Hypothesis strategies: bad files of each type, as changes to good ones.

Bytes are changed anywhere; in texts words are exchanged, in JSON values. So the changes reach behind the first check.
"""

from __future__ import annotations

import copy
import json
import re
from typing import Any

from hypothesis import strategies as st

from tests.fuzz.readers import Reader

WORDS = (b"0", b"-1", b"3", b"1e300", b"1e400", b"nan", b"inf", b"9" * 400, b"x", b"", b"\xff", b"[" * 50)
VALUES: tuple[Any, ...] = (
    0, -1, 1e300, float("nan"), float("inf"), 10**400, 10**18, None, True,
    "x", "", "<b>", "\n", [], {}, [[]], [1, 2], {"a": 1},
)  # fmt: skip


@st.composite
def bytes_changed(draw: st.DrawFn, seed: bytes) -> bytes:
    """Some bytes replaced, removed, repeated or cut off."""
    content = bytearray(seed)
    for _ in range(draw(st.integers(1, 4))):
        at = draw(st.integers(0, len(content)))
        end = min(len(content), at + draw(st.integers(0, 12)))
        change = draw(st.sampled_from(("replace", "remove", "repeat", "cut", "insert")))
        if change == "replace":
            content[at:end] = draw(st.binary(min_size=end - at, max_size=end - at))
        elif change == "remove":
            del content[at:end]
        elif change == "repeat":
            content[at:at] = content[at:end] * draw(st.integers(1, 50))
        elif change == "cut":
            del content[at:]
        else:
            content[at:at] = draw(st.binary(max_size=12))
    return bytes(content)


@st.composite
def words_changed(draw: st.DrawFn, seed: bytes) -> bytes:
    """Some words of a text exchanged for others, for what is no number, or for huge ones."""
    words = re.split(rb"([\s,=/]+)", seed)
    for _ in range(draw(st.integers(1, 3))):
        at = draw(st.integers(0, len(words) - 1))
        words[at] = draw(st.sampled_from(WORDS) | st.sampled_from(words))
    return b"".join(words)


@st.composite
def values_changed(draw: st.DrawFn, seed: bytes) -> bytes:
    """Some values of a JSON text exchanged, or their keys."""
    root = {"root": json.loads(seed)}
    for _ in range(draw(st.integers(1, 3))):
        holder: Any = root
        key: Any = "root"
        while isinstance(holder[key], dict | list) and holder[key] and draw(st.integers(0, 5)):
            holder = holder[key]
            key = draw(st.sampled_from(sorted(holder) if isinstance(holder, dict) else range(len(holder))))
        change = draw(st.sampled_from(("value", "remove", "rename")))
        if change == "value" or holder is root or isinstance(holder, list):
            holder[key] = copy.deepcopy(draw(st.sampled_from(VALUES)))
        elif change == "remove":
            del holder[key]
        else:
            holder[draw(st.sampled_from(("-1", "x", "1e3", "", "9" * 30)))] = holder.pop(key)
    return json.dumps(root["root"]).encode()


def contents(reader: Reader) -> st.SearchStrategy[bytes]:
    """Contents for a reader: changed good ones, and any bytes."""
    kinds: list[st.SearchStrategy[bytes]] = [st.binary(max_size=200)]
    for seed in reader.seeds:
        kinds.append(bytes_changed(seed))
        if b"\0" not in seed and seed.isascii():
            kinds.append(words_changed(seed))
        if reader.name.endswith(".json"):
            kinds.append(values_changed(seed))
    return st.one_of(kinds)
