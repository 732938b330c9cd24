"""A finished run, put together again from its results file and its sequence, so that it can be examined.

A results file knows poses and qualities. What it lacks is derived: states from the qualities, by the limits that the
tracker uses; view regions and control points from the poses.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from acp_lab.cad.part import Part
from acp_lab.control_points.canonical_frame import eye_position
from acp_lab.control_points.coplanar_points import mid_section_points
from acp_lab.control_points.view_regions import ALL_REGIONS, region_scores
from acp_lab.errors import SequenceError
from acp_lab.geometry.camera import Camera
from acp_lab.geometry.pose import transform
from acp_lab.sequences import protocol
from acp_lab.sequences.frame import Frame
from acp_lab.sequences.results_csv import ResultRow
from acp_lab.tracking.observer import SessionInfo, TrackedObject
from acp_lab.tracking.result import Timings, TrackResult, TrackState
from acp_lab.tracking.session import TrackRun
from acp_lab.tracking.sought import Sought
from acp_lab.tracking.states import StateConfig, StateMachine


def run_from_rows(
    rows: Iterable[ResultRow],
    sequence: protocol.Sequence,
    parts: Mapping[int, Part],
    method: str,
    states: StateConfig | None = None,
    searches: Mapping[tuple[int, int], Sought] | None = None,
) -> TrackRun:
    """A run over one scene as its rows tell it.

    Args:
        rows: of that scene; those of other scenes are left out.
        parts: by object id; only these objects are taken.
        states: limits between tracking, weak and lost; by default the tracker's own.
        searches: by (object id, image id), where a lost part was looked for.

    Raises:
        SequenceError: no rows, or no image can be read (for the camera).
    """
    of_object: dict[int, list[ResultRow]] = {object_id: [] for object_id in parts}
    for row in sorted(rows, key=lambda row: row.im_id):
        if row.scene_id == sequence.scene_id and row.obj_id in of_object:
            of_object[row.obj_id].append(row)
    if not any(of_object.values()):
        raise SequenceError(f"{sequence.name}: the results have no row of this scene and these objects")
    camera = _camera(sequence)
    results = {
        object_id: _results(of_one, parts[object_id], camera, states or StateConfig(), searches or {})
        for object_id, of_one in of_object.items()
        if of_one
    }
    objects = tuple(TrackedObject(object_id, parts[object_id]) for object_id in results)
    session = SessionInfo(sequence.name, sequence.scene_id, method, objects, getattr(sequence, "truth", None))
    starts = {object_id: of_one[0].cam_T_obj for object_id, of_one in results.items()}
    return TrackRun(sequence.name, sequence.scene_id, method, results, sequence, session, starts)


def _camera(sequence: protocol.Sequence) -> Camera:
    for frame in sequence.frames():
        if isinstance(frame, Frame):
            return frame.camera
    raise SequenceError(f"{sequence.name}: none of its images can be read: check the data set")


def _results(
    rows: Sequence[ResultRow],
    part: Part,
    camera: Camera,
    states: StateConfig,
    searches: Mapping[tuple[int, int], Sought],
) -> tuple[TrackResult, ...]:
    machine = StateMachine(states)
    results: list[TrackResult] = []
    for row in rows:
        note = machine.replay(row.score)
        direction = eye_position(row.cam_T_obj) - part.box_centre
        region = int(np.argmax(region_scores(direction, 0.5 * part.box_size)))
        points = mid_section_points(part.box_min, part.box_max, ALL_REGIONS[region].axis)
        results.append(
            TrackResult(
                frame_id=row.im_id,
                cam_T_obj=row.cam_T_obj,
                predicted=results[-1].cam_T_obj if results else row.cam_T_obj,
                control_points=camera.project(transform(row.cam_T_obj, points)),
                loss=float("nan"),
                quality=row.score,
                state=machine.state,
                region=region,
                edges=None,
                residuals_px=None,
                iterations=0,
                timings=Timings(total_s=max(row.time_s, 0.0)),
                note=note,
                sought=searches.get((row.obj_id, row.im_id)),
            )
        )
    return tuple(results)


def first_loss(results: Sequence[TrackResult]) -> int | None:
    """The frame, counted from 0, in which the quality fell for the loss that the run reports first; None without one.

    A part counts as lost only after some bad frames; tracking has to begin again at the first of these.
    """
    lost = next((number for number, result in enumerate(results) if result.state is TrackState.LOST), None)
    if lost is None:
        return None
    while lost > 0 and results[lost - 1].state is not TrackState.TRACKING:
        lost -= 1
    return lost
