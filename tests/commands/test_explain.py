"""`acp-lab explain`: from results and replays, for runs that lost the part and runs that did not, and bad input."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import cv2
import pytest
import trimesh

from acp_lab.cad.edges import sample_edges
from acp_lab.cad.part import Part
from acp_lab.cad.raycast import make_caster
from acp_lab.display.replay.recorder import Replay
from acp_lab.generator.templates import build_templates
from acp_lab.prepared_part import PreparedPart
from acp_lab.sample import sample_dataset
from acp_lab.sequences.results_csv import ResultRow, ResultsWriter
from acp_lab.tracking.sought import Sought, to_row
from tests.cli_runner import assert_one_error, run
from tests.commands.conftest import FRAME_IDS, OBJECT_IDS, true_pose
from tests.display.made_run import play
from tests.prepared_sample import sample_scene

LOSS = 12


@pytest.fixture
def results(tmp_path: Path) -> Path:
    """The sample's truth, until the part stays behind in frame LOSS: what a run that lost it writes."""
    path, scene = tmp_path / "results.csv", sample_scene()
    info = {
        "folder": str(tmp_path),
        "method": "acp",
        "options": {"dataset": str(sample_dataset()), "replay": "run.rrd"},
    }
    with ResultsWriter(path, info) as writer:
        for number, frame_id in enumerate(scene.frame_ids):
            pose = scene.truth(min(frame_id, scene.frame_ids[LOSS - 1]), 1)
            assert pose is not None
            writer.append(ResultRow(1, frame_id, 1, 0.55 if number < LOSS else 0.05, pose))
    return path


def test_a_loss_says_where_to_start_again(capsys: pytest.CaptureFixture[str], results: Path) -> None:
    outcome = run(capsys, "explain", results)
    assert (outcome.status, outcome.err) == (0, "")
    first, second, *_ = outcome.out.splitlines()
    assert (
        f"lost since frame {LOSS} (image {LOSS}) of 40, start again there: acp-lab track … --first-frame {LOSS}"
        in first
    )
    assert "a row of a results file, or for a video a POSE.json, which notebook 10 sets" in first
    assert second.startswith(f"Frame {LOSS} (image {LOSS}), object 1: weak, quality 0.05, 0.55 in the good frames")
    picture = results.with_name(f"results.frame{LOSS}.png")
    assert picture.read_bytes()[:4] == b"\x89PNG"
    assert str(picture) in outcome.out


def test_a_run_without_a_good_frame(capsys: pytest.CaptureFixture[str], results: Path) -> None:
    lines = results.read_text().splitlines()
    poor = [",".join([*line.split(",")[:3], "0.05", *line.split(",")[4:]]) for line in lines[1:]]
    results.write_text("\n".join([lines[0], *poor]) + "\n")
    outcome = run(capsys, "explain", results)
    assert (outcome.status, outcome.err) == (0, "")
    assert outcome.out.startswith("Object 1 was good in none of 40 frames.\n")


def test_where_a_lost_part_was_looked_for(capsys: pytest.CaptureFixture[str], results: Path) -> None:
    info, pose = results.with_name("results.run.json"), sample_scene().first_pose
    sought = [Sought(pose, 25.0, 80.0), Sought(None, 180.0, None, pose, 0.42)]
    rows = [to_row(1, LOSS + 2 + k, 1, one) for k, one in enumerate(sought)]
    info.write_text(json.dumps({**json.loads(info.read_text()), "searches": [*rows, {"scene_id": 1}, 7]}))
    outcome = run(capsys, "explain", results, "--frame", LOSS + 2)
    assert (outcome.status, outcome.err) == (0, "")
    verdict, search, frame, *_ = outcome.out.splitlines()
    assert f"lost since frame {LOSS}" in verdict
    assert search.startswith(f"Image {LOSS + 3}: searched in the whole image, from any side")
    assert "score 0.42" in search
    assert f"Lost since frame {LOSS + 1}; searched within 80 px of its last place, turned by up to 25 degrees" in frame
    assert "no hypothesis yet" in frame


