"""The way back of a part that was hidden or that left: how often it is found again, and how soon.

    python -m benchmarks.recovery metal_public metal_dev --parts out/parts --record dev
    python -m benchmarks.recovery metal_public metal_dev --parts out/parts --size-px 60 --record small

Frames go forwards and backwards over a scene as often as needed. In the middle the part is covered by a board, plain
or with the picture of another place of the image, for 1, 5, 10 or 30 frames, while it moves on. In "jump" the sequence
goes on, after 10 covered frames, from another of its frames: one in which the part appears within 60 px and 20 degrees
of where it was last seen ("jump near"), or the one farthest from there ("jump far"). Tracking starts from truth, with
defaults.

A run is back when, from a frame within 10 of the end of the cover on, the state is tracking and ADD below 10% of the
diameter for five frames. Runs whose part comes back beyond 60 px or 20 degrees of where it was last seen have 60
frames, and make up the row "elsewhere". False: the longest row of frames with state tracking and ADD above 30%.
With --size-px frames are scaled down until the part appears so long in the middle one, and those 60 px with them: the
absences are the same.
PARTS holds prepared parts, or one folder of them per data set. Times are CPU ms, of each frame the shorter of two
runs; those of tracked frames say how busy the machine was.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from acp_lab.commands.machine import limit_threads

limit_threads(1)  # before NumPy is imported

import numpy as np  # noqa: E402

from acp_lab.cad.part import box_corners  # noqa: E402
from acp_lab.evaluation.part_metric import PartMetric  # noqa: E402
from acp_lab.geometry.pose import rotation_angle_deg, transform  # noqa: E402
from acp_lab.machine import short_collections  # noqa: E402
from acp_lab.prepared_part import PreparedPart  # noqa: E402
from acp_lab.sequences.bop import BopDataset, BopScene  # noqa: E402
from acp_lab.sequences.frame import Frame  # noqa: E402
from acp_lab.tracking.frame_view import crop_box  # noqa: E402
from acp_lab.tracking.magnification import appears_px  # noqa: E402
from acp_lab.tracking.method import Method, method_named  # noqa: E402
from acp_lab.tracking.method_file import read_method  # noqa: E402
from acp_lab.tracking.result import TrackState  # noqa: E402
from acp_lab.tracking.tracker import Tracker  # noqa: E402
from benchmarks import measured  # noqa: E402
from benchmarks.faulty_frames import covered  # noqa: E402
from benchmarks.part_sizes import scaled  # noqa: E402
from benchmarks.robustness import SPLITS, is_in_split  # noqa: E402
from benchmarks.runs import part_name, prepared_part_of, readable_frames  # noqa: E402

RIGHT, LOST = 0.1, 0.3
STEADY = 5
"""Frames in a row that make a part back."""
HIDDEN = {"hidden 1": 1, "hidden 5": 5, "hidden 10": 10, "hidden 30": 30, "jump near": 10, "jump far": 10}
"""Covered frames, by the kind of the absence."""
WAIT_NEAR, WAIT_ELSEWHERE = 10, 60
NEAR_PX, NEAR_DEG = 60.0, 20.0
UNIT = {
    "runs": "runs",
    "back": "share of runs in which the part is back in time",
    "false": "most frames in a row with state tracking and ADD above 30%",
    "lost_ms": "95th percentile of the CPU ms of frames in which the part is lost",
    "most_ms": "the longest of them",
    "tracked_ms": "median CPU ms of frames in which the part is not lost, in the same runs",
}


@dataclass(frozen=True)
class Walk:
    """One absence.

    kind: of HIDDEN. near: whether the part comes back near. before, covered, after: rows of the scene's frames.
    """

    kind: str
    near: bool
    before: tuple[int, ...]
    covered: tuple[int, ...]
    after: tuple[int, ...]


@dataclass(frozen=True)
class Return:
    """What came of it. back_after: frames from the end of the cover, None for never; false: see the module's head.

    lost_ms, tracked_ms: of frames in which the part is lost, and of others.
    """

    kind: str
    near: bool
    back_after: int | None
    false: int
    lost_ms: tuple[float, ...]
    tracked_ms: tuple[float, ...]

    @property
    def in_time(self) -> bool:
        """Whether the part is back soon enough."""
        return self.back_after is not None and self.back_after <= (WAIT_NEAR if self.near else WAIT_ELSEWHERE)

    @property
    def row(self) -> str:
        """Of the table."""
        return self.kind if self.near else "elsewhere"


def main() -> None:
    """See the module."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("datasets", nargs="+", type=Path)
    parser.add_argument("--parts", type=Path, required=True)
    parser.add_argument("--scene", type=int, action="append")
    parser.add_argument("--method", default="acp", help="a method's name, or a TOML file")
    parser.add_argument("--kinds", default=",".join(HIDDEN))
    parser.add_argument("--split", choices=SPLITS, default="all", help="which half of the parts")
    parser.add_argument("--size-px", type=float)
    parser.add_argument("--record", metavar="KEY")
    args = parser.parse_args()
    method = read_method(Path(args.method)) if args.method.endswith(".toml") else method_named(args.method)
    found: list[Return] = []
    for root in args.datasets:
        for scene_id in args.scene or BopDataset(root).scenes():
            scene = BopDataset(root).open_scene(scene_id)
            if not is_in_split(part_name(root, scene.object_ids[0]), args.split):
                continue
            with short_collections():
                new = list(returns(scene, args.parts, method, args.kinds.split(","), args.size_px))
            print(root.name, scene_id, *(_told(one) for one in new), sep="  ", flush=True)
            found += new
    rows = sorted({one.row for one in found}, key=[*HIDDEN, "elsewhere"].index)
    values = {row: row_of([one for one in found if one.row == row]) for row in rows}
    for kind, row in values.items():
        print(kind, row)
    if args.record:
        about = "runs in which the part was covered, and came back; tracker acp, defaults, from truth"
        about += "" if args.size_px is None else f"; frames scaled until the part appears {args.size_px:g} px long"
        names = ", ".join(root.name for root in args.datasets) + ("" if args.split == "all" else f" ({args.split})")
        measured.record(f"recovery.{args.record}", about, UNIT, names, values)


