"""A training to watch: a bar that fills, the loss in its parts, and what the networks paint by now."""

from __future__ import annotations

import cv2
import ipywidgets
import numpy as np

from acp_lab.generator.painted.quality import comparison_grid
from acp_lab.generator.painted.watch import WatchedEpoch


class ProgressBar(ipywidgets.HBox):
    """A bar with a line of text; call it with (done, total), as trainings do."""

    def __init__(self, title: str = "") -> None:
        self.bar = ipywidgets.IntProgress(0, 0, 1, description=title, style={"description_width": "auto"})
        self.text = ipywidgets.Label("waiting to begin")
        super().__init__([self.bar, self.text])

    def __call__(self, done: int, total: int, text: str = "") -> None:
        """Show that `done` of `total` steps are over; the bar turns green at the end."""
        self.bar.max, self.bar.value = total, done
        self.text.value = text or f"epoch {done} of {total}"
        self.bar.bar_style = "success" if done == total else ""


class LiveTraining(ipywidgets.VBox):
    """Hand it to `train_autoencoder` as `watch`: after every epoch it shows held-out views above what is painted.

    epochs: all that it was shown, in order, for pictures afterwards. picture: the PNG that is on the page.
    """

    def __init__(self) -> None:
        self.epochs: list[WatchedEpoch] = []
        self.progress = ProgressBar()
        self.picture = ipywidgets.Image(format="png", layout=ipywidgets.Layout(width="100%", max_width="1040px"))
        super().__init__([self.progress, self.picture])

    def __call__(self, epoch: WatchedEpoch) -> None:
        """Show one more epoch; the first one of a training clears what an earlier one left."""
        if epoch.done == 1:
            self.epochs = []
        self.epochs.append(epoch)
        self.progress(epoch.done, epoch.total, _in_words(epoch))
        # A column per view: the truth above, the painting below.
        pairs = [np.stack(pair) for pair in zip(epoch.truth, epoch.painted, strict=True)]
        self.picture.value = cv2.imencode(".png", comparison_grid(pairs))[1].tobytes()


def _in_words(epoch: WatchedEpoch) -> str:
    return (
        f"{epoch.stage}, epoch {epoch.epoch} of {epoch.epochs}: held-out loss {epoch.held_out_loss:.3f} "
        f"= BCE {epoch.bce:.3f} + 0.5 · 1/PSNR {epoch.inverse_psnr:.3f}"
    )
