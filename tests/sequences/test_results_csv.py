"""The results file: exact format, exact numbers, and a line for everything that can be wrong with it."""

from __future__ import annotations

import errno
import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from acp_lab.errors import InputFileError, SequenceError, TrackingError
from acp_lab.geometry.pose import make_pose, so3_exp
from acp_lab.sequences.results_csv import (
    KeptRows,
    ResultRow,
    ResultsWriter,
    read_results,
    rows_with_ends,
    run_info_path,
    start_poses,
)
from tests.sequences.tiny_dataset import pose

HEADER = "scene_id,im_id,obj_id,score,R,t,time"
GOOD = "1,2,3,0.5,1 0 0 0 1 0 0 0 1,10 20 500,0.01"


def _row(im_id: int = 0, score: float = 0.5, obj_id: int = 1) -> ResultRow:
    return ResultRow(1, im_id, obj_id, score, pose(im_id, obj_id), 0.0125)


def _file(path: Path, *lines: str) -> Path:
    path.write_text("\n".join(lines) + "\n")
    return path


def test_the_format_to_the_letter(tmp_path: Path) -> None:
    cam_T_obj = make_pose(np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]]), np.array([1.5, -2, 1 / 3]))
    with ResultsWriter(tmp_path / "results.csv") as results:
        results.append(ResultRow(1, 20, 3, np.float64(1), cam_T_obj, np.float64(0.25)))
    assert (tmp_path / "results.csv").read_bytes() == (
        b"scene_id,im_id,obj_id,score,R,t,time\n"
        b"1,20,3,1.0,0.0 -1.0 0.0 1.0 0.0 0.0 0.0 0.0 1.0,1.5 -2.0 0.3333333333333333,0.25\n"
    )


numbers = st.floats(-1e3, 1e3)


@given(st.lists(numbers, min_size=6, max_size=6), st.floats(0, 1), st.floats(0, 100))
def test_numbers_read_back(
    tmp_path_factory: pytest.TempPathFactory, twist: list[float], score: float, time_s: float
) -> None:
    path = tmp_path_factory.getbasetemp() / "round.csv"
    cam_T_obj = make_pose(so3_exp(np.array(twist[:3])), np.array(twist[3:]))
    with ResultsWriter(path) as results:
        results.append(ResultRow(4, 5, 6, score, cam_T_obj, time_s))
    (row,) = read_results(path)
    assert row.key == (4, 5, 6)
    assert (row.score, row.time_s) == (score, time_s)
    np.testing.assert_array_equal(row.cam_T_obj[:3, 3], twist[3:])
    np.testing.assert_allclose(row.cam_T_obj, cam_T_obj, rtol=0, atol=1e-14)


def test_rows_are_there_as_soon_as_they_are_written(tmp_path: Path) -> None:
    path = tmp_path / "results.csv"
    path.write_text(HEADER + "\nof an older run\n")
    results = ResultsWriter(path, {"method": "acp"})
    assert path.read_text() == HEADER + "\n"
    results.append(_row(0))
    assert len(read_results(path)) == 1
    results.append(_row(1))
    assert len(read_results(path)) == 2
    results.close()
    results.close()


def test_the_run_stands_beside_the_results(tmp_path: Path) -> None:
    path = tmp_path / "new" / "results.csv"
    with ResultsWriter(path, {"method": "acp"}) as results:
        assert json.loads((tmp_path / "new" / "results.run.json").read_text()) == {"method": "acp"}
        results.write_run_info({"method": "acp", "frames": 3})
    assert json.loads((tmp_path / "new" / "results.run.json").read_text()) == {"method": "acp", "frames": 3}
    assert sorted(p.name for p in path.parent.iterdir()) == ["results.csv", "results.run.json"]
    with ResultsWriter(path):
        pass
    assert sorted(p.name for p in path.parent.iterdir()) == ["results.csv"]


def test_runs_whose_names_differ_in_the_suffix_have_their_own_information() -> None:
    names = {name: run_info_path(Path(name)).name for name in ("a/run.csv", "run.CSV", "run.v1", "run.v2", "run")}
    assert list(names.values()) == ["run.run.json"] * 2 + ["run.v1.run.json", "run.v2.run.json", "run.run.json"]


