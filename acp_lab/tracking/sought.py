"""Where a lost part was looked for, and what was found: told with a frame's result, logged in the replay, kept in
`results.run.json` for `acp-lab explain`.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from acp_lab.detection.pose_prior import PosePrior
from acp_lab.errors import GeometryError
from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.pose import check_pose

MOST_KEPT = 5000
"""Lost frames whose search is kept of a run; a part that left for good must not fill the disk."""


@dataclass(frozen=True, eq=False)
class Sought:
    """The search for a lost part, as it stood after a frame.

    Attributes:
        near: (4, 4) mm, the pose that it went around; None for everywhere and from any side.
        within_deg: largest turn from there. around_px: margin around where the part appears at `near`; None for the
            whole image.
        found: (4, 4) mm, the best hypothesis of the search that ended last; None where none ended or nothing was
            found. score: of it, in [0, 1].
    """

    near: FloatArray | None = None
    within_deg: float = 180.0
    around_px: float | None = None
    found: FloatArray | None = None
    score: float = 0.0

    @classmethod
    def by(cls, prior: PosePrior | None, found: FloatArray | None, score: float) -> Sought:
        """What a prior limits a search to, None for nothing; and what was found last."""
        if prior is None:
            return cls(found=found, score=score)
        return cls(prior.cam_T_obj, prior.within_deg, prior.around_px, found, score)

    @property
    def place(self) -> str:
        """Where, in words."""
        if self.near is None:
            return "in the whole image, from any side and at any distance"
        where = "in the whole image" if self.around_px is None else f"within {self.around_px:.0f} px of its last place"
        side = "from any side" if self.within_deg >= 180.0 else f"turned by up to {self.within_deg:.0f} degrees"
        return f"{where}, {side}, near a distance of {self.near[2, 3]:.0f} mm"

    def __str__(self) -> str:
        if self.found is None:
            return f"searched {self.place}; no hypothesis yet"
        at = np.round(self.found[:3, 3]).astype(int).tolist()
        return f"searched {self.place}; best hypothesis: score {self.score:.2f} at t = {at} mm"


def to_row(scene_id: int, im_id: int, obj_id: int, sought: Sought) -> Mapping[str, Any]:
    """As JSON holds it."""
    poses = {name: None if pose is None else pose.tolist() for name, pose in _poses(sought)}
    limits = {"within_deg": sought.within_deg, "around_px": sought.around_px, "score": sought.score}
    return {"scene_id": scene_id, "im_id": im_id, "obj_id": obj_id, **poses, **limits}


def from_rows(rows: Iterable[Any], scene_id: int) -> dict[tuple[int, int], Sought]:
    """By (obj_id, im_id): those of one scene. Rows that are none, of a file that was edited, are left out."""
    found = {}
    for row in rows:
        try:
            if int(row["scene_id"]) != scene_id:
                continue
            around = row["around_px"]
            found[int(row["obj_id"]), int(row["im_id"])] = Sought(
                _pose(row["near"]),
                float(row["within_deg"]),
                None if around is None else float(around),
                _pose(row["found"]),
                float(row["score"]),
            )
        except (KeyError, TypeError, ValueError, GeometryError):
            continue
    return found


def _poses(sought: Sought) -> tuple[tuple[str, FloatArray | None], ...]:
    return ("near", sought.near), ("found", sought.found)


def _pose(rows: Any) -> FloatArray | None:
    if rows is None:
        return None
    pose = np.array(rows, np.float64)
    check_pose(pose, "a search")
    return pose
