"""Settings of the detector; lengths in px count on images in which the part's diameter is `scan_px` or `search_px`."""

from __future__ import annotations

from dataclasses import dataclass, replace

from acp_lab.errors import AcpLabError
from acp_lab.geometry.camera import Camera

USUAL_DEPTHS_MM = 250.0, 1200.0
"""Of a part on a table before a camera: looked at, however large it appears there."""
LARGEST_SHARE, LEAST_PX = 0.5, 120.0
"""At other distances it is looked for where it appears so large, see `usual_depths_mm`."""
_LEAST_SHARE, _FEWEST_VERIFIED = 0.01, 6
SEARCH_SAMPLES = 80
"""Edge samples that a stored view keeps; a template has some of them."""


@dataclass(frozen=True)
class DetectionConfig:
    """How a part is looked for; the defaults are the same for every part and image.

    Attributes:
        depth_mm: nearest and farthest distance of the part's centre along the optical axis; None for `usual_depths_mm`.
        view_subdivisions: of the icosphere of views, 2 for 162, 3 for 642.
        turns: in-plane turns of each view.
        depth_step: ratio of neighbouring levels of the pyramid.
        scan_px, search_px: diameter of the part in the images that are scanned and searched.
        features: edge points of a template. spread_px: how far from an image edge they still count.
        length_power: a template's mean response counts times its visible length to this power.
        starts: candidates of the scan whose poses are searched.
        kept: of these, after each round of the search.
        verified: distinct poses whose evidence is looked at.
    """

    depth_mm: tuple[float, float] | None = None
    view_subdivisions: int = 2
    turns: int = 24
    depth_step: float = 1.15
    scan_px: float = 64.0
    search_px: float = 100.0
    features: int = 48
    spread_px: float = 4.0
    length_power: float = 0.35
    starts: int = 4000
    kept: tuple[int, ...] = (1300, 450)
    verified: int = 240

    def __post_init__(self) -> None:
        near, far = self.depth_mm or USUAL_DEPTHS_MM
        if not 0.0 < near <= far < float("inf"):
            raise AcpLabError(f"depth range {near:g} to {far:g} mm: give two distances, 0 < nearest <= farthest")
        if not 0.0 < self.spread_px <= 30.0:  # distances are kept in two bytes
            raise AcpLabError(f"spread_px = {self.spread_px:g}: give px above 0, at most 30")
        if not 1 <= self.features <= SEARCH_SAMPLES:
            raise AcpLabError(f"features = {self.features}: give 1 to {SEARCH_SAMPLES}, as many as a view keeps")

    def sharing(self, share: float) -> DetectionConfig:
        """With as many candidates as a share of all poses asks for."""
        share = min(max(share, _LEAST_SHARE), 1.0)
        return replace(
            self,
            starts=round(share * self.starts),
            kept=tuple(round(share * kept) for kept in self.kept),
            verified=max(round(share * self.verified), _FEWEST_VERIFIED),
        )


def usual_depths_mm(diameter: float, camera: Camera) -> tuple[float, float]:
    """Nearest and farthest distance (mm) at which a part is looked for that nothing is told of.

    USUAL_DEPTHS_MM, and wherever a part of that diameter (mm) appears LARGEST_SHARE of the image's shorter side to
    LEAST_PX long: what is small is held near, and what is large stands far away.
    """
    near, far = USUAL_DEPTHS_MM
    focal_px = 0.5 * (camera.fx + camera.fy)
    largest_px = LARGEST_SHARE * min(camera.width, camera.height)
    return min(near, diameter * focal_px / largest_px), max(far, diameter * focal_px / LEAST_PX)
