"""From control points to the latent code (paper IV-A, stage two): a small MLP of eight numbers.

The eight coordinates are made comparable first. Scaling each by itself would not do: what distinguishes a part turned
left from one turned right is a small trapezoid in a quad that is otherwise the same, a difference of differences. So
they are turned to their principal axes and each of these is scaled to spread 1 (whitening), a fixed linear map.
"""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor, nn

from acp_lab.generator.painted.config import NetworkShape

# Canonical px: an axis along which training varied less than this is not amplified further.
LEAST_SPREAD_PX = 0.05


class LatentRegressor(nn.Module):
    """Control points (b, 8), canonical px in the order x1, y1, ..., y4, to latent codes (b, latent)."""

    centre: Tensor
    axes: Tensor

    def __init__(self, shape: NetworkShape) -> None:
        super().__init__()
        self.register_buffer("centre", torch.zeros(8))
        self.register_buffer("axes", torch.eye(8))
        self.layers = nn.Sequential(
            nn.Linear(8, shape.hidden),
            nn.SiLU(),
            nn.Linear(shape.hidden, shape.hidden),
            nn.SiLU(),
            nn.Linear(shape.hidden, shape.latent),
        )

    def standardise(self, control_points: np.ndarray) -> None:
        """Set the whitening from typical training control points (n, 8) px."""
        centre = control_points.mean(0)
        variances, directions = np.linalg.eigh(np.cov(control_points.T))
        spread = np.sqrt(np.maximum(variances, LEAST_SPREAD_PX**2))
        self.centre.copy_(torch.from_numpy(centre))
        self.axes.copy_(torch.from_numpy(directions / spread))

    def forward(self, control_points: Tensor) -> Tensor:
        """See the class."""
        latent: Tensor = self.layers((control_points - self.centre) @ self.axes)
        return latent
