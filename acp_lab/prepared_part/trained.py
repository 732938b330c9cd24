"""What was trained, one thing per view region, together with how it was trained and how good it became."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, Generic, TypeVar

T = TypeVar("T")
R = TypeVar("R")


@dataclass(frozen=True, eq=False)
class Trained(Mapping[int, T], Generic[T, R]):
    """A mapping from view region 0..5 to what was trained for it; regions that were not trained are no keys.

    Attributes:
        by_region: what was trained.
        reports: about each region, in the order of training.
        settings: identifies the settings, on one line; the same for all regions.
    """

    by_region: Mapping[int, T] = field(default_factory=dict)
    reports: Mapping[int, R] = field(default_factory=dict)
    settings: str = ""

    def __getitem__(self, region: int) -> T:
        return self.by_region[region]

    def __iter__(self) -> Iterator[int]:
        return iter(self.by_region)

    def __len__(self) -> int:
        return len(self.by_region)

    @property
    def regions(self) -> tuple[int, ...]:
        """The view regions that were trained, ascending."""
        return tuple(sorted(self.by_region))

    def with_region(self, region: int, value: T, report: R) -> Trained[T, R]:
        """The same with one more region."""
        return Trained({**self.by_region, region: value}, {**self.reports, region: report}, self.settings)

    def under(self, settings: str) -> Trained[T, R]:
        """The same if it was trained with these settings, else nothing yet, to be trained with them."""
        return self if self.settings == settings else Trained(settings=settings)


@dataclass(frozen=True)
class RegionReport:
    """Held-out quality of one region's visibility network, as stored in part.json."""

    region: int
    precision: float
    recall: float
    hidden_found: float
    final_loss: float
    train_s: float


RegressionValues = Mapping[str, Any]
"""What the regression did to the control points of a region, as numbers by name."""