def returns(
    scene: BopScene, parts: Path, method: Method, kinds: Sequence[str], size_px: float | None = None
) -> Iterator[Return]:
    """What comes of a scene's absences; parts: folder of prepared parts; the others as on the command line."""
    object_id = scene.object_ids[0]
    model = prepared_part_of(scene, parts)
    metric = PartMetric(model.part, 500)
    frames = readable_frames(scene)
    truths = [scene.truth(frame.index, object_id) for frame in frames]
    known = [(f, t) for f, t in zip(frames, truths, strict=True) if t is not None]
    scale = 1.0
    if size_px is not None:
        middle, truth = known[len(known) // 2]
        scale = min(size_px / appears_px(model.part, middle.camera, truth), 1.0)
        known = [(scaled(frame, scale), truth) for frame, truth in known]
    for number, kind in enumerate(kinds):
        walk = _walk(kind, known, model, scale * NEAR_PX)
        if walk is not None:
            plain = (number + scene.scene_id) % 2 == 0
            yield _shorter(*(_play(walk, known, Tracker(model, method), metric, plain) for _ in range(2)))


def _shorter(one: Return, other: Return) -> Return:
    """The same absence played twice, of each frame the shorter time: what else a machine does comes and goes."""
    lost, tracked = (
        tuple(map(min, first, second))
        for first, second in ((one.lost_ms, other.lost_ms), (one.tracked_ms, other.tracked_ms))
    )
    return replace(one, lost_ms=lost, tracked_ms=tracked)


def _walk(kind: str, known: list[tuple[Frame, Any]], model: PreparedPart, near_px: float) -> Walk | None:
    """The rows to play; None where the scene has no place that is near."""
    count, seen, hidden = len(known), 12, HIDDEN[kind]
    path = [*range(count), *range(count - 2, 0, -1)]
    turn = [path[k % len(path)] for k in range(seen + hidden + WAIT_ELSEWHERE + 2 * STEADY)]
    before, covered, after = turn[:seen], turn[seen : seen + hidden], turn[seen + hidden :]
    if kind.startswith("jump"):
        far = [max(px / near_px, deg / NEAR_DEG) for px, deg in (_away(known[before[-1]], one, model) for one in known)]
        near = [k for k in range(count) if 0.5 < far[k] <= 1.0]
        if kind == "jump near" and not near:
            return None
        first = max(near, key=lambda k: far[k]) if kind == "jump near" else int(np.argmax(far))
        at = path.index(first)
        after = [path[(at + k) % len(path)] for k in range(len(after))]
        covered = [before[-1]] * hidden
    px, deg = _away(known[before[-1]], known[after[0]], model)
    is_near = px <= near_px and deg <= NEAR_DEG
    wait = WAIT_NEAR if is_near else WAIT_ELSEWHERE
    return Walk(kind, is_near, tuple(before), tuple(covered), tuple(after[: wait + 2 * STEADY]))


def _away(one: tuple[Frame, Any], other: tuple[Frame, Any], model: PreparedPart) -> tuple[float, float]:
    """px between the places of the part's centre in the image, degrees between its turns."""
    centres = [frame.camera.project(transform(pose, model.part.box_centre[None]))[0] for frame, pose in (one, other)]
    turned = min(
        rotation_angle_deg(one[1][:3, :3], (other[1] @ turn)[:3, :3]) for turn in model.part.symmetries.transforms()
    )
    return float(np.linalg.norm(centres[0] - centres[1])), float(turned)


def _play(walk: Walk, known: list[tuple[Frame, Any]], tracker: Tracker, metric: PartMetric, plain: bool) -> Return:
    corners = box_corners(tracker.part)
    first, truth = known[walk.before[0]]
    tracker.start(first, truth)
    errors, tracking, lost_ms, tracked_ms = list[float](), list[bool](), list[float](), list[float]()
    rows = [*walk.before[1:], *walk.covered, *walk.after]
    covers = range(len(walk.before) - 1, len(walk.before) - 1 + len(walk.covered))
    for number, row in enumerate(rows):
        frame, truth = known[row]
        if number in covers:
            frame = covered(frame, crop_box(corners, truth, frame.camera, 15.0), plain)
        begin = time.process_time()
        result = tracker.track(frame)
        of_state = lost_ms if result.state is TrackState.LOST else tracked_ms
        of_state.append(1e3 * (time.process_time() - begin))
        errors.append(metric.share(result.cam_T_obj, truth))
        tracking.append(result.state is TrackState.TRACKING)
    right = [e < RIGHT and t for e, t in zip(errors, tracking, strict=True)]
    since = covers.stop
    back = next((k - since + 1 for k in range(since, len(rows) - STEADY) if all(right[k : k + STEADY])), None)
    wrong = [e > LOST and t for e, t in zip(errors, tracking, strict=True)]
    return Return(walk.kind, walk.near, back, longest(wrong), tuple(lost_ms), tuple(tracked_ms))


def longest(flags: list[bool]) -> int:
    """How many in the longest row are true."""
    most = run = 0
    for flag in flags:
        run = run + 1 if flag else 0
        most = max(most, run)
    return most


def _told(one: Return) -> str:
    back = "never" if one.back_after is None else str(one.back_after)
    return f"{one.kind}{'' if one.near else ' (far)'}: {back}" + (f" (false {one.false})" if one.false > STEADY else "")


def row_of(returns: Sequence[Return]) -> dict[str, float]:
    """The values of a row, see UNIT."""
    lost = [ms for one in returns for ms in one.lost_ms]
    return {
        "runs": len(returns),
        "back": float(np.mean([one.in_time for one in returns])) if returns else 0.0,
        "false": max((one.false for one in returns), default=0),
        "lost_ms": float(np.percentile(lost, 95)) if lost else 0.0,
        "most_ms": max(lost, default=0.0),
        "tracked_ms": float(np.median([ms for one in returns for ms in one.tracked_ms])) if returns else 0.0,
    }


if __name__ == "__main__":
    main()
