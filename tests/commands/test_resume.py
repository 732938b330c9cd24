"""`acp-lab track --resume`: goes on where a stopped run stopped, with the same inputs only."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from acp_lab.commands import auto_start, track_run
from acp_lab.prepared_part.integrity import checksum, write_header
from acp_lab.sequences import read_results
from acp_lab.sequences.results_csv import ResultsWriter, rows_with_ends
from tests.cli_runner import Outcome, assert_one_error, run
from tests.commands.conftest import CAMERA, FRAME_IDS, OBJECT_IDS, edit_json, true_pose, write_dataset
from tests.sequences.timed_video import timed_video
from tests.sequences.tiny_dataset import write_json

PER_FRAME = len(OBJECT_IDS)


def track(capsys: pytest.CaptureFixture[str], dataset: Path, parts: Path, out: Path, *words: str | Path) -> Outcome:
    return run(capsys, "track", dataset, "--parts", parts, "--out", out, *words)


@pytest.fixture
def whole(capsys: pytest.CaptureFixture[str], dataset: Path, parts: Path, tmp_path: Path) -> Path:
    """The results of a run that was not stopped."""
    assert track(capsys, dataset, parts, tmp_path / "whole.csv").status == 0
    return tmp_path / "whole.csv"


def cut(whole: Path, out: Path, rows: int, torn: bytes = b"") -> Path:
    """As if the run had been killed after so many rows, in the middle of the next."""
    ends = [end for _, end in rows_with_ends(whole)]
    out.write_bytes(whole.read_bytes()[: ends[rows - 1]] + torn)
    shutil.copy(whole.with_suffix(".run.json"), out.with_suffix(".run.json"))
    return out


def keys(path: Path) -> list[tuple[int, int, int]]:
    return [row.key for row in read_results(path)]


@pytest.mark.parametrize(("rows", "torn"), [(2, b""), (4, b"1,3,1,0.5,1 0"), (5, b""), (7, b"1"), (9, b"")])
def test_it_goes_on_after_the_last_whole_frame(
    capsys: pytest.CaptureFixture[str], dataset: Path, parts: Path, tmp_path: Path, whole: Path, rows: int, torn: bytes
) -> None:
    out = cut(whole, tmp_path / "cut.csv", rows, torn)
    kept = rows // PER_FRAME * PER_FRAME
    outcome = track(capsys, dataset, parts, out, "--resume")
    assert outcome.status == 0, outcome
    assert f"goes on behind scene 1, image {FRAME_IDS[kept // PER_FRAME - 1]}" in outcome.err
    assert keys(out) == keys(whole)
    end = rows_with_ends(whole)[kept - 1][1]
    assert out.read_bytes()[:end] == whole.read_bytes()[:end]  # what was there is not touched
    for row, other in zip(read_results(out), read_results(whole), strict=True):
        assert np.linalg.norm(row.cam_T_obj[:3, 3] - other.cam_T_obj[:3, 3]) < 2.0
    assert json.loads(out.with_suffix(".run.json").read_text())["complete"] is True


def test_the_same_command_from_the_start_on(
    capsys: pytest.CaptureFixture[str], dataset: Path, parts: Path, tmp_path: Path, whole: Path
) -> None:
    """Nothing there, a header alone, all there: a loop may always say --resume."""
    out = tmp_path / "results.csv"
    assert track(capsys, dataset, parts, out, "--resume").status == 0
    assert keys(out) == keys(whole)
    out.write_bytes(out.read_bytes().partition(b"\n")[0] + b"\n")
    assert track(capsys, dataset, parts, out, "--resume").status == 0
    assert keys(out) == keys(whole)
    before = out.read_bytes()
    outcome = track(capsys, dataset, parts, out, "--resume")
    assert outcome.status == 0
    assert "nothing is tracked" in outcome.err
    assert out.read_bytes() == before


def test_frames_without_sight_are_tracked_again(
    capsys: pytest.CaptureFixture[str], dataset: Path, parts: Path, tmp_path: Path
) -> None:
    """A tracker cannot start in a frame that was not seen."""
    (dataset / "test" / "000001" / "rgb" / "000003.png").write_bytes(b"")
    assert track(capsys, dataset, parts, tmp_path / "whole.csv").status == 0
    out = cut(tmp_path / "whole.csv", tmp_path / "cut.csv", 3 * PER_FRAME)
    outcome = track(capsys, dataset, parts, out, "--resume")
    assert outcome.status == 0
    assert "image 2, from its pose; tracks 1 frame again in which an object was lost or not seen" in outcome.err
    assert keys(out) == keys(tmp_path / "whole.csv")


def test_the_pose_of_a_lost_part_is_no_start(
    capsys: pytest.CaptureFixture[str], dataset: Path, parts: Path, tmp_path: Path, whole: Path
) -> None:
    """Its last rows have a score, though a low one: the tracker would take their pose for one that was given."""
    lines = whole.read_text().splitlines(keepends=True)
    for line in (1 + 2 * PER_FRAME, 1 + 3 * PER_FRAME):  # of the first object, in the last two frames that are kept
        scene_id, im_id, object_id, _, *others = lines[line].split(",")
        lines[line] = ",".join((scene_id, im_id, object_id, "0.070000", *others))
    whole.write_text("".join(lines))
    out = cut(whole, tmp_path / "cut.csv", 4 * PER_FRAME)
    outcome = track(capsys, dataset, parts, out, "--resume")
    assert outcome.status == 0
    assert f"image {FRAME_IDS[1]}, from its pose; tracks 2 frames again" in outcome.err
    assert keys(out) == keys(whole)
    assert all(row.score > 0.5 for row in read_results(out))


def test_what_the_run_before_saw_is_not_forgotten(
    capsys: pytest.CaptureFixture[str], dataset: Path, parts: Path, tmp_path: Path
) -> None:
    """The summary counts its frames too, and names the frame that it lost first; where it searched stays."""
    for im_id in FRAME_IDS[1:3]:
        (dataset / "test" / "000001" / "rgb" / f"{im_id:06d}.png").write_bytes(b"")
    told = f"5 frames of 320 x 240 .*; first lost from image {FRAME_IDS[1]} on; 2 not readable"
    whole = track(capsys, dataset, parts, tmp_path / "whole.csv")
    assert len(re.findall(told, whole.out)) == PER_FRAME, whole.out
    out = cut(tmp_path / "whole.csv", tmp_path / "cut.csv", 4 * PER_FRAME)
    searches = [{"scene_id": 1, "im_id": im_id, "score": 0.5} for im_id in (FRAME_IDS[2], FRAME_IDS[4])]
    edit_json(out.with_suffix(".run.json"), lambda info: info.update(searches=searches))
    outcome = track(capsys, dataset, parts, out, "--resume")
    assert outcome.status == 0, outcome
    assert f"image {FRAME_IDS[3]}" in outcome.err
    assert len(re.findall(told, outcome.out)) == PER_FRAME, outcome.out
    info = json.loads(out.with_suffix(".run.json").read_text())
    assert info["searches"] == searches[:1]
    assert info["unreadable"] == [{"scene_id": 1, "im_id": im_id} for im_id in FRAME_IDS[1:3]]


def test_scenes_that_were_done_are_in_the_summary(
    capsys: pytest.CaptureFixture[str], parts: Path, tmp_path: Path
) -> None:
    dataset = write_dataset(tmp_path / "two", scenes=(1, 7))
    assert track(capsys, dataset, parts, tmp_path / "whole.csv").status == 0
    out = cut(tmp_path / "whole.csv", tmp_path / "cut.csv", 5 * PER_FRAME)
    lines = track(capsys, dataset, parts, out, "--resume").out.splitlines()
    assert [line.partition(":")[0].partition(" (")[0] for line in lines[:4]] == [
        f"scene {scene_id}, object {object_id}" for scene_id in (1, 7) for object_id in OBJECT_IDS
    ]
    assert all(": 5 frames" in line for line in lines[:4])


def test_several_scenes_and_fewer_frames(capsys: pytest.CaptureFixture[str], parts: Path, tmp_path: Path) -> None:
    dataset = write_dataset(tmp_path / "two", scenes=(1, 7))
    words = ("--max-frames", "3")
    assert track(capsys, dataset, parts, tmp_path / "whole.csv", *words).status == 0
    for rows, told in ((3 * PER_FRAME, "scene 1 has its rows"), (4 * PER_FRAME, "scene 7, image 0")):
        out = cut(tmp_path / "whole.csv", tmp_path / "cut.csv", rows)
        outcome = track(capsys, dataset, parts, out, "--resume", *words)
        assert outcome.status == 0, outcome
        assert told in outcome.err
        assert keys(out) == keys(tmp_path / "whole.csv")


@pytest.mark.parametrize(
    ("before", "now"),
    [
        (("--max-frames", "3"), ("--max-frames", "5")),
        (("--max-frames", "3"), ()),
    ],
)
def test_a_scene_that_ends_too_early_is_refused(
    capsys: pytest.CaptureFixture[str], parts: Path, tmp_path: Path, before: tuple[str, ...], now: tuple[str, ...]
) -> None:
    """Its rest would be tracked from its first frame on, behind the other scene: rows that nobody can read."""
    dataset = write_dataset(tmp_path / "two", scenes=(1, 3), object_ids=(1,))
    out = tmp_path / "results.csv"
    assert track(capsys, dataset, parts, out, *before).status == 0
    rows = out.read_bytes()
    outcome = track(capsys, dataset, parts, out, "--resume", *now)
    assert_one_error(outcome, "results.csv", "scene 1 ends after 3 frames", "--max-frames", "run without --resume")
    assert out.read_bytes() == rows


def test_scenes_in_another_order(capsys: pytest.CaptureFixture[str], parts: Path, tmp_path: Path) -> None:
    """The scene that was begun goes on first, so that the file can be cut off and resumed once more."""
    dataset = write_dataset(tmp_path / "two", scenes=(1, 3), object_ids=(1,))
    assert track(capsys, dataset, parts, tmp_path / "whole.csv", "--scene", "3", "--scene", "1").status == 0
    out, other_order = cut(tmp_path / "whole.csv", tmp_path / "cut.csv", 2), ("--scene", "1", "--scene", "3")
    assert track(capsys, dataset, parts, out, "--resume", *other_order).status == 0
    assert keys(out) == keys(tmp_path / "whole.csv")
    again = cut(out, tmp_path / "again.csv", 3)
    assert track(capsys, dataset, parts, again, "--resume", *other_order).status == 0
    assert keys(again) == keys(out)


def test_objects_that_start_in_different_images(
    capsys: pytest.CaptureFixture[str], dataset: Path, parts: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As --init auto finds them: such a run is refused for what it is, not for rows that would be wrong."""
    found = [auto_start.FoundStart(im_id, {obj: true_pose(im_id, obj)}) for im_id, obj in ((0, 1), (3, 4))]
    monkeypatch.setattr(auto_start, "find_starts", lambda sequence, models: (found, ""))
    out, words = tmp_path / "results.csv", ("--init", "auto", "--resume")
    assert track(capsys, dataset, parts, out, *words).status == 0
    rows = out.read_bytes()
    outcome = track(capsys, dataset, parts, out, *words)
    assert_one_error(outcome, "in scene 1, object 1 and object 4 start in different images", "run without --resume")
    assert out.read_bytes() == rows


