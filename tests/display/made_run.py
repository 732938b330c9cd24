"""A made-up tracking session: a box in front of a camera, with results that a tracker could have had."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from itertools import islice

import numpy as np

from acp_lab.cad.part import Part
from acp_lab.generator.base import GeneratedEdges
from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.camera import Camera
from acp_lab.geometry.pose import make_pose, transform
from acp_lab.sequences.frame import Frame, UnreadableFrame
from acp_lab.tracking.observer import Observer, SessionInfo, TrackedObject
from acp_lab.tracking.result import TargetView, Timings, TrackResult, TrackState, TrackStep

CAMERA = Camera(160, 128, 150.0, 150.0, 79.5, 63.5)
FRAME_IDS = (0, 1, 3, 4)
UNREADABLE_ID = 3
STEPS = 3
W = np.array([[-20.0, -15, 0], [20, -15, 0], [20, 15, 0], [-20, 15, 0]])
COVARIANCE = np.diag([0.01, 0.01, 0.02, 1.0, 4.0, 9.0]) ** 2
"""Of each result: rad, mm."""


def box(width: float = 40.0) -> Part:
    """A box of width x 30 x 20 mm, its centre in the origin."""
    corners = 0.5 * np.array([[x, y, z] for x in (-width, width) for y in (-30, 30) for z in (-20, 20)])
    faces = [(0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1)]
    faces += [(2, 3, 7), (2, 7, 6), (0, 2, 6), (0, 6, 4), (1, 5, 7), (1, 7, 3)]
    return Part.from_mesh(corners, np.array(faces), "box")


def true_pose(frame_id: int, object_id: int = 1) -> FloatArray:
    """The box moves to the right."""
    return make_pose(np.eye(3), np.array([2.0 * frame_id, 10.0 * object_id, 200.0]))


def result(frame: Frame | UnreadableFrame, object_id: int) -> TrackResult:
    """One millimetre off in x, predicted there; the fifth of the edge points has no image edge."""
    cam_T_obj = true_pose(frame.index, object_id)
    cam_T_obj[0, 3] += 1.0
    quad = CAMERA.project(transform(cam_T_obj, W))
    if isinstance(frame, UnreadableFrame):
        return TrackResult(
            frame.index,
            cam_T_obj,
            cam_T_obj,
            quad,
            0.0,
            0.0,
            TrackState.LOST,
            0,
            None,
            None,
            0,
            Timings(),
            frame.reason,
        )
    points = quad[0] + np.linspace(0.0, 1.0, 9)[:, None] * (quad[1] - quad[0])
    edges = GeneratedEdges(points, np.tile([1.0, 0.0], (9, 1)), np.ones(9), np.arange(9))
    residuals = np.linspace(-4.0, 4.0, 9)
    residuals[4] = np.nan
    timings = Timings(search_s=0.003, total_s=0.006)
    return TrackResult(
        frame.index, cam_T_obj, cam_T_obj, quad, 1.5, 0.8, TrackState.TRACKING, 2, edges, residuals, 10, timings
    )


def recorded(frame: Frame | UnreadableFrame, object_id: int) -> TrackResult:
    """The same with the iterations that led there, from 3 mm away, and with what was found in the image."""
    found = result(frame, object_id)
    if isinstance(frame, UnreadableFrame):
        return found
    steps = []
    for left in range(STEPS - 1, -1, -1):
        pose = found.cam_T_obj.copy()
        pose[0, 3] += left
        steps.append(TrackStep(CAMERA.project(transform(pose, W)), pose, 1.5 + left, STEPS - 1 - left))
    distances = np.hypot(*np.meshgrid(np.arange(40.0) - 20, np.arange(30.0) - 15)).astype(np.float32)
    target = TargetView(found.control_points + 0.25, (60, 50), (40, 30), distances)
    return replace(found, steps=tuple(steps), target=target, covariance=COVARIANCE)


def frames() -> Iterable[Frame | UnreadableFrame]:
    """Four frames with a gap in their ids; the third cannot be read."""
    for frame_id in FRAME_IDS:
        if frame_id == UNREADABLE_ID:
            yield UnreadableFrame(frame_id, CAMERA, "000003.png: the file is empty")
        else:
            image = np.full((CAMERA.height, CAMERA.width, 3), (30 * frame_id, 60, 90), np.uint8)
            yield Frame(frame_id, image, CAMERA)


def play(
    observers: Iterable[Observer],
    object_ids: tuple[int, ...] = (1,),
    with_truth: bool = True,
    results: Callable[[Frame | UnreadableFrame, int], TrackResult] = result,
    name: str = "made/test/000001",
    begin: int = 0,
) -> None:
    """One session from start to end; begin: the first frame, counted, that is tracked."""
    observers = tuple(observers)
    tracked = tuple(TrackedObject(object_id, box()) for object_id in object_ids)
    truth = true_pose if with_truth else None
    for observer in observers:
        observer.on_start(SessionInfo(name, 1, "acp", tracked, truth, len(FRAME_IDS)))
    for frame in islice(frames(), begin, None):
        for observer in observers:
            observer.on_frame(frame, {object_id: results(frame, object_id) for object_id in object_ids})
    for observer in observers:
        observer.on_end()
