"""The doctor's verdicts and exit status."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from acp_lab.commands import doctor
from acp_lab.commands.doctor import Check, Verdict
from tests.cli_runner import run


def _checks(*found: Check):  # type: ignore[no-untyped-def]
    return lambda: iter(found)


def test_absent_things_are_no_failure(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    found = (Check(Verdict.OK, "Python"), Check(Verdict.ABSENT, "OpenGL", "install it"))
    monkeypatch.setattr(doctor, "checks", _checks(*found))
    outcome = run(capsys, "doctor")
    assert (outcome.status, outcome.err) == (0, "")
    assert outcome.out.splitlines()[:2] == ["ok      Python", "absent  OpenGL: install it"]


def test_broken_things_are_a_failure(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(doctor, "checks", _checks(Check(Verdict.BROKEN, "numpy\nis", "fix")))
    outcome = run(capsys, "doctor")
    assert outcome.status == 1
    assert outcome.out.splitlines()[0] == "BROKEN  numpy is: fix"


def test_requirements_that_are_not_met() -> None:
    missing = doctor._check_requirement("acp-lab-no-such-package>=1")
    assert missing is not None
    assert missing.verdict is Verdict.BROKEN
    assert "pip install" in missing.fix
    old = doctor._check_requirement("numpy>=99")
    assert old is not None
    assert old.verdict is Verdict.BROKEN
    assert ">=99" in old.what
    assert doctor._check_requirement("numpy; extra == 'dev'") is None
    fine = doctor._check_requirement("numpy>=1")
    assert fine is not None
    assert fine.verdict is Verdict.OK


def test_a_check_that_fails_itself_is_reported() -> None:
    def check() -> Check:
        raise RuntimeError("oops")

    found = doctor._safely(check)
    assert found.verdict is Verdict.BROKEN
    assert "oops" in found.what


def _no_module(name: str | None, message: str) -> Callable[[], Check]:
    def check() -> Check:
        raise ImportError(message, name=name)

    return check


@pytest.mark.parametrize(
    ("name", "message"), [("cv2", "anything"), ("cv2.gapi", "anything"), (None, "libGL.so.1: no such file")]
)
def test_a_package_that_a_line_above_names_is_no_second_fault(
    name: str | None, message: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    what = "opencv-python-headless 4.13 cannot be imported (libGL.so.1: no such file)"
    monkeypatch.setattr(doctor, "check_packages", _checks(Check(Verdict.BROKEN, what, "install it again")))
    monkeypatch.setattr(doctor, "checks_of_machine", lambda: (_no_module(name, message),))
    outcome = run(capsys, "doctor")
    assert outcome.out.splitlines()[-2:] == [
        "absent  check cannot be tried: see opencv-python-headless above",
        "1 broken: fix these first",
    ]


@pytest.mark.parametrize("name", ["numpy", None])
def test_a_package_that_no_line_names_is_a_fault(name: str | None) -> None:
    broken = [Check(Verdict.BROKEN, "opencv-python-headless is not installed", "install it")]
    found = doctor._safely(_no_module(name, "no module"), broken)
    assert found.verdict is Verdict.BROKEN
    assert "report this" in found.fix


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("raise ImportError('libGL.so.1: no such file')", "cannot be imported (libGL.so.1: no such file)"),
        ("import no_such_module_at_all", "cannot be imported (No module named 'no_such_module_at_all')"),
        ("raise RuntimeError", "cannot be imported (RuntimeError)"),
    ],
)
def test_an_optional_package_that_cannot_be_imported(
    content: str, words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "rerun_notebook.py").write_text(content)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "rerun_notebook", raising=False)
    found = doctor.check_notebook_viewer()
    assert found.verdict is Verdict.ABSENT
    assert found.what == f"rerun_notebook is installed, but {words}"
    assert "pip uninstall rerun_notebook, then " in found.fix


def test_an_optional_package_that_is_not_installed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "cascadio", None)
    found = doctor.check_step()
    assert (found.verdict, found.what) == (Verdict.ABSENT, "cascadio")


def test_programs_that_hang_are_left() -> None:
    done = doctor._run([sys.executable, "-c", "import time; time.sleep(60)"], 0.5)
    assert done.returncode == 124
    assert "0.5 s" in done.stderr


@pytest.mark.parametrize(
    "check", [doctor.check_ray_casting, doctor.check_writing, doctor.check_sample, doctor.check_step]
)
def test_what_every_machine_with_a_full_environment_has(check) -> None:  # type: ignore[no-untyped-def]
    assert check().verdict is Verdict.OK, check()


@pytest.mark.slow
def test_the_whole_report(capsys: pytest.CaptureFixture[str]) -> None:
    outcome = run(capsys, "doctor")
    assert outcome.status == 0, outcome.out
    assert outcome.err == ""
    verdicts = {line.split()[0] for line in outcome.out.splitlines()[:-1]}
    assert verdicts <= {"ok", "absent"}