def test_one_that_is_not_found_costs_the_others_nothing(
    capsys: pytest.CaptureFixture[str], dataset: Path, parts: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Unless it was asked for by its id, or nothing else is found."""
    lacks = "--init auto: object 4 is not found in the first 5 frames"

    def find(sequence: object, models: Mapping[int, object]) -> tuple[list[auto_start.FoundStart], str]:
        poses = {object_id: true_pose(0, object_id) for object_id in models if object_id == 1}
        return [auto_start.FoundStart(0, poses)] if poses else [], lacks if 4 in models else ""

    monkeypatch.setattr(auto_start, "find_starts", find)
    out = tmp_path / "results.csv"
    outcome = track(capsys, dataset, parts, out, "--init", "auto")
    assert outcome.status == 0
    assert f"warning: {lacks}; it is left out" in outcome.err
    assert [object_id for _, _, object_id in keys(out)] == [1] * len(FRAME_IDS)
    assert_one_error(track(capsys, dataset, parts, out, "--init", "auto", "--object", "4"), lacks)
    assert_one_error(track(capsys, dataset, parts, out, "--init", "auto", "--object", "1", "--object", "4"), lacks)


def test_a_video(capsys: pytest.CaptureFixture[str], dataset: Path, parts: Path, tmp_path: Path) -> None:
    CAMERA.to_json(tmp_path / "camera.json")
    pose = true_pose(0)
    entry = {"cam_R_m2c": pose[:3, :3].ravel().tolist(), "cam_t_m2c": pose[:3, 3].tolist()}
    write_json(tmp_path / "pose.json", entry)
    words = ["track", "--video", dataset / "test" / "000001" / "rgb", "--camera", tmp_path / "camera.json"]
    words += ["--mesh", dataset / "models" / "obj_000001.ply", "--init", tmp_path / "pose.json", "--parts", parts]
    assert run(capsys, *words, "--out", tmp_path / "whole.csv").status == 0
    out = cut(tmp_path / "whole.csv", tmp_path / "cut.csv", 2)
    assert run(capsys, *words, "--out", out, "--resume").status == 0
    assert keys(out) == keys(tmp_path / "whole.csv")
    CAMERA.to_json(tmp_path / "camera.json")
    edit_json(tmp_path / "camera.json", lambda camera: camera.update(fx=401.0))
    before = cut(tmp_path / "whole.csv", out, 2).read_bytes()
    assert_one_error(run(capsys, *words, "--out", out, "--resume"), "its images or camera", "without --resume")
    assert out.read_bytes() == before


def test_a_video_whose_frames_come_at_uneven_times(
    capsys: pytest.CaptureFixture[str], dataset: Path, parts: Path, tmp_path: Path
) -> None:
    """Its header announces another number of frames, which must neither be waited for nor be a limit."""
    files = sorted((dataset / "test" / "000001" / "rgb").iterdir())
    images = [cv2.imread(str(path))[..., ::-1].copy() for path in files] * 2
    CAMERA.to_json(tmp_path / "camera.json")
    pose = true_pose(0)
    entry = {"cam_R_m2c": pose[:3, :3].ravel().tolist(), "cam_t_m2c": pose[:3, 3].tolist()}
    write_json(tmp_path / "pose.json", entry)
    for name, step_ms in (("slow", 100), ("fast", 16)):
        video = timed_video(tmp_path / f"{name}.mkv", [step_ms * i for i in range(len(images))], images)
        words = ["track", "--video", video, "--camera", tmp_path / "camera.json", "--init", tmp_path / "pose.json"]
        words += ["--mesh", dataset / "models" / "obj_000001.ply", "--parts", parts]
        out = tmp_path / f"{name}.csv"
        assert run(capsys, *words, "--out", out).status == 0
        rows = out.read_bytes()
        assert [key[1] for key in keys(out)] == list(range(len(images)))
        outcome = run(capsys, *words, "--out", out, "--resume")
        assert outcome.status == 0
        assert "all frames have their rows already" in outcome.out + outcome.err
        assert out.read_bytes() == rows


def edit_truth(dataset: Path, parts: Path) -> None:
    edit_json(
        dataset / "test" / "000001" / "scene_gt.json", lambda truth: truth["0"][1].update(cam_t_m2c=[35.0, 1.0, 260.0])
    )


def remove_image(dataset: Path, parts: Path) -> None:
    (dataset / "test" / "000001" / "rgb" / "000006.png").unlink()


def other_image(dataset: Path, parts: Path) -> None:
    folder = dataset / "test" / "000001" / "rgb"
    shutil.copy(folder / "000000.png", folder / "000006.png")


def say_other_pixels(dataset: Path, parts: Path) -> None:
    write_json(dataset / "test" / "000001" / "rgb" / "pixels.json", {"bits": 12})


def prepare_again(dataset: Path, parts: Path) -> None:
    from acp_lab.cad.part import Part
    from acp_lab.preparation import prepare
    from acp_lab.prepared_part import PrepareOptions

    part = Part.from_file(dataset / "models" / "obj_000004.ply")
    prepare(part, PrepareOptions(generator="templates", edge_break_mm=0.5), out=parts)


@pytest.mark.parametrize(
    ("change", "words", "told"),
    [
        (edit_truth, (), "scene 1, the start pose of object 4 differs"),
        (remove_image, (), "scene 1, its images or camera differs"),
        (other_image, (), "scene 1, its images or camera differs"),
        (say_other_pixels, (), "scene 1, its images or camera differs"),
        (prepare_again, (), "the prepared part obj_000004 differs"),
        (None, ("--method", "acp-edges"), "the method differs"),
        (None, ("--object", "1"), "object 4 differs"),
        (None, ("--init-noise-mm", "1"), "the start pose of object"),
    ],
)
def test_other_inputs_are_refused(
    capsys: pytest.CaptureFixture[str],
    dataset: Path,
    parts: Path,
    tmp_path: Path,
    whole: Path,
    change,  # type: ignore[no-untyped-def]
    words: tuple[str, ...],
    told: str,
) -> None:
    out = cut(whole, tmp_path / "cut.csv", 4)
    before = out.read_bytes()
    if change is not None:
        change(dataset, parts)
    outcome = track(capsys, dataset, parts, out, "--resume", *words)
    assert_one_error(outcome, told, "give --out another name, or run without --resume, which replaces these rows")
    assert out.read_bytes() == before


def ask_for_more(dataset: Path, parts: Path) -> None:
    """The networks of no region take no time, but stand among the options; other times come by themselves."""
    for folder in parts.iterdir():
        header = json.loads((folder / "part.json").read_text())
        header["options"]["learned"] = header["options"]["templates"] | {"generator": "learned"}
        header["cpu_s"]["edges"] += 1.0
        write_header(folder, header, {path.name: path.read_bytes() for path in folder.glob("*.safetensors")})


def tell_less(run_info: dict[str, Any], parts: Path) -> None:
    """As earlier versions did: the whole part.json, and nothing of whether the start was found."""
    inputs = {name: value for name, value in run_info["inputs"].items() if not name.endswith("was found")}
    for folder in parts.iterdir():
        inputs[f"the prepared part {folder.name}"] = checksum((folder / "part.json").read_bytes())
    run_info["inputs"] = inputs


def test_a_part_that_was_asked_for_otherwise_is_the_same(
    capsys: pytest.CaptureFixture[str], dataset: Path, parts: Path, tmp_path: Path, whole: Path
) -> None:
    out = cut(whole, tmp_path / "cut.csv", 4)
    ask_for_more(dataset, parts)
    assert track(capsys, dataset, parts, out, "--resume").status == 0
    assert keys(out) == keys(whole)


def test_a_run_of_an_earlier_version_goes_on(
    capsys: pytest.CaptureFixture[str], dataset: Path, parts: Path, tmp_path: Path, whole: Path
) -> None:
    out = cut(whole, tmp_path / "cut.csv", 4)
    edit_json(out.with_suffix(".run.json"), lambda info: tell_less(info, parts))
    assert track(capsys, dataset, parts, out, "--resume").status == 0
    assert keys(out) == keys(whole)
    ask_for_more(dataset, parts)
    out = cut(whole, tmp_path / "other.csv", 4)
    edit_json(out.with_suffix(".run.json"), lambda info: tell_less(info, parts))
    prepare_again(dataset, parts)
    assert_one_error(track(capsys, dataset, parts, out, "--resume"), "the prepared part obj_000004 differs")


def test_a_start_that_is_said_to_be_found_is_another(
    capsys: pytest.CaptureFixture[str], dataset: Path, parts: Path, tmp_path: Path, whole: Path
) -> None:
    """Its pose is the same, and the first frame another."""
    first = tmp_path / "start.csv"
    rows = read_results(whole)[:PER_FRAME]
    for score in (1.0, 0.9):
        with ResultsWriter(first) as starts:
            for row in rows:
                starts.append(replace(row, score=score))
        out = tmp_path / f"{score}.csv"
        assert track(capsys, dataset, parts, out, "--init", first, "--max-frames", "2").status == 0
    outcome = track(capsys, dataset, parts, tmp_path / "1.0.csv", "--init", first, "--resume")
    assert_one_error(outcome, "scene 1, the start pose of object 1, whether it was found differs")
    assert track(capsys, dataset, parts, tmp_path / "0.9.csv", "--init", first, "--resume").status == 0


def test_results_without_their_run_are_refused(
    capsys: pytest.CaptureFixture[str], dataset: Path, parts: Path, tmp_path: Path, whole: Path
) -> None:
    out = cut(whole, tmp_path / "cut.csv", 4)
    edit_json(out.with_suffix(".run.json"), lambda info: info.pop("inputs"))
    assert_one_error(track(capsys, dataset, parts, out, "--resume"), "cut.run.json", "without --resume")
    out.with_suffix(".run.json").unlink()
    assert_one_error(track(capsys, dataset, parts, out, "--resume"), "cut.run.json", "without --resume")
    out.write_text("scene_id,im_id,obj_id,score,R,t,time\nnonsense\n")
    assert_one_error(track(capsys, dataset, parts, out, "--resume"), "cut.csv: line 2")


def test_an_older_replay_is_not_replaced(
    capsys: pytest.CaptureFixture[str], dataset: Path, parts: Path, tmp_path: Path, whole: Path
) -> None:
    out = cut(whole, tmp_path / "cut.csv", 4)
    (tmp_path / "run.rrd").write_bytes(b"RRF2 of the frames before")
    outcome = track(capsys, dataset, parts, out, "--resume", "--replay", tmp_path / "run.rrd")
    assert_one_error(outcome, "run.rrd", "another name")
    assert track(capsys, dataset, parts, out, "--resume", "--replay", tmp_path / "rest.rrd").status == 0
    assert (tmp_path / "rest.rrd").stat().st_size > 10_000


def test_two_runs_into_one_file(
    capsys: pytest.CaptureFixture[str],
    dataset: Path,
    parts: Path,
    tmp_path: Path,
    whole: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The second is refused in one line while the first one writes, and tears nothing."""
    out, second = tmp_path / "results.csv", []
    really = track_run.SummaryObserver.on_frame

    def once(self, frame, results) -> None:  # type: ignore[no-untyped-def]
        really(self, frame, results)
        if frame.index == 3 and not second:
            second.append(None)
            second[0] = track(capsys, dataset, parts, out)

    monkeypatch.setattr(track_run.SummaryObserver, "on_frame", once)
    assert track(capsys, dataset, parts, out).status == 0
    assert_one_error(second[0], "results.csv", "another acp-lab is writing these results")
    assert keys(out) == keys(whole)


def test_objects_that_come_later_are_looked_for(
    capsys: pytest.CaptureFixture[str], dataset: Path, parts: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The truth of the first image names object 1 alone."""
    edit_json(dataset / "test" / "000001" / "scene_gt.json", lambda truth: truth["0"].pop())
    asked = list[set[int]]()

    def find(sequence: object, models: Mapping[int, object]) -> tuple[list[auto_start.FoundStart], str]:
        asked.append(set(models))
        return [auto_start.FoundStart(3, {object_id: true_pose(3, object_id) for object_id in models})], ""

    monkeypatch.setattr(auto_start, "find_starts", find)
    out = tmp_path / "results.csv"
    for words in ((), ("--object", "4"), ("--first-frame", "3")):
        assert track(capsys, dataset, parts, out, "--init", "auto", *words).status == 0
    assert asked == [{1, 4}, {4}, {1, 4}]
    outcome = track(capsys, dataset, parts, out, "--init", "auto", "--object", "9")
    assert_one_error(outcome, "--object 9: no truth of the images that --init auto looks at names it", "there are 1, 4")
