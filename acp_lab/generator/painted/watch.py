"""What an observer of a training sees: after each epoch its loss, and what the networks paint by then.

Painted are the first held-out views, the same in every epoch: in stage 1 from their own edge images, the
reconstructions, from stage 2 on from their control points, which is t(I).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from acp_lab.geometry.arrays import Float32Array

STAGE_NAMES = ("auto-encoder", "latent regressor", "fine-tuning", "second regressor")


@dataclass(frozen=True, eq=False)
class WatchedEpoch:
    """The state of a training after one of its epochs.

    Attributes:
        stage: one of STAGE_NAMES.
        epoch, epochs: counted from 1, within the stage; done, total: of all stages.
        loss: mean over the epoch's batches: eq. 4, or of codes the mean square error (latent and second regressor).
        truth, painted: (k, size, size) held-out edge images and what is painted for them.
        bce, inverse_psnr, held_out_loss: eqs 2, 3 and 4 of these.
    """

    stage: str
    epoch: int
    epochs: int
    done: int
    total: int
    loss: float
    truth: Float32Array
    painted: Float32Array
    bce: float
    inverse_psnr: float
    held_out_loss: float


Watch = Callable[[WatchedEpoch], None]
