"""A bench in files: CSV, JSON and Markdown. The HTML page, with plots and pictures, is `display.bench_page`."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterable, Iterator, Sequence, Set
from dataclasses import asdict, dataclass
from itertools import groupby
from pathlib import Path
from typing import Any

from acp_lab.bench.basins import FRAME, LIMIT, Basin, basins
from acp_lab.bench.peers import PAPER_TABLES, reported, stands_for
from acp_lab.bench.protocol import Variant
from acp_lab.bench.record import Run
from acp_lab.bench.tables import ALL, LIMITS, Row, table
from acp_lab.evaluation.bootstrap import Interval
from acp_lab.evaluation.metrics import number_cell
from acp_lab.evaluation.paper_tables import Table
from acp_lab.files import write_whole
from acp_lab.sequences.json_file import write_json
from acp_lab.sequences.results_csv import ResultsWriter

HEAD = (
    "method", "sequences", "runs", "@2%", "@5%", "@10%", "AUC %", "5cm5° %", "rot °", "trans mm", "until lost", "lost",
    "resets", "ms", "ms 95%", "MB so far", "prepare s",
)  # fmt: skip
MARKS = {"better": " ▲", "worse": " ▼", "tie": " ="}
LEGEND = (
    "Shares in percent: mean over sequences, 95% bootstrap interval in brackets: drawn are sequences, of each its "
    "starts, and blocks of frames; of a single sequence it says nothing of others. ▲ better, ▼ worse than the first "
    "method, = tie: the interval of the difference, paired by sequence, start and frame, holds 0. rot, trans: medians "
    "over frames. until lost: frames before ADD exceeds 30% of the diameter, mean over runs. ms: CPU of one thread per "
    "frame that is not lost (of outside trackers what their files tell). MB so far: the most that the process had held "
    "by the end of a run, with all that it did before, so it is no method's own. prepare s: CPU of preparing a part "
    "for the method, mean over parts (- where a part was prepared before this was counted)."
)


BASIN_LEGEND = (
    f"Share of runs, in percent, whose ADD(-S) is below {100 * LIMIT:g}% of the diameter in frame {FRAME} after the "
    "start; in brackets its 95% bootstrap interval: drawn are sequences, and of each its starts."
)


@dataclass(frozen=True)
class Report:
    """All of a bench: its runs and the rows made of them. machine: that it ran on, told beside times.

    basins: of convergence, () where no start is off.
    """

    runs: tuple[Run, ...]
    rows: tuple[Row, ...]
    machine: str
    basins: tuple[Basin, ...] = ()

    @classmethod
    def of(cls, runs: Sequence[Run], machine: str) -> Report:
        """The report of some runs; the first one's method is what others are held against."""
        return cls(tuple(runs), table(runs), machine, basins(runs))

    @property
    def methods(self) -> list[str]:
        """Names, in the order of the runs."""
        return list(dict.fromkeys(run.method for run in self.runs))

    def __str__(self) -> str:
        columns = ("method", "runs", "@2%", "@5%", "@10%", "until lost", "ms")
        kept = [HEAD.index(name) for name in columns]
        lines = []
        for group, how, rows in self.blocks():
            table = [HEAD, *(cells(row) for row in rows)]
            widths = [max(len(row[place]) for row in table) for place in kept]
            lines += [f"{group}: {how}"]
            lines += ["  ".join(row[p].ljust(w) for p, w in zip(kept, widths, strict=True)).rstrip() for row in table]
        return "\n".join(lines)

    def blocks(self) -> Iterator[tuple[str, str, list[Row]]]:
        """(group, variant, rows) of each table."""
        for (group, how), rows in groupby(self.rows, key=lambda row: (row.group, str(_shared(row.variant)))):
            yield group, how, list(rows)

    def write(self, folder: Path, given: Iterable[Path] = ()) -> tuple[Path, ...]:
        """bench.csv, bench.json, bench.md, and the poses as results/METHOD__DATASET.csv; these files. InputFileError.

        Poses are those of runs from truth on every frame, without resets: nothing in the file could tell another run.
        given: results files of outside trackers, which stay as they are where they lie in results/ already.
        """
        write_whole(folder / "bench.csv", _csv(self).encode(), "the table")
        told = {"machine": self.machine, "methods": self.methods, "rows": flat_rows(self), "basins": flat_basins(self)}
        write_json(folder / "bench.json", told)
        write_whole(folder / "bench.md", markdown(self).encode(), "the tables")
        return _write_poses(self.runs, folder / "results", {path.resolve() for path in given})


