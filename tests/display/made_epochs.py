"""Epochs of a training that never happened: one vertical line, painted brighter or darker."""

from __future__ import annotations

import numpy as np

from acp_lab.generator.painted.watch import STAGE_NAMES, WatchedEpoch

TRUTH = np.zeros((3, 16, 16), np.float32)
TRUTH[:, :, 8] = 1.0


def epoch(done: int, stage: int = 0, bright: float = 0.5) -> WatchedEpoch:
    bce = 1.0 / done
    return WatchedEpoch(
        STAGE_NAMES[stage], done, 4, done, 4, 0.3, TRUTH, np.float32(bright) * TRUTH, bce, 0.1, bce + 0.05
    )
