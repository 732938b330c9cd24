"""Notebook 09: tracking a sequence, and reading a failure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from acp_lab.cad.part import Part
from acp_lab.course.answers import Hint, as_array, as_choice, as_function
from acp_lab.course.grader import exercise
from acp_lab.course.workshop import sample_scene
from acp_lab.evaluation import add_mm
from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.pose import disturb_pose
from acp_lab.prepared_part import PreparedPart
from acp_lab.sequences.altered import AlteredSequence
from acp_lab.sequences.frame import Frame
from acp_lab.tracking.result import TrackState
from acp_lab.tracking.session import TrackRun
from acp_lab.tracking.states import StateConfig, StateMachine
from acp_lab.tracking.tracker import Tracker

CAUSES = ("occlusion", "missing frames", "bad start", "focal length", "edge break")
_SPOILT = {"A": "occlusion", "B": "focal length", "C": "bad start"}
_LOOK_AT = {
    "A": "the quality falls within a few frames and comes back later. Play the frames around its lowest point, and "
    "look at the picture before you read what explain calls it.",
    "B": "the quality is as usual from the first frame to the last, and so is the error. Do the edges sit on the part? "
    "Print the last column of cam_T_obj in frame 0, and of the truth.",
    "C": "look at the very first frame: do the edges sit on the part, and is its quality that of the other runs?",
}
_TRICKY = (
    (0.9, 0.55, 0.48, 0.52, 0.58, 0.62, 0.55),
    (0.9, 0.1, 0.7, 0.1, 0.1, 0.3, 0.45, 0.7, 0.4, 0.55, 0.52, 0.65),
    (0.9, 0.2, 0.3, 0.2, 0.2, 0.2, 0.7, 0.8),
    (0.9, 0.5, 0.4, 0.6, 0.25, 0.25, 0.2, 0.2, 0.5, 0.5, 0.55, 0.6),  # the limits: neither below nor above
)


@exercise("09.1")
def states_of_qualities(answer: Any) -> str:
    """states(qualities) -> list of words, held against the tracker's own machine."""
    states = as_function(answer, "a function states(qualities)")
    rng = np.random.default_rng(91)
    longer = [np.round(rng.uniform(0.1, 0.8, 40), 3).tolist() for _ in range(3)]
    for qualities in (*map(list, _TRICKY), *longer):
        found = states(list(qualities))
        try:
            is_one_each = not isinstance(found, str) and len(found) == len(qualities)
        except TypeError:
            is_one_each = False
        if not is_one_each:
            raise Hint("Return a list with one word for each quality.")
        _compare_states(qualities, [as_choice(word, tuple(TrackState)) for word in found])
    return "Two limits for each change, and some patience: without them a quality near a limit would flicker."


def _compare_states(qualities: Sequence[float], found: Sequence[str]) -> None:
    machine = StateMachine(StateConfig())
    for number, (quality, word) in enumerate(zip(qualities, found, strict=True)):
        before = machine.state
        machine.update(quality)
        if word == machine.state:
            continue
        past = ", ".join(f"{value:g}" for value in qualities[max(0, number - 2) : number]) or "nothing"
        raise Hint(
            f"A frame with quality {quality:g}, after {past}, while the state is '{before}': yours turns to '{word}'. "
            f"Which limits count when the state is '{before}', and how many low or high frames in a row were there?"
        )


@exercise("09.2")
def what_spoilt_them(answer: Any) -> str:
    """What was done to each of the `unlabelled_runs`."""
    if not isinstance(answer, Mapping):
        raise Hint('Answer with a dictionary such as {"A": "occlusion", "B": "occlusion", "C": "occlusion"}.')
    given = {str(name).strip().upper(): cause for name, cause in answer.items()}
    missing = [name for name in _SPOILT if name not in given]
    if missing:
        raise Hint(f"Run {missing[0]} has no answer yet: the keys are {', '.join(_SPOILT)}.")
    for name, cause in _SPOILT.items():
        if as_choice(given[name], CAUSES) != cause:
            raise Hint(f"Run {name}: {_LOOK_AT[name]}")
    return (
        "All three. explain names the first beside other causes, calls the second something else, and of the third "
        "says, knowing the truth, only that the pose is beside the part: what is wrong from the first frame on has no "
        "good frame before it to be compared with, only such as are as wrong."
    )


