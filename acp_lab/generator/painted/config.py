"""Settings of the edge image generator and what is reported about it; light, so that reading a part needs no torch."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from acp_lab.control_points.canonical_frame import CANONICAL_SIZE
from acp_lab.errors import PreparationError
from acp_lab.generator.painted.edge_images import PAINTING_SIZE, EdgeImageConfig
from acp_lab.generator.painted.quality import GenerationQuality

SMALLEST_SIZE = 16
# Narrower fine layers pay for the pixels of a larger picture.
WIDTHS_UP_TO_128 = (64, 64, 48)
WIDTHS_ABOVE_128 = (64, 48, 32)


@dataclass(frozen=True)
class NetworkShape:
    """Sizes of the networks of one region.

    Attributes:
        size: side of the image, px, a multiple of 16.
        latent: length of the latent code.
        widths: channels on the decoder's grids of size/16, size/8 and size/4 cells.
        hidden: width of the two hidden layers of the latent regressor.
    """

    size: int = PAINTING_SIZE
    latent: int = 128
    widths: tuple[int, int, int] = WIDTHS_ABOVE_128
    hidden: int = 256

    def __post_init__(self) -> None:
        if self.size < SMALLEST_SIZE or self.size % 16:
            raise PreparationError(f"edge images of {self.size} px: choose a multiple of 16, such as 128")


@dataclass(frozen=True)
class AutoencoderConfig:
    """Settings of one region's training.

    Attributes:
        images: the training set; shape: the networks, whose image size is that of the training set.
        autoencoder_epochs, latent_epochs, fine_tune_epochs, second_epochs: of the four stages.
        autoencoder_rate, latent_rate, fine_tune_rate: largest learning rates; the second regressor takes the latter
            of stage 2.
        batch: images per step.
    """

    images: EdgeImageConfig = field(default_factory=EdgeImageConfig)
    shape: NetworkShape = field(default_factory=NetworkShape)
    autoencoder_epochs: int = 1
    latent_epochs: int = 1
    fine_tune_epochs: int = 5
    second_epochs: int = 3
    autoencoder_rate: float = 4e-2
    latent_rate: float = 2e-2
    fine_tune_rate: float = 1e-2
    batch: int = 16

    @classmethod
    def as_printed(cls) -> AutoencoderConfig:
        """About 1000 views (paper IV-A) of a region, as we read it, each seen some four times as often."""
        return cls(
            images=EdgeImageConfig(views=1000),
            autoencoder_epochs=2,
            latent_epochs=2,
            fine_tune_epochs=20,
            second_epochs=12,
        )

    def painting(self, size: int) -> AutoencoderConfig:
        """The same for pictures of another size, px, with layers of the usual widths for it, or narrower if they were.

        Lines closer than about two pixels flow into one; larger pictures keep small features apart.
        """
        if size == self.images.size == self.shape.size:
            return self
        widths = _usual_widths(size)
        if self.shape.widths != _usual_widths(self.shape.size):
            coarse, middle, fine = (min(pair) for pair in zip(widths, self.shape.widths, strict=True))
            widths = coarse, middle, fine
        return replace(
            self, images=replace(self.images, size=size), shape=replace(self.shape, size=size, widths=widths)
        )

    @classmethod
    def fast(cls) -> AutoencoderConfig:
        """A third of the printed views, fewer epochs, smaller pictures, for lessons and tests: blurred, not exact."""
        return replace(
            cls.as_printed(),
            images=EdgeImageConfig(size=CANONICAL_SIZE, views=350, held_out=40),
            shape=NetworkShape(size=CANONICAL_SIZE, widths=(64, 48, 24)),
            fine_tune_epochs=16,
        )


def _usual_widths(size: int) -> tuple[int, int, int]:
    return WIDTHS_UP_TO_128 if size <= CANONICAL_SIZE else WIDTHS_ABOVE_128


@dataclass(frozen=True)
class AutoencoderReport:
    """How good one region's generator is on held-out views, jittered where training jitters them.

    Attributes:
        region: 0..5.
        generated: t(I) with the regressed W; mid_section: with that of the middle section.
        reconstructed: the auto-encoder itself, at the end of stage 1.
        autoencoder_loss, latent_loss, fine_tune_loss, second_loss: means over each stage's last epoch; 0 for a stage
            that is switched off.
        train_s: wall seconds, in all runs together.
        bias_percent: ADD of the pose that a painting shows, % of the diameter, the median over held-out views
            (`pose_bias`); None of parts of earlier versions and of edges without 3D points.
    """

    region: int
    generated: GenerationQuality
    mid_section: GenerationQuality
    reconstructed: GenerationQuality
    autoencoder_loss: float
    latent_loss: float
    fine_tune_loss: float
    second_loss: float
    train_s: float
    bias_percent: float | None = None

    @classmethod
    def from_json(cls, values: Mapping[str, Any]) -> AutoencoderReport:
        """The inverse of dataclasses.asdict; raises TypeError or KeyError for anything else."""
        qualities = {name: GenerationQuality(**values[name]) for name in ("generated", "mid_section", "reconstructed")}
        return cls(**{**values, **qualities})
