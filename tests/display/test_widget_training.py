"""The widgets that show a training as it runs."""

from __future__ import annotations

import cv2
import numpy as np

from acp_lab.display.widgets import LiveTraining, ProgressBar
from tests.display.made_epochs import epoch


def test_live_training_follows_and_begins_anew() -> None:
    live = LiveTraining()
    for done in (1, 2, 3, 4):
        live(epoch(done, bright=0.25 * done))
    assert [seen.done for seen in live.epochs] == [1, 2, 3, 4]
    assert (live.progress.bar.value, live.progress.bar.max, live.progress.bar.bar_style) == (4, 4, "success")
    assert live.progress.text.value == (
        "auto-encoder, epoch 4 of 4: held-out loss 0.300 = BCE 0.250 + 0.5 · 1/PSNR 0.100"
    )
    picture = cv2.imdecode(np.frombuffer(live.picture.value, np.uint8), cv2.IMREAD_GRAYSCALE)
    assert picture.shape == (2 * 18 - 2, 3 * 18 - 2)
    assert picture[5, 8] == picture[5 + 18, 8] == 255
    live(epoch(1))
    assert [seen.done for seen in live.epochs] == [1]
    assert live.progress.bar.bar_style == ""


def test_a_plain_bar_counts_epochs() -> None:
    bar = ProgressBar("visibility network")
    assert bar.text.value == "waiting to begin"
    bar(3, 20)
    assert (bar.bar.value, bar.bar.max, bar.text.value) == (3, 20, "epoch 3 of 20")
