"""`acp-lab track` and `acp-lab eval` from start to end, on two drawn boxes."""

from __future__ import annotations

import gc
import json
import re
import shutil
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from acp_lab.commands.track import TrackOptions, scene_jobs
from acp_lab.commands.track_run import ObjectSummary, Reporter, RunSummary, _next_after_loss
from acp_lab.control_points.canonical_frame import eye_position
from acp_lab.control_points.view_regions import choose_region
from acp_lab.generator.visibility import RegionNetwork
from acp_lab.geometry.camera import Camera
from acp_lab.geometry.pose import inverse, rotation_angle_deg, transform
from acp_lab.prepared_part import PreparedPart, PrepareOptions, Trained
from acp_lab.prepared_part.trained import RegionReport
from acp_lab.sequences import ResultRow, ResultsWriter, read_results, write_pose
from acp_lab.sequences.frame import Frame
from acp_lab.tracking.frame_solver import FrameSolver
from acp_lab.tracking.method import METHODS
from acp_lab.tracking.observer import SessionInfo
from acp_lab.tracking.result import Timings, TrackResult, TrackState
from tests.cli_runner import Outcome, assert_one_error, run
from tests.commands.conftest import CAMERA, FRAME_IDS, OBJECT_IDS, edit_json, true_pose, write_dataset
from tests.sequences.tiny_dataset import write_json


def track(capsys: pytest.CaptureFixture[str], dataset: Path, parts: Path, out: Path, *words: str | Path) -> Outcome:
    outcome = run(capsys, "track", dataset, "--parts", parts, "--out", out, *words)
    assert outcome.status == 0, outcome
    return outcome


def poses(path: Path) -> np.ndarray:
    return np.array([row.cam_T_obj for row in read_results(path)])


def test_a_row_per_frame_and_object(
    capsys: pytest.CaptureFixture[str], dataset: Path, parts: Path, tmp_path: Path
) -> None:
    outcome = track(capsys, dataset, parts, tmp_path / "out" / "results.csv")
    rows = read_results(tmp_path / "out" / "results.csv")
    assert sorted(row.key for row in rows) == [(1, f, o) for f in FRAME_IDS for o in OBJECT_IDS]
    assert all(0.0 <= row.score <= 1.0 and row.time_s > 0.0 for row in rows)
    assert outcome.err.count("\n") == 1
    assert "templates" in outcome.err  # which generator was used