def markdown(report: Report) -> str:
    """All tables in Markdown."""
    lines = ["# Trackers side by side", "", LEGEND, "", f"Machine: {report.machine}", ""]
    for group, how, rows in report.blocks():
        lines += [f"## {group}: {how}", "", f"| {' | '.join(HEAD)} |", "|---" * len(HEAD) + "|"]
        lines += [f"| {' | '.join(cells(row))} |" for row in rows] + [""]
    for group, head, basin_rows in basin_tables(report):
        lines += [f"## {group}: basin of convergence", "", BASIN_LEGEND, "", f"| {' | '.join(head)} |"]
        lines += ["|---" * len(head) + "|"] + [f"| {' | '.join(row)} |" for row in basin_rows] + [""]
    for paper in PAPER_TABLES:
        lines += [f"## {paper.data}", "", "| method | reported @2% | reported @5% | here | @2% | @5% | where from |"]
        lines += ["|---" * 7 + "|"] + [f"| {' | '.join(line)} |" for line in paper_lines(paper, report)] + [""]
    return "\n".join(lines)


def basin_tables(report: Report) -> Iterator[tuple[str, list[str], list[list[str]]]]:
    """(group, head, rows) of each table of basins: a row per method, a column per start."""
    for group in dict.fromkeys(basin.group for basin in report.basins):
        own = [basin for basin in report.basins if basin.group == group]
        columns = sorted({basin.variant.group for basin in own})
        named = {basin.variant.group: str(_shared(basin.variant)) for basin in own}
        rows = []
        for method in dict.fromkeys(basin.method for basin in own):
            by_start = {basin.variant.group: percent(basin.found) for basin in own if basin.method == method}
            rows.append([method, *(by_start.get(column, "-") for column in columns)])
        yield group, ["method", *(named[column] for column in columns)], rows


def flat_basins(report: Report) -> list[dict[str, Any]]:
    """Every basin as plain named values."""
    return [
        {
            "group": basin.group, "step": basin.variant.step, "noise_deg": basin.variant.noise_deg,
            "noise_mm": basin.variant.noise_mm, "method": basin.method, "runs": basin.runs,
            **dict(_interval("found", basin.found)),
        }
        for basin in report.basins
    ]  # fmt: skip


def cells(row: Row) -> list[str]:
    """A row as text, in the order of `HEAD`."""
    marks = [MARKS[verdict] for verdict in row.verdicts] or [""] * len(LIMITS)
    recalls = [percent(interval) + mark for interval, mark in zip(row.recalls, marks, strict=True)]
    scores = row.pooled
    return [
        row.method, str(row.sequences), str(row.runs), *recalls, number_cell(100 * scores.auc_10pct, 1),
        number_cell(100 * scores.cm5deg5, 1), number_cell(scores.rot_deg_median, 2),
        number_cell(scores.trans_mm_median, 2), number_cell(row.until_lost, 1), f"{row.lost}", f"{row.resets}",
        number_cell(row.ms_median, 1), number_cell(row.ms_95, 1), number_cell(row.memory_mb, 0),
        number_cell(row.prepare_s, 1),
    ]  # fmt: skip