def test_a_part_that_was_found_again(capsys: pytest.CaptureFixture[str], results: Path, tmp_path: Path) -> None:
    lines = results.read_text().splitlines()
    for number in range(LOSS + 4, 40):
        columns = lines[number + 1].split(",")
        lines[number + 1] = ",".join([*columns[:3], "0.9", *columns[4:]])
    results.write_text("\n".join(lines) + "\n")
    first = run(capsys, "explain", results).out.splitlines()[0]
    assert f"was lost from frame {LOSS} (image {LOSS}) on, and found again in frame {LOSS + 5}" in first


def test_a_part_that_was_lost_twice_is_lost(capsys: pytest.CaptureFixture[str], results: Path) -> None:
    lines = results.read_text().splitlines()
    for number in range(LOSS + 4, LOSS + 12):
        columns = lines[number + 1].split(",")
        lines[number + 1] = ",".join([*columns[:3], "0.9", *columns[4:]])
    results.write_text("\n".join(lines) + "\n")
    first = run(capsys, "explain", results).out.splitlines()[0]
    assert f"lost more than once, first from frame {LOSS} (image {LOSS}) on" in first
    assert f"is lost since frame {LOSS + 13}" in first


def test_a_frame_of_choice(capsys: pytest.CaptureFixture[str], results: Path, tmp_path: Path) -> None:
    outcome = run(capsys, "explain", results, "--frame", "5", "--out", tmp_path / "five.png")
    assert outcome.status == 0
    assert "Frame 5 (image 5), object 1: tracking" in outcome.out
    assert "ADD 0.0% of the diameter" in outcome.out
    assert (tmp_path / "five.png").is_file()


def test_poses_beside_the_part_are_told_where_the_quality_shows_none(
    capsys: pytest.CaptureFixture[str], results: Path
) -> None:
    """All frames keep the score of the good ones; those from LOSS on fall behind the part."""
    text = results.read_text().replace(",0.05,", ",0.55,")
    results.write_text(text)
    outcome = run(capsys, "explain", results)
    assert (outcome.status, outcome.err) == (0, "")
    assert "Object 1 was never lost in 40 frames." in outcome.out
    frame = int(outcome.out.partition("\nFrame ")[2].partition(" ")[0])
    assert LOSS < frame < 40
    assert "The tracked pose is beside the part. It is off by 1" in outcome.out
    assert "% of the edges in view are found in the image at the true pose" in outcome.out
    assert "Nothing stands out" not in outcome.out


def test_a_replay_is_explained_by_the_results_beside_it(capsys: pytest.CaptureFixture[str], results: Path) -> None:
    play([Replay(results.with_name("run.rrd")), Replay(results.with_name("other.rrd"))])
    assert f"lost since frame {LOSS}" in run(capsys, "explain", results.with_name("run.rrd")).out
    outcome = run(capsys, "explain", results.with_name("other.rrd"))
    assert_one_error(outcome, "other.rrd", "results.csv", "made in Python", "acp.explain(run, frame)")


def test_a_replay_that_two_runs_wrote_is_none_of_the_first_one_s(
    capsys: pytest.CaptureFixture[str], results: Path, tmp_path: Path
) -> None:
    """The first one by name was explained, whichever wrote it last."""
    info, replay = results.with_name("results.run.json"), results.with_name("run.rrd")
    told = json.loads(info.read_text())
    play([Replay(replay)])
    shutil.copy(results, tmp_path / "again.csv")
    other = tmp_path / "again.run.json"
    other.write_text(json.dumps(told))
    outcome = run(capsys, "explain", replay)
    assert_one_error(outcome, "run.rrd", "more than one run", "again.csv and results.csv", "give the results file")
    assert run(capsys, "explain", results).status == 0
    # One whose replay of the same name is in another folder is no rival; in a folder that was moved nobody knows.
    other.write_text(json.dumps({**told, "options": {**told["options"], "replay": "elsewhere/run.rrd"}}))
    assert f"lost since frame {LOSS}" in run(capsys, "explain", replay).out
    for path in (info, other):
        path.write_text(json.dumps({**json.loads(path.read_text()), "folder": str(tmp_path / "gone")}))
    assert_one_error(run(capsys, "explain", replay), "run.rrd", "again.csv and results.csv")


