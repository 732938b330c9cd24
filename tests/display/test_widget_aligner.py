"""The aligner: a hand drags, snap finishes, the file reads back."""

from __future__ import annotations

import itertools
import threading
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import traitlets

from acp_lab.control_points.view_regions import REGION_NAMES
from acp_lab.display.widgets import pose_aligner
from acp_lab.display.widgets.controls import close_with_parts
from acp_lab.display.widgets.find_panel import LOOKING
from acp_lab.display.widgets.pose_aligner import CLICK, DRAG, PoseAligner
from acp_lab.display.widgets.pose_origin import Origin
from acp_lab.errors import InputFileError
from acp_lab.evaluation import add_mm
from acp_lab.geometry.pose import make_pose, rotation_angle_deg, so3_exp, transform
from acp_lab.sequences.frame import Frame
from acp_lab.sequences.json_file import read_pose, was_found
from acp_lab.tracking.find import Detection, Finder
from acp_lab.tracking.snap import SnapResult
from tests.display.open_widgets import open_widgets
from tests.display.scripted_hand import drag, drag_onto_the_part, view_from_beside
from tests.prepared_sample import sample_model, sample_scene


def first_frame() -> Frame:
    frame = sample_scene().frame(0)
    assert isinstance(frame, Frame)
    return frame


@pytest.fixture
def aligner() -> PoseAligner:
    made = PoseAligner(sample_model(), first_frame())
    made.mode.value = DRAG
    return made


def add_percent(pose: np.ndarray) -> float:
    part = sample_model().part
    return 100.0 * add_mm(part.vertices, pose, sample_scene().first_pose) / part.diameter


@pytest.mark.parametrize("seed", [0, *(pytest.param(k, marks=pytest.mark.slow) for k in range(1, 6))])
def test_a_scripted_drag_from_beside_snaps_to_the_part(seed: int, tmp_path: Path) -> None:
    """From a view 40 degrees and 60 px off, each point dragged to within 5 px of its place."""
    rng = np.random.default_rng(seed)
    model, frame, truth = sample_model(), first_frame(), sample_scene().first_pose
    aligner = PoseAligner(model, frame, view_from_beside(model, frame, truth, 40.0, 60.0, rng))
    assert add_percent(aligner.cam_T_obj) > 15.0
    drag_onto_the_part(aligner, truth, 5.0, rng)
    by_hand, said = aligner.cam_T_obj, []
    aligner.message.observe(lambda change: said.append((change.new, aligner._snap_button.disabled)), "value")
    found = aligner.snap()
    assert said[0] == ("searching …", True)
    assert not aligner._snap_button.disabled
    np.testing.assert_array_equal(aligner.pose_before, by_hand)
    assert found is not None
    assert found.is_good
    assert add_percent(aligner.cam_T_obj) < 2.0
    assert "found" in aligner.message.value
    # The points went along, and the file says the same.
    np.testing.assert_allclose(aligner.editor.points, aligner.points_at(aligner.cam_T_obj))
    aligner.save(tmp_path / "POSE.json")
    assert was_found(tmp_path / "POSE.json")
    np.testing.assert_allclose(read_pose(tmp_path / "POSE.json"), aligner.cam_T_obj, atol=1e-9)
    assert aligner.is_saved
    aligner.path.value = str(tmp_path / "POSE.json")
    aligner._save_as_told()
    assert "POSE.json" in aligner.message.value
    assert "but" not in aligner.message.value.rpartition("POSE.json")[2]
    # What was said is not true of the next pose.
    aligner.turn((0.0, 0.0, 5.0))
    assert aligner.snapped is None
    assert aligner.message.value == ""
    assert not aligner.is_saved


def test_what_was_not_snapped_is_saved_with_a_word(aligner: PoseAligner, tmp_path: Path) -> None:
    aligner.path.value = str(tmp_path / "POSE.json")
    aligner._save_as_told()
    assert "not snapped" in aligner.message.value
    assert not was_found(tmp_path / "POSE.json")
    assert aligner.is_saved
    aligner.snapped = SnapResult(aligner.cam_T_obj, 0.17, 0.1, 0.17, 0.9, None, np.zeros(0), is_good=False)  # type: ignore[arg-type]
    aligner._save_as_told()
    assert "snap did not find the part" in aligner.message.value