def paper_lines(paper: Table, report: Report) -> list[list[str]]:
    """The rows of one of the paper's tables, ours beside: method, reported @2 and @5, ours, its @2 and @5, where from.

    Reported numbers are means over the paper's groups, on the paper's images, and must not be subtracted from ours.
    """
    plain = [row for row in report.rows if row.variant.group == Variant().group and not row.variant.resets]
    group = ALL if any(row.group == ALL for row in plain) else next((row.group for row in plain), "")
    lines = []
    for peer, row in reported(paper):
        ours = stands_for(peer, report.methods)
        found = next((r for r in plain if r.group == group and r.method == ours), None)
        here = ["-", "-", "-"] if found is None else [found.method, *(percent(r) for r in found.recalls[:2])]
        means = [number_cell(100 * mean, 1) for mean in (row.mean_2, row.mean_5)]
        lines.append([peer.name, *means, *here, peer.where])
    return lines


def flat_rows(report: Report) -> list[dict[str, Any]]:
    """Every row as plain named values, None where a number is not known."""
    return [{name: _plain(value) for name, value in _flat(row)} for row in report.rows]


def percent(interval: Interval) -> str:
    """An interval of shares in percent."""
    return f"{100 * interval.mean:.1f} [{100 * interval.low:.1f}, {100 * interval.high:.1f}]"


def _flat(row: Row) -> Iterator[tuple[str, Any]]:
    how = row.variant
    yield from (("group", row.group), ("step", how.step), ("noise_deg", how.noise_deg), ("noise_mm", how.noise_mm))
    yield from (("with_resets", how.resets), ("method", row.method), ("sequences", row.sequences), ("runs", row.runs))
    for limit, interval in zip(LIMITS, row.recalls, strict=True):
        yield from _interval(f"mean_recall_{100 * limit:g}", interval)
    yield from asdict(row.pooled).items()
    yield from (("until_lost_mean", row.until_lost), ("lost_runs", row.lost), ("resets", row.resets))
    yield from (("ms_median", row.ms_median), ("ms_95", row.ms_95), ("memory_mb", row.memory_mb))
    yield "prepare_s", row.prepare_s
    yield from (("width", row.size[0]), ("height", row.size[1]), ("threads", row.threads))
    nothing = Interval(math.nan, math.nan, math.nan)
    for place, limit in enumerate(LIMITS):
        yield from _interval(f"gain_{100 * limit:g}", row.against[place] if row.against else nothing)
        yield f"gain_{100 * limit:g}_is", row.verdicts[place] if row.against else ""


def _interval(name: str, interval: Interval) -> Iterator[tuple[str, float]]:
    yield from ((name, interval.mean), (f"{name}_low", interval.low), (f"{name}_high", interval.high))


def _csv(report: Report) -> str:
    rows, text = flat_rows(report), io.StringIO()
    writer = csv.DictWriter(text, list(rows[0]) if rows else ["group"], lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()


def results_name(method: str, dataset: str) -> str:
    """Of a results file, which `outside.tracker_and_dataset` reads again."""
    return f"{method.replace(' ', '_')}__{dataset}.csv"


def _write_poses(runs: Sequence[Run], folder: Path, given: Set[Path]) -> tuple[Path, ...]:
    """In the BOP results format, of runs from truth on every frame; they serve as --results-from again."""
    by_file: dict[str, list[Run]] = {}
    for run in runs:
        if run.variant == Variant() and not run.sequence.instance:
            by_file.setdefault(results_name(run.method, run.sequence.dataset), []).append(run)
    for name, members in by_file.items():
        if (folder / name).resolve() in given:  # it says more than we read: frames without truth, what its run was
            continue
        with ResultsWriter(folder / name) as results:
            for row in sorted((row for run in members for row in run.rows), key=lambda row: row.key):
                results.append(row)
    return tuple(folder / name for name in by_file)


def _shared(variant: Variant) -> Variant:
    """The variant without its seed."""
    return Variant(variant.step, variant.noise_deg, variant.noise_mm, 0, variant.resets)


def _plain(value: Any) -> Any:
    return None if isinstance(value, float) and not math.isfinite(value) else value
