"""Numbers in Markdown and notebooks: each is marked with where it comes from, and checked against it.

A mark is an HTML comment, which neither GitHub nor JupyterLab shows. It stands behind the numbers that it is about:

    95%<!-- m: acp.metal_public/all/@2 --> of the frames           a measured number: docs/measured.json
    0.95 / 1.00 / 1.00<!-- m: acp.metal_public/all/@* -->          several: as many as the entry has there
    1.00 and 0.90<!-- m: acp.metal_public/1/@2; acp.metal_public/2/@2 -->          from several places
    alpha is 5%<!-- c: acp_lab.tracking.schedule.ShareSchedule.alpha --> a setting: a value in the code
    a tilt of 12 degrees<!-- not measured: setting -->             excuses all numbers of this block; see KINDS

`<!-- m: acp.metal_public/*/@*+ms -->` on a line of its own before a table is about the table: its rows are those of the
entry, in their order, and the last numbers of each row are the values; numbers before them are labels.
`<!-- not measured: KIND -->` on a line of its own excuses everything up to the next heading, before the first one the
whole text.

`python -m benchmarks.quotes` lists what differs and what has no mark; `--write` corrects the digits that differ.
"""

from __future__ import annotations

import argparse
import importlib
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.measured import ROOT, Entry, MeasuredError, load, rows_of

KINDS = {
    "definition": "a threshold, a unit, a convention, a formula",
    "setting": "what a reader, an exercise or an option chooses",
    "data": "what the data are, as their recipe or their maker says",
    "paper": "from the paper or another publication",
    "arithmetic": "follows from the numbers beside it",
    "advice": "a rule of thumb for the reader",
}
"""Why a number may stand without an entry."""

NUMBER = re.compile(r"(?<![\w.^])(?:(?<![^\s(|])[-+−])?(?:\d+(?:\.\d+)?|\.\d+)(?:e-?\d+)?(?!\w|\.\d)")
UNIT = r"\s?(?:%|°|(?:ms|mm|px|s|dB|MB|GB|degrees?|seconds?|minutes?|hours?)\b)"
AHEAD = re.compile(rf"{UNIT}|(?:,| to| and| or| ?/) ?{NUMBER.pattern}{UNIT}| of \d")
"""Behind a number that looks measured: a unit, at once or after a second number; or "of" so many."""

DEFINED = re.compile(
    r"@\s?\d+%?(?: ?/ ?@?\d+%?)*"  # @2%, @2 / 5 / 10%: names of scores
    r"|(?:within|below|above|at) (?:2|5|10|30)%(?:(?:,| and| or| /) (?:2|5|10)%?)*"  # their limits in words
    r"|(?:<|≤) ?(?:2|5|10)%"
    r"|5 ?cm ?(?:and )?5 ?°"
    r"|\b\d+ ?[x×] ?\d+\b|[Pp]ython \d\.\d+|Apache-2\.0"
)
"""Numbers that are names; they need no mark."""

HIDDEN = re.compile(
    r"\$\$[^$]*\$\$|\$[^$\n]+\$|``.*?``|`[^`\n]*`|\]\([^)\s]*\)|\bhttps?://\S+|"
    r"\b(?:[Ee]qs?\.|[Ff]igs?\.|[Tt]able|[Ss]ections?|[Nn]otebooks?|[Ee]xercises?) [\dIVX.]+(?:(?:,| and| to) \d+)*"
    r"|\*\*\d\d\.\d\*\*|^#.*$",
    re.MULTILINE,
)
"""Code, formulas, addresses, references by number, headings: never quotes."""

COMMENT = re.compile(r"<!--\s*(?P<kind>m|c|not measured):\s*(?P<what>.*?)\s*-->", re.DOTALL)
ALONE = re.compile(rf"^{COMMENT.pattern}$")
PAPER_COLUMN = re.compile(r"^\s*(the )?paper\b|^\s*authors' code", re.IGNORECASE)


@dataclass(frozen=True)
class Problem:
    """Something about one block of a text: where, what, and the digits that would be right (None: cannot say)."""

    where: str
    what: str

    def __str__(self) -> str:
        return f"{self.where}: {self.what}"


@dataclass(frozen=True)
class Block:
    """A paragraph, list item, heading or table row.

    Attributes:
        start: its first character in the text.
        text: as written.
        line: its first line, from 1.
        rows: of the table mark that it falls under, else None: (value, unit) per number.
        excused: under a section's `not measured`.
        paper_columns: cells of a table row that quote the paper.
    """

    start: int
    text: str
    line: int
    rows: list[tuple[float, str]] | None = None
    excused: bool = False
    paper_columns: tuple[int, ...] = ()


