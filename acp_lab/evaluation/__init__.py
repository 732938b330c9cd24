"""How good poses are: errors, scores, tables.

Scores need poses, their truth and the CAD model, and nothing of what made the poses: no module here imports a
tracker. So results of any method, ours or not, are scored by the same code, from a run or from a file.
"""

from __future__ import annotations

from acp_lab.evaluation.evaluation import Evaluation, ObjectScores, evaluate
from acp_lab.evaluation.metrics import (
    FrameErrors,
    PoseError,
    Scores,
    add_mm,
    adds_mm,
    area_under_curve,
    closest_truth,
    frames_until_lost,
    pose_error,
    recall,
    rotation_error_deg,
    translation_error_mm,
)
from acp_lab.evaluation.part_metric import PartMetric, metric_name

__all__ = [
    "Evaluation",
    "FrameErrors",
    "ObjectScores",
    "PartMetric",
    "PoseError",
    "Scores",
    "add_mm",
    "adds_mm",
    "area_under_curve",
    "closest_truth",
    "evaluate",
    "frames_until_lost",
    "metric_name",
    "pose_error",
    "recall",
    "rotation_error_deg",
    "translation_error_mm",
]
