"""Evaluation of results files: which frames count, what is refused, table and JSON."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from acp_lab.errors import AcpLabError, InputFileError, SequenceError
from acp_lab.evaluation import evaluate
from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.pose import disturb_pose, make_pose, so3_exp
from acp_lab.sequences import BopDataset, ResultRow, ResultsWriter, open_sequence
from tests.sequences.tiny_dataset import (
    DIAMETER,
    pose,
    pose_entry,
    write_dataset,
    write_json,
    write_models,
    write_scene,
)

KEYS = [
    "frames",
    "recall_2",
    "recall_5",
    "recall_10",
    "auc_10pct",
    "cm5deg5",
    "rot_deg_median",
    "trans_mm_median",
    "frames_until_lost",
    "time_s_median",
]


def _shifted(frame_id: int, share: float = 0.0, object_id: int = 1) -> FloatArray:
    """The truth moved sideways by a share of the diameter: its ADD."""
    cam_T_obj = pose(frame_id, object_id)
    cam_T_obj[0, 3] += share * DIAMETER
    return cam_T_obj


def _row(frame_id: int, share: float = 0.0, object_id: int = 1, scene_id: int = 1, time_s: float = 0.02) -> ResultRow:
    return ResultRow(scene_id, frame_id, object_id, 0.9, _shifted(frame_id, share, object_id), time_s)


@pytest.fixture
def dataset(tmp_path: Path) -> BopDataset:
    return BopDataset(write_dataset(tmp_path / "set", frame_ids=(3, 5, 6, 10, 11)))


def test_the_first_frame_is_left_out_and_missing_rows_are_failures(dataset: BopDataset) -> None:
    rows = [_row(3, 9.0), _row(5, 0.01), _row(6, 0.04), _row(11, 0.09)]
    (scored,) = evaluate(rows, dataset).objects
    assert (scored.scene_id, scored.obj_id, scored.metric) == (1, 1, "ADD")
    assert scored.errors.frame_ids == (5, 6, 10, 11)
    np.testing.assert_allclose(scored.errors.distance, [0.01, 0.04, np.inf, 0.09])
    result = scored.scores
    assert (result.frames, result.frames_until_lost) == (4, 2)
    assert (result.recall_2, result.recall_5, result.recall_10) == (0.25, 0.5, 0.75)
    assert result.auc_10pct == pytest.approx((0.9 + 0.6 + 0.1) / 4)
    assert result.cm5deg5 == 0.75
    assert result.trans_mm_median == pytest.approx(0.5 * (0.04 + 0.09) * DIAMETER)
    assert result.time_s_median == 0.02


def test_frames_without_truth_are_ignored(dataset: BopDataset) -> None:
    path = dataset.root / "test" / "000001" / "scene_gt.json"
    truth = json.loads(path.read_text())
    truth["6"] = []
    del truth["10"]
    truth["99"] = [pose_entry(pose(99))]  # truth without an image is no frame
    write_json(path, truth)
    (scored,) = evaluate([_row(i) for i in (3, 5, 6, 10)], dataset).objects
    assert scored.errors.frame_ids == (5, 11)
    assert scored.scores.recall_2 == 0.5


def test_a_start_frame_without_truth_is_left_out_all_the_same(dataset: BopDataset) -> None:
    path = dataset.root / "test" / "000001" / "scene_gt.json"
    truth = json.loads(path.read_text())
    del truth["3"]
    write_json(path, truth)
    assert evaluate([_row(5)], dataset).objects[0].errors.frame_ids == (5, 6, 10, 11)


def test_every_scene_and_object_with_a_row_is_scored_and_pooled(tmp_path: Path) -> None:
    root = write_dataset(tmp_path / "set", (0, 1, 2), (1, 2))
    write_scene(root / "test" / "000004", (0, 1), (2,))
    rows = [_row(2, 0.5, 2, 4), _row(1, 0.0, 2, 4), _row(1), _row(2), _row(1, 0.03, 2), _row(2, 0.03, 2)]
    with pytest.raises(SequenceError, match="no image 2, of which there are results"):
        evaluate(rows, root)
    result = evaluate(rows[1:], root)
    assert [(item.scene_id, item.obj_id) for item in result.objects] == [(1, 1), (1, 2), (4, 2)]
    assert result.pooled.frames == 5
    assert result.pooled.recall_2 == 0.6
    assert result.pooled.recall_5 == 1.0
    assert result.pooled.frames_until_lost == 5


def test_symmetric_objects_are_scored_by_add_s(tmp_path: Path) -> None:
    half_turn = make_pose(so3_exp(np.array([0, 0, np.pi])), np.zeros(3))
    root = write_dataset(tmp_path / "set", (0, 1), (1, 2))
    write_models(root, {1: {"symmetries_discrete": [half_turn.ravel().tolist()]}, 2: {"symmetries_continuous": []}})
    rows = [ResultRow(1, 1, i, 1.0, pose(1, i) @ half_turn, 0.1) for i in (1, 2)]
    result = evaluate(rows, root)
    symmetric, plain = result.objects
    assert (symmetric.metric, plain.metric, result.metric) == ("ADD-S", "ADD", "ADD(-S)")
    assert symmetric.scores.recall_2 == 1.0
    assert symmetric.scores.rot_deg_median == pytest.approx(0, abs=1e-5)
    assert plain.scores.recall_10 == 0.0
    assert plain.scores.rot_deg_median == pytest.approx(180)
    assert plain.scores.frames_until_lost == 0


def test_results_may_be_a_file_rows_or_a_run(dataset: BopDataset, tmp_path: Path) -> None:
    rows = [_row(i, 0.01 * i) for i in (3, 5, 6, 10, 11)]
    path = tmp_path / "results.csv"
    with ResultsWriter(path) as results:
        for row in rows:
            results.append(row)

    class Run:
        def __init__(self) -> None:
            self.rows = tuple(rows)

    scene = open_sequence(dataset.root / "test" / "000001")
    expected = asdict(evaluate(rows, dataset).pooled)
    for given in (path, str(path), Run(), iter(rows)):
        found = asdict(evaluate(given, scene).pooled)
        assert found == pytest.approx(expected, abs=1e-5)


def test_the_json_has_the_keys_of_the_contract(dataset: BopDataset, tmp_path: Path) -> None:
    result = evaluate([_row(5, 0.01, time_s=-1.0)], dataset)
    path = tmp_path / "scores.json"
    result.write_json(path)
    values = json.loads(path.read_text())
    assert list(values) == ["objects", "pooled"]
    (scored,) = values["objects"]
    assert list(scored) == ["scene_id", "obj_id", "metric", *KEYS]
    assert list(values["pooled"]) == ["metric", *KEYS]
    assert (scored["frames"], scored["recall_2"], scored["frames_until_lost"]) == (4, 0.25, 1)
    # Three of four frames have no row, none has a time: not known, and no NaN or Infinity in JSON.
    assert (scored["rot_deg_median"], scored["trans_mm_median"], scored["time_s_median"]) == (
        None,
        None,
        None,
    )


def test_a_scene_of_one_frame_has_nothing_to_score(tmp_path: Path) -> None:
    root = write_dataset(tmp_path / "set", (0,))
    result = evaluate([_row(0)], root)
    assert result.to_json()["pooled"] == {
        "metric": "ADD",
        **dict.fromkeys(KEYS),
        "frames": 0,
        "frames_until_lost": 0,
    }
    assert "-" in str(result)


def test_the_table_prints_in_terminal_and_notebook(dataset: BopDataset) -> None:
    result = evaluate([_row(i, 0.01) for i in (5, 6, 10)], dataset)
    lines = str(result).splitlines()
    assert len(lines) == 3
    assert len({len(line) for line in lines}) == 1
    assert lines[0].split()[:5] == ["scene", "object", "metric", "frames", "@2%"]
    assert lines[1].split()[:5] == ["1", "1", "ADD", "4", "75.0"]
    assert lines[2].split()[0] == "all"
    html = result._repr_html_()
    assert html.count("<tr>") == 3
    assert "<td>75.0</td>" in html


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        ([], "no rows to evaluate"),
        ([_row(5), _row(5)], "scene 1, image 5, object 1 has two rows"),
        ([_row(5, scene_id=8)], "no scene 8: it has scene 1"),
        ([_row(5, object_id=4)], "no object 4, of which there are results: its truth has 1"),
        ([_row(5), _row(7)], "no image 7, of which there are results"),
    ],
)
def test_rows_that_fit_nothing_are_refused(dataset: BopDataset, rows: list[ResultRow], message: str) -> None:
    with pytest.raises(SequenceError, match=message) as error:
        evaluate(rows, dataset)
    assert "\n" not in str(error.value)


def test_a_video_has_no_truth(dataset: BopDataset) -> None:
    with pytest.raises(SequenceError, match="clip: has no truth to score against"):
        evaluate([], SimpleNamespace(name="clip"))  # type: ignore[arg-type]


def test_rows_of_another_scene_than_the_one_given(dataset: BopDataset) -> None:
    write_scene(dataset.root / "test" / "000002")
    with pytest.raises(SequenceError, match="results of scene 2: the scene given is 1"):
        evaluate([_row(1, scene_id=2)], dataset.open_scene(1))


@pytest.mark.parametrize("missing", ["test/000001/scene_gt.json", "models/models_info.json", "models/obj_000001.ply"])
def test_missing_files_are_one_line(dataset: BopDataset, missing: str) -> None:
    (dataset.root / missing).unlink()
    with pytest.raises(AcpLabError) as error:
        evaluate([_row(5)], dataset)
    assert missing in str(error.value)
    assert "\n" not in str(error.value)
    with pytest.raises(InputFileError, match="no such results file"):
        evaluate(dataset.root / "none.csv", dataset)


def test_no_image_is_opened(dataset: BopDataset) -> None:
    for path in (dataset.root / "test" / "000001" / "rgb").iterdir():
        path.write_bytes(b"")
    assert evaluate([_row(5)], dataset).pooled.frames == 4


def test_noisy_truth_of_the_shared_sequences(shared_data: Path) -> None:
    dataset = BopDataset(shared_data / "metal_public")
    rng = np.random.default_rng(0)
    rows = []
    for scene_id in dataset.scenes():
        scene = dataset.open_scene(scene_id)
        (object_id,) = scene.object_ids
        centre = dataset.part(object_id).box_centre
        for frame_id in scene.frame_ids:
            truth = scene.truth(frame_id, object_id)
            assert truth is not None
            rows.append(ResultRow(scene_id, frame_id, object_id, 1.0, disturb_pose(truth, centre, 1.0, 3.0, rng)))
    result = evaluate(rows, dataset)
    assert result.pooled.frames == 3 * 29
    assert result.pooled.rot_deg_median == pytest.approx(1.0, abs=1e-6)
    assert result.pooled.recall_10 == 1.0
    assert 0.0 < result.pooled.auc_10pct < 1.0
    # Turned about the centre of the box, near the centroid, ADD stays near the shift.
    for scored in result.objects:
        assert np.median(scored.errors.distance) == pytest.approx(3.0 / 95.0, rel=0.15)