def test_a_collection_of_garbage_does_not_hold_up_a_frame(
    capsys: pytest.CaptureFixture[str], dataset: Path, parts: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    left_alone, solve = list[int](), FrameSolver.solve

    def counted(*given: Any) -> Any:
        left_alone.append(gc.get_freeze_count())
        return solve(*given)

    monkeypatch.setattr(FrameSolver, "solve", counted)
    track(capsys, dataset, parts, tmp_path / "results.csv")
    assert min(left_alone) > 10_000
    assert gc.get_freeze_count() == 0


def test_the_boxes_are_followed(capsys: pytest.CaptureFixture[str], dataset: Path, parts: Path, tmp_path: Path) -> None:
    track(capsys, dataset, parts, tmp_path / "results.csv")
    outcome = run(capsys, "eval", dataset, tmp_path / "results.csv", "--json", tmp_path / "scores.json")
    assert outcome.status == 0, outcome
    assert "@5%" in outcome.out
    scores = json.loads((tmp_path / "scores.json").read_text())
    assert [item["obj_id"] for item in scores["objects"]] == list(OBJECT_IDS)
    assert scores["pooled"]["recall_5"] == 1.0
    assert scores["pooled"]["frames"] == (len(FRAME_IDS) - 1) * len(OBJECT_IDS)


def test_run_json_tells_how_it_came_about(
    capsys: pytest.CaptureFixture[str], dataset: Path, parts: Path, tmp_path: Path
) -> None:
    track(capsys, dataset, parts, tmp_path / "results.csv", "--seed", "3")
    info = json.loads((tmp_path / "results.run.json").read_text())
    assert info["complete"] is True
    assert info["method"] == "acp"
    assert info["options"]["seed"] == 3
    assert info["configuration"]
    assert info["parts"]["obj_000001"]["generator"] == "templates"
    assert len(info["parts"]["obj_000001"]["sha256"]) == 64
    assert {"numpy", "acp_lab", "python"} <= set(info["versions"])
    assert info["machine"]["cpu"]
    assert info["threads"] == 1


def test_a_method_of_ones_own(capsys: pytest.CaptureFixture[str], dataset: Path, parts: Path, tmp_path: Path) -> None:
    config = tmp_path / "mine.toml"
    config.write_text(
        'control_points = "mid-section"\n[source]\nkind = "cad-samples"\ngenerator = "templates"\n'
        '[variables]\nkind = "pose"\n[schedule]\nalpha = 0.06\n'
    )
    track(capsys, dataset, parts, tmp_path / "results.csv", "--config", str(config))
    info = json.loads((tmp_path / "results.run.json").read_text())
    assert info["method"] == "mine"
    configuration = info["configuration"]
    expected = {"kind": "share-of-diameter", "alpha": 0.06, "shares": [1.0, 0.5, 0.28], "samples": 1500}
    assert configuration["schedule"] == expected
    assert configuration["variables"] == {"kind": "pose", "linearise": "step", "lengths": "image"}
    assert configuration["targets"][0]["loss"] == "geman-mcclure"
    outcome = run(capsys, "eval", dataset, tmp_path / "results.csv", "--json", tmp_path / "scores.json")
    assert outcome.status == 0, outcome
    assert json.loads((tmp_path / "scores.json").read_text())["pooled"]["recall_10"] == 1.0


def test_every_named_method_is_one_that_track_takes(
    capsys: pytest.CaptureFixture[str], dataset: Path, parts: Path, tmp_path: Path
) -> None:
    """These parts have templates alone: the others say which generator they lack, before anything is written."""
    for name in METHODS:
        out = tmp_path / f"{name}.csv"
        outcome = run(capsys, "track", dataset, "--parts", parts, "--out", out, "--method", name, "--max-frames", "2")
        if name in ("acp", "acp-edges", "region", "region-points", "slet"):
            assert outcome.status == 0, outcome
            assert json.loads(out.with_suffix(".run.json").read_text())["method"] == name
        else:
            assert_one_error(outcome, "--generator autoencoder")
            assert not out.exists()
    outcome = run(capsys, "track", dataset, "--parts", parts, "--out", tmp_path / "x.csv", "--method", "acp-papr")
    assert_one_error(outcome, "acp-papr")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("targets = []", "targets"),
        ("[solver]\nsteps = 1000000000", "solver.steps = 1000000000"),
        ("[[schedule]]\nalpha = 0.1", "schedule"),
        ("[source]\nkind = 'eyes'", "source.kind = 'eyes'"),
    ],
)
def test_a_method_that_makes_no_sense_is_one_line(
    capsys: pytest.CaptureFixture[str], dataset: Path, parts: Path, tmp_path: Path, text: str, words: str
) -> None:
    config = tmp_path / "mine.toml"
    config.write_text(text)
    out = tmp_path / "results.csv"
    outcome = run(capsys, "track", dataset, "--parts", parts, "--out", out, "--config", config)
    assert_one_error(outcome, words)
    assert not out.exists()