def test_a_loaded_pose_counts_as_saved_and_its_file_stays_byte_for_byte(
    aligner: PoseAligner, tmp_path: Path
) -> None:
    file = tmp_path / "POSE.json"
    assert not aligner.load(file)
    assert aligner.path.value == str(file)
    assert not aligner.is_saved
    text = hand_written_pose(file)
    assert aligner.load(file)
    assert aligner.is_saved
    np.testing.assert_array_equal(aligner.cam_T_obj, read_pose(file))
    np.testing.assert_allclose(aligner.editor.points, aligner.points_at(aligner.cam_T_obj))
    aligner.save(file)
    assert file.read_text() == text
    # Another place, a file that is gone, another pose: those are written.
    aligner.save(tmp_path / "copy.json")
    assert (tmp_path / "copy.json").exists()
    aligner.save(file)
    assert file.read_text() == text
    file.unlink()
    aligner.save(file)
    assert file.exists()
    aligner.turn((0.0, 0.0, 5.0))
    assert not aligner.is_saved
    aligner.save(file)
    np.testing.assert_allclose(read_pose(file), aligner.cam_T_obj, atol=1e-9)


def test_a_pose_is_saved_as_found_until_a_hand_moves_it(aligner: PoseAligner, tmp_path: Path) -> None:
    file = tmp_path / "POSE.json"
    aligner.path.value = str(file)

    def saved_as_found() -> bool:
        aligner._save_as_told()
        return was_found(file)

    truth = sample_scene().first_pose
    aligner._take_found(Detection(truth, 0.9, np.array([0.0, 0.0, 1.0])))
    assert saved_as_found()
    assert "<b>but not snapped</b>: as the detector found it" in aligner.message.value
    aligner.load(file)
    assert aligner.origin is Origin.READ_AS_FOUND
    assert saved_as_found()
    assert aligner.message.value.endswith("as it was read")
    # The very same pose of the hand, then one that was turned.
    for pose in (truth, truth @ make_pose(so3_exp(np.array([0.0, 0.0, 0.1])), np.zeros(3))):
        aligner.cam_T_obj = pose
        assert not saved_as_found()
        assert "that of your hand alone" in aligner.message.value
    aligner.load(file)
    assert aligner.origin is Origin.READ
    assert not saved_as_found()
    aligner.snapped = SnapResult(aligner.cam_T_obj, 0.17, 0.1, 0.17, 0.9, None, np.zeros(0), is_good=False)  # type: ignore[arg-type]
    assert not saved_as_found()
    aligner.snapped = replace(aligner.snapped, is_good=True)
    assert saved_as_found()
    assert aligner.message.value.endswith("POSE.json")


def test_a_malformed_pose_is_refused_and_kept(aligner: PoseAligner, tmp_path: Path) -> None:
    file = tmp_path / "POSE.json"
    file.write_text("{}")
    with pytest.raises(InputFileError, match="cam_R_m2c"):
        aligner.load(file)
    assert file.read_text() == "{}"
    assert not aligner.is_saved


def test_what_is_told_is_never_taken_for_html(aligner: PoseAligner, tmp_path: Path) -> None:
    """Names of files and parts reach the page as text."""
    evil = "<img src=x onerror=alert(1)>"
    (tmp_path / evil).write_text("")
    for place in (tmp_path / evil / "POSE.json", tmp_path / f"{evil}.json"):  # one cannot be written, one can
        aligner.path.value = str(place)
        aligner._save_as_told()
        assert "<img" not in aligner.message.value
        assert "&lt;img src=x onerror=alert(1)&gt;" in aligner.message.value
    assert "<b>but not snapped</b>" in aligner.message.value