def unlabelled_runs(model: PreparedPart) -> dict[str, TrackRun]:
    """Three runs over the sample, each spoilt in one way; model: the sample part, prepared."""
    scene, part = sample_scene(), model.part
    start = scene.first_pose
    far = disturb_pose(start, part.box_centre, 150.0, 5.0, np.random.default_rng(1))
    runs = (
        Tracker(model).run(AlteredSequence(scene, _strip), start),
        Tracker(model).run(AlteredSequence(scene, _short_lens), start),
        Tracker(model).run(scene, far),
    )
    return {name: replace(run, name=f"run {name}") for name, run in zip(_SPOILT, runs, strict=True)}


def _strip(frame: Frame) -> Frame:
    """A narrow patterned board that passes from the right to the left."""
    if not 14 <= frame.index < 34:
        return frame
    image = frame.image.copy()
    left = 390 - 12 * (frame.index - 14)
    for number, x in enumerate(range(left, left + 72, 6)):
        image[:, max(x, 0) : max(x + 6, 0)] = ((215, 215, 220), (70, 60, 50))[number % 2]
    return replace(frame, image=image)


def _short_lens(frame: Frame) -> Frame:
    camera = frame.camera
    return replace(frame, camera=replace(camera, fx=1.055 * camera.fx, fy=1.055 * camera.fy))


LARGEST_PERCENT = 10.0
"""Of the diameter: a small tracker may drift, but must not lose the part."""


@exercise("09.3")
def small_tracker(answer: Any) -> str:
    """make(part) -> a tracker with start(frame, cam_T_obj) and track(frame), run over the sample."""
    make = as_function(answer, "a class, or a function make(part), that gives a tracker")
    scene = sample_scene()
    part = scene.dataset.part(1)
    tracker = make(part)
    missing = [name for name in ("start", "track") if not callable(getattr(tracker, name, None))]
    if missing:
        raise Hint(
            f"What make(part) returns has no method {missing[0]}: it needs start(frame, cam_T_obj) and track(frame)."
        )
    percents = []
    for number, frame in enumerate(scene.frames()):
        assert isinstance(frame, Frame)
        try:
            pose = tracker.track(frame) if number else tracker.start(frame, scene.first_pose.copy())
        except Exception as error:  # the learner's code may fail in any way
            raise Hint(f"Frame {number}: {type(error).__name__}: {error}") from None
        percents.append(_percent_of(part, pose, scene.truth(frame.index, 1), number))
    within = sum(percent < 2.0 for percent in percents[1:])
    return (
        f"You wrote a tracker: all {len(percents)} frames, {within} of {len(percents) - 1} below 2% of the diameter, "
        f"the largest error {max(percents):.1f}%. What acp adds is memory, offsets of edges, recovery and a state."
    )


def _percent_of(part: Part, pose: Any, truth: FloatArray | None, number: int) -> float:
    try:
        found = as_array(pose, (4, 4), "a pose")
    except Hint:
        raise Hint(
            f"Frame {number}: return the pose cam_T_obj, a finite (4, 4) matrix, from start as well as from track."
        ) from None
    assert truth is not None
    percent = 100.0 * add_mm(part.vertices, found, truth) / part.diameter
    if percent <= LARGEST_PERCENT:
        return percent
    if number < 3:
        raise Hint(
            f"Frame {number}: ADD is {percent:.0f}% of the diameter already. Check one step: does J times the step "
            "have the sign of the residuals, and is the shift in mm, the turn in radians about the part's middle?"
        )
    raise Hint(
        f"It held for {number} frames; in frame {number} ADD is {percent:.0f}%. Do you choose the visible edges anew "
        "in each frame, predict, and let far candidates count less as the reach shrinks?"
    )