def test_the_time_of_a_row_is_that_of_the_whole_frame(
    capsys: pytest.CaptureFixture[str], dataset: Path, parts: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """From the decoded frame to the pose: looking at the image counts, not the solver alone."""
    look = FrameSolver.look

    def slowly(*args: Any, **kwargs: Any) -> Any:
        time.sleep(0.05)
        return look(*args, **kwargs)

    monkeypatch.setattr(FrameSolver, "look", slowly)
    track(capsys, dataset, parts, tmp_path / "results.csv", "--object", "1", "--max-frames", "3")
    rows = read_results(tmp_path / "results.csv")
    assert len(rows) == 3
    assert min(row.time_s for row in rows) >= 0.05


# ---- view regions that were not prepared ---------------------------------------------------------------------


def learned_only(parts: Path, name: str, region: int) -> None:
    """As `prepare --generator learned --regions K` leaves a part, its network calling every edge visible."""
    model = PreparedPart.load(parts / name)
    n = len(model.edges)
    zeros = [np.zeros(shape, np.float32) for shape in ((4, 8), (4,), (4, 4), (4,), (n, 4))]
    everything = RegionNetwork(*zeros, np.ones(n, np.float32), np.arange(n, dtype=np.int32))
    networks = Trained({region: everything}, {region: RegionReport(region, 1.0, 1.0, 1.0, 0.0, 0.0)}, "made")
    shutil.rmtree(parts / name)
    replace(model, templates=None, networks=networks).save(parts / name)


def test_a_start_from_a_region_that_was_not_prepared_is_one_line_and_exit_2(
    capsys: pytest.CaptureFixture[str], dataset: Path, parts: Path, tmp_path: Path
) -> None:
    box = PreparedPart.load(parts / "obj_000001").part
    seen_from = choose_region(eye_position(true_pose(0)) - box.box_centre, 0.5 * box.box_size)
    opposite = seen_from ^ 1
    learned_only(parts, "obj_000001", opposite)
    out = tmp_path / "results.csv"
    outcome = run(capsys, "track", dataset, "--parts", parts, "--out", out, "--object", "1")
    said = f"is seen from view region {seen_from}, generator learned is prepared for {opposite} only"
    where = "scene_gt.json: image 0: obj_000001"
    assert_one_error(outcome, where, f"{said}; run: acp-lab prepare", f"--regions {seen_from}\n")
    assert not out.exists()
    out.write_text("scene_id,im_id,obj_id,score,R,t,time\n")
    outcome = run(capsys, "track", dataset, "--parts", parts, "--out", out)
    assert_one_error(outcome, said)
    assert out.read_text() == "scene_id,im_id,obj_id,score,R,t,time\n", "older results stay"
    out.unlink()
    # Prepared for the region that it is seen from, it is tracked.
    learned_only(parts, "obj_000001", seen_from)
    track(capsys, dataset, parts, out, "--object", "1")
    assert len(read_results(out)) == len(FRAME_IDS)


def test_a_view_that_was_not_prepared_is_one_warning(capsys: pytest.CaptureFixture[str]) -> None:
    """Of a run in which the part turns there; the tracker notes it in one frame."""
    camera = Camera(64, 48, 60.0, 60.0, 31.5, 23.5)
    frame = Frame(7, np.zeros((48, 64, 3), np.uint8), camera)
    said = "view region 0 is not prepared: that of region 4 is used; accuracy will fall"
    quiet = TrackResult(
        7, np.eye(4), np.eye(4), np.zeros((4, 2)), 0.1, 0.5, TrackState.TRACKING, 4, None, None, 1, Timings()
    )
    reporter = Reporter(0)
    reporter.on_start(SessionInfo("scene", 1, "acp", ()))
    for note in ("", said, "tracking -> weak: quality 0.20"):
        reporter.on_frame(frame, {3: replace(quiet, note=note)})
    reporter.on_end()
    assert [line for line in capsys.readouterr().err.splitlines() if line.startswith("warning")] == [
        f"warning: image 7, object 3: {said}"
    ]


# ---- starts --------------------------------------------------------------------------------------------------


def test_same_seed_same_numbers(capsys: pytest.CaptureFixture[str], dataset: Path, parts: Path, tmp_path: Path) -> None:
    noise = ("--init-noise-deg", "2", "--init-noise-mm", "1", "--seed")
    for name, seed in (("a", "5"), ("b", "5"), ("c", "6")):
        track(capsys, dataset, parts, tmp_path / f"{name}.csv", *noise, seed)
    np.testing.assert_array_equal(poses(tmp_path / "a.csv"), poses(tmp_path / "b.csv"))
    assert not np.array_equal(poses(tmp_path / "a.csv"), poses(tmp_path / "c.csv"))


@pytest.mark.parametrize(("noise_deg", "noise_mm"), [(0.5, 0.5), (5.0, 3.0), (0.5, 0.0), (0.0, 2.0), (120.0, 40.0)])
def test_noise_is_exact_and_from_the_seed(
    dataset: Path, parts: Path, tmp_path: Path, noise_deg: float, noise_mm: float
) -> None:
    options = TrackOptions(
        parts=parts, out=tmp_path / "r.csv", dataset=dataset, noise_deg=noise_deg, noise_mm=noise_mm, seed=7
    )
    (job,) = scene_jobs(options)
    (again,) = scene_jobs(options)
    for object_id in OBJECT_IDS:
        start, truth = job.starts[object_id], true_pose(0, object_id)
        np.testing.assert_array_equal(start, again.starts[object_id])
        assert rotation_angle_deg(start[:3, :3], truth[:3, :3]) == pytest.approx(noise_deg, abs=1e-5)
        centre = job.models[object_id].part.box_centre
        moved = transform(start, centre[None]) - transform(truth, centre[None])
        assert np.linalg.norm(moved) == pytest.approx(noise_mm, abs=1e-9)
    relative = [job.starts[i] @ inverse(true_pose(0, i)) for i in OBJECT_IDS]
    assert not np.allclose(relative[0], relative[1])  # each object has noise of its own


def test_choosing_scene_object_and_frames(capsys: pytest.CaptureFixture[str], parts: Path, tmp_path: Path) -> None:
    dataset = write_dataset(tmp_path / "two", scenes=(1, 7))
    track(capsys, dataset, parts, tmp_path / "all.csv", "--max-frames", "2")
    assert {row.key[:2] for row in read_results(tmp_path / "all.csv")} == {(1, 0), (1, 2), (7, 0), (7, 2)}
    words = ("--scene", "7", "--object", "4", "--max-frames", "1")
    track(capsys, dataset, parts, tmp_path / "one.csv", *words)
    assert [row.key for row in read_results(tmp_path / "one.csv")] == [(7, 0, 4)]


def test_starting_from_a_file(capsys: pytest.CaptureFixture[str], dataset: Path, parts: Path, tmp_path: Path) -> None:
    (dataset / "test" / "000001" / "scene_gt.json").unlink()
    with ResultsWriter(tmp_path / "poses.csv") as writer:
        writer.append(ResultRow(1, 0, 4, 1.0, true_pose(0, 4)))
    track(capsys, dataset, parts, tmp_path / "results.csv", "--init", str(tmp_path / "poses.csv"))
    assert [row.obj_id for row in read_results(tmp_path / "results.csv")] == [4] * len(FRAME_IDS)


def test_estimates_of_a_file_are_not_given_poses(dataset: Path, parts: Path, tmp_path: Path) -> None:
    """A detector or a tracker is never quite sure, as whoever knows is."""
    with ResultsWriter(tmp_path / "poses.csv") as writer:
        for object_id, score in zip(OBJECT_IDS, (0.97, 1.0), strict=True):
            writer.append(ResultRow(1, 0, object_id, score, true_pose(0, object_id)))
    options = TrackOptions(parts=parts, out=tmp_path / "r.csv", dataset=dataset)
    (given,) = scene_jobs(options)
    assert given.found == frozenset()
    (job,) = scene_jobs(replace(options, init=str(tmp_path / "poses.csv")))
    assert job.found == {OBJECT_IDS[0]}
    (other,) = scene_jobs(replace(options, init=str(tmp_path / "poses.csv"), objects=OBJECT_IDS[1:]))
    assert other.found == frozenset()


def test_a_run_starts_where_its_start_poses_do(
    capsys: pytest.CaptureFixture[str], dataset: Path, parts: Path, tmp_path: Path
) -> None:
    with ResultsWriter(tmp_path / "poses.csv") as writer:
        for frame_id in (3, 5):
            writer.append(ResultRow(1, frame_id, 4, 1.0, true_pose(frame_id, 4)))
    words, out = ("--object", "4", "--init", tmp_path / "poses.csv"), tmp_path / "results.csv"
    outcome = track(capsys, dataset, parts, out, *words)
    assert "note: scene 1: starts in image 3, the first with start poses in" in outcome.err
    assert [row.im_id for row in read_results(out)] == [3, 5, 6]
    assert track(capsys, dataset, parts, out, *words, "--resume").status == 0
    track(capsys, dataset, parts, out, *words, "--first-frame", "5")
    assert [row.im_id for row in read_results(out)] == [5, 6]


def test_objects_that_start_later_are_named(
    capsys: pytest.CaptureFixture[str], dataset: Path, parts: Path, tmp_path: Path
) -> None:
    (dataset / "test" / "000001" / "scene_gt.json").unlink()
    with ResultsWriter(tmp_path / "poses.csv") as writer:
        writer.append(ResultRow(1, 2, 4, 1.0, true_pose(2, 4)))
        for object_id in OBJECT_IDS:
            writer.append(ResultRow(1, 3, object_id, 1.0, true_pose(3, object_id)))
    out, words = tmp_path / "results.csv", ("--init", tmp_path / "poses.csv")
    outcome = track(capsys, dataset, parts, out, *words)
    assert "warning: scene 1: starts in image 2; object 1 is not tracked" in outcome.err
    assert {row.obj_id for row in read_results(out)} == {4}
    outcome = track(capsys, dataset, parts, out, *words, "--object", "1")
    assert "warning" not in outcome.err
    assert [(row.im_id, row.obj_id) for row in read_results(out)] == [(3, 1), (5, 1), (6, 1)]


def test_a_start_that_was_not_found_is_warned_of(
    capsys: pytest.CaptureFixture[str], dataset: Path, parts: Path, tmp_path: Path
) -> None:
    """As `acp-lab detect` writes it, whose score is the probability that the part is there."""
    out, words = tmp_path / "results.csv", ("--init", tmp_path / "poses.csv")
    for score, is_told in ((0.63, True), (0.8, False)):
        with ResultsWriter(tmp_path / "poses.csv") as writer:
            writer.append(ResultRow(1, 0, 1, score, true_pose(0, 1)))
            writer.append(ResultRow(1, 0, 4, 0.1, true_pose(0, 4)))
        outcome = track(capsys, dataset, parts, out, *words, "--object", "1")
        assert ("image 0, object 1: its start pose has a score of 0.63" in outcome.err) == is_told
        assert "object 4" not in outcome.err


def test_another_object_may_be_there_twice(
    capsys: pytest.CaptureFixture[str], dataset: Path, parts: Path, tmp_path: Path
) -> None:
    edit_json(dataset / "test" / "000001" / "scene_gt.json", lambda truth: truth["3"].append(truth["3"][0]))
    out = tmp_path / "results.csv"
    assert_one_error(run(capsys, "track", dataset, "--parts", parts, "--out", out), "object 1 more than once")
    track(capsys, dataset, parts, out, "--object", "4")
    assert run(capsys, "eval", dataset, out).status == 0
    assert run(capsys, "explain", out, "--frame", "2").status == 0


def test_so_does_one_of_a_video(capsys: pytest.CaptureFixture[str], dataset: Path, parts: Path, tmp_path: Path) -> None:
    CAMERA.to_json(tmp_path / "camera.json")
    with ResultsWriter(tmp_path / "poses.csv") as writer:
        writer.append(ResultRow(1, 2, 1, 1.0, true_pose(FRAME_IDS[2])))
    write_pose(tmp_path / "pose.json", true_pose(FRAME_IDS[3]))
    words = ["track", "--video", dataset / "test" / "000001" / "rgb", "--camera", tmp_path / "camera.json"]
    words += ["--mesh", dataset / "models" / "obj_000001.ply", "--parts", parts, "--out", tmp_path / "results.csv"]
    assert run(capsys, *words, "--init", tmp_path / "poses.csv").status == 0
    assert [row.im_id for row in read_results(tmp_path / "results.csv")] == [2, 3, 4]
    assert run(capsys, *words, "--init", tmp_path / "pose.json", "--first-frame", "3").status == 0
    assert [row.im_id for row in read_results(tmp_path / "results.csv")] == [3, 4]
    outcome = run(capsys, *words, "--init", tmp_path / "pose.json", "--first-frame", "9")
    assert_one_error(outcome, "has no image 9")
    outcome = run(capsys, "track", dataset, "--parts", parts, "--out", tmp_path / "other.csv", "--first-frame", "3")
    assert_one_error(outcome, "--first-frame 3", "--init")


@pytest.mark.parametrize("is_found", [False, True])
def test_a_pose_file_says_whether_its_pose_was_found(
    dataset: Path, parts: Path, tmp_path: Path, is_found: bool
) -> None:
    CAMERA.to_json(tmp_path / "camera.json")
    write_pose(tmp_path / "pose.json", true_pose(0), found=is_found)
    options = TrackOptions(
        parts=parts,
        out=tmp_path / "r.csv",
        video=dataset / "test" / "000001" / "rgb",
        mesh=dataset / "models" / "obj_000001.ply",
        camera=tmp_path / "camera.json",
        init=str(tmp_path / "pose.json"),
    )
    (job,) = scene_jobs(options)
    assert job.found == (frozenset({1}) if is_found else frozenset())


def test_a_frame_in_the_middle_that_cannot_be_read(
    capsys: pytest.CaptureFixture[str], dataset: Path, parts: Path, tmp_path: Path
) -> None:
    (dataset / "test" / "000001" / "rgb" / "000003.png").write_bytes(b"")
    outcome = track(capsys, dataset, parts, tmp_path / "results.csv", "--object", "1")
    assert outcome.err.count("warning: ") == 1
    assert "000003.png" in outcome.err
    rows = {row.im_id: row for row in read_results(tmp_path / "results.csv")}
    assert set(rows) == set(FRAME_IDS)
    assert rows[3].score == 0.0
    assert rows[5].score > 0.0


def test_the_summary_says_what_was_seen(
    capsys: pytest.CaptureFixture[str], dataset: Path, parts: Path, tmp_path: Path
) -> None:
    for frame_id in FRAME_IDS[1:]:
        (dataset / "test" / "000001" / "rgb" / f"{frame_id:06d}.png").write_bytes(b"")
    outcome = track(capsys, dataset, parts, tmp_path / "results.csv", "--object", "1")
    assert (
        "5 frames of 320 x 240 (3 lost, 1 tracking, 1 weak; first lost from image 2 on; 4 not readable)" in outcome.out
    ), outcome.out
    assert f"results.csv: written; acp-lab explain {tmp_path / 'results.csv'} says why" in outcome.out
    outcome = track(capsys, dataset, parts, tmp_path / "my out.csv")
    assert f"acp-lab explain '{tmp_path / 'my out.csv'}' --scene 1 --object 1 says why" in outcome.out


def test_a_part_that_was_not_prepared_to_its_end_is_warned_of(
    capsys: pytest.CaptureFixture[str], dataset: Path, parts: Path, tmp_path: Path
) -> None:
    """An interrupted prepare leaves the stages that it had done, and what it was asked for."""
    folder, mesh = parts / "obj_000001", dataset / "models" / "obj_000001.ply"
    whole = PreparedPart.load(folder, mesh)
    assert not whole.lacks
    replace(whole, options={"both": PrepareOptions(regions=(0, 3))}).save(folder)
    words = ("--object", "1", "--max-frames", "1")
    outcome = track(capsys, dataset, parts, tmp_path / "results.csv", *words)
    told = f"warning: {folder}: lacks visibility networks of view regions 0, 3, as after an interrupted prepare; run: "
    assert f"{told}acp-lab prepare {mesh} --out {parts}\n" in outcome.err


def test_the_summary_says_where_no_frame_was_good(tmp_path: Path) -> None:
    poor = ObjectSummary(1, 4, "box")
    poor.add(0, TrackState.WEAK, is_unreadable=False)
    assert _next_after_loss(RunSummary((poor,)), tmp_path / "r.csv").endswith("r.csv says why no frame was good")
    assert _next_after_loss(RunSummary((poor,)), tmp_path / "r.csv", live=True) == ""


def test_the_summary_says_where_poses_are_inexact(
    capsys: pytest.CaptureFixture[str], dataset: Path, parts: Path, tmp_path: Path
) -> None:
    usual = re.search(r"exactness (\d\.\d\d)", track(capsys, dataset, parts, tmp_path / "results.csv").out)
    assert usual is None or float(usual[1]) > 0.9, "it is named only where it is low"
    (tmp_path / "vague.toml").write_text(
        'base = "acp"\n[uncertainty]\nkind = "calibrated"\nshift_px = 30.0\n', encoding="utf-8"
    )
    vague = track(capsys, dataset, parts, tmp_path / "vague.csv", "--config", str(tmp_path / "vague.toml"))
    assert re.search(r"quality (0|1)\.\d\d, exactness 0\.[0-8]\d, \d+\.\d ms per frame \(medians\)", vague.out), vague
    # What it says of poses changes none.
    poses = [[row.cam_T_obj for row in read_results(tmp_path / name)] for name in ("results.csv", "vague.csv")]
    np.testing.assert_array_equal(*poses)


def test_a_folder_of_images(capsys: pytest.CaptureFixture[str], dataset: Path, parts: Path, tmp_path: Path) -> None:
    CAMERA.to_json(tmp_path / "camera.json")
    pose = true_pose(0)
    entry = {"cam_R_m2c": pose[:3, :3].ravel().tolist(), "cam_t_m2c": pose[:3, 3].tolist()}
    write_json(tmp_path / "pose.json", entry)
    words = ["--video", dataset / "test" / "000001" / "rgb", "--mesh", dataset / "models" / "obj_000001.ply"]
    words += ["--camera", tmp_path / "camera.json", "--init", tmp_path / "pose.json"]
    outcome = run(capsys, "track", *words, "--parts", parts, "--out", tmp_path / "results.csv")
    assert outcome.status == 0, outcome
    assert [row.key for row in read_results(tmp_path / "results.csv")] == [(1, i, 1) for i in range(5)]
    assert "folds the image" not in outcome.err
    replace(CAMERA, dist=(-2.5, 0.0, 0.0, 0.0, 0.0)).to_json(tmp_path / "camera.json")
    outcome = run(capsys, "track", *words, "--parts", parts, "--out", tmp_path / "results.csv")
    assert "note: camera distortion -2.5, 0, 0, 0, 0: folds the image" in outcome.err


def test_a_replay_on_the_way(capsys: pytest.CaptureFixture[str], dataset: Path, parts: Path, tmp_path: Path) -> None:
    track(capsys, dataset, parts, tmp_path / "results.csv", "--replay", str(tmp_path / "run.rrd"))
    assert (tmp_path / "run.rrd").stat().st_size > 10_000


def test_interrupted_run_keeps_its_rows(
    capsys: pytest.CaptureFixture[str],
    dataset: Path,
    parts: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    seen = []

    def interrupt(self: object, frame: object, results: object) -> None:
        seen.append(frame)
        if len(seen) == 3:
            raise KeyboardInterrupt

    monkeypatch.setattr("acp_lab.commands.track_run.SummaryObserver.on_frame", interrupt)
    outcome = run(capsys, "track", dataset, "--parts", parts, "--out", tmp_path / "results.csv")
    assert outcome.status == 130
    assert len(read_results(tmp_path / "results.csv")) == 3 * len(OBJECT_IDS)
    assert json.loads((tmp_path / "results.run.json").read_text())["complete"] is False


@pytest.mark.parametrize("content", ["", "nonsense\n", "scene_id,im_id,obj_id,score,R,t,time\n1,0,1\n"])
def test_eval_of_a_malformed_results_file(
    capsys: pytest.CaptureFixture[str], dataset: Path, tmp_path: Path, content: str
) -> None:
    (tmp_path / "results.csv").write_text(content)
    assert_one_error(run(capsys, "eval", dataset, tmp_path / "results.csv"), "results.csv")


def test_eval_with_truth_of_the_first_frame_alone(
    capsys: pytest.CaptureFixture[str], dataset: Path, tmp_path: Path
) -> None:
    edit_json(
        dataset / "test" / "000001" / "scene_gt.json",
        lambda poses: [poses.pop(str(frame_id)) for frame_id in FRAME_IDS[1:]],
    )
    with ResultsWriter(tmp_path / "results.csv") as writer:
        writer.append(ResultRow(1, 2, 1, 1.0, true_pose(2)))
    outcome = run(capsys, "eval", dataset, tmp_path / "results.csv", "--json", tmp_path / "scores.json")
    assert_one_error(outcome, dataset, "no frame but the first has truth")
    assert not (tmp_path / "scores.json").exists()


def test_eval_of_missing_things(capsys: pytest.CaptureFixture[str], dataset: Path, tmp_path: Path) -> None:
    assert_one_error(run(capsys, "eval", dataset, tmp_path / "none.csv"), "none.csv")
    with ResultsWriter(tmp_path / "results.csv") as writer:
        writer.append(ResultRow(1, 2, 1, 1.0, true_pose(2)))
    assert_one_error(run(capsys, "eval", tmp_path / "nowhere", tmp_path / "results.csv"), "nowhere")
    same = run(capsys, "eval", dataset, tmp_path / "results.csv", "--json", tmp_path / "results.csv")
    assert_one_error(same, "overwrite")
    assert_one_error(
        run(capsys, "eval", dataset, tmp_path / "results.csv", "--json", tmp_path / "results.csv" / "x.json"),
        "x.json",
    )
    assert_one_error(run(capsys, "eval", dataset, tmp_path / "results.csv", "--json", tmp_path), "folder")


def test_whoever_tracks_prepared_parts_waits_for_no_library_that_is_not_needed(
    dataset: Path, parts: Path, tmp_path: Path
) -> None:
    """Trimesh alone, with what it brings, takes half a second and tens of MB."""
    heavy = ("torch", "kornia", "rerun", "matplotlib", "pyrender", "trimesh", "networkx", "scipy.optimize")
    words = ["track", str(dataset), "--parts", str(parts), "--out", str(tmp_path / "out.csv")]
    code = (
        f"import sys; from acp_lab.cli import main; assert main({words!r}) == 0; "
        f"print('imported:', [m for m in {heavy!r} if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "imported: []"
