"""The files of the one-click environments and of continuous integration: well-formed, in step with pyproject.toml,
the Makefile and the notebooks, and safe."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any

import pytest
import yaml

from tests.notebooks.notebook_files import lesson_paths

PROJECT = Path(__file__).resolve().parents[1]
CONFIG = tomllib.loads((PROJECT / "pyproject.toml").read_text(encoding="utf-8"))
PYTHON = CONFIG["project"]["requires-python"].removeprefix(">=")
BINDER, CONTAINER_FOLDER = PROJECT / "binder", PROJECT / ".devcontainer"
CONTAINER = json.loads((CONTAINER_FOLDER / "devcontainer.json").read_text(encoding="utf-8"))
CI = PROJECT / ".ci" / "run"
SCRIPTS = (BINDER / "postBuild", BINDER / "start", CONTAINER_FOLDER / "create", CONTAINER_FOLDER / "lab", CI)

# From the schema of the Dev Container specification, which refuses all others in a file with "image".
KNOWN_KEYS = {
    *("name", "image", "features", "hostRequirements", "containerEnv", "remoteEnv", "remoteUser", "containerUser"),
    *("initializeCommand", "onCreateCommand", "updateContentCommand", "postCreateCommand", "postStartCommand"),
    *("postAttachCommand", "waitFor", "forwardPorts", "portsAttributes", "otherPortsAttributes", "customizations"),
    *("mounts", "init", "runArgs", "shutdownAction", "overrideCommand", "workspaceFolder", "workspaceMount"),
}


def binder_lines(name: str) -> list[str]:
    """A file's lines without comments."""
    lines = (BINDER / name).read_text(encoding="utf-8").splitlines()
    return [line for line in lines if line and not line.startswith("#")]


def test_the_container_has_known_keys_and_values() -> None:
    assert set(CONTAINER) <= KNOWN_KEYS
    for name in ("containerEnv", "remoteEnv"):
        assert all(isinstance(value, str) for value in CONTAINER[name].values())
    assert {str(port) for port in CONTAINER["forwardPorts"]} == set(CONTAINER["portsAttributes"])
    for amount in ("memory", "storage"):
        assert re.fullmatch(r"\d+([tgmk]b)?", CONTAINER["hostRequirements"][amount])


def test_both_take_the_oldest_python_that_is_supported() -> None:
    assert CONTAINER["image"] == f"python:{PYTHON}"
    assert f"  - python={PYTHON}" in binder_lines("environment.yml")


def test_both_install_this_checkout() -> None:
    (torch,) = (name for name in CONFIG["project"]["dependencies"] if name.startswith("torch"))
    assert f"  - {torch.replace('torch', 'pytorch-cpu', 1)}" in binder_lines("environment.yml")
    assert 'pip install --no-cache-dir -e ".[notebook]"' in (BINDER / "postBuild").read_text(encoding="utf-8")
    assert "notebook" in CONFIG["project"]["optional-dependencies"]
    create = (CONTAINER_FOLDER / "create").read_text(encoding="utf-8")
    assert "make install\n" in create
    assert '${PIP_ARGS:-} -e ".[notebook]"' in create
    for package in binder_lines("apt.txt"):
        assert package in create
        assert package in (PROJECT / "environment.md").read_text(encoding="utf-8")


def test_make_reads_what_the_container_sets() -> None:
    makefile = (PROJECT / "Makefile").read_text(encoding="utf-8")
    for name in ("VENV", "PIP_ARGS"):
        assert re.search(rf"^{name}\s*\?=", makefile, re.MULTILINE), f"{name} of the environment would be ignored"
    venv = CONTAINER["containerEnv"]["VENV"]
    assert CONTAINER["remoteEnv"]["PATH"].startswith(f"{venv}/bin:")
    assert CONTAINER["customizations"]["vscode"]["settings"]["python.defaultInterpreterPath"] == f"{venv}/bin/python"


