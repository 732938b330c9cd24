"""`acp-lab bench` as it is typed: from data sets to a page, taken up again, and its one-line errors."""

from __future__ import annotations

import csv
import json
import re
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest

from acp_lab.bench.protocol import SequenceKey
from acp_lab.commands import bench_parts
from acp_lab.commands.bench import BenchOptions
from acp_lab.commands.bench_parts import RICHEST_FIRST, generator_of
from acp_lab.commands.prepare import Spread
from acp_lab.display.replay.file import check_replay
from acp_lab.display.replay.recorder import Replay
from acp_lab.prepared_part import PreparedPart, PrepareOptions
from acp_lab.sequences import read_results
from acp_lab.tracking.method import METHODS
from tests.cli_runner import assert_one_error, run
from tests.commands.conftest import FRAME_IDS, edit_json, true_pose
from tests.prepared_part.test_model import painted
from tests.sequences.tiny_dataset import pose_entry, write_json


@pytest.fixture
def prepared(parts: Path, dataset: Path) -> Path:
    """One folder of prepared parts per data set, as bench has them."""
    (parts.parent / "all").mkdir()
    return Path(shutil.move(parts, parts.parent / "all" / dataset.name)).parent


def rows_of(out: Path) -> list[dict[str, str]]:
    with (out / "bench.csv").open(encoding="utf-8") as file:
        return list(csv.DictReader(file))


