"""What is printed to be pasted arrives as it was meant, also where names hold spaces."""

from __future__ import annotations

import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from acp_lab.display.replay.file import check_replay
from acp_lab.errors import InputFileError, PreparationError
from acp_lab.pasted import quoted
from acp_lab.prepared_part import PreparedPart


def test_plain_names_stay_as_they_are() -> None:
    assert quoted(Path("parts/obj_000001")) == "parts/obj_000001"


@pytest.mark.parametrize("name", ["my clip 1.mp4", "it's", "a;b", "$HOME", "ü.ply"])
@pytest.mark.skipif(sys.platform == "win32", reason="asks a POSIX shell")
def test_a_shell_takes_it_for_one_word(name: str) -> None:
    said = subprocess.run(["sh", "-c", f"printf %s {quoted(name)}"], capture_output=True, check=True)
    assert said.stdout.decode() == name


def test_the_command_of_a_missing_part_can_be_pasted(tmp_path: Path) -> None:
    mesh = tmp_path / "my meshes" / "box.ply"
    with pytest.raises(PreparationError) as caught:
        PreparedPart.load(tmp_path / "my parts" / "box", mesh)
    command = str(caught.value).partition("run: ")[2]
    assert shlex.split(command) == ["acp-lab", "prepare", str(mesh), "--out", str(tmp_path / "my parts")]


def test_so_can_that_of_a_missing_replay(tmp_path: Path) -> None:
    with pytest.raises(InputFileError) as caught:
        check_replay(tmp_path / "my run.rrd")
    assert f"acp-lab track --replay '{tmp_path / 'my run.rrd'}' writes one" in str(caught.value)
