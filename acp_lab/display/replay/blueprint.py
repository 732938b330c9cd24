"""How the viewer is laid out when a replay opens: image left, 3D right, curves below.

A blueprint is advice to the viewer; whoever looks may drag everything elsewhere.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.pose import transform
from acp_lab.tracking.observer import TrackedObject
from acp_lab.tracking.result import TrackResult

PLAYBACK_FPS = 15.0
EYE_DIRECTION = (0.6, -0.55, -1.0)
"""From the parts to the eye of the 3D view: on the camera's side, up and to the right; camera frame."""
EYE_DISTANCE = 3.4
"""In radii of what is to be seen."""
PAIRS = ("pose_error", "uncertainty")
"""Curves of two values, of turn and shift."""


@dataclass(frozen=True, eq=False)
class Spot:
    """A place to look at: centre (3,) mm, camera frame, and how far around it things are, mm."""

    centre: FloatArray
    reach: float


def spot_of(objects: Sequence[TrackedObject], results: Mapping[int, TrackResult]) -> Spot:
    """Where the tracked objects are in a frame."""
    places = [
        (transform(results[tracked.object_id].cam_T_obj, tracked.part.box_centre), tracked.part.radius)
        for tracked in objects
        if tracked.object_id in results
    ]
    centre: FloatArray = np.mean([place for place, _ in places], axis=0)
    reach = max(float(np.linalg.norm(place - centre)) + radius for place, radius in places)
    return Spot(centre, reach)


def single_run(objects: Sequence[str], spot: Spot) -> Any:
    """The layout for one run. objects: names of their entities."""
    import rerun.blueprint as rrb

    views = rrb.Tabs(_image("", "image"), _target("", "target", objects), active_tab=0, name="image")
    return _page(
        rrb.Horizontal(views, _space("", "3D", objects, spot), column_shares=[3, 2]),
        rrb.Horizontal(*_curves([""]), _words({"": objects}), column_shares=[2, 2, 2, 2, 3]),
    )


def comparison(titles: Mapping[str, str], objects: Mapping[str, Sequence[str]], spot: Spot) -> Any:
    """The layout for two runs over the same frames: their images beside each other, their curves in common plots.

    titles: by the name of the entity below which a run is; objects: likewise, the names of theirs.
    """
    import rerun.blueprint as rrb

    sides = [
        rrb.Tabs(
            _image(f"{root}/", title),
            _target(f"{root}/", "target", objects[root]),
            _space(f"{root}/", "3D", objects[root], spot),
            active_tab=0,
            name=title,
        )
        for root, title in titles.items()
    ]
    by_root = {f"{root}/": objects[root] for root in titles}
    return _page(
        rrb.Horizontal(*sides),
        rrb.Horizontal(*_curves(list(by_root)), _words(by_root), column_shares=[2, 2, 2, 2, 3]),
    )


def _page(top: Any, bottom: Any) -> Any:
    import rerun.blueprint as rrb

    return rrb.Blueprint(
        rrb.Vertical(top, bottom, row_shares=[5, 3]),
        rrb.TimePanel(state="collapsed", timeline="frame", fps=PLAYBACK_FPS, play_state="paused"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.BlueprintPanel(state="collapsed"),
    )


def _image(root: str, name: str) -> Any:
    """The image with the generated edges, the control points and the truth."""
    import rerun.blueprint as rrb

    shown = ["image", "generated_edges", "control_points", "truth"]
    return rrb.Spatial2DView(
        origin=f"{root}camera", name=name, contents=[f"+ {root}camera/{part}/**" for part in shown]
    )


def _target(root: str, name: str, objects: Sequence[str]) -> Any:
    """The image with what was searched for in it: crop, image edges, distance map, all CAD edges of the part."""
    import rerun.blueprint as rrb

    shown = ["image", "distance_map", "crop", "target_edges", "control_points"]
    return rrb.Spatial2DView(
        origin=f"{root}camera",
        name=name,
        contents=[
            *(f"+ {root}camera/{part}/**" for part in shown),
            *(f"+ {root}mesh/{name}/cad_edges" for name in objects),
        ],
    )


def _space(root: str, name: str, objects: Sequence[str], spot: Spot) -> Any:
    """The parts in space before their image."""
    import rerun.blueprint as rrb

    shown = [f"+ {root}{part}/**" for part in ("mesh", "truth", "trajectory", "uncertainty")]
    shown += [f"+ {root}camera", f"+ {root}camera/image", *(f"- {root}truth/{name}/cad_edges" for name in objects)]
    direction = np.array(EYE_DIRECTION) / np.linalg.norm(EYE_DIRECTION)
    eye = spot.centre + EYE_DISTANCE * spot.reach * direction
    return rrb.Spatial3DView(
        origin=root.rstrip("/") or "/",
        name=name,
        contents=shown,
        line_grid=False,
        eye_controls=rrb.EyeControls3D(position=eye, look_target=spot.centre, eye_up=[0.0, -1.0, 0.0]),
    )


def _curves(roots: Sequence[str]) -> list[Any]:
    """Four plots in a row; the rarer curves are behind tabs."""
    import rerun.blueprint as rrb

    def plot(curve: str, name: str, y_range: tuple[float, float] | None = None) -> Any:
        return rrb.TimeSeriesView(
            origin="/",
            contents=[f"+ {root}curves/{curve}/**" for root in roots],
            name=name,
            axis_y=None if y_range is None else rrb.ScalarAxis(range=y_range),
            # Each stage of the time has a colour of its own, and their legend would hide them.
            plot_legend=rrb.PlotLegend(visible=curve in PAIRS or (len(roots) > 1 and curve != "ms")),
        )

    return [
        plot("quality", "quality", (0.0, 1.0)),
        rrb.Tabs(
            plot("add_percent", "ADD(-S) %"),
            plot("pose_error", "deg, mm"),
            plot("uncertainty", "known to"),
            active_tab=0,
        ),
        rrb.Tabs(plot("loss", "loss"), plot("step_loss", "loss of steps"), active_tab=0),
        rrb.Tabs(plot("ms", "ms"), plot("iterations", "iterations"), plot("region", "region"), active_tab=0),
    ]


def _words(objects: Mapping[str, Sequence[str]]) -> Any:
    """States as lanes, the numbers of the frame, and the log of what happened; objects by root."""
    import rerun.blueprint as rrb

    states = [f"+ {root}state/**" for root in objects]
    # A view shows one text only.
    numbers = [
        rrb.TextDocumentView(origin=f"{root}numbers/{name}", name=f"{root}{name}" if root else name)
        for root, names in objects.items()
        for name in names
    ]
    together = [rrb.Vertical(*numbers, name="numbers")] if len(numbers) <= 2 else numbers
    log = rrb.TextLogView(origin="/", contents=states, name="log")
    return rrb.Vertical(
        rrb.StateTimelineView(origin="/", contents=states, name="state"),
        rrb.Tabs(*together, log, active_tab=0),
        row_shares=[1, 1] if len(numbers) > 1 else [2, 3],
    )
