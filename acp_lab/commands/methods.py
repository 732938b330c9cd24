"""Which tracker `--method NAME` or `--config FILE` means."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from acp_lab.errors import TrackingError

if TYPE_CHECKING:
    from acp_lab.prepared_part import PreparedPart
    from acp_lab.tracking.method import MethodConfig
    from acp_lab.tracking.method_tracker import MethodTracker
    from acp_lab.tracking.tracker import Tracker, TrackerConfig

METHOD_NAMES = ("acp", "acp-paper", "direct-6dof", "unoptimised-points")


def check_method(name: str) -> None:
    """TrackingError for a name that is no method."""
    if name not in METHOD_NAMES:
        raise TrackingError(
            f"--method {name}: no such method: there are {', '.join(METHOD_NAMES)}; --config FILE takes any other"
        )


@dataclass(frozen=True)
class Method:
    """A tracking method with its settings; `name` is what results are called."""

    name: str
    config: TrackerConfig | MethodConfig

    @classmethod
    def of(cls, name: str, config_file: Path | None) -> Method:
        """The method of a file if there is one, else the named one; InputFileError, TrackingError."""
        from acp_lab.tracking.method import METHODS
        from acp_lab.tracking.tracker import TrackerConfig

        if config_file is not None:
            from acp_lab.tracking.method_file import read_method

            read = read_method(config_file)
            return cls(read.name, read)
        check_method(name)
        return cls(name, METHODS[name] if name in METHODS else TrackerConfig())

    def tracker(self, model: PreparedPart) -> Tracker | MethodTracker:
        """A tracker of a part; PreparationError when the part lacks the generator that the method needs."""
        from acp_lab.tracking.method import MethodConfig
        from acp_lab.tracking.method_tracker import MethodTracker
        from acp_lab.tracking.tracker import Tracker

        if isinstance(self.config, MethodConfig):
            return MethodTracker(model, self.config)
        return Tracker(model, self.config)