def test_content_counts_not_the_name(capsys: pytest.CaptureFixture[str], results: Path) -> None:
    info = results.with_name("results.run.json")
    info.write_text(info.read_text().replace("run.rrd", "run.replay"))
    play([Replay(results.with_name("run.rrd"))])
    results.with_name("run.rrd").rename(results.with_name("run.replay"))
    assert f"lost since frame {LOSS}" in run(capsys, "explain", results.with_name("run.replay")).out
    results.rename(results.with_name("results.rrd"))
    outcome = run(capsys, "explain", results.with_name("results.rrd"), "--dataset", sample_dataset())
    assert f"lost since frame {LOSS}" in outcome.out


def test_results_whose_data_set_is_not_told(capsys: pytest.CaptureFixture[str], results: Path) -> None:
    results.with_name("results.run.json").unlink()
    assert_one_error(run(capsys, "explain", results), "results.csv", "--dataset", "acp.explain(run, frame)")
    outcome = run(capsys, "explain", results, "--dataset", sample_dataset())
    assert outcome.status == 0
    assert f"lost since frame {LOSS}" in outcome.out


def test_results_of_images_that_the_data_set_lacks(
    capsys: pytest.CaptureFixture[str], results: Path, tmp_path: Path
) -> None:
    """A frame without an image was explained without one: nothing stood out."""
    data = shutil.copytree(sample_dataset(), tmp_path / "data")
    for path in sorted((data / "test" / "000001" / "rgb").iterdir())[6:]:
        path.unlink()
    outcome = run(capsys, "explain", results, "--dataset", data, "--frame", "5")
    assert_one_error(outcome, "results.csv", "data", "has no image 6, of which there are results", "--dataset DIR")
    # Results of fewer images than there are, such as a run with --max-frames leaves.
    lines = results.read_text().splitlines()
    results.write_text("\n".join([lines[0], *lines[3:6]]) + "\n")
    outcome = run(capsys, "explain", results, "--dataset", data, "--frame", "2")
    assert (outcome.status, outcome.err) == (0, "")
    assert "Frame 2 (image 4)" in outcome.out


def test_a_video_whose_mesh_is_in_metres(capsys: pytest.CaptureFixture[str], results: Path, tmp_path: Path) -> None:
    """The prepared part knows the unit; the command has no option for it."""
    scene, mesh = sample_scene(), tmp_path / "bracket.stl"
    part = scene.dataset.part(1)
    trimesh.Trimesh(part.vertices / 1000.0, part.faces, process=False).export(mesh)
    in_metres = Part.from_file(mesh, unit="m")
    edges = sample_edges(in_metres)
    templates = build_templates(in_metres, edges, make_caster(in_metres), subdivisions=1)
    PreparedPart(in_metres, edges, templates=templates).save(tmp_path / "parts" / "bracket")
    camera = scene.camera(0)
    numbers = {name: getattr(camera, name) for name in ("width", "height", "fx", "fy", "cx", "cy")}
    (tmp_path / "CAMERA.json").write_text(json.dumps({**numbers, "dist": [0.0] * 5}))
    tracked = {"video": str(scene.folder / "rgb"), "mesh": mesh.name, "camera": "CAMERA.json", "parts": "parts"}
    info = results.with_name("results.run.json")
    info.write_text(json.dumps({**json.loads(info.read_text()), "options": tracked}))
    outcome = run(capsys, "explain", results)
    assert (outcome.status, outcome.err) == (0, "")
    assert f"lost since frame {LOSS}" in outcome.out
    shutil.rmtree(tmp_path / "parts")
    assert_one_error(run(capsys, "explain", results), "bracket.stl", "metres")


def test_the_limits_of_the_states_are_the_run_s_own(capsys: pytest.CaptureFixture[str], results: Path) -> None:
    info = results.with_name("results.run.json")
    told = json.loads(info.read_text())
    info.write_text(json.dumps({**told, "configuration": {"states": {"weak_below": 0.02, "lost_below": 0.01}}}))
    assert "never lost in 40 frames" in run(capsys, "explain", results).out


