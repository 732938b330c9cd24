"""Parts of any size are tracked alike: settings in mm are in proportion, and nothing else depends on mm."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, is_dataclass, replace
from typing import Any, ClassVar

import numpy as np
import pytest

from acp_lab.cad.part import LARGEST_DIAMETER, SMALLEST_DIAMETER, USUAL_DIAMETERS, Part
from acp_lab.evaluation.part_metric import PartMetric
from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.pose import disturb_pose
from acp_lab.prepared_part import DEFAULT_EDGE_BREAK_MM
from acp_lab.sequences.frame import Frame
from acp_lab.tracking.kalman import KalmanPrediction
from acp_lab.tracking.learning.edge_profiles import ProfileConfig
from acp_lab.tracking.method import ACP, METHODS
from acp_lab.tracking.part_size import for_size
from acp_lab.tracking.tracker import Tracker
from acp_lab.tracking.uncertainty import PoseUncertainty
from tests.made_parts import bracket, looking_at
from tests.tracking.rendered import CAMERA, draw, poses, prepared

FRAMES, DISTANCE = 6, 260.0


@dataclass(frozen=True)
class Inner:
    in_mm: ClassVar[Mapping[str, int]] = {"reach": 1, "stiffness": -2}
    reach: float = 2.0
    stiffness: float = 1.0
    share: float = 0.5


@dataclass(frozen=True)
class Outer:
    in_mm: ClassVar[Mapping[str, int]] = {"limits": 1}
    inner: Inner = Inner()
    several: tuple[Inner, ...] = (Inner(),)
    limits: tuple[float, float] = (1.0, 3.0)
    reach: float = 7.0


def test_only_what_is_in_mm_grows() -> None:
    large = Inner(8.0, 1.0 / 16.0)
    assert for_size(Outer(), 4.0) == Outer(large, (large,), (4.0, 12.0))
    assert for_size(Outer(), 1.0) == Outer()


def in_mm(settings: Any) -> dict[str, tuple[Any, int]]:
    """Settings that are named as lengths in mm, or told so by their class, by their paths, with their power of mm."""
    found: dict[str, tuple[Any, int]] = {}
    for field in fields(settings):
        value, powers = getattr(settings, field.name), getattr(settings, "in_mm", {})
        for number, one in enumerate(value if isinstance(value, tuple) else (value,)):
            if is_dataclass(one):
                found |= {f"{field.name}.{number}.{name}": inner for name, inner in in_mm(one).items()}
        if field.name.endswith("_mm") or field.name in powers:
            found[field.name] = value, powers.get(field.name, 1)
    return found


@pytest.mark.parametrize("method", METHODS.values(), ids=METHODS)
def test_every_setting_in_mm_is_in_proportion(method: Any) -> None:
    told, large = in_mm(method), in_mm(for_size(method, 8.0))
    assert set(told) == set(large)
    for name, (value, power) in told.items():
        assert large[name][0] == pytest.approx(np.multiply(8.0**power, value)), name


def test_acp_has_such_settings() -> None:
    names = set(in_mm(ACP))
    assert {"prediction.0.shift_mm", "learning.0.offsets.0.largest", "learning.0.profiles.0.outline_mm"} < names
    assert {"uncertainty.0.outline_mm", "learning.0.offsets.0.inner_limits"} < names
    assert "priors.0.translation" in in_mm(METHODS["region"])


@pytest.mark.parametrize("share", [0.001, 0.3, 0.999])
def test_parts_of_usual_size_are_tracked_with_settings_as_they_are(share: float) -> None:
    part = made((1.0 - share) * USUAL_DIAMETERS[0] + share * USUAL_DIAMETERS[1])
    assert part.times_usual == 1.0
    assert Tracker(prepared(part)).solver.method is ACP


def test_a_tracker_has_the_settings_of_its_part() -> None:
    part = made(320.0)
    assert part.times_usual == pytest.approx(2.0)
    tracker = Tracker(prepared(part))
    prediction = tracker.solver.method.prediction
    assert tracker.method is ACP  # as it was given, for another tracker, too
    assert isinstance(prediction, KalmanPrediction)
    assert prediction.shift_mm == pytest.approx(2.0 * KalmanPrediction().shift_mm)
    assert made(30.0).times_usual == pytest.approx(0.5)


@pytest.mark.parametrize("times", [SMALLEST_DIAMETER / USUAL_DIAMETERS[0], LARGEST_DIAMETER / USUAL_DIAMETERS[1]])
def test_settings_that_are_taken_serve_parts_of_any_size(times: float) -> None:
    for settings in (
        PoseUncertainty(crease_mm=1e6),
        ProfileConfig(outline_mm=-100.0, usual_break_mm=100.0, trait_shift_mm=1e6),
        ProfileConfig(trait_shift_mm=1e-5),
    ):
        assert for_size(settings, times) != settings


def made(diameter: float) -> Part:
    """A bracket that is so large."""
    part = bracket()
    return Part.from_mesh(part.vertices * (diameter / part.diameter), part.faces, "bracket")


def tracked(times: float, method: Any = ACP, start_deg: float = 3.0) -> list[tuple[FloatArray, float]]:
    """Poses in units of the part, and their qualities, of a bracket so many times as large; the same images.

    start_deg: how far the start is off, and twice as many mm.
    """
    small, part = made(256.0), made(256.0 * times)
    start = looking_at(small, np.array([1.0, 0.5, 0.4]), DISTANCE * small.diameter / 60.0, 0.4)
    unit = 256.0 / 60.0
    truths = poses(small, start, FRAMES, np.array([0.02, -0.025, 0.015, 0.8 * unit, -0.5 * unit, 1.2 * unit]))
    model = replace(prepared(part), edge_break_mm=part.times_usual * DEFAULT_EDGE_BREAK_MM)
    tracker = Tracker(model, method)
    found = []
    for number, truth in enumerate(truths):
        frame = Frame(number, draw([(small, truth)], number), CAMERA)
        if number == 0:
            at = truth.copy()
            at[:3, 3] *= times
            rng = np.random.default_rng(3)
            result = tracker.start(frame, disturb_pose(at, part.box_centre, start_deg, 2.0 * start_deg * times, rng))
        else:
            result = tracker.track(frame)
        pose = result.cam_T_obj.copy()
        pose[:3, 3] /= times
        assert number == 0 or PartMetric(small).percent(pose, truth) < (5.0 if method.name.startswith("acp") else 60.0)
        found.append((pose, result.quality))
    return found


@pytest.mark.parametrize(
    ("name", "start_deg"), [("acp", 3.0), ("acp", 0.0), ("acp-edges", 3.0), ("region", 3.0), ("slet", 3.0)]
)
def test_a_larger_part_farther_away_is_tracked_to_the_same_poses(name: str, start_deg: float) -> None:
    """A power of two, so that even rounding is the same; of an exact start colours measure their offsets, too."""
    small, large = (tracked(times, METHODS[name], start_deg) for times in (1.0, 8.0))
    for (pose, quality), (large_pose, large_quality) in zip(small, large, strict=True):
        np.testing.assert_allclose(large_pose, pose, atol=1e-5)
        assert large_quality == pytest.approx(quality, abs=1e-5)
