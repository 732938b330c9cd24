"""Tracking: one part frame by frame, several parts through a sequence, and who may listen."""

from __future__ import annotations

from acp_lab.tracking.observer import (
    Observer,
    SessionInfo,
    TargetView,
    Timings,
    TrackedObject,
    TrackResult,
    TrackState,
    TrackStep,
)
from acp_lab.tracking.session import PartTracker, TrackRun, track_sequence
from acp_lab.tracking.tracker import Tracker, TrackerConfig

__all__ = [
    "Observer",
    "PartTracker",
    "SessionInfo",
    "TargetView",
    "Timings",
    "TrackResult",
    "TrackRun",
    "TrackState",
    "TrackStep",
    "TrackedObject",
    "Tracker",
    "TrackerConfig",
    "track_sequence",
]
