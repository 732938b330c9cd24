"""The tables are typed in; what can be checked is that they are whole, and that ours are what was measured."""

from __future__ import annotations

import numpy as np
import pytest

from acp_lab.evaluation.paper_tables import (
    METAL_PUBLIC,
    PAPER_ABLATION,
    PAPER_RT_LESS,
    PAPER_T_LESS,
    MethodRow,
    Table,
)
from benchmarks.measured import load


@pytest.mark.parametrize("table", [PAPER_RT_LESS, PAPER_T_LESS, PAPER_ABLATION, METAL_PUBLIC], ids=lambda t: t.data)
def test_tables_are_whole(table: Table) -> None:
    assert len({row.name for row in table.rows}) == len(table.rows)
    for row in table.rows:
        for shares in (row.within_2, row.within_5):
            assert len(shares) in (0, len(table.columns))
            assert all(0.0 <= share <= 1.0 for share in shares)
        if row.within_2:
            assert all(near <= far for near, far in zip(row.within_2, row.within_5, strict=True))
        assert row.name in str(table)


def test_the_papers_claims_follow_from_its_table() -> None:
    """Best within 2% in the first three groups, GFI in the fourth (paper, section V-B)."""
    for group in range(4):
        best = max(PAPER_RT_LESS.rows, key=lambda row: row.within_2[group])
        assert best.name == ("paper's method" if group < 3 else "GFI")


def test_our_rows_are_the_measured_ones() -> None:
    entries = load()
    scenes = [entries["acp.metal_public"].values[scene] for scene in "123"]
    acp = METAL_PUBLIC["acp, this toolkit"]
    assert acp.within_2 == pytest.approx([scene["@2"] for scene in scenes], abs=0.005)
    assert acp.within_5 == pytest.approx([scene["@5"] for scene in scenes], abs=0.005)
    assert acp.time_ms == pytest.approx(entries["speed.frame.640x512"].values["acp"][0], abs=0.06)
    for name, row in entries["peers.metal_public"].values.items():
        told = METAL_PUBLIC[NAMES[name]]
        assert told.within_2 == tuple(row[f"scene_{scene}"][0] for scene in "123")
        assert told.within_5 == tuple(row[f"scene_{scene}"][1] for scene in "123")
        assert told.time_ms == pytest.approx(np.mean(row["ms"]))


NAMES = {
    "SRT3D": "SRT3D",
    "M3T region": "M3T, region",
    "M3T region and ORB": "M3T, region and ORB",
    "SLET": "SLET",
    "GOS of OpenCV": "GOS, cv2.rapid",
}
"""What the programs are called in the file of measured numbers, and in the table."""


def test_rows_and_printing() -> None:
    table = Table("made", ("a", "b"), (MethodRow("x", (0.2, 0.4), (0.5, 0.7), 3.0), MethodRow("long name", (), (1, 1))))
    assert table["x"].mean_2 == pytest.approx(0.3)
    assert np.isnan(table["long name"].mean_2)
    lines = str(table).splitlines()
    assert lines[0] == "made"
    assert lines[1].split() == ["method", "@2%", "a", "@2%", "b", "@5%", "a", "@5%", "b", "ms"]
    assert lines[3].split() == ["long", "name", "-", "-", "1.000", "1.000", "-"]
    assert len({len(line) for line in lines[1:]}) == 1
    with pytest.raises(KeyError, match="one of x, long name"):
        table["y"]
    assert "@2%" not in str(PAPER_ABLATION), "columns that nobody gave are left out"
