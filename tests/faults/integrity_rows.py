"""Prepared parts and outputs: nothing changed unseen, nothing torn, nothing lost."""

from __future__ import annotations

import json
import os
import shutil
import signal
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from safetensors.numpy import load_file, save_file

from acp_lab.prepared_part import PreparedPart
from acp_lab.prepared_part.integrity import write_header
from acp_lab.sequences.results_csv import rows_with_ends
from tests.commands.conftest import FRAME_IDS, OBJECT_IDS
from tests.faults.input_rows import edit
from tests.faults.table import Outcome, Workplace, row

PREPARE_AGAIN = "acp-lab prepare"


def edit_arrays(path: Path, **arrays: Any) -> None:
    """Change arrays of a file: a function of the old one each."""
    stored = load_file(path)
    save_file(stored | {name: np.ascontiguousarray(change(stored[name])) for name, change in arrays.items()}, path)


def seal_again(folder: Path) -> None:
    """Checksums that agree with whatever is there."""
    contents = {path.name: path.read_bytes() for path in folder.glob("*.safetensors")}
    write_header(folder, json.loads((folder / "part.json").read_text()), contents)


def refused_part(at: Workplace, *words: str) -> str:
    said = at.refused(at.track(), *words, PREPARE_AGAIN)
    assert not at.out.exists()
    return said


@row("edge points of a prepared part scaled by 5%", "refused: nothing but a checksum notices", quick=True)
def scaled_edges(at: Workplace) -> str:
    edit_arrays(at.part / "edges.safetensors", points_obj=lambda points: 1.05 * points)
    return refused_part(at, "edges.safetensors", "checksum")


@row("one bit of a prepared part flipped", "refused")
def flipped_bit(at: Workplace) -> str:
    path = at.part / "templates.safetensors"
    content = bytearray(path.read_bytes())
    content[-1] ^= 1
    path.write_bytes(bytes(content))
    return refused_part(at, "templates.safetensors", "checksum")


@row("NaN in a stored mesh, checksums made anew", "refused")
def stored_nan(at: Workplace) -> str:
    edit_arrays(at.part / "mesh.safetensors", vertices=lambda vertices: vertices * np.nan)
    seal_again(at.part)
    return refused_part(at, "mesh.safetensors", "NaN")


@row("a file of a prepared part is cut off", "refused")
def cut_part(at: Workplace) -> str:
    path = at.part / "mesh.safetensors"
    path.write_bytes(path.read_bytes()[:100])
    return refused_part(at, "mesh.safetensors")


@row("a file of a prepared part is missing", "refused")
def missing_file(at: Workplace) -> str:
    (at.part / "edges.safetensors").unlink()
    return refused_part(at, "edges.safetensors")


@row("a pipe in place of a prepared part's file", "refused, not waited for")
def pipe_as_part(at: Workplace) -> str:
    (at.part / "edges.safetensors").unlink()
    os.mkfifo(at.part / "edges.safetensors")
    return refused_part(at, "edges.safetensors", "pipe")


@row("a value of part.json changed by hand", "refused")
def edited_part(at: Workplace) -> str:
    edit(at.part / "part.json", lambda values: values.update(diameter_mm=53.0))
    return refused_part(at, "part.json", "checksum")


@row("a wrong type in part.json, checksums made anew", "refused")
def wrong_type(at: Workplace) -> str:
    edit(at.part / "part.json", lambda values: values.update(diameter_mm="wide"))
    seal_again(at.part)
    return refused_part(at, "obj_000001")


@row("a part of a later version", "refused, with both versions")
def later_version(at: Workplace) -> str:
    edit(at.part / "part.json", lambda values: values.update(version=99))
    return refused_part(at, "part.json", "99")


@row(
    "a part of the earlier version, without checksums",
    "`track` refuses it; `prepare` adds them and keeps all",
    quick=True,
)
def earlier_version(at: Workplace) -> str:
    def forget(values: dict[str, Any]) -> None:
        del values["files"], values["checksum"]
        values["version"] = 1

    before = (at.part / "templates.safetensors").read_bytes()
    edit(at.part / "part.json", forget)
    said = refused_part(at, "part.json", "without checksums")
    again = at.run("prepare", at.data / "models" / "obj_000001.ply", "--out", at.parts, "--generator", "templates")
    assert again.status == 0, again
    assert (at.part / "templates.safetensors").read_bytes() == before
    assert at.track().status == 0
    return f"{said}; then prepared and tracked"


@row("a part that is not prepared", "refused, with the command to run")
def not_prepared(at: Workplace) -> str:
    shutil.rmtree(at.part)
    return refused_part(at, "not prepared")


@row("a part prepared from another mesh", "refused")
def other_mesh(at: Workplace) -> str:
    mesh = at.data / "models" / "obj_000001.ply"
    mesh.write_text(mesh.read_text() + "\n")
    return refused_part(at, "another mesh")