def test_places_that_cannot_be_written(tmp_path: Path) -> None:
    with pytest.raises(InputFileError, match="cannot be written"):
        ResultsWriter(tmp_path)
    (tmp_path / "file").write_text("")
    with pytest.raises(InputFileError, match="cannot be written"):
        ResultsWriter(tmp_path / "file" / "results.csv")


@pytest.mark.parametrize("score", [float("nan"), -0.1, 1.1])
def test_numbers_that_are_no_result_are_not_written(tmp_path: Path, score: float) -> None:
    with ResultsWriter(tmp_path / "results.csv") as results:
        with pytest.raises(TrackingError, match="scene 1, image 0, object 1"):
            results.append(_row(score=score))
        with pytest.raises(TrackingError):
            results.append(ResultRow(1, 0, 1, 0.5, np.full((4, 4), np.nan), 0.0))
    assert read_results(tmp_path / "results.csv") == ()


def test_files_of_other_tools_are_read(tmp_path: Path) -> None:
    path = tmp_path / "results.csv"
    spaced = '1,3,3, 0.5 ,"1  0 0  0 1 0\t0 0 1", 10 20 500 ,-1'
    path.write_bytes(b"\xef\xbb\xbf" + "\r\n".join([HEADER, GOOD, spaced, "", ""]).encode())
    rows = read_results(path)
    assert [row.im_id for row in rows] == [2, 3]
    assert rows[1].time_s == -1
    np.testing.assert_array_equal(rows[1].cam_T_obj[:3, 3], [10, 20, 500])


@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_empty_lines_are_none_for_who_goes_on_either(tmp_path: Path, end: str) -> None:
    path = tmp_path / "results.csv"
    lines = [HEADER, GOOD, "", GOOD.replace("1,2,3", "1,3,3"), "", ""]
    path.write_bytes(end.join(lines).encode())
    rows = rows_with_ends(path)
    assert [row.key for row, _ in rows] == [row.key for row in read_results(path)]
    assert path.read_bytes()[: rows[1][1]].endswith(b"0.01" + end.encode())
    assert path.read_bytes()[rows[1][1] :].strip() == b""


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("1,2,3,0.5,1 0 0 0 1 0 0 0 1,10 20", "line 3 has 6 fields, not 7"),
        ("1,2", "line 3 has 2 fields"),
        ("x,2,3" + GOOD[5:], "line 3: scene_id is 'x': give a whole number from 0"),
        ("1,2.0,3" + GOOD[5:], "line 3: im_id is '2.0'"),
        ("1,2,-3" + GOOD[5:], "line 3: obj_id is '-3'"),
        (GOOD.replace("0.5", "high"), "line 3: score is 'high': give a finite number"),
        (GOOD.replace("0.5", "nan"), "line 3: score is 'nan'"),
        (GOOD.replace("0.5", ""), "line 3: score is ''"),
        (GOOD.replace("1 0 0 0 1 0 0 0 1", "1 0 0 0 1 0 0 0"), "line 3: R is .*: give 9 finite numbers"),
        (GOOD.replace("1 0 0 0 1 0 0 0 1", "2 0 0 0 2 0 0 0 2"), "line 3: R: not a rotation"),
        (GOOD.replace("10 20 500", "10 20 inf"), "line 3: t is '10 20 inf': give 3 finite numbers"),
        (GOOD.replace("0.01", "fast"), "line 3: time is 'fast'"),
        ("1,1,3" + GOOD[5:], "line 3: scene 1, image 1, object 3 stands in line 2 already: keep one row"),
    ],
)
def test_malformed_lines_are_named(tmp_path: Path, line: str, message: str) -> None:
    path = _file(tmp_path / "results.csv", HEADER, "1,1,3" + GOOD[5:], line)
    with pytest.raises(InputFileError, match=message) as error:
        read_results(path)
    assert str(path) in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "the file is empty"),
        (b"im_id,scene_id\n", "line 1 is 'im_id,scene_id': it must be scene_id,im_id"),
        (GOOD.encode(), "line 1 is .*: it must be"),
        (b"\xff\xfe\x80", "no CSV text"),
        (b'"' + b"x" * 200_000, "no CSV text"),
    ],
)
def test_other_files_are_refused(tmp_path: Path, content: bytes, message: str) -> None:
    path = tmp_path / "results.csv"
    path.write_bytes(content)
    with pytest.raises(InputFileError, match=message) as error:
        read_results(path)
    assert "\n" not in str(error.value)


