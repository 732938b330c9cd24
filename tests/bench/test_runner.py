"""Runs of a tracker that errs by known amounts: what is measured must be what was planted."""

from __future__ import annotations

import math
import weakref
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from acp_lab.bench import runner
from acp_lab.bench.protocol import SequenceKey, Task, Variant, task_of
from acp_lab.bench.runner import run, run_task, sequences_of
from acp_lab.errors import PreparationError, TrackingError
from acp_lab.evaluation.metrics import pooled_scores
from acp_lab.geometry.pose import disturb_pose, rotation_angle_deg, transform
from acp_lab.machine import peak_memory_mb
from acp_lab.prepared_part import PreparedPart
from acp_lab.sample import sample_dataset
from acp_lab.sequences.bop import BopScene
from acp_lab.sequences.frame import Frame
from acp_lab.tracking.method import ACP, ACP_EDGES, METHODS
from acp_lab.tracking.result import Timings, TrackResult, TrackState
from tests.commands.conftest import edit_json, write_dataset
from tests.prepared_sample import sample_model, sample_scene

PLANTED_MM = 3.0
LOST_MM = 500.0


def sample_task(variant: Variant | None = None, method: str = "acp-edges") -> Task:
    key = SequenceKey("sample", sample_scene().scene_id, 1)
    return task_of(sample_dataset(), "test", Path("parts"), key, METHODS[method], variant or Variant())


class ErringTracker:
    """Knows the truth, and is off it by a shift along the camera's x axis; from `lost_from` on it is far away."""

    lost_from = 10**9
    starts: list[tuple[int, np.ndarray]]

    def __init__(self, model: PreparedPart, method: Any) -> None:
        ErringTracker.starts = []
        self._since = 0

    def start(self, frame: Frame, cam_T_obj: np.ndarray) -> TrackResult:
        ErringTracker.starts.append((frame.index, cam_T_obj))
        self._since = 0
        return self.track(frame)

    def track(self, frame: Frame) -> TrackResult:
        pose = sample_scene().truth(frame.index, 1)
        assert pose is not None
        pose[0, 3] += LOST_MM if self._since >= self.lost_from else PLANTED_MM
        self._since += 1
        nothing = np.zeros((4, 2))
        return TrackResult(frame.index, pose, pose, nothing, 0.0, 0.5, TrackState.TRACKING, 0, None, None, 0, Timings())


