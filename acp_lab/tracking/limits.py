"""Limits of a method's settings: what is beyond them is a slip of the keyboard, and would take hours or gigabytes.

Settings check what only they know (`__post_init__` of each). Here is what holds for all of them, by the unit that their
names end in, so that a method from a file is refused before anything is tracked.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from typing import Any

from acp_lab.errors import ParameterError
from acp_lab.tracking.method import Method

MOST_COUNTED = 100_000
MOST_PX = 1000.0
MOST_POWER = 10.0
MOST, LEAST_POSITIVE = 1e6, 1e-6
POSITIVE = frozenset({"blur_px"})
"""Settings that cv2 takes for a size."""
MAY_BE_INFINITE = frozenset({"agreement_alone"})


def check_limits(method: Method, where: str) -> None:
    """ParameterError, beginning with `where`, that names the first setting beyond its limits."""
    for name, value in _numbers(method, ""):
        setting = name.rpartition(".")[2]
        most = _most(setting, value)
        if math.isinf(value) and value > 0 and setting in MAY_BE_INFINITE:
            continue
        if not abs(value) <= most:  # NaN, too
            raise ParameterError(f"{where}: {name} = {value:g}: give at most {most:g}")
        if value < 0.0 and setting.endswith("_px"):
            raise ParameterError(f"{where}: {name} = {value:g}: give 0 or more")
        if value < LEAST_POSITIVE and setting in POSITIVE:
            raise ParameterError(f"{where}: {name} = {value:g}: give more than 0")


def _most(setting: str, value: float) -> float:
    if isinstance(value, int):
        most: float = MOST_COUNTED
    elif setting.endswith("_power"):
        most = MOST_POWER
    else:
        most = MOST
    return min(most, MOST_PX) if setting.endswith("_px") else most


def _numbers(config: Any, name: str) -> Iterator[tuple[str, float]]:
    """All numbers of a configuration, each with its dotted name."""
    if is_dataclass(config):
        for field in fields(config):
            yield from _numbers(getattr(config, field.name), f"{name}.{field.name}" if name else field.name)
    elif isinstance(config, tuple):
        for item in config:
            yield from _numbers(item, name)
    elif isinstance(config, int | float) and not isinstance(config, bool):
        yield name, config
