"""The ablation's choice of settings: never by sequences of the part that is scored, never by disturbed starts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.pose import transform
from benchmarks.ablation import STARTS, Track, _resized, chosen_without, rows_of
from tests.prepared_sample import sample_scene

GOOD, BAD = np.full(20, 0.01), np.full(20, 0.5)


def a_track(part: str, setting: str, errors: FloatArray, start: str = "truth") -> Track:
    return Track(f"sequence of {part}", part, "acp-paper", setting, start, errors)


def test_settings_are_chosen_on_other_parts_from_truth() -> None:
    off = next(start for start in STARTS if start != "truth")
    tracks = [
        *(a_track("mine", setting, errors) for setting, errors in (("small", GOOD), ("large", BAD))),
        *(a_track("other", setting, errors) for setting, errors in (("small", BAD), ("large", GOOD))),
        *(a_track("third", setting, errors, off) for setting, errors in (("small", GOOD), ("large", BAD))),
    ]
    assert chosen_without("mine", tracks) == "large"
    assert chosen_without("other", tracks) == "small"


def test_rows_tell_starts_apart_and_count_lost_frames() -> None:
    off = next(start for start in STARTS if start != "truth")
    half = np.where(np.arange(20) < 10, 0.03, np.inf)
    rows = rows_of([a_track("mine", "small", GOOD), a_track("mine", "small", half, off)])
    assert rows["truth: acp-paper"]["@2"][0] == 1.0
    assert [rows[f"{off}: acp-paper"][key][0] for key in ("@2", "@5", "@10")] == pytest.approx([0.0, 0.5, 0.5])


def test_an_image_of_another_size_shows_the_same_view() -> None:
    scene = sample_scene()
    frame, pose = scene.frame(scene.frame_ids[0]), scene.first_pose
    larger = _resized(frame, (2 * frame.camera.width, 3 * frame.camera.height))
    assert larger.image.shape[:2] == (3 * frame.camera.height, 2 * frame.camera.width)
    points_cam = transform(pose, np.array([[0.0, 0.0, 0.0], [10.0, 5.0, 3.0]]))
    before, after = frame.camera.project(points_cam), larger.camera.project(points_cam)
    np.testing.assert_allclose(after + 0.5, (before + 0.5) * (2.0, 3.0), atol=1e-9)
    grey = replace(frame, image=np.full_like(frame.image, 77))
    assert (_resized(grey, (1224, 1024)).image == 77).all()
