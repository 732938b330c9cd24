"""Results as they come."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import acp_lab as acp
from acp_lab.errors import InputFileError, TrackingError
from acp_lab.sequences import read_results
from acp_lab.sequences.altered import AlteredSequence
from acp_lab.sequences.frame import Frame
from acp_lab.sequences.results_csv import ResultsWriter
from acp_lab.tracking.results_file import ResultsFile
from tests.prepared_sample import sample_model, sample_scene

FEW = (0, 1, 2)


def test_rows_are_those_of_the_run(tmp_path: Path) -> None:
    path = tmp_path / "new" / "results.csv"
    sequence = AlteredSequence(sample_scene(), frame_ids=FEW)
    run = acp.Tracker(sample_model()).run(
        sequence, sequence.first_pose, observers=[acp.ResultsFile(path, {"method": "acp"})]
    )
    rows = read_results(path)
    assert [row.key for row in rows] == [row.key for row in run.rows]
    for row, of_run in zip(rows, run.rows, strict=True):
        np.testing.assert_allclose(row.cam_T_obj, of_run.cam_T_obj, atol=1e-9)
        assert row.score == of_run.score
    assert json.loads(path.with_suffix(".run.json").read_text()) == {"method": "acp"}


def test_an_interrupted_run_leaves_its_rows(tmp_path: Path) -> None:
    def stop(frame: Frame) -> Frame:
        if frame.index == 2:
            raise KeyboardInterrupt
        return frame

    path = tmp_path / "results.csv"
    with pytest.raises(KeyboardInterrupt):
        acp.Tracker(sample_model()).run(
            AlteredSequence(sample_scene(), stop), sample_scene().first_pose, observers=[ResultsFile(path)]
        )
    assert [row.im_id for row in read_results(path)] == [0, 1]


def test_a_wrong_start_costs_no_older_results(tmp_path: Path) -> None:
    path = tmp_path / "results.csv"
    older = "scene_id,im_id,obj_id,score,R,t,time\n"
    path.write_text(older)
    away = sample_scene().first_pose.copy()
    away[2, 3] = -100.0
    with pytest.raises(TrackingError):
        acp.Tracker(sample_model()).run(sample_scene(), away, observers=[ResultsFile(path)])
    assert path.read_text() == older


def test_only_results_are_replaced(tmp_path: Path) -> None:
    path, info = tmp_path / "POSE.json", tmp_path / "results.run.json"
    path.write_text('{"cam_R_m2c": []}')
    with pytest.raises(InputFileError, match=r"POSE\.json: the results would replace a file that is not results"):
        ResultsFile(path)
    with pytest.raises(InputFileError, match=r"POSE\.json: the results would replace"):
        ResultsWriter(path)
    info.write_text("a diary")
    with pytest.raises(InputFileError, match=r"results\.run\.json: the results would replace"):
        ResultsFile(tmp_path / "results.csv")
    assert (path.read_text(), info.read_text()) == ('{"cam_R_m2c": []}', "a diary")


def test_a_place_that_cannot_be_written(tmp_path: Path) -> None:
    with pytest.raises(InputFileError, match="choose another place"):
        acp.Tracker(sample_model()).run(sample_scene(), sample_scene().first_pose, observers=[ResultsFile(tmp_path)])
