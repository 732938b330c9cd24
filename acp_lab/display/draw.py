"""All that only draws, under one name, for notebooks: pictures, 3D scenes, films and the plots of every study.

    from acp_lab.display.draw import draw_edges, draw_losses, panels, show_image

Each lives in the module of its study, and is loaded from there when it is first used.
"""

from __future__ import annotations

import importlib
from typing import Any

_OFFERED: dict[str, tuple[str, ...]] = {
    "pictures": (
        "panels",
        "show_image",
        "without_ground",
        "cut_to",
        "draw_edges",
        "draw_strokes",
        "draw_dots",
        "draw_quad",
    ),
    "film": ("Film", "film"),
    "scene_3d": (
        "space",
        "draw_samples",
        "draw_lines",
        "draw_camera",
        "draw_on_image_plane",
        "draw_plane_points",
        "draw_rays",
        "same_scale",
    ),
    "plots.accuracy": ("draw_depth_errors", "draw_errors", "draw_recall", "draw_table"),
    "plots.ambiguity": ("ambiguity_figure", "draw_pair"),
    "plots.basin": ("basin_figure", "draw_basin", "draw_basin_curves"),
    "plots.bench": (
        "bench_figure",
        "figure_svg",
        "draw_recall_curves",
        "draw_times",
        "draw_preparing",
        "draw_basins",
        "draw_against",
    ),
    "plots.diagnosis": ("Explanation", "explain"),
    "plots.edge_finding": ("profile", "draw_profile", "draw_finding"),
    "plots.finding": (
        "direction_colours",
        "draw_edge_directions",
        "draw_contrast",
        "draw_template",
        "draw_scores",
        "draw_turns",
        "draw_evidence",
    ),
    "plots.frame_story": ("add_percents", "draw_runs", "draw_found", "draw_memory"),
    "plots.generator_study": (
        "draw_inverse_psnr",
        "draw_images",
        "draw_epochs",
        "draw_training",
        "draw_edge_points",
        "draw_view",
    ),
    "plots.key_frames": ("draw_key_frames",),
    "plots.loss_study": (
        "draw_losses",
        "draw_printed",
        "draw_distances",
        "draw_landscape",
        "draw_erased",
        "draw_found_shares",
    ),
    "plots.manipulation": ("draw_way", "draw_ways", "draw_growth"),
    "plots.motion": ("draw_two_poses", "draw_step"),
    "plots.painting_bias": ("draw_painting_bias",),
    "plots.pose_bound": ("BoundCurves", "bound_figure", "draw_bound"),
    "plots.pose_parameters": ("draw_pose_parameters", "draw_pose_errors"),
    "plots.redundancy": ("draw_view_tables", "draw_directions", "draw_drifts", "draw_descents"),
    "plots.sensitivity": (
        "sensitivity_figure",
        "draw_change_table",
        "draw_sensitivities",
        "draw_conditions",
        "draw_cosines",
    ),
    "plots.summary": ("Curves", "draw_frame", "draw_curves", "SummaryPicture"),
    "plots.view_regions": ("draw_regions", "draw_box", "draw_tilts", "draw_moved", "draw_residuals"),
}
_HOME = {name: module for module, names in _OFFERED.items() for name in names}


def __getattr__(name: str) -> Any:
    """Load a function at its first use (PEP 562)."""
    if name not in _HOME:
        raise AttributeError(f"module 'acp_lab.display.draw' has no attribute '{name}'")
    value = getattr(importlib.import_module(f"acp_lab.display.{_HOME[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *_HOME})