def test_a_bench_from_data_to_page(
    capsys: pytest.CaptureFixture[str], dataset: Path, prepared: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    theirs = tmp_path / "Theirs__data.csv"
    words = ("bench", dataset, "--methods", "acp-edges", "--parts", prepared, "--out", out, "--jobs", "1")
    assert run(capsys, *words).status == 0
    shutil.copy(out / "results" / "acp-edges__data.csv", theirs)
    more = ("--noise", "1,1", "--seeds", "2", "--steps", "1,2", "--results-from", theirs)
    outcome = run(capsys, *words, *more)
    assert (outcome.status, outcome.err) == (0, ""), outcome
    assert re.search(r"^  Theirs .* lost  @5% tie$", outcome.out, re.MULTILINE)
    rows = {(row["method"], row["step"], row["noise_deg"]): row for row in rows_of(out)}
    assert set(rows) == {("acp-edges", step, noise) for step in "12" for noise in ("0.0", "1.0")} | {
        ("Theirs", "1", "0.0")
    }
    ours, same = rows["acp-edges", "1", "0.0"], rows["Theirs", "1", "0.0"]
    # What was exported and read again is the same tracker.
    assert float(ours["mean_recall_5"]) == float(same["mean_recall_5"]) > 0.0
    assert same["gain_5_is"] == "tie"
    assert rows["acp-edges", "1", "1.0"]["runs"] == "4"
    assert json.loads((out / "bench.json").read_text())["methods"] == ["acp-edges", "Theirs"]
    assert "Theirs" in (out / "index.html").read_text(encoding="utf-8")
    (replay,) = (out / "replays").glob("*.rrd")
    assert check_replay(replay).is_complete


def test_what_was_run_is_not_run_again(
    capsys: pytest.CaptureFixture[str], dataset: Path, prepared: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    words = ("bench", dataset, "--methods", "acp-edges", "--parts", prepared, "--out", tmp_path / "out", "--jobs", "1")
    assert run(capsys, *words).status == 0
    before = rows_of(tmp_path / "out")

    def refuse(*_: object) -> None:
        raise AssertionError("was run again")

    monkeypatch.setattr("acp_lab.bench.runner.run", refuse)
    monkeypatch.setattr("acp_lab.bench.spread.run_task", refuse)
    assert run(capsys, *words).status == 0
    assert rows_of(tmp_path / "out") == before


def test_poses_of_an_earlier_bench_are_named(
    capsys: pytest.CaptureFixture[str], dataset: Path, prepared: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    words = ("bench", dataset, "--methods", "acp-edges", "--parts", prepared, "--out", out, "--jobs", "1")
    poses = f"{out / 'results'}: poses of runs from truth on every frame, without resets:"
    assert run(capsys, *words).out.splitlines()[-1] == f"{poses} 1 of this bench"
    (out / "results" / "mine.csv").write_text("notes\n")
    earlier = run(capsys, *words, "--resets").out.splitlines()[-1]
    assert earlier == f"{poses} none of this bench; not of it: acp-edges__data.csv, mine.csv"
    assert (out / "results" / "mine.csv").read_text() == "notes\n"


def test_a_method_of_a_file_stands_beside_the_others_and_is_run_again_when_it_changed(
    capsys: pytest.CaptureFixture[str], dataset: Path, prepared: Path, tmp_path: Path
) -> None:
    out, files = tmp_path / "out", (tmp_path / "mine.toml", tmp_path / "other.toml")
    files[0].write_text('base = "acp-edges"\nmargin_px = 30\n')
    files[1].write_text('base = "acp-edges"\nname = "named in it"\n')
    words = ("bench", dataset, "--methods", "acp-edges", "--parts", prepared, "--out", out, "--jobs", "1")
    words += ("--config", files[0], "--config", files[1])

    def states() -> dict[str, str]:
        kept = [json.loads(path.read_text()) for path in (out / "runs").iterdir()]
        return {run["method"]: run["state"] for run in kept}

    assert run(capsys, *words).status == 0
    assert [row["method"] for row in rows_of(out)] == ["acp-edges", "mine", "named in it"]
    assert (out / "results" / "named_in_it__data.csv").exists()
    before = states()
    files[0].write_text('base = "acp-edges"\nmargin_px = 31\n')
    assert run(capsys, *words).status == 0
    assert {name for name, state in states().items() if state != before[name]} == {"mine"}
    named = ("--results-from", out / "results" / "named_in_it__data.csv")
    assert_one_error(run(capsys, *words, *named), "named in it is one of --methods or --config", "rename the file")


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ('base = "acp"', "name = 'mine' is taken"),  # by the file before
        ('name = "region"', "name = 'region' is taken"),
        ('name = "GOS"', "name = 'GOS' is taken"),
        ('name = "a/b"', "name = 'a/b': results are written under it"),
        ('name = "a__b"', "name = 'a__b': results are written under it"),
        ('name = ""', "name = ''"),
        ("[solver]\nno = 1", "solver.no: no such setting"),
        ("\0", "is no TOML"),
        (None, "no such method file: check --config"),
    ],
)
def test_files_that_are_no_method_of_their_own(
    capsys: pytest.CaptureFixture[str], dataset: Path, tmp_path: Path, text: str | None, expected: str
) -> None:
    first, second = tmp_path / "mine.toml", tmp_path / "other" / "mine.toml"
    second.parent.mkdir()
    first.write_text('base = "acp"\nmargin_px = 40\n')
    if text is not None:
        second.write_text(text)
    words = ("bench", dataset, "--out", tmp_path / "out", "--config", first, "--config", second)
    assert_one_error(run(capsys, *words), second, expected)
    assert not (tmp_path / "out").exists()


def test_parts_may_lie_where_prepare_left_them(
    capsys: pytest.CaptureFixture[str], dataset: Path, parts: Path, tmp_path: Path
) -> None:
    words = ("bench", dataset, "--methods", "acp-edges", "--parts", parts, "--out", tmp_path / "out", "--jobs", "1")
    outcome = run(capsys, *words)
    assert outcome.status == 0
    assert "Preparing" not in outcome.out
    assert not (parts / "data").exists()


def test_a_part_of_its_data_set_goes_first_and_one_of_another_mesh_is_none(dataset: Path, parts: Path) -> None:
    one, four = (SequenceKey("data", 1, object_id) for object_id in (1, 4))
    flat, own = parts, parts / "data"

    def places(alone: bool = True) -> dict[SequenceKey, Path]:
        return bench_parts.places_of(dataset, [one, four], parts, alone=alone)

    assert places() == {one: flat, four: flat}
    assert places(alone=False) == {one: own, four: own}
    shutil.copytree(parts / "obj_000001", own / "obj_000001")
    assert places() == {one: own, four: flat}
    mesh = dataset / "models" / "obj_000004.ply"
    mesh.write_bytes(mesh.read_bytes().replace(b"\nelement", b"\ncomment exported again\nelement", 1))
    assert places() == {one: own, four: own}


def test_half_a_replay_is_never_linked(
    capsys: pytest.CaptureFixture[str], dataset: Path, prepared: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "out"
    words = ("bench", dataset, "--methods", "acp-edges", "--parts", prepared, "--out", out, "--jobs", "1")

    def broken_off(task: object, observers: list[Replay]) -> None:
        observers[0].path.write_bytes(b"half")
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr("acp_lab.bench.runner.watch", broken_off)
        assert run(capsys, *words).status != 0
    assert not list((out / "replays").iterdir())
    assert run(capsys, *words).status == 0
    (replay,) = (out / "replays").iterdir()
    assert check_replay(replay).is_complete
    # Nor one that a killed process left, which could not tidy up.
    whole = replay.read_bytes()
    replay.unlink()
    replay.with_name(f"{replay.stem}.unfinished.rrd").write_bytes(whole[: len(whole) // 2])
    assert run(capsys, *words).status == 0
    assert list((out / "replays").iterdir()) == [replay]
    assert check_replay(replay).is_complete


def test_changed_data_is_run_again(
    capsys: pytest.CaptureFixture[str], dataset: Path, prepared: Path, tmp_path: Path
) -> None:
    words = ("bench", dataset, "--methods", "acp-edges", "--parts", prepared, "--out", tmp_path / "out", "--jobs", "1")
    assert run(capsys, *words).status == 0
    (before,) = rows_of(tmp_path / "out")
    # From the third frame on the boxes stand elsewhere than where they are said to be.
    for name in ("000003.png", "000005.png", "000006.png"):
        path = dataset / "test" / "000001" / "rgb" / name
        cv2.imwrite(str(path), np.roll(cv2.imread(str(path)), 4, axis=1))
    assert run(capsys, *words).status == 0
    (images,) = rows_of(tmp_path / "out")
    assert float(images["trans_mm_median"]) > float(before["trans_mm_median"]) + 1.0
    edit_json(dataset / "test" / "000001" / "scene_gt.json", lambda values: values.pop("6"))
    assert run(capsys, *words).status == 0
    (truth,) = rows_of(tmp_path / "out")
    assert int(truth["frames"]) < int(images["frames"])


def test_two_instances_of_one_part_are_two_sequences(
    capsys: pytest.CaptureFixture[str], dataset: Path, prepared: Path, tmp_path: Path
) -> None:
    # Both boxes are the same part now; every second image tells them in the other order.
    truth = {}
    for number, frame_id in enumerate(FRAME_IDS):
        both = [pose_entry(true_pose(frame_id, shown), 1) for shown in (1, 4)]
        truth[str(frame_id)] = both[:: 1 if number % 2 else -1]
    write_json(dataset / "test" / "000001" / "scene_gt.json", truth)
    words = ("bench", dataset, "--methods", "acp-edges", "--parts", prepared, "--out", tmp_path / "out", "--jobs", "1")
    assert run(capsys, *words).status == 0
    (row,) = rows_of(tmp_path / "out")
    assert (row["sequences"], row["lost_runs"]) == ("2", "0")
    places = []
    for name in ("data-1-1--acp-edges--step1--*.json", "data-1-1-1--acp-edges--step1--*.json"):
        (path,) = (tmp_path / "out" / "runs").glob(name)
        kept = json.loads(path.read_text())
        places.append(np.array(kept["poses"]).reshape(-1, 3, 4)[:, 0, 3])
    assert (places[0] > 20.0).all()
    assert (places[1] < -20.0).all()


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (("--results-from", "nowhere__data.csv"), "nowhere__data.csv"),
        (("--results-from", "Theirs__other.csv"), "Theirs__DATASET.csv"),
        (("--noise", "2;2"), "--noise 2;2"),
        (("--noise", "200,1"), "--noise 200,1"),
        (("--methods", "acp-paper,acp-paper-literal"), "paint in different frames"),
        (("--scheduler", "tcp://127.0.0.1:9"), "--scheduler tcp://127.0.0.1:9"),
        (("--scheduler", ""), "--scheduler '': is no address"),
        (("--scheduler", " "), "--scheduler '': is no address"),
    ],
)
def test_bad_usage(
    capsys: pytest.CaptureFixture[str], dataset: Path, prepared: Path, tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch, words: tuple[str, ...], expected: str,
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("acp_lab.bench.workers._CONNECT_S", 0.5)
    common = ("bench", dataset, "--methods", "acp-edges", "--parts", prepared, "--out", "out")
    assert_one_error(run(capsys, *common, *words), expected)
    assert not (tmp_path / "out" / "bench.csv").exists()


def test_a_data_set_without_truth_is_one_line(
    capsys: pytest.CaptureFixture[str], dataset: Path, prepared: Path, tmp_path: Path
) -> None:
    edit_json(dataset / "test" / "000001" / "scene_gt.json", lambda values: values.pop("0"))
    words = ("bench", dataset, "--methods", "acp-edges", "--parts", prepared, "--out", tmp_path / "out")
    assert_one_error(run(capsys, *words), "no first frame has truth")


def test_truth_of_the_first_frame_alone_is_told_before_parts_are_prepared(
    capsys: pytest.CaptureFixture[str], dataset: Path, tmp_path: Path
) -> None:
    truth = dataset / "test" / "000001" / "scene_gt.json"
    edit_json(truth, lambda poses: [poses.pop(str(frame_id)) for frame_id in FRAME_IDS[1:]])
    outcome = run(capsys, "bench", dataset, "--methods", "acp", "--out", tmp_path / "bench")
    assert_one_error(outcome, dataset, "no frame but the first has truth")
    assert not (tmp_path / "bench").exists()


@pytest.mark.parametrize("steps", ["5", "1,5"])
def test_steps_beyond_the_end_are_told_before_parts_are_prepared(
    capsys: pytest.CaptureFixture[str], dataset: Path, tmp_path: Path, steps: str
) -> None:
    words = ("bench", dataset, "--methods", "acp", "--out", tmp_path / "bench", "--steps", steps)
    told = "error: --steps 5: data has 5 images in its longest scene: give at most 4\n"
    assert_one_error(run(capsys, *words), told)
    assert not (tmp_path / "bench").exists()


def test_steps_that_leave_out_every_frame_with_truth(
    capsys: pytest.CaptureFixture[str], dataset: Path, prepared: Path, tmp_path: Path
) -> None:
    truth = dataset / "test" / "000001" / "scene_gt.json"
    edit_json(truth, lambda poses: [poses.pop(str(frame_id)) for frame_id in FRAME_IDS[2:]])
    words = ("bench", dataset, "--methods", "acp-edges", "--parts", prepared, "--out", tmp_path / "out", "--jobs", "1")
    told = "no frame that was tracked has truth but the first", "or give smaller --steps"
    assert_one_error(run(capsys, *words, "--steps", "2"), dataset, *told)


def test_a_name_that_is_a_method_and_a_file(
    capsys: pytest.CaptureFixture[str], dataset: Path, prepared: Path, tmp_path: Path
) -> None:
    words = ("bench", dataset, "--methods", "acp-edges", "--parts", prepared, "--out", tmp_path / "out", "--jobs", "1")
    assert run(capsys, *words).status == 0
    again = ("--results-from", tmp_path / "out" / "results" / "acp-edges__data.csv")
    assert_one_error(run(capsys, *words, *again), "acp-edges", "rename the file")


def test_outside_results_with_free_scores_that_lie_in_the_results_folder(
    capsys: pytest.CaptureFixture[str], dataset: Path, prepared: Path, tmp_path: Path
) -> None:
    """They are taken as they are, and stay as they are: with all their rows, and what their run was."""
    out = tmp_path / "out"
    words = ("bench", dataset, "--methods", "acp-edges", "--parts", prepared, "--out", out, "--jobs", "1")
    assert run(capsys, *words).status == 0
    lines = (out / "results" / "acp-edges__data.csv").read_text().splitlines()
    rows = [line.split(",") for line in lines[1:]]
    rows[0][3], rows[1][3] = "37.5", "-2"
    theirs, elsewhere = out / "results" / "Theirs__data.csv", tmp_path / "Others__data.csv"
    for path in (theirs, elsewhere):
        path.write_text("\n".join([lines[0], *map(",".join, rows)]) + "\n")
    write_json(out / "results" / "Theirs__data.run.json", {"version": 3})
    before = theirs.read_bytes()
    assert run(capsys, *words, "--results-from", theirs, "--results-from", elsewhere).status == 0
    assert {row["method"] for row in rows_of(out)} == {"acp-edges", "Theirs", "Others"}
    assert theirs.read_bytes() == before
    assert json.loads((out / "results" / "Theirs__data.run.json").read_text()) == {"version": 3}
    assert [row.score for row in read_results(out / "results" / "Others__data.csv")][:2] == [1.0, 0.0]


def test_a_part_of_another_mesh_in_the_folder(
    capsys: pytest.CaptureFixture[str], dataset: Path, prepared: Path, tmp_path: Path
) -> None:
    """The way out is named by the command that has it."""
    mesh = dataset / "models" / "obj_000001.ply"
    mesh.write_bytes(mesh.read_bytes().replace(b"\nelement", b"\ncomment exported again\nelement", 1))
    words = ("bench", dataset, "--methods", "acp-edges", "--parts", prepared, "--out", tmp_path / "out", "--jobs", "1")
    assert_one_error(run(capsys, *words), "--no-resume", "options of acp-lab prepare", "--parts")


def test_two_files_of_one_tracker(
    capsys: pytest.CaptureFixture[str], dataset: Path, prepared: Path, tmp_path: Path
) -> None:
    """As "Their_tracker" and "Their tracker" are called the same; without the check they would be two seeds of one."""
    out = tmp_path / "out"
    words = ("bench", dataset, "--methods", "acp-edges", "--parts", prepared, "--out", out, "--jobs", "1")
    assert run(capsys, *words).status == 0
    files = [tmp_path / "Their_tracker__data.csv", tmp_path / "Their tracker__data.csv"]
    for file in files:
        shutil.copy(out / "results" / "acp-edges__data.csv", file)
    given = [word for file in files for word in ("--results-from", file)]
    assert_one_error(run(capsys, *words, *given), "Their tracker on data/1/1 stands in two files")


def test_parts_whose_auto_encoder_paints_in_the_other_frame(
    capsys: pytest.CaptureFixture[str], dataset: Path, prepared: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nothing is prepared over what took minutes to train: the user is told what to do, in one line."""
    for name in ("obj_000001", "obj_000004"):
        painted(PreparedPart.load(prepared / "data" / name)).save(prepared / "data" / name)
        assert PreparedPart.load(prepared / "data" / name).autoencoder().frame == "prediction"
    monkeypatch.setattr("acp_lab.commands.prepare.prepare_parts", lambda *_, **__: pytest.fail("was prepared again"))
    words = ("bench", dataset, "--methods", "acp-paper", "--parts", prepared, "--out", tmp_path / "out", "--jobs", "1")
    assert_one_error(
        run(capsys, *words), f"--parts {prepared / 'data'}: ", "--painting-frame pose; or give another --parts"
    )
    assert not (tmp_path / "out" / "bench.csv").exists()


@pytest.mark.parametrize(
    ("noise", "count"), [((), 1), (("0,0",), 1), (("2,2",), 4), (("2,2", "2,2"), 4), (("2,2", "0,0", "5,5"), 7)]
)
def test_no_start_is_run_twice(tmp_path: Path, noise: tuple[str, ...], count: int) -> None:
    variants = BenchOptions((), "acp", tmp_path / "out", noise=noise, seeds=3).variants()
    assert len(variants) == len(set(variants)) == count


@pytest.mark.parametrize(("cores", "jobs"), [(3, 3), (256, 256), (1000, 256)])
def test_by_default_there_are_as_many_processes_as_cores_up_to_the_most(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, cores: int, jobs: int
) -> None:
    asked: list[BenchOptions] = []
    monkeypatch.setattr("acp_lab.commands.bench.run_bench", asked.append)
    monkeypatch.setattr("acp_lab.commands.machine.cores", lambda: cores)
    assert run(capsys, "bench").status == 0
    assert [options.jobs for options in asked] == [jobs]


def test_what_is_prepared_does_not_depend_on_the_order_of_methods() -> None:
    chosen = [METHODS[name] for name in ("region", "acp")]
    assert [generator_of(method) for method in chosen] == ["templates", "both"]
    assert RICHEST_FIRST.index("both") < RICHEST_FIRST.index("templates")
    assert {generator_of(method) for method in METHODS.values()} <= set(RICHEST_FIRST)


def test_parts_are_prepared_together_for_what_their_methods_ask(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[tuple[list[Path], PrepareOptions, Spread]] = []
    monkeypatch.setattr(
        "acp_lab.commands.prepare.prepare_parts",
        lambda meshes, out, options, spread: asked.append((meshes, options, spread)),
    )
    meshes = [Path("obj_000001.ply"), Path("obj_000004.ply")]
    monkeypatch.setattr(bench_parts, "_lacking", lambda *_: iter(meshes))
    spread = Spread(3)
    for name, frame in (("acp-paper", "pose"), ("acp-paper-literal", "prediction"), ("acp-paper-samples", "pose")):
        asked.clear()
        methods = [METHODS["region"], METHODS[name], METHODS["acp"]]
        bench_parts.prepare_missing(Path("data"), "test", Path("parts"), [], methods, spread)
        assert [options.generator for _, options, _ in asked] == ["both", "autoencoder", "templates"]
        assert asked[1][1].painting_frame == frame
        told = "Preparing 2 parts (both), which parts lacks: once, then kept ..."
        assert capsys.readouterr().out.splitlines()[0] == told
        assert all(found == meshes and how is spread for found, _, how in asked)