def test_a_typed_name_is_taken_as_it_is_meant(
    aligner: PoseAligner, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    monkeypatch.setenv("USERPROFILE", str(tmp_path / "home"))
    for typed, place in (("  POSE.json ", tmp_path / "POSE.json"), ("~/POSE.json", tmp_path / "home" / "POSE.json")):
        aligner.path.value = typed
        aligner._save_as_told()
        assert str(place) in aligner.message.value
        np.testing.assert_allclose(read_pose(place), aligner.cam_T_obj, atol=1e-9)
    (tmp_path / "mine.stl").write_text("solid mine")
    for typed, told in ((" ", "no file can have that name"), ("a\0b", "no file can have"), ("mine.stl", "not a pose")):
        aligner.path.value = typed
        aligner._save_as_told()
        assert told in aligner.message.value
    assert (tmp_path / "mine.stl").read_text() == "solid mine"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["POSE.json", "home", "mine.stl"]


def test_the_part_begins_in_the_middle_of_the_image(aligner: PoseAligner) -> None:
    middle = aligner.editor.points.mean(0)
    assert np.linalg.norm(middle - (319.5, 255.5)) < 15.0
    assert aligner.editor.is_good
    assert len(aligner.editor.overlays) == 1


def test_dragging_moves_the_pose_and_undo_takes_it_back(aligner: PoseAligner) -> None:
    before = aligner.cam_T_obj
    drag(aligner.editor, 1, aligner.editor.points[1] + (8.0, -6.0))
    moved = aligner.cam_T_obj
    assert rotation_angle_deg(before[:3, :3], moved[:3, :3]) > 0.5
    aligner.editor.undo()
    np.testing.assert_allclose(aligner.cam_T_obj, before, atol=1e-4)


def test_a_folded_quad_leaves_the_pose_alone(aligner: PoseAligner) -> None:
    before = aligner.cam_T_obj
    # In one stroke: on the way there the quad would still be good.
    points = aligner.editor.points[[0, 2, 1, 3]]
    aligner.editor.points = points
    assert "folded" in aligner.editor.problem
    np.testing.assert_array_equal(aligner.cam_T_obj, before)


@pytest.mark.parametrize("region", range(6))
def test_every_face_can_be_looked_at(region: int, aligner: PoseAligner) -> None:
    aligner.see_from(region)
    assert aligner.editor.is_good
    assert aligner.region == region, REGION_NAMES[region]
    np.testing.assert_allclose(aligner.points_at(aligner.cam_T_obj), aligner.editor.points)


def test_turning_keeps_the_centre_and_the_other_pose_fits_the_same_points(aligner: PoseAligner) -> None:
    centre_obj = sample_model().part.box_centre
    before = transform(aligner.cam_T_obj, centre_obj)
    aligner.turn((0.0, 0.0, 15.0))
    np.testing.assert_allclose(transform(aligner.cam_T_obj, centre_obj), before)
    pose, points = aligner.cam_T_obj, aligner.editor.points
    aligner.take_other_pose()
    assert rotation_angle_deg(aligner.cam_T_obj[:3, :3], pose[:3, :3]) > 5.0
    assert np.abs(aligner.points_at(aligner.cam_T_obj) - points).max() < 12.0


@pytest.mark.parametrize("seed", [2, 3])
def test_points_that_sit_leave_the_pose_that_fits_them_whichever_came_first(seed: int) -> None:
    """Halfway, four coplanar points may be nearer to the second pose, which fits nothing once they all sit."""
    model, frame, truth = sample_model(), sample_scene().frame(0), sample_scene().first_pose
    rng = np.random.default_rng(seed)
    start = view_from_beside(model, frame, truth, 40.0, 60.0, rng)
    for order in itertools.permutations(range(4)):
        aligner = PoseAligner(model, frame, start)
        targets = aligner.points_at(truth) + rng.uniform(-3.0, 3.0, (4, 2))
        for index in order:
            aligner.editor.dragging = True
            drag(aligner.editor, index, targets[index], steps=2)
        assert np.abs(aligner.points_at(aligner.cam_T_obj) - targets).max() < 4.0, order
        aligner.close()


def test_corners_clicked_on_model_and_image_give_the_pose(aligner: PoseAligner) -> None:
    truth, chooser = sample_scene().first_pose, aligner.chooser
    aligner.mode.value = CLICK
    chooser.look(truth[:3, :3])
    rows = chooser.seen_corners()[:: max(1, len(chooser.seen_corners()) // 6)][:6]
    aligner.solve_corners()
    assert "needs 4 points" in aligner.message.value
    pixels = first_frame().camera.project(transform(truth, chooser.corners_obj[rows]))
    for number, (row, pixel) in enumerate(zip(rows, pixels, strict=True)):
        chooser._handle_custom_msg(_click(chooser.project(chooser.corners_obj[[row]])[0] + 2.0), [])
        aligner.picture._handle_custom_msg(_click(pixel), [])
        assert aligner.pairs.count == number + 1
    assert add_percent(aligner.cam_T_obj) < 0.5
    # A wrong one, dragged away, makes it worse; undo repairs it; undo again takes the last pair away.
    drag(aligner.picture, 0, pixels[0] + (30.0, 0.0))
    assert add_percent(aligner.cam_T_obj) > 0.5
    aligner.picture.undo()
    assert add_percent(aligner.cam_T_obj) < 0.5
    aligner.picture.undo()
    assert aligner.pairs.count == len(rows) - 1
    aligner.pairs.clear()
    assert aligner.pairs.count == len(aligner.picture.points) == 0


def click_corners(aligner: PoseAligner, count: int) -> np.ndarray:
    """Clicks the places of corners as the truth has them, exactly; the pixels (n, 2)."""
    truth, chooser = sample_scene().first_pose, aligner.chooser
    chooser.look(truth[:3, :3])
    rows = chooser.seen_corners()[:: max(1, len(chooser.seen_corners()) // count)][:count]
    pixels = first_frame().camera.project(transform(truth, chooser.corners_obj[rows]))
    for row, pixel in zip(rows, pixels, strict=True):
        aligner.pairs.choose(int(row))
        aligner.pairs.place(pixel)
    return pixels


def test_clicking_corners_comes_first() -> None:
    aligner = PoseAligner(sample_model(), first_frame())
    assert aligner.mode.value == CLICK == aligner.mode.options[0]
    assert "drag to turn" in aligner.chooser.status


def test_each_corner_tells_how_far_off_it_is(aligner: PoseAligner) -> None:
    pixels = click_corners(aligner, 6)
    assert [label.split(":")[0] for label in aligner.picture.labels] == list("123456")
    assert max(float(label.split()[1]) for label in aligner.picture.labels) < 0.1
    drag(aligner.picture, 2, pixels[2] + (20.0, 0.0))
    off = [float(label.split()[1]) for label in aligner.picture.labels]
    assert int(np.argmax(off)) == 2
    assert off[2] > 4.0
    assert f"most at corner 3: {off[2]:.1f} px" in aligner.message.value
    while aligner.pairs.count > 3:
        aligner.picture.undo()
    assert aligner.picture.labels == ()


def test_undo_solves_the_pairs_that_are_left(aligner: PoseAligner) -> None:
    """The last of five is 25 px off; without it the pose is good again, and so is what is said of it."""
    truth, chooser = sample_scene().first_pose, aligner.chooser
    click_corners(aligner, 4)
    pose = aligner.cam_T_obj
    other = next(int(row) for row in chooser.seen_corners()[::-1] if int(row) not in aligner.pairs._corners)
    aligner.pairs.choose(other)
    pixel = first_frame().camera.project(transform(truth, chooser.corners_obj[[other]]))[0]
    aligner.pairs.place(pixel + 25.0)
    assert add_percent(aligner.cam_T_obj) > 0.5
    aligner.picture.undo()
    assert aligner.pairs.count == len(aligner.picture.points) == len(aligner.picture.labels) == 4
    assert aligner.message.value.startswith("4 corners")
    np.testing.assert_allclose(aligner.cam_T_obj, pose, atol=1e-6)


def test_what_reset_took_away_undo_brings_back_with_its_corners(aligner: PoseAligner) -> None:
    click_corners(aligner, 5)
    corners, pose, said = list(aligner.pairs._corners), aligner.cam_T_obj, aligner.message.value
    aligner.picture.reset()
    assert aligner.pairs.count == 0
    aligner.pairs.choose(corners[3])
    aligner.pairs.place(np.array([50.0, 60.0]))
    assert aligner.pairs.count == 1
    aligner.picture.undo()
    aligner.picture.undo()
    assert aligner.pairs._corners == corners
    assert aligner.message.value == said
    np.testing.assert_allclose(aligner.cam_T_obj, pose, atol=1e-6)


def test_a_drag_that_began_before_an_undo_was_heard_of_takes_it_back(aligner: PoseAligner) -> None:
    """The kernel is busy, undo is pressed, then a point dragged: the page still has five."""
    click_corners(aligner, 5)
    corners, points = list(aligner.pairs._corners), aligner.picture.points
    moved = points + np.eye(5)[:, 3:4] * (2.0, 1.0)
    aligner.picture._handle_custom_msg({"kind": "undo"}, [])
    assert aligner.pairs.count == 4
    for dragging in (True, False):
        aligner.picture.set_state({"points": moved.tolist(), "dragging": dragging})
    assert aligner.pairs._corners == corners
    assert aligner.pairs.count == len(aligner.picture.points) == len(aligner.picture.labels) == 5
    assert aligner.message.value.startswith("5 corners")
    aligner.picture.undo()
    assert aligner.pairs.count == len(aligner.picture.points) == 4
    # Points of pairs that were cleared meanwhile are nobody's.
    aligner.pairs.clear()
    aligner.picture.set_state({"points": moved.tolist(), "dragging": True})
    aligner.picture.set_state({"dragging": False})
    assert aligner.pairs.count == len(aligner.picture.points) == 0


def test_corners_that_give_no_pose_have_no_residuals(aligner: PoseAligner) -> None:
    click_corners(aligner, 4)
    assert len(aligner.picture.labels) == 4
    aligner.picture.points = np.full((4, 2), 100.0)
    assert aligner.picture.labels == ()
    assert "choose others" in aligner.message.value


def test_the_picture_says_that_the_model_comes_first(aligner: PoseAligner) -> None:
    assert "choose a corner on the model first" in aligner.picture.status
    aligner.pairs.choose(0)
    assert "now click" in aligner.picture.status
    click_corners(aligner, 3)
    assert "choose a corner on the model first" in aligner.picture.status
    aligner.pairs.clear()
    click_corners(aligner, 4)
    assert aligner.picture.status == ""


def test_the_part_stops_before_the_camera(aligner: PoseAligner) -> None:
    radius, centre_obj = sample_model().part.radius, sample_model().part.box_centre
    for _ in range(60):
        aligner.turn((0.0, 0.0, 0.0), 0.9)
    near = transform(aligner.cam_T_obj, centre_obj)[2]
    assert radius < near < 1.2 * radius
    assert "no nearer" in aligner.message.value
    aligner.turn((0.0, 0.0, 0.0), 1.1)
    assert transform(aligner.cam_T_obj, centre_obj)[2] > near
    assert aligner.message.value == ""


def test_snapping_again_where_nothing_moved_changes_nothing(
    aligner: PoseAligner, monkeypatch: pytest.MonkeyPatch
) -> None:
    aligner.cam_T_obj = sample_scene().first_pose
    found = aligner.snap()
    assert found is not None
    assert found.is_good
    pose, told, before = aligner.cam_T_obj, aligner.message.value, aligner.pose_before
    calls: list[object] = []

    def counted(*arguments: object) -> SnapResult:
        calls.append(arguments)
        return found

    monkeypatch.setattr(pose_aligner, "snap", counted)
    assert aligner.snap() is found
    assert not calls
    assert aligner.cam_T_obj is pose
    assert aligner.pose_before is before
    assert aligner.message.value == told
    # Points that show another pose, or none, have moved.
    aligner.editor.points = aligner.editor.points[[0, 2, 1, 3]]
    aligner.snap()
    assert calls
    assert aligner.editor.is_good


def test_a_snap_that_is_interrupted_says_so(aligner: PoseAligner, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(*_: object) -> SnapResult:
        raise KeyboardInterrupt

    monkeypatch.setattr(pose_aligner, "snap", interrupted)
    pose = aligner.cam_T_obj
    with pytest.raises(KeyboardInterrupt):
        aligner.snap()
    assert "interrupted" in aligner.message.value
    assert not aligner._snap_button.disabled
    assert aligner.cam_T_obj is pose


def test_undo_after_a_turn_to_another_face_stays_with_its_points(aligner: PoseAligner) -> None:
    """Points of the face that was seen before are other points: a pose from them is thrown about."""
    aligner.cam_T_obj = sample_scene().first_pose
    before = aligner.region
    aligner.cad_view.dragging = True
    for step in range(1, 12):
        aligner.cad_view.orbit = (40.0 * step, 0.0)
        if aligner.region != before:
            break
    assert aligner.region != before, "the test's own point is gone"
    aligner.cad_view.orbit = (40.0 * step + 8.0, 0.0)
    aligner.cad_view.dragging = False
    turned = aligner.cam_T_obj
    for _ in range(3):
        aligner.editor.undo()
    assert rotation_angle_deg(turned[:3, :3], aligner.cam_T_obj[:3, :3]) < 5.0
    np.testing.assert_allclose(aligner.points_at(aligner.cam_T_obj), aligner.editor.points, atol=3.0)


def test_the_model_turns_below_the_hand_and_its_axes_with_it(aligner: PoseAligner) -> None:
    """The side that faces the eye goes where the hand goes; buttons stay with the camera's axes."""
    chooser = aligner.chooser
    before, axes = chooser.pose, chooser.overlays[0].coordinates
    assert chooser.orbits
    chooser.dragging = True
    for step in ((10.0, 0.0), (30.0, 0.0), (30.0, 12.0)):
        chooser.orbit = step
    chooser.dragging = False
    front_obj = sample_model().part.box_centre - 20.0 * before[2, :3]
    moved = chooser.camera.project(transform(chooser.pose, front_obj)[None])
    was = chooser.camera.project(transform(before, front_obj)[None])
    assert (moved - was)[0, 0] > 2.0
    assert (moved - was)[0, 1] > 0.5
    turned_deg = rotation_angle_deg(before[:3, :3], chooser.pose[:3, :3])
    assert abs(turned_deg - np.degrees(np.hypot(30.0, 12.0) / 158.4)) < 1.0
    assert {overlay.label for overlay in chooser.overlays[:2]} == {"object axes"}
    assert np.abs(chooser.overlays[0].coordinates[:1] - axes[:1]).max() > 1.0


def test_dragging_the_model_beside_the_points_turns_the_part(aligner: PoseAligner) -> None:
    before, history = aligner.cam_T_obj, len(aligner.editor._history)
    aligner.cad_view.dragging = True
    for step in range(5):
        aligner.cad_view.orbit = (4.0 * step, 2.0 * step)
    aligner.cad_view.dragging = False
    assert rotation_angle_deg(before[:3, :3], aligner.cam_T_obj[:3, :3]) > 4.0
    np.testing.assert_allclose(aligner.cad_view.pose[:3, :3], aligner.cam_T_obj[:3, :3], atol=1e-9)
    assert len(aligner.editor._history) == history + 1, "one drag is one step to undo"


def test_what_was_turned_stays_turned_when_the_mode_changes(tmp_path: Path) -> None:
    aligner = PoseAligner(sample_model(), first_frame())
    aligner.chooser.turn((0.0, 40.0, 0.0))
    seen = aligner.chooser.pose[:3, :3]
    aligner.mode.value = DRAG
    np.testing.assert_allclose(aligner.cam_T_obj[:3, :3], seen)
    aligner.turn((0.0, 0.0, 30.0))
    aligner.mode.value = CLICK
    np.testing.assert_allclose(aligner.chooser.pose[:3, :3], aligner.cam_T_obj[:3, :3])
    # A pose that somebody made is not turned by looking at the model from elsewhere.
    made = aligner.cam_T_obj
    aligner.chooser.turn((30.0, 0.0, 0.0))
    looked = aligner.chooser.pose
    aligner.mode.value = DRAG
    aligner.mode.value = CLICK
    assert aligner.cam_T_obj is made
    np.testing.assert_array_equal(aligner.chooser.pose, looked)


def test_find_it_for_me_shows_hypotheses_and_takes_the_one_that_is_clicked(aligner: PoseAligner) -> None:
    before = aligner.cam_T_obj
    found = aligner.finder.find()
    assert found[0].is_accepted
    assert "<b>found</b>" in aligner.message.value
    assert len(aligner.finder.children) == len(found)
    assert aligner.cam_T_obj is before, "nothing is taken before it is chosen"
    canvas, choose = aligner.finder.children[0].children
    assert choose.description.startswith(f"1: score {found[0].score:.2f}")
    canvas._handle_custom_msg({"kind": "click", "x": 5.0, "y": 5.0}, [])
    assert add_percent(aligner.cam_T_obj) < 3.0
    np.testing.assert_allclose(aligner.editor.points, aligner.points_at(aligner.cam_T_obj))
    strokes = canvas.overlays[0].coordinates.reshape(-1, 2)
    assert ((strokes > 0.0) & (strokes < canvas.image_size)).all()
    # Distances between which it is not, and none at all.
    aligner.finder.nearest_mm.value, aligner.finder.farthest_mm.value = 50_000.0, 60_000.0
    assert aligner.finder.find() == ()
    assert aligner.finder.children == ()
    assert "nothing here" in aligner.message.value
    aligner.finder.nearest_mm.value = 70_000.0
    assert aligner.finder.find() == ()
    assert "0 &lt; nearest" in aligner.message.value


def test_one_search_at_a_time_and_its_words_stay(aligner: PoseAligner, monkeypatch: pytest.MonkeyPatch) -> None:
    begun, goes_on, calls = threading.Event(), threading.Event(), []

    def slow(*_: object) -> tuple[Detection, ...]:
        calls.append(threading.current_thread())
        begun.set()
        assert goes_on.wait(60.0)
        return ()

    monkeypatch.setattr(Finder, "find", slow)
    button = aligner.finder._button
    button.click()
    assert button.disabled, "before the thread has begun"
    button.click()
    assert begun.wait(60.0)
    assert aligner.finder.find() == ()
    aligner.turn((0.0, 0.0, 10.0))
    assert aligner.message.value == LOOKING
    goes_on.set()
    calls[0].join(60.0)
    assert len(calls) == 1
    assert not button.disabled
    assert "nothing here" in aligner.message.value
    aligner.turn((0.0, 0.0, 10.0))
    assert aligner.message.value == ""


def test_a_search_that_is_interrupted_says_so(aligner: PoseAligner, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(*_: object) -> tuple[Detection, ...]:
        raise KeyboardInterrupt

    monkeypatch.setattr(Finder, "find", interrupted)
    with pytest.raises(KeyboardInterrupt):
        aligner.finder.find()
    assert "interrupted" in aligner.message.value
    assert not aligner.finder.is_searching


def test_hypotheses_that_are_replaced_are_closed(aligner: PoseAligner) -> None:
    aligner.finder.find()
    before = len(open_widgets())
    shown = aligner.finder.children
    aligner.finder.find()
    assert len(open_widgets()) == before
    assert shown[0].children[0].comm is None
    assert aligner.finder.children[0].children[0].comm is not None


def test_an_aligner_that_is_closed_during_a_search_leaves_no_widgets(monkeypatch: pytest.MonkeyPatch) -> None:
    before = open_widgets()
    aligner = PoseAligner(sample_model(), first_frame())
    pose = sample_scene().first_pose

    def closing(finder: Finder, *_: object) -> tuple[Detection, ...]:
        close_with_parts(aligner)
        return (Detection(pose, 0.9, np.array([0.0, 0.0, 1.0])),)

    monkeypatch.setattr(Finder, "find", closing)
    assert len(aligner.finder.find()) == 1
    assert open_widgets() == before


def test_snapping_where_nothing_is_says_so(aligner: PoseAligner) -> None:
    away = aligner.cam_T_obj.copy()
    away[0, 3] += 4000.0
    aligner.cam_T_obj = away
    assert aligner.snap() is None
    assert "not seen" in aligner.message.value


def test_an_assigned_pose_takes_the_points_along(aligner: PoseAligner) -> None:
    truth = sample_scene().first_pose
    aligner.cam_T_obj = truth
    np.testing.assert_allclose(aligner.editor.points, aligner.points_at(truth))
    np.testing.assert_allclose(aligner.cam_T_obj, truth)
    with pytest.raises(traitlets.TraitError, match=r"\(4, 4\)"):
        aligner.cam_T_obj = np.eye(3)


def test_a_place_that_cannot_be_written_is_told(aligner: PoseAligner, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    aligner.path.value = str(tmp_path / "file" / "POSE.json")
    aligner._save_as_told()
    assert "cannot be written" in aligner.message.value


def hand_written_pose(path: Path) -> str:
    """Writes the true start pose as nobody's program would; its text."""
    truth = sample_scene().first_pose
    rotation, shift = truth[:3, :3].ravel().tolist(), truth[:3, 3].tolist()
    text = f'{{"note": "by hand",   "cam_t_m2c": {shift}, "cam_R_m2c": {rotation}}}'
    path.write_text(text)
    return text


def _click(pixel: np.ndarray) -> dict[str, object]:
    return {"kind": "click", "x": float(pixel[0]), "y": float(pixel[1])}