@pytest.fixture(autouse=True)
def prepared_sample(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(PreparedPart, "load", lambda *_: sample_model())
    runner._prepared.cache_clear()


def test_a_planted_error_is_measured_as_that_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(runner, "Tracker", ErringTracker)
    found = run(sample_task())
    count = len(sample_scene().frame_ids) - 1
    assert len(found.frame_ids) == count
    np.testing.assert_allclose(found.distance, PLANTED_MM / sample_model().part.diameter, rtol=1e-9)
    np.testing.assert_allclose(found.translation_mm, PLANTED_MM, rtol=1e-9)
    np.testing.assert_allclose(found.rotation_deg, 0.0, atol=1e-5)
    scores = pooled_scores([found.errors])
    assert scores.trans_mm_median == pytest.approx(PLANTED_MM)
    assert scores.auc_10pct == pytest.approx(1.0 - PLANTED_MM / (0.1 * sample_model().part.diameter))


def test_the_start_is_off_by_exactly_what_was_asked_and_a_seed_gives_a_direction(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(runner, "Tracker", ErringTracker)
    true, centre = sample_scene().first_pose, sample_model().part.box_centre
    starts = []
    for seed in (0, 1):
        run(sample_task(Variant(noise_deg=5.0, noise_mm=4.0, seed=seed)))
        starts.append(ErringTracker.starts[0][1])
        assert rotation_angle_deg(starts[-1][:3, :3], true[:3, :3]) == pytest.approx(5.0)
        assert np.linalg.norm(transform(starts[-1], centre) - transform(true, centre)) == pytest.approx(4.0)
    assert not np.allclose(*starts)
    # As the contract says: the generator of [seed, scene, object].
    rng = np.random.default_rng([1, sample_scene().scene_id, 1])
    np.testing.assert_allclose(starts[1], disturb_pose(true, centre, 5.0, 4.0, rng))


def test_resets_start_again_from_the_truth_of_the_lost_frame(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(runner, "Tracker", ErringTracker)
    monkeypatch.setattr(ErringTracker, "lost_from", 5)
    kept, reset = run(sample_task()), run(sample_task(Variant(resets=True)))
    ids = sample_scene().frame_ids
    assert kept.resets == ()
    assert int((~(kept.distance < 0.3)).sum()) == len(ids) - 5
    # Five good frames, of which the first is the start, then a lost one, in which it starts again.
    assert reset.resets == ids[5::5]
    assert [frame_id for frame_id, _ in ErringTracker.starts] == [ids[0], *ids[5::5]]
    np.testing.assert_allclose(ErringTracker.starts[1][1], sample_scene().truth(ids[5], 1))
    assert int((~(reset.distance < 0.3)).sum()) == len(ids[5::5])


def test_every_third_frame_is_every_third_frame(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(runner, "Tracker", ErringTracker)
    assert run(sample_task(Variant(step=3))).frame_ids == sample_scene().frame_ids[::3][1:]


@pytest.mark.parametrize("refusal", [TrackingError, PreparationError])
def test_a_refused_start_is_a_run_without_poses(
    monkeypatch: pytest.MonkeyPatch, refusal: type[TrackingError | PreparationError]
) -> None:
    def refuse(*_: object) -> None:
        raise refusal("the part is not seen")

    monkeypatch.setattr(ErringTracker, "start", refuse)
    monkeypatch.setattr(runner, "Tracker", ErringTracker)
    found = run(sample_task())
    assert found.is_lost
    assert np.isinf(found.distance).all()
    assert "not seen" in found.note


def test_a_real_run_says_all_there_is_to_say() -> None:
    found = run(sample_task())
    assert pooled_scores([found.errors]).recall_5 > 0.9
    assert found.size == (640, 512)
    assert 0.0 < np.median(found.ms) < 1e4
    assert found.metric == "ADD"
    peak = peak_memory_mb()
    assert peak is None or 50.0 < found.memory_mb <= peak
    assert run_task(sample_task().to_json())[0] == "{"


def test_sequences_are_found() -> None:
    assert sequences_of(sample_dataset(), "test") == [SequenceKey("sample", 1, 1)]


def test_a_part_without_the_generator_is_refused_before_anything_runs() -> None:
    runner.check(sample_task())
    with pytest.raises(PreparationError, match="method acp-paper"):
        runner.check(sample_task(method="acp-paper"))


def test_the_defaults_of_a_task_are_the_methods(monkeypatch: pytest.MonkeyPatch) -> None:
    assert sample_task().settings() == ACP_EDGES
    assert sample_task(method="acp").settings() == ACP


def test_a_long_scene_is_read_frame_by_frame(monkeypatch: pytest.MonkeyPatch) -> None:
    """What fits stays decoded for the next run, and no more than that; nothing holds on to the others."""
    monkeypatch.setattr(runner, "Tracker", ErringTracker)
    monkeypatch.setattr(runner, "DECODED_MB", 3 * 3 * 640 * 512 / 1e6)
    runner._opened.cache_clear()
    alive: list[weakref.ref[Frame]] = []
    most = 0
    read = BopScene.frame

    def watched(scene: BopScene, frame_id: int) -> Frame:
        nonlocal most
        frame = read(scene, frame_id)
        assert isinstance(frame, Frame)
        alive.append(weakref.ref(frame))
        most = max(most, sum(one() is not None for one in alive))
        return frame

    monkeypatch.setattr(BopScene, "frame", watched)
    count = len(sample_scene().frame_ids)
    run(sample_task())
    assert len(alive) == count
    assert most <= 3 + 2
    run(sample_task())
    assert len(alive) == 2 * count - 3  # the three that fit were not read again
    runner._opened.cache_clear()


def test_a_process_that_lives_long_sees_that_data_was_changed(tmp_path: Path) -> None:
    root = write_dataset(tmp_path / "data")
    task = task_of(root, "test", tmp_path / "parts", SequenceKey("data", 1, 1), METHODS["region"], Variant())
    before, part = runner._opened_of(task).frame(3), runner._measured_of(task)[0]
    assert runner._opened_of(task).frame(3) is before
    assert runner._measured_of(task)[0] is part
    image = root / "test" / "000001" / "rgb" / "000003.png"
    assert cv2.imwrite(str(image), np.zeros((240, 320, 3), np.uint8))
    after = runner._opened_of(task).frame(3)
    assert isinstance(before, Frame)
    assert isinstance(after, Frame)
    assert before.image.any()
    assert not after.image.any()
    assert runner._measured_of(task)[0] is part  # the model was not touched
    edit_json(
        root / "models" / "models_info.json",
        lambda infos: infos["1"].update(symmetries_continuous=[{"axis": [0, 0, 1], "offset": [0, 0, 0]}]),
    )
    assert not part.symmetries.continuous
    assert runner._measured_of(task)[0].symmetries.continuous


def test_a_method_is_charged_with_what_it_needs() -> None:
    assert runner.stages_of(METHODS["region"]) == ("edges", "templates")
    assert runner.stages_of(ACP) == ("edges", "templates", "networks", "views")
    assert runner.stages_of(METHODS["acp-paper"]) == ("edges", "control points", "auto-encoder")


def test_preparation_of_earlier_parts_is_not_known(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(runner, "Tracker", ErringTracker)
    spent = dict.fromkeys(("edges", "templates", "networks", "views"), 2.5)
    for cpu_s, expected in ((spent, 10.0), ({}, math.nan)):
        model = replace(sample_model(), cpu_s=cpu_s)
        monkeypatch.setattr(PreparedPart, "load", lambda *_, model=model: model)
        runner._prepared.cache_clear()
        assert run(sample_task()).prepare_s == pytest.approx(expected, nan_ok=True)
