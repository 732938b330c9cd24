"""The wheel: it carries the code of every layer and the sample, and nothing of the tests."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

PROJECT = Path(__file__).resolve().parents[1]
CONFIG = tomllib.loads((PROJECT / "pyproject.toml").read_text(encoding="utf-8"))


def test_every_requirement_is_bounded() -> None:
    """An uncapped torch would pull gigabytes of CUDA packages; the others would break on some later day."""
    extras = CONFIG["project"]["optional-dependencies"].values()
    requirements = [*CONFIG["project"]["dependencies"], *(item for extra in extras for item in extra)]
    for requirement in requirements:
        assert ">=" in requirement, requirement
        assert "<" in requirement.partition(";")[0], requirement


def test_the_locked_versions_are_within_their_ranges() -> None:
    lines = (PROJECT / ".ci" / "constraints.txt").read_text(encoding="utf-8").splitlines()
    locked = dict(line.split("==") for line in lines if not line.startswith("#"))
    extras = CONFIG["project"]["optional-dependencies"]
    wanted = [Requirement(text) for text in CONFIG["project"]["dependencies"]]
    wanted += [Requirement(text) for name in ("dev", "step", "recipes", "notebook") for text in extras[name]]
    for requirement in wanted:
        assert canonicalize_name(requirement.name) in locked, requirement
        assert requirement.specifier.contains(locked[canonicalize_name(requirement.name)]), requirement


def test_the_package_with_gpl_code_in_its_wheels_is_imported_in_two_places_only() -> None:
    """environment.md says so, and that everything else works without it."""
    importing = [
        path.relative_to(PROJECT / "acp_lab").as_posix()
        for path in sorted((PROJECT / "acp_lab").rglob("*.py"))
        if re.search(r"^\s*(import av\b|from av\b)", path.read_text(encoding="utf-8"), re.MULTILINE)
    ]
    assert importing == ["course/stand_ins.py", "display/replay/overlay_video.py"]


def test_environment_md_explains_every_package() -> None:
    text = (PROJECT / "environment.md").read_text(encoding="utf-8")
    extras = CONFIG["project"]["optional-dependencies"].values()
    for requirement in [*CONFIG["project"]["dependencies"], *(item for extra in extras for item in extra)]:
        name = requirement.partition(">=")[0].partition("[")[0]
        bounds = requirement.partition(";")[0].removeprefix(name).partition("]")[2] or requirement.partition(";")[
            0
        ].removeprefix(name)
        assert f"| {name} | {bounds.strip()} |" in text, f"environment.md lacks: | {name} | {bounds.strip()} |"


def test_a_folder_of_that_name_does_not_hide_the_package(tmp_path: Path) -> None:
    """Whoever works beside a clone has such a folder: the clone."""
    (tmp_path / "acp_lab").mkdir()
    code = "import acp_lab; print(acp_lab.Part.__name__)"
    environment = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, env=environment, capture_output=True, text=True, check=False
    )
    assert (done.stdout, done.returncode) == ("Part\n", 0), done.stderr


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The wheel of this checkout."""
    # A copy, since setuptools leaves a build folder behind; without isolation nothing is downloaded.
    folder = tmp_path_factory.mktemp("wheel")
    source = folder / "source"
    shutil.copytree(PROJECT / "acp_lab", source / "acp_lab", ignore=shutil.ignore_patterns("__pycache__"))
    for pattern in ("pyproject.toml", "*.md", "LICENSE", "CITATION.cff"):
        for path in PROJECT.glob(pattern):
            shutil.copy(path, source / path.name)
    for name in ("notebooks", "docs", "binder"):
        shutil.copytree(PROJECT / name, source / name, ignore=shutil.ignore_patterns("course_files", ".*"))
    command = [sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", str(folder), str(source)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-3000:]
    (path,) = folder.glob("acp_lab-*.whl")
    return path


@pytest.mark.slow
def test_the_wheel_carries_code_and_sample(wheel: Path) -> None:
    names = set(zipfile.ZipFile(wheel).namelist())
    code = {
        path.relative_to(PROJECT).as_posix()
        for path in (PROJECT / "acp_lab").rglob("*")
        if path.is_file() and "__pycache__" not in path.parts
    }
    assert code <= names, sorted(code - names)[:10]
    assert "acp_lab/py.typed" in names
    assert any(name.startswith("acp_lab/sample/data/test/000001/rgb/") for name in names)
    assert not [name for name in names if name.startswith(("tests/", "data_recipes/", "benchmarks/"))]
    assert wheel.stat().st_size < 8e6


@pytest.mark.slow
def test_the_installed_wheel_works(wheel: Path, tmp_path: Path) -> None:
    """Away from the checkout, with this environment's packages: command line and sample are there."""
    zipfile.ZipFile(wheel).extractall(tmp_path / "site")
    environment = {**os.environ, "PYTHONPATH": str(tmp_path / "site")}
    code = (
        "import sys, acp_lab; assert acp_lab.__file__.startswith(sys.argv[1]), acp_lab.__file__\n"
        "from acp_lab.commands.doctor import check_sample; print(check_sample())\n"
        "from acp_lab.cli import main; sys.exit(main(['--version']))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, str(tmp_path / "site")],
        capture_output=True,
        text=True,
        check=False,
        cwd=tmp_path,
        env=environment,
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("ok      sample: ")
    assert "acp_lab " in done.stdout.splitlines()[1]


@pytest.mark.slow
def test_pip_installs_the_course(wheel: Path, tmp_path: Path) -> None:
    """`acp-lab lab` of an installed wheel copies notebooks and docs to a folder, and never over somebody's work."""
    pip = [sys.executable, "-m", "pip", "install", "--quiet", "--no-index", "--no-deps", "--ignore-installed"]
    subprocess.run([*pip, "--prefix", str(tmp_path / "env"), str(wheel)], check=True, capture_output=True)
    (site,) = (tmp_path / "env").rglob("site-packages")
    work = tmp_path / "work"
    mine = work / "mine" / "notebooks" / "00_start_here.ipynb"
    mine.parent.mkdir(parents=True)
    mine.write_text("my work")
    code = (
        "from pathlib import Path; from acp_lab.commands import doctor, lab\n"
        "lab.course_folder(None); lab.course_folder(Path('mine')); lab.course_folder(Path('mine'))\n"
        "print(lab.install_extra('step')); print(*[check.__name__ for check in doctor.checks_of_machine()])"
    )
    environment = {**os.environ, "PYTHONPATH": str(site)}
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=False, cwd=work, env=environment
    )
    assert done.returncode == 0, done.stderr
    lines = done.stdout.splitlines()
    assert lines[0].startswith(f"the course is in {work / 'acp_lab_course'} (")
    assert lines[2] == f"the course is in {work / 'mine'}"
    assert lines[3] == 'python -m pip install "acp_lab[step]"'
    assert "chromium" not in lines[4]
    assert mine.read_text() == "my work"
    for name in ("notebooks", "docs"):
        theirs = {
            path.relative_to(PROJECT) for path in (PROJECT / name).rglob("*.[im][pd]*") if ".ipynb_" not in str(path)
        }
        missing = [
            path
            for path in theirs
            if "course_files" not in path.parts and not (work / "acp_lab_course" / path).exists()
        ]
        assert not missing
    assert not dead_links(work / "acp_lab_course")


def dead_links(folder: Path) -> list[str]:
    """Links of a folder's documents and notebooks to files that are not there; what only a checkout has, apart."""
    dead = []
    for path in [*folder.rglob("*.md"), *folder.rglob("*.ipynb")]:
        for link in re.findall(r"\]\(([^)#\s\\]+)", path.read_text(encoding="utf-8")):
            target = Path(os.path.normpath(path.parent / link))
            inside = target.relative_to(folder).parts if target.is_relative_to(folder) else ()
            is_shipped = "://" not in link and inside and inside[0] not in ("acp_lab", "tests", ".devcontainer")
            if is_shipped and not target.exists():
                dead.append(f"{path.relative_to(folder)}: {link}")
    return dead
