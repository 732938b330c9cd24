"""The trackers of the paper's tables: where a row of each comes from, or why there is none.

`evaluation.paper_tables` holds what the paper reports of them, on its own images. docs/bench.md says how each is run.
"""

from __future__ import annotations

from dataclasses import dataclass

from acp_lab.evaluation.paper_tables import PAPER_ABLATION, PAPER_RT_LESS, PAPER_T_LESS, MethodRow, Table


@dataclass(frozen=True)
class Peer:
    """A row of the paper's tables.

    Attributes:
        name: as the paper calls it; ours: the method here that stands for it, "" for none.
        outside: beginnings of the names of results files that are taken for it.
        where: where its row comes from, or why there is none.
    """

    name: str
    ours: str
    outside: tuple[str, ...]
    where: str


PEERS = (
    Peer("paper's method", "acp-paper", (), "--methods acp-paper"),
    Peer("pose instead of control points", "direct-6dof", (), "--methods direct-6dof"),
    Peer("control points not regressed", "unoptimised-points", (), "--methods unoptimised-points"),
    Peer("RBGT", "region", ("RBGT",), "--methods region, of the same family; or --results-from RBGT__DATASET.csv"),
    Peer("SRT3D", "region", ("SRT3D",), "--methods region, our own; or --results-from SRT3D__DATASET.csv"),
    Peer("GOS", "GOS", ("GOS",), "--methods GOS, of cv2.rapid (--install-peers); or --results-from GOS__DATASET.csv"),
    Peer("SLET", "slet", ("SLET",), "--methods slet, our own; or --results-from SLET__DATASET.csv"),
    Peer("GFI", "", ("GFI",), "--results-from GFI__DATASET.csv; see docs/bench.md"),
    Peer("STB", "", ("STB",), "--results-from STB__DATASET.csv; see docs/bench.md"),
    Peer("DeepAC", "", ("DeepAC",), "--results-from DeepAC__DATASET.csv; needs a GPU and its weights"),
)
PAPER_TABLES = (PAPER_RT_LESS, PAPER_T_LESS, PAPER_ABLATION)


def peer_of(row: MethodRow) -> Peer:
    """The peer of a row of a paper's table; KeyError for a row of another table."""
    return next(peer for peer in PEERS if peer.name == row.name)


def stands_for(peer: Peer, methods: list[str]) -> str | None:
    """Which of the methods that were run is the peer, its own results before ours; None where none is."""
    for method in methods:
        if any(method == name or method.startswith(f"{name} ") for name in peer.outside):
            return method
    return peer.ours if peer.ours in methods else None


def reported(table: Table) -> list[tuple[Peer, MethodRow]]:
    """The rows of a paper's table with their peers."""
    return [(peer_of(row), row) for row in table.rows]
