"""Files and settings that come from outside."""

from __future__ import annotations

import json
import os
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import trimesh

from tests.commands.conftest import CAMERA, FRAME_IDS, true_pose
from tests.faults.table import Outcome, Workplace, row


def edit(path: Path, change: Callable[[Any], object]) -> None:
    """Change the values of a JSON file."""
    values = json.loads(path.read_text())
    change(values)
    path.write_text(json.dumps(values))


def obj(at: Workplace, text: str) -> Path:
    """An OBJ file of that text."""
    path = at.folder / "block.obj"
    path.write_text(text)
    return path


def video(at: Workplace, camera: dict[str, Any] | None = None, pose: dict[str, Any] | None = None) -> Outcome:
    """`track --video` of the images, with a camera and a start pose of one's own."""
    start = true_pose(0)
    entry = {"cam_R_m2c": start[:3, :3].ravel().tolist(), "cam_t_m2c": start[:3, 3].tolist()}
    own = {name: getattr(CAMERA, name) for name in ("width", "height", "fx", "fy", "cx", "cy")} | {"dist": [0] * 5}
    (at.folder / "CAMERA.json").write_text(json.dumps(camera or own))
    (at.folder / "POSE.json").write_text(json.dumps(entry | (pose or {})))
    words = ["track", "--video", at.scene / "rgb", "--mesh", at.data / "models" / "obj_000001.ply"]
    words += ["--camera", at.folder / "CAMERA.json", "--init", at.folder / "POSE.json"]
    return at.run(*words, "--parts", at.parts, "--out", at.out)


def settings(at: Workplace, text: str) -> Outcome:
    """`track --config` with those lines."""
    (at.folder / "mine.toml").write_text(f'base = "acp"\n{text}\n')
    return at.track("--config", at.folder / "mine.toml")


@row("a mesh file is empty", "refused", quick=True)
def empty_mesh(at: Workplace) -> str:
    at.mesh.write_bytes(b"")
    return at.refused(at.prepare(), "block.ply", "empty")


@row("a mesh file is cut off", "refused: half a part is another part")
def cut_mesh(at: Workplace) -> str:
    at.mesh.write_bytes(at.mesh.read_bytes()[:-40])
    return at.refused(at.prepare(), "block.ply")


@row("a text with the name of a mesh", "refused")
def no_mesh(at: Workplace) -> str:
    at.mesh.write_text("to be done")
    return at.refused(at.prepare(), "block.ply")


@row("OBJ vertices with two numbers", "refused", quick=True)
def flat_vertices(at: Workplace) -> str:
    mesh = obj(at, "v 0 0\nv 10 0\nv 0 10\nf 1 2 3\n")
    return at.refused(at.prepare(mesh=mesh), "block.obj", "2 numbers")


@row("an OBJ vertex at 1e300", "refused")
def far_vertex(at: Workplace) -> str:
    mesh = obj(at, "v 0 0 1e300\nv 10 0 0\nv 0 10 0\nv 0 0 10\nf 1 2 3\nf 1 2 4\n")
    return at.refused(at.prepare(mesh=mesh), "block.obj", "no point")


@row("an OBJ vertex that is not a number", "refused")
def nan_vertex(at: Workplace) -> str:
    mesh = obj(at, "v 0 0 nan\nv 10 0 0\nv 0 10 0\nv 0 0 10\nf 1 2 3\nf 1 2 4\n")
    return at.refused(at.prepare(mesh=mesh), "block.obj", "no point")


@row("a face names a vertex that is not there", "refused")
def missing_vertex(at: Workplace) -> str:
    mesh = obj(at, "v 0 0 0\nv 10 0 0\nv 0 10 0\nf 1 2 9\n")
    return at.refused(at.prepare(mesh=mesh), "block.obj")


@row("a mesh in metres", "refused, with the unit that it looks like")
def metres(at: Workplace) -> str:
    trimesh.creation.box((0.04, 0.03, 0.02)).export(at.folder / "block.stl")
    return at.refused(at.prepare(mesh=at.folder / "block.stl"), "metres")


@row("a pipe in place of a mesh", "refused, not waited for", quick=True)
def pipe_as_mesh(at: Workplace) -> str:
    at.mesh.unlink()
    os.mkfifo(at.mesh)
    return at.refused(at.prepare(), "block.ply", "pipe")


@row("an endless device in place of a mesh", "refused, not read")
def device_as_mesh(at: Workplace) -> str:
    at.mesh.unlink()
    at.mesh.symlink_to("/dev/zero")
    return at.refused(at.prepare(), "block.ply", "device")


