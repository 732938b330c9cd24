"""Replays are read back with rerun's own reader: what is in them, when, and where in the image."""

from __future__ import annotations

import subprocess
import sys
from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from acp_lab.commands.replay import check_replay
from acp_lab.display.replay import Replay
from acp_lab.errors import InputFileError
from tests.display.made_run import CAMERA, FRAME_IDS, frames, play, result

WANTED = ("image", "generated_edges", "control_points", "mesh", "truth", "loss", "quality", "add", "state")


def read(path: Path) -> dict[str, dict[str, list[tuple[int | None, Any]]]]:
    """Entity -> component -> [(frame, value)], in the order of the file; frame is None for what is static."""
    from rerun.chunk import RrdReader

    content: dict[str, dict[str, list[tuple[int | None, Any]]]] = defaultdict(lambda: defaultdict(list))
    for chunk in RrdReader(path).stream().to_chunks():
        batch = chunk.to_record_batch()
        # The time line of durations is left out: its nanoseconds become Python values only with pandas.
        names = [name for name in batch.schema.names if name != "time"]
        columns = {name: batch.column(name).to_pylist() for name in names}
        times = columns.get("frame") or [None] * batch.num_rows
        for name, values in columns.items():
            for time, value in zip(times, values, strict=True):
                if value is not None:
                    content[str(chunk.entity_path)][name].append((time, value))
    return content


def component(entity: dict[str, list[tuple[int | None, Any]]], ending: str) -> list[tuple[int | None, Any]]:
    """The values of the component whose name ends so."""
    (name,) = [name for name in entity if name.endswith(ending)]
    return entity[name]


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    play([Replay(tmp_path / "run.rrd")], object_ids=(1, 7))
    return tmp_path / "run.rrd"


def test_everything_is_in_it(recording: Path) -> None:
    content = read(recording)
    for wanted in WANTED:
        assert any(wanted in entity for entity in content), wanted
    for object_id in (1, 7):
        assert f"/camera/generated_edges/obj_{object_id:06d}" in content
    check_replay(recording)


def test_the_file_is_complete(recording: Path) -> None:
    command = [sys.executable, "-m", "rerun", "rrd", "verify", str(recording)]
    done = subprocess.run(command, capture_output=True, check=False)
    assert done.returncode == 0, done.stderr


def test_the_time_line_counts_on(tmp_path: Path) -> None:
    replay = Replay(tmp_path / "two.rrd", sessions=2)
    play([replay])
    play([replay])
    times = [time for time, _ in component(read(tmp_path / "two.rrd")["/curves/quality/obj_000001"], "scalars")]
    assert times == list(range(2 * len(FRAME_IDS)))


def test_points_are_half_a_pixel_further_in_rerun(recording: Path) -> None:
    content = read(recording)
    first = next(iter(frames()))
    _, points = component(content["/camera/control_points/obj_000001"], "positions")[0]
    np.testing.assert_allclose(points, result(first, 1).control_points + 0.5, atol=1e-4)
    _, (matrix,) = component(content["/camera"], "image_from_camera")[0]
    # Column by column.
    np.testing.assert_allclose(matrix[6:8], [CAMERA.cx + 0.5, CAMERA.cy + 0.5])


def test_one_image_per_readable_frame(recording: Path) -> None:
    images = component(read(recording)["/camera/image"], "blob")
    assert [time for time, _ in images] == [0, 1, 3]
    assert bytes(images[0][1][0])[:2] == b"\xff\xd8"  # JPEG


def test_edges_disappear_where_there_are_none(recording: Path) -> None:
    edges = read(recording)["/camera/generated_edges/obj_000001"]
    assert [time for time, _ in component(edges, "strips")] == [0, 1, 3]
    assert [time for time, _ in component(edges, "is_recursive")] == [2]


def test_state_tells_what_happened(recording: Path) -> None:
    texts = [text for _, (text,) in component(read(recording)["/state/obj_000001"], "text")]
    assert "tracking" in texts[0]
    assert "lost" in texts[2]
    assert "the file is empty" in texts[2]


def test_no_truth_no_truth_entities(tmp_path: Path) -> None:
    play([Replay(tmp_path / "run.rrd")], with_truth=False)
    content = read(tmp_path / "run.rrd")
    assert not any("truth" in entity for entity in content)
    assert not any(name.endswith("scalars") for name in content.get("/curves/add_percent/obj_000001", {}))


@pytest.mark.filterwarnings("ignore:RRD file has no footer")
def test_a_killed_run_can_still_be_read(tmp_path: Path) -> None:
    replay = Replay(tmp_path / "run.rrd", sessions=2)
    play([replay])
    replay._recording.flush()  # what the background writer does by itself after a moment
    assert "/camera/image" in read(tmp_path / "run.rrd")
    replay.close()


def test_a_place_that_cannot_be_written(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(InputFileError, match=r"run\.rrd.*cannot be written"):
        play([Replay(tmp_path / "file" / "run.rrd")])