def test_missing_files_and_header_alone(tmp_path: Path) -> None:
    with pytest.raises(InputFileError, match="no such results file"):
        read_results(tmp_path / "none.csv")
    with pytest.raises(InputFileError, match="cannot be read"):
        read_results(tmp_path)
    assert read_results(_file(tmp_path / "results.csv", HEADER)) == ()


def test_start_poses_are_those_of_one_image(tmp_path: Path) -> None:
    path = tmp_path / "POSES.csv"
    with ResultsWriter(path) as results:
        for row in (_row(0, obj_id=7), _row(0), _row(1)):
            results.append(row)
    poses = start_poses(path, 1, 0)
    assert list(poses) == [1, 7]
    np.testing.assert_allclose(poses[7], pose(0, 7), atol=1e-12)
    with pytest.raises(SequenceError, match="no row for scene 1, image 5"):
        start_poses(path, 1, 5)


def test_of_several_start_poses_of_an_object_the_most_likely_counts(tmp_path: Path) -> None:
    """A detector tells several; results of a tracker have one row each, and those of a detector are no such results."""
    path = tmp_path / "found.csv"
    poses = {0.4: pose(0, 1), 0.9: pose(3, 1), 0.7: pose(5, 1)}
    with ResultsWriter(path) as results:
        for score, cam_T_obj in poses.items():
            results.append(ResultRow(1, 0, 1, score, cam_T_obj, 0.1))
        results.append(ResultRow(1, 0, 1, 0.9, pose(7, 1), 0.1))
        results.append(ResultRow(1, 1, 1, 1.0, pose(8, 1), 0.1))
    np.testing.assert_allclose(start_poses(path, 1, 0)[1], poses[0.9], atol=1e-12)
    with pytest.raises(InputFileError, match="line 3: scene 1, image 0, object 1 stands in line 2 already"):
        read_results(path)


def test_old_results_stay_where_the_new_run_cannot_be_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "results.csv"
    with ResultsWriter(path, {"run": 1}) as results:
        results.append(_row())
    before = path.read_bytes(), run_info_path(path).read_bytes()

    def full(path: Path, content: bytes) -> int:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(Path, "write_bytes", full)
    with pytest.raises(InputFileError, match=r"results.run.json: the file cannot be written \(No space left"):
        ResultsWriter(path, {"run": 2})
    assert (path.read_bytes(), run_info_path(path).read_bytes()) == before


@pytest.mark.parametrize("rows", [0, 2], ids=["restarted", "went on"])
def test_a_file_that_another_run_wrote_in_between_is_not_gone_on_with(tmp_path: Path, rows: int) -> None:
    path = tmp_path / "results.csv"
    with ResultsWriter(path) as results:
        results.append(_row(0))
    length = path.stat().st_size
    with ResultsWriter(path, kept=KeptRows(length, length)):
        pass
    with ResultsWriter(path) as results:
        for im_id in range(rows):
            results.append(_row(im_id))
    between = path.read_bytes()
    with pytest.raises(InputFileError, match="another run has written it in the meantime"):
        ResultsWriter(path, {"run": 2}, KeptRows(length, length))
    assert path.read_bytes() == between
    assert not run_info_path(path).exists()


def test_a_pose_that_could_not_be_read_again_is_not_written(tmp_path: Path) -> None:
    away = ResultRow(1, 0, 1, 0.5, make_pose(np.eye(3), np.array([0.0, 0.0, 2e9])))
    with ResultsWriter(tmp_path / "results.csv") as results, pytest.raises(TrackingError, match="within 1e\\+09"):
        results.append(away)
