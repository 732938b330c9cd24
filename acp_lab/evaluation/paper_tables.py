"""The paper's tables and our measurements beside them: numbers to look at, never to compute with.

They come from different images, so a row of one must not be subtracted from a row of another; within a table all
methods saw the same. Paper: Tables I to III. Ours: docs/measured.json, with machine and commands; the
programs of others ran once on the same three public sequences, from the true first pose, without resets.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class MethodRow:
    """One method in one table.

    Attributes:
        name: of the method.
        within_2, within_5: share of the frames whose ADD is below 2 and 5% of the diameter, one per group of
            parts or per sequence; () where it was not given.
        time_ms: per frame, the middle where a range was measured; None where it was not given.
    """

    name: str
    within_2: tuple[float, ...]
    within_5: tuple[float, ...]
    time_ms: float | None = None

    @property
    def mean_2(self) -> float:
        """Mean of `within_2`, NaN without any."""
        return _mean(self.within_2)

    @property
    def mean_5(self) -> float:
        """Mean of `within_5`, NaN without any."""
        return _mean(self.within_5)


@dataclass(frozen=True)
class Table:
    """Methods on the same images. Prints as a table; data: what the images are; columns: the groups."""

    data: str
    columns: tuple[str, ...]
    rows: tuple[MethodRow, ...]

    def __getitem__(self, name: str) -> MethodRow:
        """The row of a method; KeyError for another name."""
        for row in self.rows:
            if row.name == name:
                return row
        raise KeyError(f"{name}: one of {', '.join(row.name for row in self.rows)}")

    def __str__(self) -> str:
        columns = [("method", *(row.name for row in self.rows))]
        for limit in (2, 5):
            for number, group in enumerate(self.columns):
                given = [row.within_2 if limit == 2 else row.within_5 for row in self.rows]
                if any(given):
                    shares = (f"{values[number]:.3f}" if values else "-" for values in given)
                    columns.append((f"@{limit}% {group}", *shares))
        if any(row.time_ms is not None for row in self.rows):
            columns.append(("ms", *("-" if row.time_ms is None else f"{row.time_ms:.1f}" for row in self.rows)))
        widths = [max(map(len, column)) for column in columns]
        lines = (
            "  ".join([row[0].ljust(widths[0]), *(cell.rjust(w) for cell, w in zip(row[1:], widths[1:], strict=True))])
            for row in zip(*columns, strict=True)
        )
        return "\n".join([self.data, *lines])


PAPER_RT_LESS = Table(
    "paper, Table I: RT-Less, metal parts in four groups of rising complexity",
    ("group 1", "group 2", "group 3", "group 4"),
    (
        MethodRow("paper's method", (0.508, 0.488, 0.502, 0.130), (0.934, 0.898, 0.906, 0.688), 88.0),
        MethodRow("RBGT", (0.104, 0.316, 0.244, 0.044), (0.722, 0.774, 0.782, 0.354), 67.0),
        MethodRow("SRT3D", (0.198, 0.420, 0.366, 0.118), (0.798, 0.906, 0.896, 0.510), 42.0),
        MethodRow("GOS", (0.228, 0.268, 0.142, 0.098), (0.810, 0.674, 0.646, 0.328), 99.0),
        MethodRow("SLET", (0.372, 0.384, 0.252, 0.116), (0.826, 0.856, 0.746, 0.532), 72.0),
        MethodRow("GFI", (0.368, 0.310, 0.368, 0.156), (0.840, 0.766, 0.732, 0.656), 256.0),
        MethodRow("STB", (0.206, 0.184, 0.132, 0.032), (0.642, 0.588, 0.440, 0.202), 40.0),
    ),
)

PAPER_T_LESS = Table(
    "paper, Table II: T-Less, parts without texture, not of metal",
    ("group 1", "group 2"),
    (
        MethodRow("paper's method", (), (0.630, 0.624)),
        MethodRow("RBGT", (), (0.558, 0.518)),
        MethodRow("SRT3D", (), (0.696, 0.494)),
        MethodRow("GOS", (), (0.352, 0.516)),
        MethodRow("SLET", (), (0.442, 0.502)),
        MethodRow("DeepAC", (), (0.670, 0.630)),
    ),
)

PAPER_ABLATION = Table(
    "paper, Table III: ablation, two parts of RT-Less",
    ("part 6", "part 18"),
    (
        MethodRow("paper's method", (), (0.900, 0.712)),
        MethodRow("pose instead of control points", (), (0.660, 0.324)),
        MethodRow("control points not regressed", (), (0.884, 0.646)),
    ),
)

METAL_PUBLIC = Table(
    "here: three path-traced sequences of metal parts, 29 frames each",
    ("regular", "hand, light", "occlusion"),
    (
        MethodRow("acp, this toolkit", (1.00, 1.00, 1.00), (1.00, 1.00, 1.00), 2.0),
        MethodRow("SRT3D", (0.83, 0.00, 0.07), (1.00, 0.00, 0.45), 0.7),
        MethodRow("M3T, region", (0.62, 0.00, 0.07), (1.00, 0.00, 0.59), 0.7),
        MethodRow("M3T, region and ORB", (0.72, 0.00, 0.10), (1.00, 0.00, 0.69), 3.2),
        MethodRow("SLET", (0.00, 0.03, 0.62), (0.00, 0.41, 0.93), 27.0),
        MethodRow("GOS, cv2.rapid", (0.00, 0.00, 0.00), (0.00, 0.14, 0.00), 5.0),
    ),
)


def _mean(shares: tuple[float, ...]) -> float:
    return sum(shares) / len(shares) if shares else float("nan")
