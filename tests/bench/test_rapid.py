"""RAPID, OLS and GOS: the pipe, a worker that dies, and the real thing where its environment was made."""

from __future__ import annotations

import io
import sys
from pathlib import Path

import numpy as np
import pytest

from acp_lab.bench import runner
from acp_lab.bench.protocol import SequenceKey, Variant, task_of
from acp_lab.bench.rapid import environment, tracker
from acp_lab.bench.rapid.plain_arrays import receive, send
from acp_lab.bench.rapid.tracker import NAMES, RapidTracker, Worker, shared_worker
from acp_lab.errors import AcpLabError, PreparationError, TrackingError
from acp_lab.sample import sample_dataset
from acp_lab.sequences.frame import Frame, UnreadableFrame
from tests.prepared_sample import sample_scene


@pytest.fixture(autouse=True)
def no_worker_stays() -> None:
    shared_worker.cache_clear()


def sample_frame() -> Frame:
    frame = sample_scene().frame(sample_scene().frame_ids[0])
    assert isinstance(frame, Frame)
    return frame


def test_messages_survive_the_pipe(rng: np.random.Generator) -> None:
    stream = io.BytesIO()
    arrays = [rng.normal(size=(3, 4)), np.arange(6, dtype=np.uint8).reshape(2, 3), np.zeros(0), rng.normal(size=())]
    send(stream, {"do": "track", "number": 7}, *arrays)
    send(stream, {"do": "next"})
    stream.seek(0)
    found = receive(stream)
    assert found is not None
    assert found[0] == {"do": "track", "number": 7}
    for one, other in zip(found[1], arrays, strict=True):
        np.testing.assert_array_equal(one, other)
        assert one.dtype == other.dtype
    assert receive(stream) == ({"do": "next"}, [])
    assert receive(stream) is None


def test_without_the_environment_the_command_is_named(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv(environment.VARIABLE, str(tmp_path / "nowhere"))
    key = SequenceKey("sample", 1, 1)
    task = task_of(sample_dataset(), "test", tmp_path, key, "GOS", Variant())
    with pytest.raises(PreparationError, match="acp-lab bench --install-peers"):
        runner.check(task)


def test_an_installation_that_fails_says_why_and_leaves_nothing_that_counts(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv(environment.VARIABLE, str(tmp_path / "peers"))
    monkeypatch.setattr(environment, "REQUIREMENT", str(tmp_path / "no_such_wheel.whl"))
    with pytest.raises(PreparationError, match=r"no_such_wheel\.whl"):
        environment.install()
    with pytest.raises(PreparationError, match="--install-peers"):
        environment.python()


def test_a_worker_ends_with_its_input(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tracker, "python", lambda: Path(sys.executable))
    worker = Worker()
    assert worker._process.stdin is not None
    worker._process.stdin.close()
    assert worker._process.wait(timeout=30) == 0


def test_a_worker_that_dies_is_one_clear_error(monkeypatch: pytest.MonkeyPatch) -> None:
    """Our own OpenCV has no cv2.rapid: the worker ends at the first start."""
    monkeypatch.setattr(tracker, "python", lambda: Path(sys.executable))
    part = sample_scene().dataset.part(1)
    with pytest.raises(AcpLabError, match=r"cv2\.rapid died") as caught:
        RapidTracker(part, "GOS").start(sample_frame(), sample_scene().first_pose)
    # A refused start would be a result, and be kept; this is none.
    assert not isinstance(caught.value, TrackingError)


@pytest.fixture
def installed() -> None:
    try:
        environment.python()
    except PreparationError:
        pytest.skip(f"cv2.rapid is not there ({environment.folder()}): acp-lab bench --install-peers")


@pytest.mark.slow
@pytest.mark.usefixtures("installed")
@pytest.mark.parametrize("name", NAMES)
def test_a_real_tracker_keeps_the_part_in_sight_in_the_frame_that_it_sees_twice(name: str) -> None:
    scene = sample_scene()
    found = RapidTracker(scene.dataset.part(1), name)
    frame, truth = sample_frame(), scene.first_pose
    started = found.start(frame, truth)
    np.testing.assert_array_equal(started.cam_T_obj, truth)
    result = found.track(frame)
    assert np.linalg.norm(result.cam_T_obj[:3, 3] - truth[:3, 3]) < 0.6 * scene.dataset.part(1).diameter
    assert found.ms > 0.0
    blind = found.track(UnreadableFrame(99, None, "torn"))
    np.testing.assert_array_equal(blind.cam_T_obj, result.cam_T_obj)
    assert blind.quality == 0.0
