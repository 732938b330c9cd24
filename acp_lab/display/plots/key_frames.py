"""Key frames of a sequence under several trackers, as the qualitative figures of the paper show them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from acp_lab.display.accuracy import AddPercent
from acp_lab.display.look import GENERATED, TRUTH, UNKNOWN, WRONG, as_it_is
from acp_lab.display.pictures import draw_edges, show_image
from acp_lab.errors import SequenceError
from acp_lab.sequences.frame import Frame
from acp_lab.sequences.protocol import Sequence as FrameSequence
from acp_lab.studies.true_edges import TrueEdges
from acp_lab.tracking.session import TrackRun

if TYPE_CHECKING:
    from matplotlib.axes import Axes

FAILED_PERCENT = 10.0
MARGIN_PX = 25.0


def draw_key_frames(
    axes: Sequence[Axes],
    runs: Mapping[str, TrackRun],
    sequence: FrameSequence,
    frame_ids: Sequence[int],
    object_id: int = 1,
) -> None:
    """A row of axes per run, a column per frame: the CAD's edges at the run's pose, and the ADD in % of the diameter.

    Where a pose is off by more than 10% its edges have the colour of what is wrong, and the true ones lie below. Each
    column is cut to the part's true place, or to that of the first run where truth is not known.

    Raises SequenceError for a frame that the sequence or a run does not have, or that cannot be read.
    """
    wanted = (frame for frame in sequence.frames() if frame.index in set(frame_ids))
    images = {frame.index: frame.to_keep() for frame in wanted if isinstance(frame, Frame)}
    for row, (name, run) in enumerate(runs.items()):
        if object_id not in run.results:
            raise SequenceError(f"{name}: object {object_id} was not tracked: there are {sorted(run.results)}")
        poses = {result.frame_id: result.cam_T_obj for result in run.results[object_id]}
        edges, error = TrueEdges(run.parts[object_id]), AddPercent(run.parts[object_id])
        for column, frame_id in enumerate(frame_ids):
            frame, found = images.get(frame_id), poses.get(frame_id)
            if frame is None or found is None:
                raise SequenceError(f"{name}: there is no picture or no pose of frame {frame_id}: choose another")
            panel, true = axes[row * len(frame_ids) + column], sequence.truth(frame_id, object_id)
            percent = error(found, true)
            failed = bool(percent > FAILED_PERCENT)
            around = edges.at(found if true is None else true, frame.camera)
            show_image(panel, frame.image, around=around.points, margin_px=MARGIN_PX)
            if true is not None and failed:
                draw_edges(panel, around, TRUTH, width=1.0)
            draw_edges(panel, edges.at(found, frame.camera), WRONG if failed else GENERATED)
            told = "" if np.isnan(percent) else f", {percent:.1f}%"
            panel.set_title(f"frame {frame_id}{told}", fontsize=9, color=WRONG if failed else UNKNOWN)
            if column == 0:
                panel.set_ylabel(as_it_is(name))
