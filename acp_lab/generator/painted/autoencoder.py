"""The auto-encoder of edge images and its loss (paper IV-A, stage one).

An encoder squeezes an edge image into 128 numbers, the latent code; a decoder paints the image again. The decoder
is the part that tracking needs, so it is the one made to be fast: it works on coarse grids with many channels and
only its last layer spreads 16 channels over 4 x 4 pixels each (pixel shuffle). The paper gives no layers; the
latent size is that of the authors' code, which works at 512 x 512 with strided convolutions.

Convention: images are (b, 1, size, size) float32 in [0, 1]; the decoder gives logits, the sigmoid of which is the
image. Everything lies channels-last in memory, which is twice as fast on a CPU.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn

from acp_lab.generator.painted.config import NetworkShape

PSNR_WEIGHT = 0.5
# Most pixels show no edge: starting there saves the first steps.
DARK_LOGIT = -2.0


class Encoder(nn.Sequential):
    """Edge images (b, 1, size, size) to latent codes (b, latent), of mean 0 and spread 1 over the numbers of each."""

    def __init__(self, shape: NetworkShape) -> None:
        cells = shape.size // 16
        super().__init__(
            nn.PixelUnshuffle(4),
            nn.Conv2d(16, 32, 3, padding=1),
            nn.SiLU(),
            nn.Conv2d(32, 64, 3, padding=1, stride=2),
            nn.SiLU(),
            nn.Conv2d(64, 64, 3, padding=1, stride=2),
            nn.SiLU(),
            nn.Flatten(),
            nn.Linear(64 * cells * cells, shape.latent),
            # A code of known scale is an easier target for the regressor of stage two.
            nn.LayerNorm(shape.latent, eps=1e-8, elementwise_affine=False),
        )
        self.to(memory_format=torch.channels_last)  # type: ignore[call-overload]


class Decoder(nn.Sequential):
    """Latent codes (b, latent) to logits of edge images (b, 1, size, size)."""

    def __init__(self, shape: NetworkShape) -> None:
        cells = shape.size // 16
        coarse, middle, fine = shape.widths
        last = nn.Conv2d(fine, 16, 3, padding=1)
        nn.init.constant_(last.bias, DARK_LOGIT)  # type: ignore[arg-type]
        super().__init__(
            nn.Linear(shape.latent, coarse * cells * cells),
            nn.Unflatten(1, (coarse, cells, cells)),
            nn.SiLU(),
            nn.Conv2d(coarse, 4 * middle, 3, padding=1),
            nn.PixelShuffle(2),
            nn.SiLU(),
            nn.Conv2d(middle, middle, 3, padding=1),
            nn.SiLU(),
            nn.Conv2d(middle, 4 * fine, 3, padding=1),
            nn.PixelShuffle(2),
            nn.SiLU(),
            nn.Conv2d(fine, fine, 3, padding=1),
            nn.SiLU(),
            last,
            nn.PixelShuffle(4),
        )
        self.to(memory_format=torch.channels_last)  # type: ignore[call-overload]


def bce_loss(logits: Tensor, truth: Tensor) -> Tensor:
    """Eq. 2: mean binary cross entropy per pixel, of images given by their logits, which keeps log(0) away."""
    return nn.functional.binary_cross_entropy_with_logits(logits, truth)


def inverse_psnr_loss(images: Tensor, truth: Tensor) -> Tensor:
    """Eq. 3 as printed: -1 / (10 log10 MSE), which is 1/PSNR for images in [0, 1]; the mean over the images.

    It is not `kornia.losses.psnr_loss`, which is -PSNR. Its pole lies at MSE = 1, every pixel wrong.
    """
    mean_square = (images - truth).square().flatten(1).mean(1)
    return (-0.1 / torch.log10(mean_square)).mean()


def autoencoder_loss(logits: Tensor, truth: Tensor) -> Tensor:
    """Eq. 4: l_BCE + 0.5 l_PSNR of images given by their logits (b, 1, h, w)."""
    return bce_loss(logits, truth) + PSNR_WEIGHT * inverse_psnr_loss(torch.sigmoid(logits), truth)
