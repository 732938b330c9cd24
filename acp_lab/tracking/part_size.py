"""Settings in mm are for parts of usual size, 60 to 160 mm; for smaller and larger ones they are in proportion.

A screw that is held before the lens and a casting that hangs from a crane appear equally long, and move equally far in
the image. By how many mm they do, and by how many their edges lie beside the CAD's, goes with their size. The paper's
parts are some 100 mm long, and nothing there tells what becomes of others.
"""

from __future__ import annotations

from dataclasses import fields, is_dataclass, replace
from typing import Any, TypeVar

Settings = TypeVar("Settings", bound=Any)


def for_size(settings: Settings, times: float) -> Settings:
    """Settings, a dataclass, for a part that is so many times as large as those that they were made for.

    What their class names in `in_mm` is multiplied, and so it is in the settings that they hold.
    """
    if times == 1.0:
        return settings
    in_mm = getattr(settings, "in_mm", ())
    changed: dict[str, Any] = {}
    for field in fields(settings):
        value = getattr(settings, field.name)
        if is_dataclass(value):
            changed[field.name] = for_size(value, times)
        elif field.name in in_mm:
            changed[field.name] = tuple(times * one for one in value) if isinstance(value, tuple) else times * value
    return replace(settings, **changed)
