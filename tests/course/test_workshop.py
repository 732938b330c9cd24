"""Where the course keeps its files, and the sample made ready."""

from __future__ import annotations

from pathlib import Path

import matplotlib as mpl
import numpy as np
import pytest
from IPython.core.interactiveshell import InteractiveShell

from acp_lab import course
from acp_lab.control_points.canonical_frame import eye_position
from acp_lab.control_points.view_regions import choose_region
from acp_lab.errors import InputFileError


@pytest.fixture
def folder(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    monkeypatch.setenv("ACP_LAB_COURSE", str(tmp_path / "files"))
    return tmp_path / "files"


def test_files_lie_where_the_variable_says_and_out_of_git(folder: Path) -> None:
    assert course.files_folder() == folder
    assert (folder / ".gitignore").read_text() == "*\n"
    (folder / ".gitignore").write_text("mine\n")
    course.files_folder()
    assert (folder / ".gitignore").read_text() == "mine\n"


def test_files_lie_beside_the_notebooks_otherwise(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.delenv("ACP_LAB_COURSE", raising=False)
    monkeypatch.chdir(tmp_path)
    assert course.files_folder() == tmp_path / "course_files"


def test_a_folder_that_cannot_be_made(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("ACP_LAB_COURSE", str(tmp_path / "file" / "files"))
    with pytest.raises(InputFileError, match="set ACP_LAB_COURSE to a folder of yours"):
        course.files_folder()


def test_the_sample_is_seen_in_one_region() -> None:
    scene, part = course.sample_scene(), course.sample_part()
    eyes = [eye_position(scene.truth(i, 1)) for i in scene.frame_ids]
    assert {choose_region(eye - part.box_centre, 0.5 * part.box_size) for eye in eyes} == {course.SAMPLE_REGION}


@pytest.mark.slow
def test_the_sample_is_prepared_once(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    made = course.sample_model(generator="templates")
    assert "prepared, and kept" in capsys.readouterr().out
    again = course.sample_model(generator="templates")
    assert capsys.readouterr().out == "", "nothing to wait for"
    assert (folder / "parts_quick" / course.sample_part().name / "part.json").is_file()
    np.testing.assert_array_equal(again.edges.points_obj, made.edges.points_obj)


def test_errors_of_the_package_are_one_line_and_fail_the_cell(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("IPYTHONDIR", str(tmp_path))
    shell = InteractiveShell()
    monkeypatch.setattr("IPython.get_ipython", lambda: shell)
    shown: list[list[str]] = []
    shell._showtraceback = lambda kind, error, lines: shown.append(lines)
    with mpl.rc_context():
        course.start()
    shell.run_cell("from acp_lab.errors import InputFileError, AcpLabError")
    for line in ("raise InputFileError('clip.mp4: no such video')", "def f(): raise InputFileError('here')\nf()"):
        done = shell.run_cell(line)
        assert not done.success
        assert isinstance(done.error_in_exec, InputFileError)
    assert shown == [["InputFileError: clip.mp4: no such video"], ["InputFileError: here"]]
    shell.run_cell("1 / 0")
    assert len(shown) == 3
    assert len(shown[2]) > 1, "other errors keep their traceback"


def test_start_sets_the_look() -> None:
    with mpl.rc_context():
        mpl.rcParams["figure.facecolor"] = "none"
        course.start()
        assert mpl.rcParams["figure.facecolor"] == "white", "a figure must read on a dark page"
