"""Tracking: one part frame by frame, several parts through a sequence, and who may listen."""

from __future__ import annotations

from acp_lab.tracking.method import METHODS, Method
from acp_lab.tracking.observer import Observer, SessionInfo, TrackedObject
from acp_lab.tracking.result import TargetView, Timings, TrackResult, TrackState, TrackStep
from acp_lab.tracking.session import PartTracker, TrackRun, track_sequence
from acp_lab.tracking.tracker import Tracker

__all__ = [
    "METHODS",
    "Method",
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
    "track_sequence",
]
