"""Methods as TOML: to print, to keep, to change one line of, to run again (`acp-lab track --config FILE`).

    base = "acp-paper"
    name = "my-method"
    [variables]
    direction = "autograd"
    [schedule]
    alpha = 0.08

What a file does not say is as in `base`, `acp-paper` if it names none. A part that comes in several kinds is a
table with `kind`; another kind than that of the base starts from its own defaults. Lists of parts, such as
[[targets]], replace the base's list. The base's `summary` is not taken over where anything is changed: its words are
of another method.
"""

from __future__ import annotations

import tomllib
from dataclasses import MISSING, fields, is_dataclass, replace
from pathlib import Path
from types import UnionType
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

from acp_lab.errors import InputFileError, TrackingError
from acp_lab.input_file import read_bytes
from acp_lab.tracking.method import ACP_PAPER, METHODS, Method

_LARGEST_WHOLE = 2**63
"""What TOML promises; Python reads larger ones, which are no float."""


def to_toml(method: Method) -> str:
    """The whole method as TOML."""
    import tomli_w

    return tomli_w.dumps(_plain(method))


def check_writable(method: Method) -> None:
    """TrackingError for a method that TOML cannot tell, such as one with a stage that is none of ours."""
    try:
        same = method_from_toml(to_toml(method), "as TOML") == method
        why = "" if same else " (it would read back as another one)"
    except (InputFileError, TypeError) as error:
        same, why = False, f" ({error})"
    if not same:
        raise TrackingError(
            f"method {method.name}: cannot be written as TOML{why}: use settings of acp_lab alone; a stage of your own "
            "runs with acp_lab.Tracker, see docs/own-stages.md"
        )


def read_method(path: str | Path) -> Method:
    """A method from a TOML file.

    Raises:
        InputFileError: the file cannot be read, or a key or value in it is none of ours; names the file and the key.
    """
    path = Path(path)
    try:
        # Editors on Windows begin a file with a byte order mark, which TOML does not know.
        text = read_bytes(path, "check --config", "method file").decode("utf-8-sig")
    except UnicodeDecodeError:
        raise InputFileError(f"{path}: no text in UTF-8: save it as UTF-8") from None
    return method_from_toml(text, str(path), path.stem)


def method_from_toml(text: str, where: str, name: str = "method") -> Method:
    """A method from TOML text; where: named in errors; name: of a method that tells none. Errors as `read_method`."""
    try:
        content = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise InputFileError(f"{where}: is no TOML ({error}): fix it") from None
    except RecursionError:
        raise InputFileError(f"{where}: is nested too deeply: fix it") from None
    base = content.pop("base", ACP_PAPER.name)
    if not isinstance(base, str) or base not in METHODS:
        raise InputFileError(f"{where}: base = {base!r}: give one of {', '.join(METHODS)}")
    start = METHODS[base] if "name" in content else replace(METHODS[base], name=name)
    if content:
        start = replace(start, summary="")
    try:
        return _changed(start, content, f"{where}: ")
    except TrackingError as error:
        raise InputFileError(f"{where}: {error}") from None


def _plain(config: Any) -> dict[str, Any]:
    values = {field.name: getattr(config, field.name) for field in fields(config)}
    if hasattr(type(config), "kind"):
        values = {"kind": config.kind, **values}
    # Tables go last: in TOML everything after a table's head belongs to it.
    values = dict(sorted(values.items(), key=lambda item: is_dataclass(item[1]) or _holds_tables(item[1])))
    return {key: _plain_value(value) for key, value in values.items()}


def _plain_value(value: Any) -> Any:
    if is_dataclass(value):
        return _plain(value)
    return [_plain_value(item) for item in value] if isinstance(value, tuple) else value


def _holds_tables(value: Any) -> bool:
    return isinstance(value, tuple) and any(is_dataclass(item) for item in value)


def _changed(config: Any, content: dict[str, Any], where: str) -> Any:
    """`config` with what `content` says; where: file and table, for messages."""
    hints = get_type_hints(type(config))
    names = [field.name for field in fields(config)]
    changes = {}
    for key, value in content.items():
        if key == "kind" and hasattr(type(config), "kind"):
            continue  # decided which class this is
        if key not in names:
            fix = f"there are {', '.join(names)}" if names else f'kind = "{config.kind}" has none: remove the line'
            raise InputFileError(f"{where}{key}: no such setting: {fix}")
        changes[key] = _checked(value, hints[key], getattr(config, key), f"{where}{key}")
    return replace(config, **changes)


def _checked(value: Any, hint: Any, current: Any, where: str) -> Any:
    """A value of a type, from what the file says; current: what it replaces, None for an item of a list."""
    classes = [kind for kind in _alternatives(hint) if is_dataclass(kind)]
    if classes:
        return _table(value, classes, current, where)
    if get_origin(hint) is Literal:
        if value not in get_args(hint):
            raise InputFileError(f"{where} = {value!r}: give one of {', '.join(map(str, get_args(hint)))}")
        return value
    if get_origin(hint) is tuple:
        if not isinstance(value, list):
            raise InputFileError(f"{where} = {_short(value)}: give a list")
        items = get_args(hint)
        if len(items) > 1 and items[1] is not Ellipsis and len(items) != len(value):
            raise InputFileError(f"{where} = {_short(value)}: give {len(items)} numbers")
        return tuple(_checked(item, items[0], None, where) for item in value)
    # bool is an int to Python, and 1 would do where true is meant.
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    if is_number and isinstance(value, int) and abs(value) > _LARGEST_WHOLE:
        raise InputFileError(f"{where} is a number of about {int(value.bit_length() * 0.30103)} digits: give another")
    if hint is float and is_number:
        return float(value)
    if type(value) is hint:
        return value
    wanted = {float: "a number", int: "a whole number", str: "a text", bool: "true or false"}[hint]
    raise InputFileError(f"{where} = {_short(value)}: give {wanted}")


def _table(value: Any, classes: list[Any], current: Any, where: str) -> Any:
    """A part of a method: of the kind that the file names, else of the current one's."""
    if not isinstance(value, dict):
        raise InputFileError(f"{where} = {_short(value)}: give a table [{where.rsplit(' ', 1)[-1]}]")
    kinds = {kind.kind: kind for kind in classes if hasattr(kind, "kind")}
    wanted = value.get("kind", getattr(type(current), "kind", None))
    if kinds and (not isinstance(wanted, str) or wanted not in kinds):
        raise InputFileError(f"{where}.kind = {wanted!r}: give one of {', '.join(kinds)}")
    chosen = kinds[wanted] if kinds else classes[0]
    return _changed(current if type(current) is chosen else _new(chosen, value, where), value, f"{where}.")


def _new(chosen: Any, value: dict[str, Any], where: str) -> Any:
    """A part with its defaults; what has none must be in the file, and is taken from there next."""
    needed = [field.name for field in fields(chosen) if field.default is field.default_factory is MISSING]
    for name in needed:
        if name not in value:
            raise InputFileError(f"{where}.{name}: is missing: give it")
    return chosen(**dict.fromkeys(needed))


def _alternatives(hint: Any) -> tuple[Any, ...]:
    return get_args(hint) if get_origin(hint) in (Union, UnionType) else (hint,)


def _short(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."
