"""acp_lab: 6DoF tracking of metal parts from their CAD models, to use, to measure and to learn from.

    import acp_lab as acp

    part = acp.Part.from_file("bracket.ply")
    model = acp.prepare(part)
    scene = acp.open_sequence("dataset/test/000001")
    tracker = acp.Tracker(model)  # or acp.Tracker(model, method="acp-paper"); acp.METHODS has all
    run = tracker.run(scene, start=scene.first_pose, observers=[acp.Replay("run.rrd")])
    print(acp.evaluate(run, scene))

The names above are loaded when they are first used, so that `import acp_lab` itself stays light.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from acp_lab.errors import AcpLabError

if TYPE_CHECKING:
    from acp_lab.cad.part import Part
    from acp_lab.display.plots.diagnosis import explain
    from acp_lab.display.replay.recorder import Replay
    from acp_lab.display.replay.viewer import show
    from acp_lab.display.widgets import PoseAligner, live
    from acp_lab.evaluation import evaluate
    from acp_lab.geometry.camera import Camera
    from acp_lab.preparation import prepare
    from acp_lab.prepared_part import PreparedPart, PrepareOptions
    from acp_lab.sequences import open_images, open_sequence, read_pose
    from acp_lab.tracking.find import Detection, detect, detect_each
    from acp_lab.tracking.method import METHODS, Method
    from acp_lab.tracking.results_file import ResultsFile
    from acp_lab.tracking.snap import snap
    from acp_lab.tracking.tracker import Tracker

__version__ = "0.1.0"

__all__ = [
    "METHODS",
    "AcpLabError",
    "Camera",
    "Detection",
    "Method",
    "Part",
    "PoseAligner",
    "PrepareOptions",
    "PreparedPart",
    "Replay",
    "ResultsFile",
    "Tracker",
    "__version__",
    "detect",
    "detect_each",
    "evaluate",
    "explain",
    "live",
    "open_images",
    "open_sequence",
    "prepare",
    "read_pose",
    "show",
    "snap",
]

_HOME = {
    "Camera": "acp_lab.geometry.camera",
    "Detection": "acp_lab.tracking.find",
    "METHODS": "acp_lab.tracking.method",
    "Method": "acp_lab.tracking.method",
    "Part": "acp_lab.cad.part",
    "PoseAligner": "acp_lab.display.widgets",
    "PrepareOptions": "acp_lab.prepared_part",
    "PreparedPart": "acp_lab.prepared_part",
    "Replay": "acp_lab.display.replay.recorder",
    "ResultsFile": "acp_lab.tracking.results_file",
    "Tracker": "acp_lab.tracking.tracker",
    "detect": "acp_lab.tracking.find",
    "detect_each": "acp_lab.tracking.find",
    "evaluate": "acp_lab.evaluation",
    "explain": "acp_lab.display.plots.diagnosis",
    "live": "acp_lab.display.widgets",
    "open_images": "acp_lab.sequences",
    "open_sequence": "acp_lab.sequences",
    "prepare": "acp_lab.preparation",
    "read_pose": "acp_lab.sequences",
    "show": "acp_lab.display.replay.viewer",
    "snap": "acp_lab.tracking.snap",
}


def __getattr__(name: str) -> Any:
    """Load one of the names of the package's face at its first use (PEP 562)."""
    if name not in _HOME:
        raise AttributeError(f"module 'acp_lab' has no attribute '{name}'")
    value = getattr(importlib.import_module(_HOME[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
