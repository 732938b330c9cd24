"""Settings that are one of a few words, checked: in Python nobody else does, and a wrong word fails far from here."""

from __future__ import annotations

from dataclasses import fields, is_dataclass
from functools import cache
from typing import Any, Literal, get_args, get_origin, get_type_hints

from acp_lab.errors import TrackingError


def check_choices(config: object, where: str = "") -> None:
    """TrackingError for a field of a dataclass, or of one in it, that is none of the words of its `Literal`.

    where: the setting that holds it, with a point behind, as "targets."; fields are named as in a method file.
    """
    if isinstance(config, tuple):
        for one in config:
            check_choices(one, where)
    elif is_dataclass(config) and not isinstance(config, type):
        for name, words in _words(type(config)).items():
            value = getattr(config, name)
            if not (isinstance(value, str) and value in words):
                shown = " ".join(repr(value).split())[:40]  # an array has several lines
                raise TrackingError(f"{where}{name} = {shown}: give one of {', '.join(words)}")
        for field in fields(config):
            check_choices(getattr(config, field.name), f"{where}{field.name}.")


@cache
def _words(kind: type) -> dict[str, tuple[Any, ...]]:
    try:
        hints = get_type_hints(kind)
    except NameError:  # of a stage of somebody's own, whose types only their module knows
        return {}
    return {name: get_args(hint) for name, hint in hints.items() if get_origin(hint) is Literal}
