"""Image processing that several layers share: Canny edges, exact distance maps, Chamfer distances.

Small wrappers of cv2 and SciPy that fix their defaults where these are inexact or change from run to run, and beside
them what each frame needs of its image and no library has, as compiled loops.
"""

from __future__ import annotations

from acp_lab.imaging.canny import (
    CannyConfig,
    Thresholds,
    blur,
    canny,
    canny_at,
    median_thresholds,
    otsu_thresholds,
    to_grey,
)
from acp_lab.imaging.chamfer import Chamfer, chamfer, nearest_distances
from acp_lab.imaging.distance import distance_map, nearest_edges

__all__ = [
    "CannyConfig",
    "Chamfer",
    "Thresholds",
    "blur",
    "canny",
    "canny_at",
    "chamfer",
    "distance_map",
    "median_thresholds",
    "nearest_distances",
    "nearest_edges",
    "otsu_thresholds",
    "to_grey",
]
