"""Settings in mm are for parts of usual size, 60 to 160 mm; for smaller and larger ones they are in proportion.

A screw that is held before the lens and a casting that hangs from a crane appear equally long, and move equally far in
the image. By how many mm they do, and by how many their edges lie beside the CAD's, goes with their size. (The paper
has one setting in mm, and does not say for parts of which size; see docs/paper-ledger.md.)
"""

from __future__ import annotations

from dataclasses import fields, is_dataclass, replace
from typing import Any, TypeVar

Settings = TypeVar("Settings", bound=Any)


def for_size(settings: Settings, times: float) -> Settings:
    """Settings, a dataclass, for a part that is so many times as large as those that they were made for.

    Their class says by `in_mm` which of them are in which power of mm, such as 1 for a length and -2 for the inverse of
    its variance; these are multiplied, and so they are in settings that they hold, one or several.
    """
    if times == 1.0:
        return settings
    in_mm = getattr(settings, "in_mm", {})
    values = {f.name: getattr(settings, f.name) for f in fields(settings)}
    scaled = {name: _scaled(value, times, in_mm.get(name, 0)) for name, value in values.items()}
    changed = {name: value for name, value in scaled.items() if value is not values[name]}
    # What holds no mm stays the very object: somebody's own may be more than its fields.
    return replace(settings, **changed) if changed else settings


def _scaled(value: Any, times: float, power: int) -> Any:
    if is_dataclass(value):
        return for_size(value, times)
    if isinstance(value, tuple):
        scaled = tuple(_scaled(one, times, power) for one in value)
        return value if all(new is old for new, old in zip(scaled, value, strict=True)) else scaled
    return times**power * value if power else value
