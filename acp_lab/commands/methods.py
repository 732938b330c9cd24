"""`acp-lab methods`, and which method `--method NAME` or `--config FILE` means."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from acp_lab.tracking.method import Method


def chosen_method(name: str, config_file: Path | None) -> Method:
    """The method of a file if there is one, else the named one; InputFileError, ParameterError, TrackingError."""
    if config_file is not None:
        from acp_lab.tracking.limits import check_limits
        from acp_lab.tracking.method_file import read_method

        method = read_method(config_file)
        check_limits(method, str(config_file))
        return method
    from acp_lab.tracking.method import method_named

    return method_named(name)


def print_methods(name: str | None = None) -> None:
    """All methods, a line each; or one of them whole, as TOML for --config. TrackingError for an unknown name."""
    from acp_lab.tracking.method import METHODS, method_named
    from acp_lab.tracking.method_file import to_toml

    if name is not None:
        print(to_toml(method_named(name)), end="")
        return
    width = max(map(len, METHODS))
    for method in METHODS.values():
        print(f"{method.name:<{width}}  {method.summary}")