def test_they_open_the_first_notebook() -> None:
    first = lesson_paths()[0]
    assert CONTAINER["customizations"]["codespaces"]["openFiles"] == [f"notebooks/{first.name}"]
    lab = (CONTAINER_FOLDER / "lab").read_text(encoding="utf-8")
    assert f"default_url=/lab/tree/{first.name})\n" in lab
    assert f"urlpath=lab/tree/notebooks/{first.name}" in (BINDER / "README.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("path", SCRIPTS, ids=lambda path: path.name)
def test_scripts_are_sound_and_stop_at_the_first_error(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    assert text.startswith("#!/usr/bin/env bash\n")
    assert "\nset -euo pipefail\n" in text
    assert "\r" not in text
    assert os.name == "nt" or os.access(path, os.X_OK), "repo2docker and devcontainers run it as it is"
    if shutil.which("bash"):
        done = subprocess.run(["bash", "-n", str(path)], capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr


def lab_command(tmp_path: Path, listed: str = "", **environment: str) -> list[str]:
    """What .devcontainer/lab would start: a stand-in for Python prints its arguments."""
    bash = shutil.which("bash")
    if bash is None:
        pytest.skip("no bash")
    python = tmp_path / "bin" / "python"
    python.parent.mkdir()
    python.write_text(f'#!{bash}\nif [[ "$3" == server ]]; then echo "{listed}"; else printf "%s\\n" "$@"; fi\n')
    python.chmod(0o755)
    base = {"PATH": os.environ["PATH"], "VENV": str(tmp_path)}
    done = subprocess.run(
        [bash, str(CONTAINER_FOLDER / "lab")],
        env={**base, **environment},
        capture_output=True,
        text=True,
        check=True,
    )
    return done.stdout.splitlines()


def test_jupyter_keeps_its_token_and_the_loopback_address(tmp_path: Path) -> None:
    words = lab_command(tmp_path)
    assert {"jupyterlab", "--no-browser", "--ip=127.0.0.1", "--port=8888"} <= set(words)
    assert not [word for word in words if "token" in word or "origin" in word]


def test_in_a_codespace_only_its_own_address_may_ask(tmp_path: Path) -> None:
    words = lab_command(
        tmp_path, CODESPACE_NAME="quiet-otter", GITHUB_CODESPACES_PORT_FORWARDING_DOMAIN="forwarded.example"
    )
    assert "--ServerApp.allow_origin=https://quiet-otter-8888.forwarded.example" in words
    assert "--ServerApp.local_hostnames=quiet-otter-8888.forwarded.example" in words
    assert not [word for word in words if "token" in word or "*" in word]


def test_a_second_one_is_not_started(tmp_path: Path) -> None:
    running = "http://localhost:8888/?token=abc :: notebooks"
    assert lab_command(tmp_path, listed=running) == [running]


# ---- continuous integration ------------------------------------------------------------------------------------


def commands(job: dict[str, Any]) -> list[str]:
    return [step["run"] for step in job["steps"] if "run" in step]


def test_the_workflow_runs_everything_on_linux_and_the_quick_tests_elsewhere() -> None:
    workflow = yaml.safe_load((PROJECT / ".github" / "workflows" / "test.yml").read_text(encoding="utf-8"))
    everything, quick = workflow["jobs"]["everything"], workflow["jobs"]["quick"]
    assert everything["runs-on"].startswith("ubuntu")
    assert commands(everything) == [".ci/run"]
    assert [system.partition("-")[0] for system in quick["strategy"]["matrix"]["os"]] == ["macos", "windows"]
    # The same packages and the same tests as `make test-fast`.
    makefile = (PROJECT / "Makefile").read_text(encoding="utf-8")
    (extras,) = re.findall(r'-e "(\.\[dev.*?\])"', makefile)
    (marker,) = re.findall(r'^test-fast:.*\n.*pytest -m "(.*)"', makefile, re.MULTILINE)
    assert commands(quick) == [f'python -m pip install -e "{extras}"', f'python -m pytest -m "{marker}"']
    for job in (everything, quick):
        (setup,) = (step for step in job["steps"] if step.get("uses", "").startswith("actions/setup-python"))
        assert setup["with"]["python-version"] == PYTHON


def ci(tmp_path: Path, *tools: str) -> str:
    """What .ci/run does where only these tools are there: the lines that stand-ins for make and apt-get write."""
    bash = shutil.which("bash")
    if bash is None or os.name == "nt":
        pytest.skip("no bash")
    told = tmp_path / "told"
    for name in (*tools, "make", "id"):
        line = f'echo "{name} $* ACP_REQUIRE_BROWSER=${{ACP_REQUIRE_BROWSER:-}}" >> {told}'
        script = tmp_path / name
        script.write_text(f"#!{bash}\n{'echo 0' if name == 'id' else line}\n")
        script.chmod(0o755)
    for name in ("dirname", "env"):
        (tmp_path / name).symlink_to(str(shutil.which(name)))
    environment = {"PATH": str(tmp_path), "PYTHON": sys.executable}
    subprocess.run([bash, str(CI)], env=environment, check=True, capture_output=True, timeout=60)
    return told.read_text()


def test_ci_installs_a_browser_and_runs_all_tests(tmp_path: Path) -> None:
    told = ci(tmp_path, "apt-get").splitlines()
    assert [line.split()[:2] for line in told] == [["apt-get", "update"], ["apt-get", "install"], ["make", "test"]]
    assert "chromium" in told[1]


@pytest.mark.parametrize("browser", ["chromium", "google-chrome"])
def test_with_a_browser_its_tests_must_run(tmp_path: Path, browser: str) -> None:
    (told,) = ci(tmp_path, browser).splitlines()
    assert told.startswith("make test")
    assert told.endswith("ACP_REQUIRE_BROWSER=1")


def test_without_a_browser_they_may_skip(tmp_path: Path) -> None:
    (told,) = ci(tmp_path).splitlines()
    assert told.endswith("ACP_REQUIRE_BROWSER=")
