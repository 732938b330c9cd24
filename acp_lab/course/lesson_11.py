"""Notebook 11: measuring."""

from __future__ import annotations

from typing import Any

import numpy as np

from acp_lab.course.answers import Hint, as_function, as_number, near
from acp_lab.course.grader import exercise
from acp_lab.course.workshop import sample_part, sample_scene
from acp_lab.evaluation.metrics import add_mm, adds_mm
from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.pose import disturb_pose
from acp_lab.studies.shared_errors import DepthShift, shifted_in_depth

LIMIT = 0.02
MISSING = float("inf")
ERRORS = (0.0, 0.011, 0.018, 0.025, 0.016, MISSING, 0.31, 0.03, 0.02)
"""ADD of nine frames as shares of the diameter; the first is where tracking began, one has no result."""
_LATE_BY_FRAMES = 0.6


def late_truth() -> dict[int, FloatArray]:
    """The sample's true poses (4, 4) by image id, their depth late by some frames; exercise 11.4 asks by how many."""
    scene = sample_scene()
    known = {frame_id: scene.truth(frame_id, 1) for frame_id in scene.frame_ids}
    truth = {frame_id: pose for frame_id, pose in known.items() if pose is not None}
    return shifted_in_depth(truth, DepthShift(0.0, -_LATE_BY_FRAMES), sample_part())


@exercise("11.1")
def add_by_hand(answer: Any) -> str:
    """add(points_obj, cam_T_est, cam_T_true) -> mm."""
    add = as_function(answer, "a function add(points_obj, cam_T_est, cam_T_true)")
    part, truth, rng = sample_part(), sample_scene().first_pose, np.random.default_rng(11)
    points_obj = part.vertices[::7]
    for angle_deg, shift_mm in ((3.0, 4.0), (20.0, 0.0), (0.0, 9.0)):
        estimate = disturb_pose(truth, part.box_centre, angle_deg, shift_mm, rng)
        found = as_number(add(points_obj, estimate, truth), "one number, a distance in mm")
        right = add_mm(points_obj, estimate, truth)
        if near(found, right, 1e-6):
            continue
        apart = points_obj @ (estimate - truth)[:3, :3].T + (estimate - truth)[:3, 3]
        if near(found, adds_mm(points_obj, estimate, truth), 1e-6):
            raise Hint("That is ADD-S, to the nearest point; ADD compares each point with itself.")
        if near(found, float(np.linalg.norm((estimate - truth)[:3, 3])), 1e-6):
            raise Hint("That compares the origins alone; ADD moves all points of the model.")
        if near(found, float(np.linalg.norm(apart.mean(0))), 1e-6):
            raise Hint("First the length of each difference, then the mean: differences in opposite directions cancel.")
        if near(found, float(np.sqrt((apart**2).sum(1).mean())), 1e-6):
            raise Hint("That is the root of the mean square; ADD is the plain mean of the distances.")
        if near(found, right / part.diameter, 1e-6):
            raise Hint("Give it in mm; the diameter comes in later.")
        raise Hint("Move the points by one pose, and by the other: how far apart are the two places of each point?")
    return "Every score in this course comes from this one number per frame."


@exercise("11.2")
def how_deep(answer: Any) -> str:
    """How far the bracket may be off in depth for an ADD just at 2% of its diameter, mm."""
    found = as_number(answer, "a length in mm")
    part, pose = sample_part(), sample_scene().first_pose
    if near(abs(found), LIMIT * part.diameter, 0.01):
        return (
            "A shift moves every point by its own length, whatever its direction. From 39 cm away it makes the "
            "image half a percent smaller, which moves the edges by a quarter of a pixel."
        )
    if near(found, LIMIT, 0.01) or near(found, 100.0 * LIMIT, 0.001):
        raise Hint("Two percent of what, in millimetres?")
    if near(found, LIMIT * float(pose[2, 3]), 0.03):
        raise Hint("Not of the distance to the camera: of the part's diameter.")
    if near(found, LIMIT * float(part.box_size.max()), 0.01):
        raise Hint("Not of its longest side: of the largest distance between two of its points.")
    raise Hint("Under a pure shift all points move alike: what is then the mean of the distances?")


@exercise("11.3")
def recall_by_hand(answer: Any) -> str:
    """The share of frames within 2% for the nine errors of the notebook."""
    share = as_number(answer, "a share between 0 and 1")
    scored = np.array(ERRORS[1:])
    wrong = (
        (float((np.array(ERRORS) < LIMIT).mean()), "The first frame was given, not tracked: it is left out."),
        (
            float((scored[np.isfinite(scored)] < LIMIT).mean()),
            "A frame without a result is a failure, not a frame less; else a tracker could win by keeping silent.",
        ),
        (float((scored <= LIMIT).mean()), "Strictly below the limit: one of the errors is just as large."),
        (float((scored >= LIMIT).mean()), "That is the share of the frames that failed."),
        (float((scored < 0.05).mean()), "That is the share within 5%."),
    )
    if near(share, float((scored < LIMIT).mean()), absolute=0.006):  # two digits will do
        return "The first frame does not count, the missing one does, and the limit itself is no success."
    for value, hint in wrong:
        if near(share, value, absolute=0.001):
            raise Hint(hint)
    if share > 1.0:
        raise Hint("A share lies between 0 and 1.")
    raise Hint("How many frames count, and in how many of them is the error below 0.02?")


@exercise("11.4")
def how_late(answer: Any) -> str:
    """By how many frames the depth of `late_truth` is late."""
    frames = as_number(answer, "a number of frames")
    if near(frames, _LATE_BY_FRAMES, absolute=0.06):
        return "The tracker told it, from images that were never late. On real data compare two, of different kinds."
    if near(frames, -_LATE_BY_FRAMES, absolute=0.06):
        raise Hint("Late, not early: the tracker runs ahead of it, by a positive number of frames.")
    if near(abs(frames), _LATE_BY_FRAMES, absolute=0.3):
        raise Hint("Near. How far ahead of the truth in depth does the more exact of the two trackers run?")
    raise Hint("`shared_errors` compares two trackers with a truth; of three axes, which is the camera's own?")
