"""Widgets for JupyterLab: points to drag, poses to find, losses to walk on, runs to step through.

    from acp_lab.display.widgets import ControlPointEditor
    ControlPointEditor(frame.image, points)

Each is plain Python around one drawing, `PointCanvas`, or one plot, `CurvePlot`; what they compute lives in
the layers below, so a widget can be driven, and tested, without a browser. docs/widgets.md shows them.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from acp_lab.display.widgets.control_point_editor import ControlPointEditor
    from acp_lab.display.widgets.curve_plot import Curve, CurvePlot
    from acp_lab.display.widgets.live_training import LiveTraining, ProgressBar
    from acp_lab.display.widgets.live_window import LiveWindow, live
    from acp_lab.display.widgets.loss_landscape import LossLandscape
    from acp_lab.display.widgets.manipulation_explorer import ManipulationExplorer
    from acp_lab.display.widgets.overlay import Overlay
    from acp_lab.display.widgets.point_canvas import PointCanvas
    from acp_lab.display.widgets.pose_aligner import PoseAligner
    from acp_lab.display.widgets.run_comparison import RunComparison
    from acp_lab.display.widgets.track_player import TrackPlayer

__all__ = [
    "ControlPointEditor",
    "Curve",
    "CurvePlot",
    "LiveTraining",
    "LiveWindow",
    "LossLandscape",
    "ManipulationExplorer",
    "Overlay",
    "PointCanvas",
    "PoseAligner",
    "ProgressBar",
    "RunComparison",
    "TrackPlayer",
    "live",
]

_HOME = {
    "ControlPointEditor": "control_point_editor",
    "Curve": "curve_plot",
    "CurvePlot": "curve_plot",
    "LiveTraining": "live_training",
    "LiveWindow": "live_window",
    "LossLandscape": "loss_landscape",
    "ManipulationExplorer": "manipulation_explorer",
    "Overlay": "overlay",
    "PointCanvas": "point_canvas",
    "PoseAligner": "pose_aligner",
    "ProgressBar": "live_training",
    "RunComparison": "run_comparison",
    "TrackPlayer": "track_player",
    "live": "live_window",
}


def __getattr__(name: str) -> Any:
    """Load a widget at its first use: some of them need the tracker, others only a picture."""
    if name not in _HOME:
        raise AttributeError(f"module 'acp_lab.display.widgets' has no attribute '{name}'")
    value = getattr(importlib.import_module(f"acp_lab.display.widgets.{_HOME[name]}"), name)
    globals()[name] = value
    return value
