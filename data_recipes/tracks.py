"""Sequences to track, made of single images with known poses.

A track is one part through the images of one scene. Data sets for pose *estimation* show their parts from all
sides in no order, so the images are ordered here: each is followed by the remaining one in which the part is nearest
to where it was; where even that one is too far, the track is cut. "Near" is measured in the picture:
the mean distance of the eight corners of the part's box, px, which counts turns, shifts and changes of distance alike.
"Too far" is that many px, or a turn by that many degrees: a small part turns over within a few pixels.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise, product
from pathlib import Path

import numpy as np

from acp_lab.geometry.camera import Camera
from acp_lab.geometry.pose import rotation_angle_deg, transform


@dataclass(frozen=True, eq=False)
class View:
    """One image of a part: its number, file, camera (pinhole, of the image's size) and cam_T_obj (4, 4), mm.

    Numbers rise along a track; gaps tell that images were left out.
    """

    number: int
    image: Path
    camera: Camera
    cam_T_obj: np.ndarray


@dataclass(frozen=True, eq=False)
class Track:
    """One part through some images. source: where they come from, as in "scene 3, object 6"."""

    source: str
    object_id: int
    views: tuple[View, ...]


def box_corners(vertices: np.ndarray) -> np.ndarray:
    """The corners (8, 3) of the box round vertices (n, 3)."""
    low, high = vertices.min(0), vertices.max(0)
    return np.array(list(product(*zip(low, high, strict=True))))


def picture_steps(views: Sequence[View], corners_obj: np.ndarray) -> np.ndarray:
    """Mean shift (n - 1,) of the box corners (8, 3) from each view to the next, px."""
    seen = _seen(views, corners_obj)
    return np.linalg.norm(np.diff(seen, axis=0), axis=2).mean(1)


def ordered(track: Track, corners_obj: np.ndarray, max_step_px: float, max_step_deg: float) -> list[Track]:
    """The track in order of nearest views, cut where no view is left within both limits.

    Starts at the first view and, after a cut, at the first of those left. Views in which a corner of the box lies
    behind the camera end up alone. What is put in order is numbered anew, from 0 on: the source's order is gone.
    """
    seen = _seen(track.views, corners_obj)
    rotations = np.array([view.cam_T_obj[:3, :3] for view in track.views])
    least_trace = 1.0 + 2.0 * np.cos(np.deg2rad(max_step_deg))
    left = list(range(len(track.views)))
    chains: list[list[int]] = []
    while left:
        chain = [left.pop(0)]
        while left:
            steps = np.linalg.norm(seen[left] - seen[chain[-1]], axis=2).mean(1)
            traces = np.einsum("nij,ij->n", rotations[left], rotations[chain[-1]])
            steps[np.isnan(steps) | (traces < least_trace)] = np.inf
            nearest = int(steps.argmin())
            if steps[nearest] > max_step_px:
                break
            chain.append(left.pop(nearest))
        chains.append(chain)
    return [
        replace(track, views=tuple(replace(track.views[i], number=k) for k, i in enumerate(chain))) for chain in chains
    ]


def longer_than(tracks: Iterable[Track], min_frames: int) -> tuple[list[Track], int]:
    """The tracks of at least min_frames views, and how many views the others had together."""
    tracks = list(tracks)
    kept = [track for track in tracks if len(track.views) >= min_frames]
    return kept, sum(len(track.views) for track in tracks) - sum(len(track.views) for track in kept)


def motion(views: Sequence[View], corners_obj: np.ndarray) -> dict[str, object]:
    """What a tracker has to follow, per step: turns in degrees, shifts of the box corners in px, as mean and max.

    Steps from or to a view with a corner behind the camera have no shift, and count for none.
    """
    turns = [rotation_angle_deg(a.cam_T_obj[:3, :3], b.cam_T_obj[:3, :3]) for a, b in pairwise(views)]
    steps = picture_steps(views, corners_obj)
    numbers = {"rot_deg": np.array(turns), "step_px": steps[np.isfinite(steps)]}
    summary: dict[str, object] = {"frames": len(views)}
    for name, values in numbers.items():
        summary[f"{name}_mean"] = round(float(values.mean()), 2) if len(values) else 0.0
        summary[f"{name}_max"] = round(float(values.max()), 2) if len(values) else 0.0
    return summary


def _seen(views: Sequence[View], corners_obj: np.ndarray) -> np.ndarray:
    """Pixels (n, 8, 2) of the corners in each view; NaN behind a camera."""
    pixels = [view.camera.project(transform(view.cam_T_obj, corners_obj)) for view in views]
    return np.array(pixels).reshape(-1, len(corners_obj), 2)
