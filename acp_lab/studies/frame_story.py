"""One frame of a run, stage by stage: prediction, search, iterations.

The tracker is run up to the frame; then its first search is repeated at the predicted pose, and its iterations are
recorded. The truth only serves to measure the error of each stage.
Convention: px along the normals of the edges that are seen at the true pose; poses cam_T_obj (4, 4), mm.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import islice

import numpy as np

from acp_lab.errors import SequenceError, TrackingError
from acp_lab.geometry.arrays import BoolArray, FloatArray
from acp_lab.geometry.pose import transform
from acp_lab.prepared_part import PreparedPart
from acp_lab.sequences.frame import Frame
from acp_lab.sequences.protocol import Sequence
from acp_lab.studies.true_edges import TrueEdges
from acp_lab.tracking.method import ACP, Method
from acp_lab.tracking.result import TrackResult
from acp_lab.tracking.targets.normals import NormalMeasure, NormalTarget
from acp_lab.tracking.tracker import Tracker

RIGHT_PX = 1.5
"""An image edge this near to an edge point's true place is that point's own."""


@dataclass(frozen=True, eq=False)
class FrameStory:
    """What happened in one frame.

    Attributes:
        frame: the image with its camera; cam_T_true: (4, 4), where the part is.
        last, predicted: (4, 4), the pose in the frame before, and the one predicted for this frame.
        observation: the first search, at the predicted pose, with the memory; its `candidates.scores` are those
            without.
        way_px: (n,) along the normals, from each generated edge point to its true place.
        result: of the tracker, with its steps.
    """

    frame: Frame
    cam_T_true: FloatArray
    last: FloatArray
    predicted: FloatArray
    observation: NormalMeasure
    way_px: FloatArray
    result: TrackResult
    _truth: TrueEdges

    def off_px(self, cam_T_obj: FloatArray) -> float:
        """Mean distance, along their normals, of the edges at a pose (4, 4) from their true places."""
        rows, camera = self._truth.rows(self.cam_T_true), self.frame.camera
        really = self._truth.project(rows, self.cam_T_true, camera)
        moved = self._truth.project(rows, cam_T_obj, camera).points
        return float(np.abs(((moved - really.points) * really.normals).sum(1)).mean())

    def is_right(self, scores: BoolArray) -> BoolArray:
        """(n,) bool: whether the candidate with the highest of scores (n, m) is the edge point's own image edge."""
        best = scores.argmax(1)[:, None]
        offset = np.take_along_axis(self.observation.candidates.offsets, best, 1)[:, 0]
        has_one = np.take_along_axis(scores, best, 1)[:, 0] > 0.0
        right: BoolArray = has_one & (np.abs(offset - self.way_px) < RIGHT_PX)
        return right


def frame_story(model: PreparedPart, sequence: Sequence, number: int, method: Method | str = ACP) -> FrameStory:
    """Track a sequence of one object from its true first pose, and record the stages of its frame `number` (from 0).

    Raises SequenceError for a frame before the third, after the last, without image or without truth, and when the
    part was not seen there; TrackingError for a method that does not search for CAD samples along normals.
    """
    object_id, start = sequence.object_ids[0], sequence.first_pose
    frames = list(islice(sequence.frames(), number + 1))
    frame = frames[-1] if frames else None
    if not 2 <= number < len(frames) or not isinstance(frame, Frame) or not isinstance(frames[0], Frame):
        raise SequenceError(f"{sequence.name}: frame {number} cannot be shown: choose a readable one after the second")
    cam_T_true = sequence.truth(frame.index, object_id)
    if cam_T_true is None:
        raise SequenceError(f"{sequence.name}: frame {number} has no truth: choose another")
    tracker = Tracker(model, method)
    if not (tracker.method.targets[0].searches and tracker.method.source.knows_samples):
        raise TrackingError(f"method {tracker.name} does not search for CAD samples along normals: take acp")
    tracker.start(frames[0], start)
    for before in frames[1:-1]:
        tracker.track(before)
    last, predicted = tracker.last, tracker.predicted
    observation = _first_search(tracker, frame, predicted)
    if observation is None:
        raise SequenceError(f"{sequence.name}: the part is not seen in frame {number}: choose another")
    tracker.records_steps = True
    result = tracker.track(frame)
    points_obj = model.edges.points_obj[observation.edges.sample_ids]
    shift = frame.camera.project(transform(cam_T_true, points_obj)) - observation.points
    way_px = (shift * observation.normals).sum(1)
    truth = TrueEdges(model.part, model.edges)
    return FrameStory(frame, cam_T_true, last, predicted, observation, way_px, result, truth)


def _first_search(tracker: Tracker, frame: Frame, pose: FloatArray) -> NormalMeasure | None:
    seen = tracker.look(frame, pose)
    if seen is None:
        return None
    target, at = seen.targets[0], seen.view.at_pose(pose)
    assert isinstance(target, NormalTarget), "a target that searches along normals"
    level = tracker.solver.levels_at(at)[0]
    return target.search(tracker.solver.source.generate(at, level.samples), at, level)