def blocks(text: str, entries: dict[str, Entry]) -> Iterator[Block | Problem]:
    """Cut a Markdown text into blocks; fenced code is left out. Problems: tables that do not fit their mark."""
    start = 0
    open_block: list[str] = []
    block_start = block_line = 0
    fenced = excused = excused_all = seen_heading = False
    table_mark: str | None = None
    rows: list[list[tuple[float, str]]] | None = None
    paper: tuple[int, ...] = ()
    table_lines = 0

    def closed() -> Iterator[Block]:
        if open_block:
            yield Block(block_start, "".join(open_block), block_line, excused=excused)
            open_block.clear()

    for line, raw in enumerate([*text.splitlines(keepends=True), "\n"], start=1):
        stripped = raw.strip()
        in_table = stripped.startswith("|")
        if table_lines and not in_table:
            if rows:
                yield Problem(f"line {line}", f"the table has fewer rows than {table_mark}: {len(rows)} are left")
            table_lines, rows, table_mark, paper = 0, None, None, ()
        if stripped.startswith("```"):
            yield from closed()
            fenced = not fenced
        elif fenced:
            pass
        elif not stripped:
            yield from closed()
        elif alone := ALONE.match(stripped):
            yield from closed()
            if alone["kind"] == "m":
                table_mark = alone["what"]
            elif alone["what"] in KINDS:
                excused, excused_all = True, not seen_heading
            else:
                yield Problem(f"line {line}", f"not measured: {alone['what']}: one of {', '.join(KINDS)}")
        elif in_table:
            yield from closed()
            table_lines += 1
            if table_lines == 1:
                cells = stripped.strip("|").split("|")
                paper = tuple(number for number, cell in enumerate(cells) if PAPER_COLUMN.match(cell))
                if table_mark is not None:
                    try:
                        rows = [row for path in table_mark.split(";") for row in rows_of(entries, path.strip())]
                    except MeasuredError as error:
                        yield Problem(f"line {line}", str(error))
            elif table_lines > 2:
                if rows is not None and not rows:
                    yield Problem(f"line {line}", f"the table has more rows than {table_mark}")
                yield Block(start, raw, line, rows.pop(0) if rows else None, excused, paper)
        else:
            is_heading = stripped.startswith("#")
            if is_heading:
                excused, seen_heading = excused_all, True
            if is_heading or re.match(r"([-*]|\d+\.) ", stripped):
                yield from closed()
            if not open_block:
                block_start, block_line = start, line
            open_block.append(raw)
            if is_heading:
                yield from closed()
        start += len(raw)
    yield from closed()


def code_value(path: str) -> list[float]:
    """The numbers behind "acp_lab.module.Class.attribute": a constant or a dataclass's default."""
    words = path.split(".")
    for count in range(len(words) - 1, 0, -1):
        try:
            found: Any = importlib.import_module(".".join(words[:count]))
        except ModuleNotFoundError:
            continue
        for word in words[count:]:
            fields = getattr(found, "__dataclass_fields__", {})
            if isinstance(found, type) and word in fields and not hasattr(found, word):
                found = fields[word].default_factory()
            elif hasattr(found, word):
                found = getattr(found, word)
            else:
                raise MeasuredError(f"{path}: there is no {word}")
        return [float(number) for number in (found if isinstance(found, tuple | list) else [found])]
    raise MeasuredError(f"{path}: no such module")


def shown(value: float, unit: str, printed: str, is_percent: bool) -> str:
    """`value` as it would be printed in place of `printed`, with as many decimals."""
    scaled = 100.0 * value if is_percent and (unit.startswith("share") or not unit) else value
    if "e" in printed:
        decimals = len(printed.partition("e")[0].partition(".")[2])
        return re.sub(r"e([+-]?)0*(\d)", lambda m: f"e{m[1].replace('+', '')}{m[2]}", f"{scaled:.{decimals}e}")
    decimals = len(printed.partition(".")[2])
    text = f"{scaled:.{decimals}f}"
    if float(text) == 0.0:
        # A bare 0 says that there is nothing, and is corrected where there is something.
        text = text.lstrip("-") if decimals or scaled == 0.0 else f"{scaled:.1g}"
    if printed.startswith("."):
        text = text.replace("0.", ".", 1)
    return "+" + text if printed.startswith("+") and not text.startswith("-") else text