def test_bad_input(capsys: pytest.CaptureFixture[str], results: Path, tmp_path: Path) -> None:
    assert_one_error(run(capsys, "explain", results, "--frame", "40"), "no frame 40", "40")
    assert_one_error(run(capsys, "explain", results, "--scene", "2"), "scene 2")
    assert_one_error(run(capsys, "explain", results, "--object", "7"), "object 7")
    assert_one_error(run(capsys, "explain", results, "--out", results), "--out", "PNG")
    assert_one_error(run(capsys, "explain", tmp_path / "none.csv"), "none.csv")
    assert_one_error(run(capsys, "explain", tmp_path / "none.rrd"), "none.rrd")


def test_an_image_of_the_run_is_not_replaced(capsys: pytest.CaptureFixture[str], results: Path, tmp_path: Path) -> None:
    data = shutil.copytree(sample_dataset(), tmp_path / "data")
    first = next(path for path in sorted((data / "test" / "000001" / "rgb").iterdir()))
    image = first.with_suffix(".png")
    pixels = cv2.imread(str(first))
    first.unlink()
    assert cv2.imwrite(str(image), pixels)
    before = image.read_bytes()
    assert_one_error(run(capsys, "explain", results, "--dataset", data, "--out", image), image, "an image of the run")
    assert image.read_bytes() == before
    (tmp_path / "notes.png").write_text("my notes")
    assert_one_error(run(capsys, "explain", results, "--out", tmp_path / "notes.png"), "notes.png", "not a picture")


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        ({"options": [1]}, "options is no JSON object"),
        ({"options": {"video": "v.mp4", "mesh": "m.ply"}}, "no camera"),
        ({"configuration": [1]}, "configuration is no JSON object"),
        ({"configuration": {"states": [1]}}, "states is no JSON object"),
        ({"configuration": {"states": {"weak_below": "half"}}}, "no number"),
    ],
)
def test_run_information_of_another_form(
    capsys: pytest.CaptureFixture[str], results: Path, values: dict[str, object], expected: str
) -> None:
    info = results.with_name("results.run.json")
    info.write_text(json.dumps({**json.loads(info.read_text()), **values}))
    assert_one_error(run(capsys, "explain", results), "results.run.json", expected, "--dataset")


def test_run_information_that_is_not_needed_may_be_of_any_form(
    capsys: pytest.CaptureFixture[str], results: Path
) -> None:
    info = results.with_name("results.run.json")
    info.write_text(json.dumps({**json.loads(info.read_text()), "searches": 7, "method": [1]}))
    assert run(capsys, "explain", results).status == 0
    results.with_name("a.run.json").write_text('{"options": [1]}')
    play([Replay(results.with_name("run.rrd"))])
    assert run(capsys, "explain", results.with_name("run.rrd")).status == 0


def test_each_object_and_scene_has_a_picture_of_its_own(
    capsys: pytest.CaptureFixture[str], dataset: Path, tmp_path: Path
) -> None:
    path = tmp_path / "run.v1"
    with ResultsWriter(path, {"folder": str(tmp_path), "options": {"dataset": str(dataset)}}) as writer:
        for frame_id in FRAME_IDS:
            for object_id in OBJECT_IDS:
                writer.append(ResultRow(1, frame_id, object_id, 0.55, true_pose(frame_id, object_id)))
    for object_id in OBJECT_IDS:
        assert run(capsys, "explain", path, "--object", object_id, "--frame", 2).status == 0
        assert (tmp_path / f"run.v1.object{object_id}.frame2.png").is_file()


def test_a_live_camera_cannot_be_looked_at_again(capsys: pytest.CaptureFixture[str], results: Path) -> None:
    info = results.with_name("results.run.json")
    options = {"video": "0", "mesh": "part.ply", "camera": "CAMERA.json"}
    info.write_text(json.dumps({**json.loads(info.read_text()), "options": options}))
    assert_one_error(run(capsys, "explain", results), "live camera 0 was tracked, whose images are gone")
