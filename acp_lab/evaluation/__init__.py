"""How good poses are: errors, scores, tables."""

from __future__ import annotations

from acp_lab.evaluation.evaluation import Evaluation, ObjectScores, evaluate
from acp_lab.evaluation.metrics import (
    FrameErrors,
    PoseError,
    Scores,
    add_mm,
    adds_mm,
    area_under_curve,
    frames_until_lost,
    pose_error,
    recall,
    rotation_error_deg,
    translation_error_mm,
)

__all__ = [
    "Evaluation",
    "FrameErrors",
    "ObjectScores",
    "PoseError",
    "Scores",
    "add_mm",
    "adds_mm",
    "area_under_curve",
    "evaluate",
    "frames_until_lost",
    "pose_error",
    "recall",
    "rotation_error_deg",
    "translation_error_mm",
]
