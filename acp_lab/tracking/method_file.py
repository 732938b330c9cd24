"""Method configurations as TOML: to print, to keep, to change one line of, to run again (`acp-lab track --config
FILE`).

    name = "my-method"
    direction = "autograd"
    [loss]
    alpha = 0.05

What a file does not say is as in `acp-paper`, unless `base` names another method to start from.
"""

from __future__ import annotations

import tomllib
from dataclasses import fields, is_dataclass, replace
from pathlib import Path
from types import UnionType
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

from acp_lab.errors import InputFileError, TrackingError
from acp_lab.tracking.method import ACP_PAPER, METHODS, MethodConfig


def to_toml(config: MethodConfig) -> str:
    """The whole configuration as TOML."""
    import tomli_w

    return tomli_w.dumps(_plain(config))


def read_method(path: str | Path) -> MethodConfig:
    """A method from a TOML file.

    Raises:
        InputFileError: the file cannot be read, or a key or value in it is none of ours; names the file and the key.
    """
    path = Path(path)
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputFileError(f"{path}: cannot be read ({error.strerror}): check --config") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InputFileError(f"{path}: is no TOML ({error}): mend it") from None
    base = content.pop("base", ACP_PAPER.name)
    if base not in METHODS:
        raise InputFileError(f"{path}: base = {base!r}: give one of {', '.join(METHODS)}")
    start = METHODS[base] if "name" in content else replace(METHODS[base], name=path.stem)
    try:
        return _changed(start, content, f"{path}: ")
    except TrackingError as error:
        raise InputFileError(f"{path}: {error}") from None


def _plain(config: Any) -> dict[str, Any]:
    values = {field.name: getattr(config, field.name) for field in fields(config)}
    # Tables go last: in TOML everything after a table's head belongs to it.
    values = dict(sorted(values.items(), key=lambda item: is_dataclass(item[1])))
    return {key: _plain(value) if is_dataclass(value) else value for key, value in values.items()}


def _changed(config: Any, content: dict[str, Any], where: str) -> Any:
    """`config` with what `content` says; where: file and table, for messages."""
    hints = get_type_hints(type(config))
    changes = {}
    for key, value in content.items():
        if key not in hints:
            raise InputFileError(f"{where}{key}: no such setting: there are {', '.join(hints)}")
        current = getattr(config, key)
        if is_dataclass(current):
            if not isinstance(value, dict):
                raise InputFileError(f"{where}{key} = {value!r}: give a table [{key}]")
            changes[key] = _changed(current, value, f"{where}{key}.")
        else:
            changes[key] = _checked(value, hints[key], f"{where}{key}")
    return replace(config, **changes)


def _checked(value: Any, hint: Any, where: str) -> Any:
    if get_origin(hint) is Literal:
        if value not in get_args(hint):
            raise InputFileError(f"{where} = {value!r}: give one of {', '.join(map(str, get_args(hint)))}")
        return value
    if get_origin(hint) in (Union, UnionType):
        raise AssertionError(f"{where}: settings have one type each")
    if get_origin(hint) is tuple:
        if not isinstance(value, list):
            raise InputFileError(f"{where} = {value!r}: give a list of numbers")
        return tuple(_checked(item, get_args(hint)[0], where) for item in value)
    # bool is an int to Python, and 1 would do where true is meant.
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    if hint is float and is_number:
        return float(value)
    if type(value) is hint:
        return value
    wanted = {float: "a number", int: "a whole number", str: "a text", bool: "true or false"}[hint]
    raise InputFileError(f"{where} = {value!r}: give {wanted}")
