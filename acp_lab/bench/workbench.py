"""Data sets and what was run on them: ask for methods on sequences, and get the report; what is missing is run."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from acp_lab.bench.protocol import SequenceKey, Variant, dataset_name, task_of
from acp_lab.bench.rapid.tracker import NAMES
from acp_lab.bench.report import Report
from acp_lab.bench.runner import sequences_of
from acp_lab.bench.spread import Progress, complete
from acp_lab.errors import ParameterError, TrackingError
from acp_lab.tracking.method import METHODS, Method, method_named
from acp_lab.tracking.method_file import check_writable


@dataclass(frozen=True)
class Workbench:
    """Where everything is.

    Attributes:
        roots: data sets by name, as `protocol.dataset_name` calls them; parts: by the same names, the folder that
            holds their prepared parts.
        runs: folder in which runs are kept; split: the data sets' folder of scenes.

    Raises ParameterError for a data set under another name, or without a folder of prepared parts.
    """

    roots: Mapping[str, Path]
    parts: Mapping[str, Path]
    runs: Path
    split: str = "test"

    def __post_init__(self) -> None:
        for name, root in self.roots.items():
            if name != dataset_name(root):
                raise ParameterError(
                    f"roots[{name!r}] = {root}: call it by the data set's name, {dataset_name(root)!r}"
                )
            if name not in self.parts:
                raise ParameterError(f"parts: has no {name!r}: give the folder that holds its prepared parts")

    @cached_property
    def sequences(self) -> tuple[SequenceKey, ...]:
        """Every object of every scene whose first frame has truth."""
        return tuple(key for root in self.roots.values() for key in sequences_of(root, self.split))

    def compare(
        self,
        methods: Iterable[Method | str],
        sequences: Iterable[SequenceKey],
        variants: Iterable[Variant] = (Variant(),),
        progress: Progress | None = None,
    ) -> Report:
        """Methods on sequences, the first method being what the others are held against.

        Args:
            methods: names, of `METHODS` or of trackers of cv2.rapid, or methods whose stages TOML can tell.

        Raises:
            ParameterError: no method or no sequence is chosen, or two methods have the same name.
            AcpLabError: a method is none, or cannot be written as TOML; or a part is not prepared for it.
        """
        methods, sequences, variants = list(methods), list(sequences), list(variants)
        if not methods:
            raise ParameterError("no method to compare: choose one or more")
        if not sequences:
            raise ParameterError("no sequence to compare on: choose one or more")
        tasks = [
            task_of(self.roots[key.dataset], self.split, self.parts[key.dataset], key, method, variant)
            for method in _by_name(methods).values()
            for key in sequences
            for variant in variants
        ]
        return Report.of(complete(tasks, self.runs, workers=1, progress=progress), "this one")


def _by_name(methods: Iterable[Method | str]) -> dict[str, Method | str]:
    """Each method once, a tracker of cv2.rapid as its name."""
    found: dict[str, Method | str] = {}
    for told in methods:
        if isinstance(told, str) and told not in (*METHODS, *NAMES):
            raise TrackingError(f"method {told}: no such method: there are {', '.join((*METHODS, *NAMES))}")
        method = method_named(told) if isinstance(told, str) and told in METHODS else told
        if isinstance(method, Method):
            check_writable(method)
        name = method if isinstance(method, str) else method.name
        if found.setdefault(name, method) != method:
            raise ParameterError(f"method {name}: two are called so: give one of them another name")
    return found
