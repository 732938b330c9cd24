"""Frames: what is seen, and what is said of it.

On the sample sequence, with view templates; poses are compared with its truth.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from acp_lab.sequences.altered import AlteredSequence
from acp_lab.sequences.frame import Frame, UnreadableFrame
from acp_lab.tracking.result import TrackResult, TrackState
from acp_lab.tracking.tracker import Tracker
from tests.commands.conftest import FRAME_IDS
from tests.faults.table import Workplace, row
from tests.prepared_sample import sample_model, sample_scene
from tests.tracking.rendered import add_percent

FIRST, LAST = 12, 14
"""Frames of the sample with the fault."""
Change = Callable[[Frame], Frame | UnreadableFrame]


def tracked(change: Change, first: int = FIRST, last: int = LAST, start_at: int = 0) -> list[TrackResult]:
    """The sample with frames `first` to `last` changed; its results."""

    def altered(frame: Frame) -> Frame | UnreadableFrame:
        return change(frame) if first <= frame.index <= last else frame

    sequence = AlteredSequence(sample_scene(), altered)
    run = Tracker(sample_model()).run(sequence, sample_scene().first_pose)
    return list(run.results[1])


def survived(
    results: list[TrackResult], after: int = LAST + 5, may_be_weak: bool = False, within_percent: float = 5.0
) -> str:
    """Assert that the part is on its place, and said to be, from a few frames after the fault on."""
    part, scene = sample_model().part, sample_scene()
    for result in results:
        truth = scene.truth(result.frame_id, 1)
        if result.frame_id >= after and truth is not None:
            assert result.state is TrackState.TRACKING or (may_be_weak and result.state is TrackState.WEAK), result
            assert add_percent(part, result.cam_T_obj, truth) < within_percent, result.frame_id
    return "tracked on"


def states_in(results: list[TrackResult], first: int = FIRST, last: int = LAST) -> set[TrackState]:
    return {result.state for result in results if first <= result.frame_id <= last}


def image(change: Callable[[np.ndarray], np.ndarray]) -> Change:
    """Change a frame's image."""
    return lambda frame: replace(frame, image=change(frame.image))


@row("three frames cannot be read", "not said to be tracked; tracked again behind them", quick=True)
def unreadable(at: Workplace) -> str:
    results = tracked(lambda frame: UnreadableFrame(frame.index, frame.camera, "gone"))
    assert TrackState.TRACKING not in states_in(results)
    assert all(result.quality == 0.0 for result in results if FIRST <= result.frame_id <= LAST)
    survived(results)
    return "weak, lost, lost; then tracked on"


@row("three blank frames", "not said to be tracked; tracked again behind them")
def blank(at: Workplace) -> str:
    results = tracked(image(lambda pixels: np.full_like(pixels, 127)))
    assert TrackState.TRACKING not in states_in(results, FIRST + 1)
    return survived(results)


@row("the camera freezes for three frames", "tracked again behind them")
def frozen(at: Workplace) -> str:
    still = sample_scene().frame(FIRST - 1)
    assert isinstance(still, Frame)
    return survived(tracked(image(lambda pixels: still.image)))


@row("three frames are dropped", "tracked on")
def dropped(at: Workplace) -> str:
    kept = [frame_id for frame_id in sample_scene().frame_ids if not FIRST <= frame_id <= LAST]
    sequence = AlteredSequence(sample_scene(), frame_ids=kept)
    return survived(list(Tracker(sample_model()).run(sequence, sample_scene().first_pose).results[1]))


@row("sensor noise of 12 grey levels in all frames behind the first", "tracked on")
def noise(at: Workplace) -> str:
    rng = np.random.default_rng(5)

    def noisy(pixels: np.ndarray) -> np.ndarray:
        return np.clip(pixels + 12.0 * rng.standard_normal(pixels.shape), 0, 255).astype(np.uint8)

    return survived(tracked(image(noisy), 1, 100), after=1)


@row("exposure flickers by a tenth, from frame to frame", "the poses stay; never said to be lost")
def flicker(at: Workplace) -> str:
    def flickering(frame: Frame) -> Frame:
        gain = 1.1 if frame.index % 2 else 0.9
        return replace(frame, image=np.clip(gain * frame.image, 0, 255).astype(np.uint8))

    survived(tracked(flickering, 1, 100), after=1, may_be_weak=True)
    return "tracked on, weak in places"


@row("lamps are switched: grey values x0.4 from one frame to the next, and back", "tracked on")
def dimmed(at: Workplace) -> str:
    return survived(tracked(image(lambda pixels: (0.4 * pixels).astype(np.uint8)), FIRST, FIRST + 10), after=1)


@row("lamps are switched: grey values x2, most of them white, and back", "tracked on, less exactly while it is white")
def glaring(at: Workplace) -> str:
    doubled = tracked(image(lambda pixels: np.clip(2.0 * pixels, 0, 255).astype(np.uint8)), FIRST, FIRST + 10)
    survived(doubled, after=1, within_percent=8.0)
    survived(doubled, after=FIRST + 15)
    return "tracked on, within 8% of the diameter while it is white"


@row("exposure flickers by 40%, from frame to frame", "tracked on")
def strong_flicker(at: Workplace) -> str:
    gains = np.random.default_rng(3).uniform(0.6, 1.4, 200)

    def flickering(frame: Frame) -> Frame:
        return replace(frame, image=np.clip(gains[frame.index] * frame.image, 0, 255).astype(np.uint8))

    survived(tracked(flickering, 1, 100), after=1, may_be_weak=True)
    return "tracked on, weak in places"


@row("the first frame does not show the part", "not said to be tracked")
def blank_start(at: Workplace) -> str:
    frame = sample_scene().frame(sample_scene().frame_ids[0])
    assert isinstance(frame, Frame)
    result = Tracker(sample_model()).start(
        replace(frame, image=np.full_like(frame.image, 127)), sample_scene().first_pose
    )
    assert result.state is TrackState.LOST
    return "lost"


@row("every image but the first is unreadable", "the summary counts them and names the first lost frame", quick=True)
def all_unreadable(at: Workplace) -> str:
    for frame_id in FRAME_IDS[1:]:
        at.image(frame_id).write_bytes(b"")
    outcome = at.track("--object", "1")
    assert outcome.status == 0, outcome
    said = outcome.out.partition("frames of 320 x 240 ")[2].partition(", quality")[0]
    assert said == "(3 lost, 1 tracking, 1 weak; first lost from image 2 on; 4 not readable)", outcome.out
    return said.strip("()")
