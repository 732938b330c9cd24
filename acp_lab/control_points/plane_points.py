"""Two ways to write four coplanar control points W as a vector that Adam may change (paper IV-C).

Both are in the axes of the box: u and v along the sides of the region's mid-section, a along the region's axis,
each in units of half the box (a plate counts as thicker, as in `region_scores`). The plane is a = o + s u + t v.

- `printed`: the paper's 11 degrees of freedom, the plane's 3 and two for each point's place in the plane.
- `plane`: the plane's 3 alone. The points are the corners of the mid-section, moved along the axis onto it.
  They are all that e_3d depends on: the homography that a plane's motion causes in the image is the same
  whichever four of the plane's points tell it.

**Bounds.** A region's directions fill a pyramid over a face of the box. Seen from along its border, the plane's quad
keeps at least `1 - |s| - |t|` of the area that the mid-section's has there; from as far into the neighbouring regions
as hysteresis goes (15%), `1 - 1.15 (|s| + |t|)`. So `|s| + |t|` stays below `LARGEST_TILT`: more than 0.4 of the
area is left from everywhere, and the quad never turns its back. `|o|` stays below 1, inside the box, and the places in
the plane within `LARGEST_SHIFT` of the corners, so that four points stay a convex quad. (Deviation from the paper,
which has no bounds.)
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
import torch

from acp_lab.cad.part import Part
from acp_lab.control_points.coplanar_points import MIN_SIDE_RATIO, mid_section_points
from acp_lab.control_points.view_regions import ViewRegion

Form = Literal["plane", "printed"]

LARGEST_OFFSET = 1.0
LARGEST_TILT = 0.5
LARGEST_SHIFT = 0.25


@dataclass(frozen=True)
class PlanePoints:
    """The map from parameters to W for one part and region.

    Attributes:
        form: "plane", 3 parameters (o, s, t), or "printed", 11: those and (du, dv) of each point.
        centre_obj: (3,) mm, middle of the box.
        axes_obj: (3, 3) mm; its rows are half the box's sides: u and v, and the depth a.
        corners: (4, 2) the mid-section's corners in units of u and v, 1 or -1 but for plates.
    """

    form: Form
    centre_obj: np.ndarray
    axes_obj: np.ndarray
    corners: np.ndarray

    @classmethod
    def of(cls, part: Part, region: ViewRegion, form: Form) -> PlanePoints:
        """The parametrisation whose zero vector is the part's mid-section of that region."""
        sides = [(region.axis + 1) % 3, (region.axis + 2) % 3]
        half_size = 0.5 * part.box_size
        half_size = np.maximum(half_size, MIN_SIDE_RATIO * float(half_size.max()))
        points = mid_section_points(part.box_min, part.box_max, region.axis)
        corners = ((points - part.box_centre) / half_size)[:, sides]
        return cls(form, part.box_centre, np.diag(half_size)[[*sides, region.axis]], corners)

    def zero(self) -> torch.Tensor:
        """(p,) float64 zeros: the mid-section."""
        return torch.zeros(3 if self.form == "plane" else 11, dtype=torch.float64)

    def bounded(self, parameters: torch.Tensor) -> torch.Tensor:
        """The parameters (p,) put back into the bounds."""
        offset = parameters[:1].clamp(-LARGEST_OFFSET, LARGEST_OFFSET)
        tilts = parameters[1:3]
        tilts = tilts * (LARGEST_TILT / tilts.abs().sum().clamp(min=LARGEST_TILT))
        shifts = parameters[3:].clamp(-LARGEST_SHIFT, LARGEST_SHIFT)
        return torch.cat([offset, tilts, shifts])

    def points_obj(self, parameters: torch.Tensor) -> torch.Tensor:
        """W, (4, 3) mm in the object frame, of parameters (p,); float64 and differentiable."""
        offset, tilts = parameters[0], parameters[1:3]
        # Copies: the part's arrays are read-only, and torch shares only what it may write to.
        places = torch.tensor(self.corners)
        if self.form == "printed":
            places = places + parameters[3:].reshape(4, 2)
        heights = offset + places @ tilts
        local = torch.cat([places, heights[:, None]], dim=1)
        return torch.tensor(self.centre_obj) + local @ torch.tensor(self.axes_obj)