@row("a PLY comment in Latin-1", "accepted")
def latin_comment(at: Workplace) -> str:
    at.mesh.write_bytes(at.mesh.read_bytes().replace(b"\nelement", b"\ncomment gr\xf6\xdfe\nelement", 1))
    assert at.prepare().status == 0
    return "prepared"


@row("an open mesh", "prepared, with a warning")
def open_mesh(at: Workplace) -> str:
    box = trimesh.creation.box((40.0, 30.0, 20.0))
    trimesh.Trimesh(box.vertices, box.faces[2:]).export(at.folder / "block.stl")
    outcome = at.prepare(mesh=at.folder / "block.stl")
    assert outcome.status == 0
    assert "not closed" in outcome.err
    return f"prepared, {at.told(outcome.err)}"


@row("a thousand loose triangles", "prepared, sampled more sparsely, with a note")
def loose_triangles(at: Workplace) -> str:
    rng = np.random.default_rng(0)
    corners = rng.uniform(-50.0, 50.0, (1000, 1, 3)) + rng.uniform(-8.0, 8.0, (1000, 3, 3))
    faces = np.arange(3000).reshape(-1, 3)
    trimesh.Trimesh(corners.reshape(-1, 3), faces, process=False).export(at.folder / "heap.ply")
    outcome = at.prepare(mesh=at.folder / "heap.ply")
    assert outcome.status == 0, outcome
    assert "12000 are taken" in outcome.err
    return "prepared, with a note"


@row("models_info.json with a number of 400 digits", "refused")
def long_number(at: Workplace) -> str:
    info = at.data / "models" / "models_info.json"
    info.write_text(info.read_text().replace('"diameter": ', '"diameter": 1' + "0" * 400 + ', "was": ', 1))
    return at.refused(at.prepare(mesh=at.data / "models" / "obj_000001.ply"), "models_info.json")


@row("models_info.json of another mesh", "refused")
def other_info(at: Workplace) -> str:
    edit(at.data / "models" / "models_info.json", lambda infos: infos["1"].update(diameter=80.0))
    return at.refused(at.prepare(mesh=at.data / "models" / "obj_000001.ply"), "obj_000001.ply", "diameter")


@row("fx = 1e9 in CAMERA.json", "refused", quick=True)
def absurd_focal_length(at: Workplace) -> str:
    camera = {"width": 320, "height": 240, "fx": 1e9, "fy": 1e9, "cx": 160, "cy": 120, "dist": [0] * 5}
    return at.refused(video(at, camera), "CAMERA.json")


@row("fx = 1e-300 in the camera of a later frame", "refused before the first frame")
def later_focal_length(at: Workplace) -> str:
    def spoil(cameras: dict[str, Any]) -> None:
        cameras["5"]["cam_K"][0] = 1e-300

    edit(at.scene / "scene_camera.json", spoil)
    said = at.refused(at.track(), "scene_camera.json", "image 5")
    assert not at.out.exists()
    return said


@row("a camera of another image size", "refused")
def other_camera(at: Workplace) -> str:
    camera = {"width": 640, "height": 480, "fx": 600, "fy": 600, "cx": 320, "cy": 240, "dist": [0] * 5}
    return at.refused(video(at, camera), "640 x 480")


@row("no camera file but a lens's field of view", "accepted")
def field_of_view(at: Workplace) -> str:
    outcome = video(at, {"width": 320, "height": 240, "hfov_deg": 43.6})
    assert outcome.status == 0, outcome
    return "tracked"


@row("a start pose that is mirrored", "refused", quick=True)
def mirrored_start(at: Workplace) -> str:
    mirrored = (true_pose(0)[:3, :3] @ np.diag([-1.0, 1.0, 1.0])).ravel().tolist()
    return at.refused(video(at, pose={"cam_R_m2c": mirrored}), "POSE.json", "mirrored")


@row("a start pose that is no rotation", "refused")
def scaled_start(at: Workplace) -> str:
    return at.refused(video(at, pose={"cam_R_m2c": [2, 0, 0, 0, 2, 0, 0, 0, 2]}), "POSE.json", "not a rotation")


@row("a start pose in metres", "refused: the part is not seen there")
def start_in_metres(at: Workplace) -> str:
    return at.refused(video(at, pose={"cam_t_m2c": [-0.035, 0.0, 0.26]}), "POSE.json", "start pose", "unit")


@row("NaN in a start pose", "refused")
def nan_start(at: Workplace) -> str:
    return at.refused(video(at, pose={"cam_t_m2c": [0.0, float("nan"), 260.0]}), "POSE.json", "finite")


