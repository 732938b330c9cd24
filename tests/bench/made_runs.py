"""Runs with errors that a test chooses."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from acp_lab.bench.protocol import SequenceKey, Variant
from acp_lab.bench.record import Run


def made_run(
    errors: Sequence[float],
    method: str = "acp",
    sequence: SequenceKey | None = None,
    variant: Variant | None = None,
    kind: str = "",
    resets: tuple[int, ...] = (),
    ms: float = 4.0,
) -> Run:
    """A run whose ADD, as a share of the diameter, is given; everything else is plain."""
    count = len(errors)
    poses = np.tile(np.hstack([np.eye(3), [[0.0], [0.0], [500.0]]]), (count, 1, 1))
    return Run(
        method, "state", sequence or SequenceKey("made", 1, 1), variant or Variant(), kind, "ADD",
        tuple(range(1, count + 1)), np.array(errors, float), np.zeros(count), np.zeros(count), np.full(count, ms),
        np.ones(count), poses, resets, (640, 480), 1, 200.0, 12.0, "cpu",
    )  # fmt: skip
