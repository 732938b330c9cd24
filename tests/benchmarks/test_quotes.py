"""Marks behind numbers: what they compare, what they let through, what they refuse."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from benchmarks import measured
from benchmarks.measured import Entry, MeasuredError, rows_of
from benchmarks.quotes import blocks, check, code_value

ENTRY = Entry(
    about="made up",
    unit={"@*": "share of frames", "ms": "ms", "offset": "px"},
    command="python -m nothing",
    data="none",
    commit="0000000",
    machine="none",
    date="2026-01-01",
    values={
        "1": {"@2": 0.954, "@5": 1.0, "ms": 8.84},
        "2": {"@2": 0.0, "@5": 0.5, "ms": 12.0},
        "list": [0.25, -9.5],
        "tiny": 3.06e-7,
    },
)
ENTRIES = {"made": ENTRY}


def said(text: str) -> list[str]:
    return [problem.what for problem in check(text, ENTRIES)[0]]


@pytest.mark.parametrize(
    "text",
    [
        "It is 95%<!-- m: made/1/@2 --> here.",
        "It is 0.95<!-- m: made/1/@2 -->, then 0.954<!-- m: made/1/@2 -->.",
        "@2 / 5%: 0.95 / 1.00<!-- m: made/1/@* -->",
        "95 / 100%<!-- m: made/1/@* -->",
        "8.8 ms<!-- m: made/1/ms --> and 9 ms<!-- m: made/1/ms -->",
        "between .25 and -9.5<!-- m: made/list -->",
        "from 9 to 12 ms<!-- m: made/1/ms; made/2/ms -->",
        "slope 3e-7<!-- m: made/tiny -->",
        "over\ntwo lines 8.8 ms\n<!-- m: made/1/ms --> of one paragraph",
        "a limit of 7 mm<!-- not measured: setting -->",
        "<!-- not measured: data -->\n\n# All\n\nIt shows 3.4 mm.\n\n## More\n\nAnd 4 mm.",
        "# One\n<!-- not measured: data -->\n\nIt shows 3.4 mm.\n\nAnd 4 mm.",
        "alpha 5%<!-- c: acp_lab.evaluation.bootstrap.LIMIT_OF_A_TEST -->",
        "within 2% and below 30%, @2 / 5 / 10%, 5cm5°",
        "`alpha = 0.07`, $0.5\\,x$, eq. 4.2, [a link](a/0.7.md), 640x512, 20 sequences\n\n```\n3.5 px\n```",
        "| the paper | here |\n|---|---|\n| 88 ms | nothing |",
        "8.8 ms at 0.95<!-- m: made/1/ms+@2 -->",
        "<!-- m: made/?/@* -->\n\n| mm off | @2% | @5% |\n|---|---|---|\n| 0.5 mm | 0.95 | 1.00 |\n| 2 | 0.00 | 0.50 |",
        "<!-- m: made/?/@* -->\n\n| scene | @2% | @5% |\n|---|---|---|\n| 1 | 0.95 | 1.00 |\n| 2 | 0.00 | 0.50 |",
    ],
)
def test_good(text: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("acp_lab.evaluation.bootstrap.LIMIT_OF_A_TEST", 0.05, raising=False)
    assert said(text) == []


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("It is 94%<!-- m: made/1/@2 --> here.", "94 is 95"),
        ("It is 0.96<!-- m: made/1/@2 -->.", "0.96 is 0.95"),
        ("8.9 ms<!-- m: made/1/ms -->", "8.9 is 8.8"),
        ("0.95 / 0.99<!-- m: made/1/@* -->", "0.99 is 1.00"),
        ("9.5<!-- m: made/list -->", "has 2 numbers, and 1 stand before it"),
        ("-9.4 and 0.25<!-- m: made/list -->", "-9.4 is 0.2"),
        ("between 0 and -9.5<!-- m: made/list -->", "0 is 0.2"),
        ("4e-7<!-- m: made/tiny -->", "4e-7 is 3e-7"),
        ("0.95<!-- m: made/3/@2 -->", "has no row '3'"),
        ("0.95<!-- m: made/1/@3 -->", "has no field '@3'"),
        ("0.95<!-- m: other -->", "no entry 'other'"),
        ("7 mm<!-- not measured: hunch -->", "hunch: give one of"),
        ("7 mm<!-- c: acp_lab.nowhere.X -->", "there is no nowhere"),
        ("0.95<!-- m: made/--fast/@2 -->", "two hyphens"),
        ("It takes 8 ms.", "8 has no mark"),
        ("It takes 8 to 9 ms.", "8 has no mark"),
        ("95% of the frames", "95 has no mark"),
        ("0.95 of the frames", "0.95 has no mark"),
        ("never lost in 30 of 30", "30 has no mark"),
        ("- an item of 3 mm<!-- not measured: setting -->\n- another of 4 mm", "4 has no mark"),
        ("# One\n<!-- not measured: data -->\n\n3 mm\n\n# Next\n\n4 mm", "4 has no mark"),
        ("| here | the paper |\n|---|---|\n| 88 ms | 3 |", "88 has no mark"),
        ("<!-- m: made/1/@2 -->\n\n| a | b |\n|---|---|\n| 0.95 | 3 mm |", "3 is 1"),
        ("<!-- m: made/?/@2 -->\n\n| a |\n|---|\n| 0.95 |", "fewer rows"),
        ("<!-- m: made/1/@2 -->\n\n| a |\n|---|\n| 0.95 |\n| 0.95 |", "more rows"),
        ("<!-- m: made/?/@2 -->\n\n| a |\n|---|\n| 0.95 |\n| 0.10 |", "0.10 is 0.00"),
    ],
)
def test_problem(text: str, problem: str) -> None:
    assert any(problem in what for what in said(text)), said(text)


def test_digits_are_corrected_where_they_differ() -> None:
    text = "3.5 px<!-- not measured: data --> and 1%, 7.1 ms<!-- m: made/1/@2; made/1/ms --> once"
    assert check(text, ENTRIES)[1] == text.replace("1%, 7.1", "95%, 8.8")


def test_a_setting_is_compared_with_the_code() -> None:
    assert code_value("acp_lab.tracking.states.StateConfig.patience") == [2.0]
    assert code_value("acp_lab.tracking.method.Method.states.patience") == [2.0], "a default made by a factory"
    with pytest.raises(MeasuredError, match="there is no patients"):
        code_value("acp_lab.tracking.states.StateConfig.patients")


def test_blocks_end_where_markdown_ends_them() -> None:
    text = "# A\none\ntwo\n\n- item\n  goes on\n- next\n| a |\n|---|\n| row |\nend\n"
    found = [block.text for block in blocks(text, ENTRIES) if not hasattr(block, "what")]
    assert found == ["# A\n", "one\ntwo\n", "- item\n  goes on\n", "- next\n", "| row |\n", "end\n"]


def test_file_keeps_entries_and_their_order(tmp_path: Path) -> None:
    path = tmp_path / "measured.json"
    measured.save({"b": ENTRY, "a": ENTRY}, path)
    assert list(json.loads(path.read_text())) == ["a", "b"]
    assert measured.load(path) == {"a": ENTRY, "b": ENTRY}
    assert len(path.read_text().splitlines()) == 2 * (len(ENTRY.values) + 11) + 2, "a row of values on a line"


def test_entry_without_its_source_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "measured.json"
    path.write_text('{"a": {"values": {"x": 1}}}')
    with pytest.raises(MeasuredError, match="command"):
        measured.load(path)


def test_recording_notes_where_numbers_come_from(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "measured.json"
    monkeypatch.setattr("sys.argv", ["x", "/somewhere/data set", "docs/x", "--seeds", "3", "--record", "key"])
    measured.record("key", "made up", "px", "none", {"a": {"b": 1.23456789, "n": 3}}, path)
    entry = measured.load(path)["key"]
    assert entry.values == {"a": {"b": 1.2346, "n": 3}}
    assert entry.command.endswith("data set docs/x --seeds 3 --record key")
    assert "/somewhere" not in entry.command


def test_units_follow_fields() -> None:
    assert rows_of(ENTRIES, "made/1") == [[(0.954, "share of frames"), (1.0, "share of frames"), (8.84, "ms")]]
    assert rows_of(ENTRIES, "made/?/ms") == [[(8.84, "ms")], [(12.0, "ms")]]
