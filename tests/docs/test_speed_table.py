"""The table of stages in docs/benchmark.md: marks compare digits in an entry's order, so its rows have to be in it."""

from __future__ import annotations

from benchmarks import measured

KEY = "speed.stages.640x512"


def test_each_row_has_the_name_of_its_number() -> None:
    text = (measured.ROOT / "docs" / "benchmark.md").read_text(encoding="utf-8")
    table = text.split(f"<!-- m: {KEY} -->", 1)[1].lstrip().split("\n\n", 1)[0]
    told = [line.split("|")[1].strip() for line in table.splitlines()[2:]]
    stages = list(measured.load()[KEY].values)
    assert len(told) == len(stages)
    for name, stage in zip(told, stages, strict=True):
        assert name.startswith(stage), f"{name}: the number beside it is of {stage}"