@row("another mesh of the same name into the same folder", "refused; the first part is as before")
def same_stem(at: Workplace) -> str:
    assert at.prepare().status == 0
    trimesh.creation.box((50.0, 30.0, 20.0)).export(at.mesh)
    said = at.refused(at.prepare(), "another mesh of the same name")
    assert PreparedPart.load(at.folder / "new" / "block").part.box_size.max() < 45.0
    return said


def held(at: Workplace, what: str, path: Path) -> str:
    """Code that holds the lock of a path, tells it and waits."""
    return (
        "import sys, time\nfrom pathlib import Path\nfrom acp_lab.locks import only_writer\n"
        f"with only_writer(Path({str(path)!r}), {what!r}):\n    print('held', flush=True)\n    time.sleep(60)\n"
    )


def while_held(at: Workplace, path: Path, command: Any) -> Outcome:
    """What a command says while another process writes; and that the lock ends when that process is killed."""
    holder = at.start(code=held(at, "it", path))
    try:
        assert holder.stdout is not None
        assert holder.stdout.readline() == "held\n"
        outcome: Outcome = command()
    finally:
        holder.send_signal(signal.SIGKILL)
        holder.communicate()
    assert command().status == 0  # the killed one blocks nobody
    return outcome


@row(
    "two `prepare` of one name into one folder at once", "the second is refused; a killed one blocks nobody", quick=True
)
def two_prepares(at: Workplace) -> str:
    outcome = while_held(at, at.folder / "new" / "block", at.prepare)
    return at.refused(outcome, "another acp-lab is writing")


@row("two `track` into one file at once", "the second is refused; a killed one blocks nobody")
def two_tracks(at: Workplace) -> str:
    outcome = while_held(at, at.out, at.track)
    return at.refused(outcome, "another acp-lab is writing")


@row("two `track` with one replay at once", "the second's replay is refused")
def two_replays(at: Workplace) -> str:
    replay = at.folder / "run.rrd"
    outcome = while_held(at, replay, lambda: at.track("--replay", replay))
    return at.refused(outcome, "another acp-lab is writing")


@row("a mesh named `...ply`", "refused: the folder above is not written")
def dots(at: Workplace) -> str:
    mesh = at.folder / "...ply"
    shutil.move(at.mesh, mesh)
    before = sorted(path.name for path in at.folder.iterdir())
    said = at.refused(at.prepare(mesh=mesh), "cannot be named")
    assert sorted(path.name for path in at.folder.iterdir()) == before
    return said


@row("half-written files of a killed run", "removed by the next run")
def leftovers(at: Workplace) -> str:
    left = [at.part / ".edges.safetensors.4711.tmp", at.folder / ".results.run.json.4711.tmp"]
    for path in left:
        path.write_bytes(b"half")
    mesh = at.data / "models" / "obj_000001.ply"
    assert at.run("prepare", mesh, "--out", at.parts, "--generator", "templates").status == 0
    assert at.track().status == 0
    assert not [path for path in left if path.exists()]
    return "removed"


def cut_after(at: Workplace, frames: int, torn: bytes = b"") -> None:
    """Track, then cut the results as if the run had been killed."""
    assert at.track().status == 0
    end = rows_with_ends(at.out)[frames * len(OBJECT_IDS) - 1][1]
    at.out.write_bytes(at.out.read_bytes()[:end] + torn)


@row("results that end in the middle of a row, `--resume`", "goes on after the last whole frame", quick=True)
def resumed(at: Workplace) -> str:
    cut_after(at, 2, b"1,3,1,0.5,0.1 0.2")
    return at.went_on(at.track("--resume"), f"image {FRAME_IDS[1]}")


@row("`--resume` after everything was tracked", "nothing is tracked, the file is as before")
def resumed_whole(at: Workplace) -> str:
    cut_after(at, len(FRAME_IDS))
    before = at.out.read_bytes()
    said = at.went_on(at.track("--resume"), "nothing is tracked")
    assert at.out.read_bytes() == before
    return said


@row("`--resume` with another start pose", "refused; the rows stay")
def resumed_otherwise(at: Workplace) -> str:
    cut_after(at, 2)
    before = at.out.read_bytes()
    edit(at.scene / "scene_gt.json", lambda truth: truth["0"][0].update(cam_t_m2c=[-34.0, 0.0, 260.0]))
    said = at.refused(at.track("--resume"), "start pose of object 1", "--out another name")
    assert at.out.read_bytes() == before
    return said


@row("`--resume` with a part that was prepared again", "refused; the rows stay")
def resumed_part(at: Workplace) -> str:
    cut_after(at, 2)
    mesh = at.data / "models" / "obj_000001.ply"
    words = ("--generator", "templates", "--edge-break", "0.5")
    assert at.run("prepare", mesh, "--out", at.parts, *words).status == 0
    return at.refused(at.track("--resume"), "the prepared part obj_000001")


@row("`--resume` with another method", "refused; the rows stay")
def resumed_method(at: Workplace) -> str:
    cut_after(at, 2)
    return at.refused(at.track("--resume", "--method", "acp-edges"), "the method")