@row("scene_gt.json is torn", "refused")
def torn_truth(at: Workplace) -> str:
    truth = at.scene / "scene_gt.json"
    truth.write_text(truth.read_text()[:-30])
    return at.refused(at.track(), "scene_gt.json", "JSON")


@row("two instances of one object", "refused")
def two_instances(at: Workplace) -> str:
    edit(at.scene / "scene_gt.json", lambda truth: truth["0"].append(truth["0"][0]))
    return at.refused(at.track(), "object 1")


@row("a TOML file with 5000 nested brackets", "refused", quick=True)
def deep_toml(at: Workplace) -> str:
    return at.refused(settings(at, "margin_px = " + "[" * 5000 + "]" * 5000), "mine.toml")


@row("solver.steps = 1000000000", "refused", quick=True)
def endless_steps(at: Workplace) -> str:
    return at.refused(settings(at, "[solver]\nsteps = 1000000000"), "solver.steps")


@row("a search range of 1000000000 px", "refused")
def endless_search(at: Workplace) -> str:
    levels = '[schedule]\nkind = "pixels"\n[[schedule.levels]]\nreach_px = 1000000000\nsigma_px = 1.0'
    return at.refused(settings(at, levels), "reach_px")


@row("--threads 100000", "refused")
def many_threads(at: Workplace) -> str:
    return at.refused(at.track("--threads", "100000"), "--threads")


@row("--init-noise-mm nan", "refused")
def no_noise(at: Workplace) -> str:
    return at.refused(at.track("--init-noise-mm", "nan"), "--init-noise-mm")


@row("an output that is an input", "refused, and the input is as before")
def output_over_input(at: Workplace) -> str:
    truth = at.scene / "scene_gt.json"
    before = truth.read_bytes()
    said = at.refused(at.run("track", at.data, "--parts", at.parts, "--out", truth), "scene_gt.json")
    assert truth.read_bytes() == before
    return said


@row("a pipe in place of the results or of the replay", "refused, not waited for", quick=True)
def pipe_as_output(at: Workplace) -> str:
    pipe = at.folder / "pipe"
    os.mkfifo(pipe)
    at.refused(at.track("--replay", pipe), "--replay", "pipe")
    return at.refused(at.run("track", at.data, "--parts", at.parts, "--out", pipe), "--out", "pipe")


@row("the first image is unreadable", "refused")
def first_image(at: Workplace) -> str:
    at.image(FRAME_IDS[0]).write_bytes(b"")
    return at.refused(at.track(), "000000.png")


@row("a later image is empty", "skipped with a warning, score 0", quick=True)
def later_image(at: Workplace) -> str:
    at.image(3).write_bytes(b"")
    said = at.went_on(at.track(), "warning: image 3", "000003.png")
    assert {r.score for r in at.rows() if r.im_id == 3} == {0.0}
    return said


@row("a later image has another size", "skipped with a warning")
def image_size(at: Workplace) -> str:
    cv2.imwrite(str(at.image(3)), np.zeros((120, 160, 3), np.uint8))
    return at.went_on(at.track(), "warning: image 3")


@row("a later image is cut off", "skipped with a warning")
def cut_image(at: Workplace) -> str:
    at.image(5).write_bytes(at.image(5).read_bytes()[:-200])
    return at.went_on(at.track(), "warning: image 5")


@row("a pipe in place of a later image", "skipped with a warning, not waited for")
def pipe_as_image(at: Workplace) -> str:
    at.image(5).unlink()
    os.mkfifo(at.image(5))
    return at.went_on(at.track(), "warning: image 5")


@row("a JPEG of 62 kB whose header says 20000 x 20000", "skipped: known from the header, never decoded")
def huge_image(at: Workplace) -> str:
    _, small = cv2.imencode(".jpg", np.zeros((64, 64, 3), np.uint8))
    content = bytearray(small.tobytes())
    frame = content.index(b"\xff\xc0")
    content[frame + 5 : frame + 9] = struct.pack(">HH", 20000, 20000)
    at.image(5).unlink()
    at.image(5).with_suffix(".jpg").write_bytes(bytes(content))
    return at.went_on(at.track(), "warning: image 5", "20000")


@row("a results file with a torn line", "`eval` refuses it, with the line")
def torn_results(at: Workplace) -> str:
    at.track()
    at.out.write_bytes(at.out.read_bytes()[:-30])
    return at.refused(at.run("eval", at.data, at.out), "results.csv: line")


@row("a results file with a row twice", "`eval` refuses it, with both lines")
def doubled_results(at: Workplace) -> str:
    at.track()
    lines = at.out.read_text().splitlines()
    at.out.write_text("\n".join([*lines, lines[1]]) + "\n")
    return at.refused(at.run("eval", at.data, at.out), "already")