def check(text: str, entries: dict[str, Entry]) -> tuple[list[Problem], str]:
    """Problems of a Markdown text, and the text with the digits that differ corrected."""
    problems: list[Problem] = []
    corrections: list[tuple[int, int, str]] = []
    for block in blocks(text, entries):
        if isinstance(block, Problem):
            problems.append(block)
            continue
        where = f"line {block.line}"
        free = DEFINED.sub(_blank, COMMENT.sub(_blank, HIDDEN.sub(_blank, block.text)))
        numbers = list(NUMBER.finditer(free))
        quoted: set[int] = set()
        excused = block.excused
        begin = 0
        marks: list[tuple[str, list[re.Match[str]], str, str]] = []
        for mark in COMMENT.finditer(block.text):
            before = [number for number in numbers if begin <= number.start() < mark.start()]
            begin = mark.end()
            marks.append((mark["kind"], before, mark["what"], mark[0]))
        if block.rows is not None:
            marks.append(("row", numbers, "", "the table's entry"))
        for kind, before, what, source in marks:
            try:
                if "--" in what:
                    raise MeasuredError(f"{source} has two hyphens inside, and GitHub then shows it: rename the row")
                values = block.rows if kind == "row" else _values(kind, what, entries)
                excused = excused or kind == "not measured"
                for match, right in _compared(before, values or [], free, source):
                    quoted.add(match.start())
                    if float(right) != float(match[0].replace("−", "-")):
                        problems.append(Problem(where, f"{match[0]} is {right} in {source}"))
                        corrections.append((block.start + match.start(), block.start + match.end(), right))
            except MeasuredError as error:
                problems.append(Problem(where, str(error)))
        labels_end = min(quoted, default=0) if block.rows is not None else 0
        if not excused:
            unnamed = _without_cells(free, block.paper_columns)
            problems += [
                Problem(where, f"{match[0]} has no mark: {_around(block.text, match)}")
                for match in NUMBER.finditer(unnamed)
                if match.start() not in quoted and match.start() >= labels_end and _looks_measured(match, unnamed)
            ]
    for first, last, digits in sorted(corrections, reverse=True):
        text = text[:first] + digits + text[last:]
    return problems, text


def _values(kind: str, what: str, entries: dict[str, Entry]) -> list[tuple[float, str]]:
    """(value, unit) of all that a mark names. Raises MeasuredError for what is not there."""
    if kind == "not measured":
        if what not in KINDS:
            raise MeasuredError(f"not measured: {what}: give one of {', '.join(KINDS)}")
        return []
    paths = [path.strip() for path in what.split(";")]
    if kind == "c":
        return [(value, "") for path in paths for value in code_value(path)]
    return [pair for path in paths for row in rows_of(entries, path) for pair in row]


def _compared(
    found: list[re.Match[str]], values: list[tuple[float, str]], text: str, source: str
) -> Iterator[tuple[re.Match[str], str]]:
    """The last numbers found, each with the digits that belong there. Raises MeasuredError for too few numbers."""
    if len(found) < len(values):
        raise MeasuredError(f"{source} has {len(values)} numbers, and {len(found)} stand before it")
    for match, (value, unit) in zip(found[len(found) - len(values) :], values, strict=True):
        is_percent = re.match(r"(?:(?: ?/| to| and| or|,) ?[\d.]+)*\s?%", text[match.end() :]) is not None
        yield match, shown(value, unit, match[0].replace("−", "-"), is_percent)


def _looks_measured(number: re.Match[str], text: str) -> bool:
    return not number[0].lstrip("-+−").isdigit() or AHEAD.match(text, number.end()) is not None


def _blank(found: re.Match[str]) -> str:
    return " " * len(found[0])


def _without_cells(row: str, columns: tuple[int, ...]) -> str:
    """A table row with some of its cells blanked."""
    if not columns:
        return row
    cells = row.split("|")
    first = 1 if row.lstrip().startswith("|") else 0
    return "|".join(
        " " * len(cell) if number - first in columns else cell for number, cell in enumerate(cells)
    )


def _around(text: str, match: re.Match[str]) -> str:
    return " ".join(text[max(0, match.start() - 40) : match.end() + 30].split())


def documents() -> list[Path]:
    """What quotes numbers: README, docs, the notebooks and their solutions."""
    found = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md")), ROOT / "benchmarks" / "README.md"]
    notebooks = ROOT / "notebooks"
    books = (path for path in sorted(notebooks.rglob("[0-9][0-9]_*.ipynb")) if ".ipynb_checkpoints" not in path.parts)
    return [*found, notebooks / "README.md", *books]


def check_file(path: Path, entries: dict[str, Entry], write: bool = False) -> list[Problem]:
    """Problems of a Markdown file or of a notebook's Markdown cells; with `write`, differing digits are corrected."""
    name = str(path.relative_to(ROOT))
    if path.suffix != ".ipynb":
        text = path.read_text(encoding="utf-8")
        problems, corrected = check(text, entries)
        if write and corrected != text:
            path.write_text(corrected, encoding="utf-8")
        return [Problem(f"{name}, {problem.where}", problem.what) for problem in problems]
    import nbformat

    notebook = nbformat.read(path, as_version=4)
    everything = []
    for number, cell in enumerate(notebook.cells):
        if cell.cell_type == "markdown":
            problems, cell.source = check(cell.source, entries)
            everything += [Problem(f"{name}, cell {number}, {found.where}", found.what) for found in problems]
    if write:
        path.write_text(nbformat.writes(notebook) + "\n", encoding="utf-8")
    return everything


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description="Compare the numbers in documents with where they come from.")
    parser.add_argument("--write", action="store_true", help="correct the digits that differ")
    options = parser.parse_args()
    entries = load()
    problems = [problem for path in documents() for problem in check_file(path, entries, options.write)]
    print("\n".join(map(str, problems)) or "every number is where it comes from")
    if problems and not options.write:
        raise SystemExit(1)


if __name__ == "__main__":
    main()
