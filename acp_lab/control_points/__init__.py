"""The four control points W of each view region, and the canonical frame that belongs to them."""

from __future__ import annotations

from acp_lab.control_points.canonical_frame import CanonicalFrame, canonical_frame, eye_position
from acp_lab.control_points.coplanar_points import mid_section_points
from acp_lab.control_points.view_regions import ALL_REGIONS, REGION_COUNT, ViewRegion, choose_region, sample_directions

__all__ = [
    "ALL_REGIONS",
    "REGION_COUNT",
    "CanonicalFrame",
    "ViewRegion",
    "canonical_frame",
    "choose_region",
    "eye_position",
    "mid_section_points",
    "sample_directions",
]
