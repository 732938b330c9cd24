"""Settings of the detector; lengths in px count on images in which the part's diameter is `scan_px` or `search_px`."""

from __future__ import annotations

from dataclasses import dataclass

from acp_lab.errors import AcpLabError

SEARCH_SAMPLES = 80
"""Edge samples that a stored view keeps; a template has some of them."""


@dataclass(frozen=True)
class DetectionConfig:
    """How a part is looked for; the defaults are the same for every part and image.

    Attributes:
        depth_mm: nearest and farthest distance of the part's centre along the optical axis.
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

    depth_mm: tuple[float, float] = (250.0, 1200.0)
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
        near, far = self.depth_mm
        if not 0.0 < near <= far < float("inf"):
            raise AcpLabError(f"depth range {near:g} to {far:g} mm: give two distances, 0 < nearest <= farthest")
        if not 0.0 < self.spread_px <= 30.0:  # distances are kept in two bytes
            raise AcpLabError(f"spread_px = {self.spread_px:g}: give px above 0, at most 30")
        if not 1 <= self.features <= SEARCH_SAMPLES:
            raise AcpLabError(f"features = {self.features}: give 1 to {SEARCH_SAMPLES}, as many as a view keeps")
