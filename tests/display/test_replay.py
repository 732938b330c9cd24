"""Replays are read back with rerun's own reader: what is in them, when, where in the image, and against the run."""

from __future__ import annotations

import math
import subprocess
import sys
import threading
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from acp_lab.display.replay.images import JPEG_QUALITY, MOST_BYTES_PER_PIXEL, MOST_WAITING, encode_jpeg
from acp_lab.display.replay.recorder import Replay
from acp_lab.errors import InputFileError, ParameterError
from acp_lab.geometry.arrays import ByteImage
from acp_lab.geometry.pose import transform
from acp_lab.prepared_part import Trained
from acp_lab.sequences.frame import Frame, UnreadableFrame
from acp_lab.sequences.image_header import is_turned
from acp_lab.tracking.method import ACP
from acp_lab.tracking.observer import SessionInfo, TrackedObject
from acp_lab.tracking.result import TrackResult, TrackState
from acp_lab.tracking.session import track_sequence
from acp_lab.tracking.sought import Sought
from acp_lab.tracking.tracker import Tracker
from tests.display.made_run import CAMERA, FRAME_IDS, STEPS, box, frames, play, recorded, result, true_pose
from tests.display.recording import Recording
from tests.prepared_sample import sample_model, sample_scene
from tests.sequences.turned_jpeg import turned

WANTED = (
    "image",
    "target_edges",
    "generated_edges",
    "control_points",
    "mesh",
    "truth",
    "loss",
    "quality",
    "add",
    "state",
    "crop",
    "distance_map",
    "regions",
    "trajectory",
    "uncertainty",
)
READABLE = [0, 1, 3]  # frames, counted; the one with id 3 cannot be read
FRAMES = list(range(len(FRAME_IDS)))


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("replay") / "run.rrd"
    play([Replay(path, iterations="all")], object_ids=(1, 7), results=recorded)
    return path


@pytest.fixture(scope="module")
def recording(path: Path) -> Recording:
    return Recording.read(path)


def made_frames() -> list[Frame | UnreadableFrame]:
    return list(frames())


# ---- what is in it ---------------------------------------------------------------------------------------------


def test_everything_is_in_it(recording: Recording) -> None:
    for wanted in WANTED:
        assert any(wanted in entity for entity in recording.entities), wanted
    for object_id in (1, 7):
        assert f"/camera/generated_edges/obj_{object_id:06d}" in recording.entities


def test_the_file_is_complete(path: Path) -> None:
    command = [sys.executable, "-m", "rerun", "rrd", "verify", str(path)]
    done = subprocess.run(command, capture_output=True, check=False)
    assert done.returncode == 0, done.stderr


def test_one_row_per_frame_on_every_timeline(recording: Recording) -> None:
    name = "obj_000001"
    per_frame = {
        f"/mesh/{name}": "mat3x3",
        f"/truth/{name}": "translation",
        f"/camera/control_points/{name}": "positions",
        f"/camera/generated_edges/{name}": "strips",
        f"/camera/target_edges/{name}": "positions",
        f"/camera/truth/{name}": "strips",
        f"/curves/quality/{name}": "scalars",
        f"/curves/add_percent/{name}": "scalars",
        f"/curves/pose_error/{name}": "scalars",
        f"/curves/iterations/{name}": "scalars",
        f"/curves/ms/{name}": "scalars",
        f"/curves/region/{name}": "scalars",
        f"/numbers/{name}": "text",
        "/image_id": "scalars",
    }
    for entity, component in per_frame.items():
        rows = recording.on_frames(entity, component)
        assert [row.frame for row in rows] == FRAMES, entity
        times = [row.time_s for row in rows]
        assert times == pytest.approx([k / 30.0 for k in FRAMES]), entity
        steps = [row.step for row in rows]
        # The result stands at the last of its frame's iterations.
        assert steps == [STEPS, 2 * STEPS + 1, 2 * STEPS + 2, 3 * STEPS + 3], entity


def test_the_time_line_counts_on(tmp_path: Path) -> None:
    replay = Replay(tmp_path / "two.rrd", sessions=2)
    play([replay])
    play([replay])
    rows = Recording.read(tmp_path / "two.rrd").on_frames("/curves/quality/obj_000001", "scalars")
    for times in ([row.frame for row in rows], [row.step for row in rows]):
        assert times == list(range(2 * len(FRAME_IDS)))
    assert np.all(np.diff([row.time_s for row in rows]) > 0.0)


def test_a_replay_is_not_replaced_by_a_second_run(tmp_path: Path) -> None:
    replay = Replay(tmp_path / "run.rrd")
    play([replay])
    written = (tmp_path / "run.rrd").read_bytes()
    with pytest.raises(ParameterError, match=r"run\.rrd: .* make a new acp\.Replay, or one of sessions=2"):
        play([replay])
    assert (tmp_path / "run.rrd").read_bytes() == written


def test_known_times_are_taken(tmp_path: Path) -> None:
    replay = Replay(tmp_path / "run.rrd")
    replay.on_start(SessionInfo("clip", 1, "acp", (TrackedObject(1, box()),)))
    for number, frame in enumerate(made_frames()[:2]):
        assert isinstance(frame, Frame)
        replay.on_frame(replace(frame, time_s=0.5 * number), {1: result(frame, 1)})
    replay.on_end()
    rows = Recording.read(tmp_path / "run.rrd").on_frames("/curves/quality/obj_000001", "scalars")
    assert [row.time_s for row in rows] == pytest.approx([0.0, 0.5])


# ---- the method's own control points ---------------------------------------------------------------------------


def test_the_control_points_that_are_drawn_are_the_methods_own(tmp_path: Path) -> None:
    """Regressed W, here those of the middle section shifted: 3D points and the quad of the true pose are theirs."""
    scene, model = sample_scene(), sample_model()
    off_mm = np.array([3.0, -2.0, 4.0])
    regressed = {region: model.control_points(region, "mid-section") + off_mm for region in range(6)}
    chosen = replace(model, regressed_points=Trained(regressed))
    tracker = Tracker(chosen, replace(ACP, control_points="regressed"))
    replay = Replay(tmp_path / "run.rrd")
    run = track_sequence({1: tracker}, scene, {1: scene.first_pose}, [replay], max_frames=2)
    found = run.results[1][1]
    recording = Recording.read(tmp_path / "run.rrd")
    shown = recording.of("/mesh/obj_000001/control_points", "positions")
    np.testing.assert_allclose(shown[-1].value, regressed[found.region], atol=1e-4)
    true_quads = recording.on_frames("/camera/truth/obj_000001", "strips")
    expected = scene.camera(1).project(transform(scene.truth(1, 1), regressed[found.region])) + 0.5
    np.testing.assert_allclose(true_quads[1].value[0][:4], expected, atol=1e-3)
    # The tracked quad lies beside the true one, which it would not if one of them were the middle section's.
    tracked = recording.on_frames("/camera/control_points/obj_000001", "positions")[1].value
    np.testing.assert_allclose(tracked, expected, atol=2.0)


# ---- values against the run ------------------------------------------------------------------------------------


def test_poses_are_those_of_the_run(recording: Recording) -> None:
    for entity, poses in (
        ("/mesh/obj_000007", [result(frame, 7).cam_T_obj for frame in made_frames()]),
        ("/truth/obj_000007", [true_pose(frame.index, 7) for frame in made_frames()]),
    ):
        matrices = recording.on_frames(entity, "mat3x3")
        shifts = recording.on_frames(entity, "translation")
        for matrix, shift, pose in zip(matrices, shifts, poses, strict=True):
            # Column by column.
            np.testing.assert_allclose(np.reshape(matrix.value[0], (3, 3)).T, pose[:3, :3], atol=1e-6)
            np.testing.assert_allclose(shift.value[0], pose[:3, 3], atol=1e-4)


def test_turned_poses_are_not_transposed(tmp_path: Path) -> None:
    turn = cv2.Rodrigues(np.array([0.1, -0.4, 0.7]))[0]

    def turned(frame: Frame | UnreadableFrame, object_id: int) -> TrackResult:
        found = recorded(frame, object_id)
        pose = found.cam_T_obj.copy()
        pose[:3, :3] = turn
        steps = tuple(replace(step, cam_T_obj=pose) for step in found.steps)
        return replace(found, cam_T_obj=pose, steps=steps)

    play([Replay(tmp_path / "run.rrd", iterations="all")], results=turned)
    for row in Recording.read(tmp_path / "run.rrd").of("/mesh/obj_000001", "mat3x3"):
        np.testing.assert_allclose(np.reshape(row.value[0], (3, 3)).T, turn, atol=1e-6)


def test_curves_are_those_of_the_run(recording: Recording) -> None:
    results = [result(frame, 1) for frame in made_frames()]
    qualities = recording.on_frames("/curves/quality/obj_000001", "scalars")
    assert [row.value for row in qualities] == [[r.quality] for r in results]
    errors = recording.on_frames("/curves/pose_error/obj_000001", "scalars")
    np.testing.assert_allclose([row.value for row in errors], [[0.0, 1.0]] * len(results), atol=1e-6)
    add = recording.on_frames("/curves/add_percent/obj_000001", "scalars")
    np.testing.assert_allclose([row.value for row in add], 100.0 / box().diameter)
    times = recording.on_frames("/curves/ms/obj_000001", "scalars")
    assert times[0].value == pytest.approx([0, 0, 0, 3, 0, 0, 6])
    ids = recording.on_frames("/image_id", "scalars")
    assert [row.value for row in ids] == [[float(frame_id)] for frame_id in FRAME_IDS]


def test_a_value_that_is_no_number_is_left_out(tmp_path: Path) -> None:
    def without_loss(frame: Frame | UnreadableFrame, object_id: int) -> TrackResult:
        found = result(frame, object_id)
        return replace(found, loss=math.nan) if frame.index == 1 else found

    play([Replay(tmp_path / "run.rrd")], results=without_loss)
    rows = Recording.read(tmp_path / "run.rrd").on_frames("/curves/loss/obj_000001", "scalars")
    assert [row.frame for row in rows] == [0, 2, 3]


def test_points_are_half_a_pixel_further_in_rerun(recording: Recording) -> None:
    first = result(made_frames()[0], 1)
    corners = recording.on_frames("/camera/control_points/obj_000001", "positions")[0]
    np.testing.assert_allclose(corners.value, first.control_points + 0.5, atol=1e-4)
    strokes = recording.on_frames("/camera/generated_edges/obj_000001", "strips")[0]
    assert first.edges is not None
    np.testing.assert_allclose(np.mean(strokes.value, axis=1), first.edges.points + 0.5, atol=1e-4)
    found = recording.on_frames("/camera/target_edges/obj_000001", "positions")[0]
    np.testing.assert_allclose(found.value, first.control_points + 0.75, atol=1e-4)
    (matrix,) = recording.of("/camera", "image_from_camera")[0].value
    # Column by column.
    np.testing.assert_allclose(matrix[6:8], [CAMERA.cx + 0.5, CAMERA.cy + 0.5])
    # The crop begins at the corner of its first pixel.
    (centre,), (half,) = (recording.on_frames("/camera/crop/obj_000001", c)[0].value for c in ("centers", "half_sizes"))
    np.testing.assert_allclose(np.array(centre) - half, [60, 50])
    np.testing.assert_allclose(np.array(centre) + half, [100, 80])


def test_edges_disappear_where_there_are_none(recording: Recording) -> None:
    for entity, component in (
        ("/camera/generated_edges/obj_000001", "strips"),
        ("/camera/target_edges/obj_000001", "positions"),
        ("/camera/crop/obj_000001", "half_sizes"),
    ):
        counts = [len(row.value) for row in recording.on_frames(entity, component)]
        assert counts[2] == 0
        assert all(count > 0 for number, count in enumerate(counts) if number != 2)


def test_the_view_region_is_shown_when_it_changes(recording: Recording) -> None:
    # Region 2 first, 0 in the unreadable frame, 2 again.
    rows = recording.on_frames("/mesh/obj_000001/regions/active", "strips")
    assert [row.frame for row in rows] == [0, 2, 3]
    face = np.array(rows[0].value[0])
    np.testing.assert_allclose(face[:, 1], 15.0)  # the side +y of the box


def test_the_trail_grows(recording: Recording) -> None:
    (trail,) = recording.on_frames("/trajectory/obj_000001", "strips")[-1].value
    centres = [result(frame, 1).cam_T_obj[:3, 3] for frame in made_frames()]
    np.testing.assert_allclose(trail, centres, atol=1e-4)


def test_how_exact_the_pose_is(recording: Recording) -> None:
    rows = recording.on_frames("/uncertainty/obj_000001", "half_sizes")
    assert [len(row.value) for row in rows] == [1, 1, 0, 1]  # nothing in the frame that cannot be read
    np.testing.assert_allclose(sorted(rows[0].value[0]), 2.7955 * np.array([1.0, 4.0, 9.0]), rtol=1e-3)
    (centre,) = recording.on_frames("/uncertainty/obj_000001", "centers")[-1].value
    np.testing.assert_allclose(centre, recorded(made_frames()[-1], 1).cam_T_obj[:3, 3], atol=1e-4)
    curve = [row.value for row in recording.on_frames("/curves/uncertainty/obj_000001", "scalars")]
    np.testing.assert_allclose(curve, [[np.degrees(0.02), 9.0]] * 3)
    texts = [row.value[0] for row in recording.on_frames("/numbers/obj_000001", "text")]
    assert [("known to 1.15 deg, 9.00 mm" in text) for text in texts] == [True, True, False, True]


def test_a_covariance_that_is_not_finite_is_none(tmp_path: Path) -> None:
    """It ended the recording."""
    nothing = np.full((6, 6), np.nan)
    play([Replay(tmp_path / "run.rrd")], results=lambda f, i: replace(recorded(f, i), covariance=nothing))
    rows = Recording.read(tmp_path / "run.rrd").on_frames("/uncertainty/obj_000001", "half_sizes")
    assert [len(row.value) for row in rows] == [0] * len(FRAMES)


# ---- words -----------------------------------------------------------------------------------------------------


def test_state_tells_what_happened(recording: Recording) -> None:
    texts = [row.value[0] for row in recording.on_frames("/state/obj_000001", "text")]
    assert "starts in region +y" in texts[0]
    assert any("the file is empty" in text for text in texts)
    assert any("view region +y -> +x" in text for text in texts)
    assert any("lost -> tracking" in text for text in texts)
    lanes = recording.on_frames("/state/obj_000001", "state")
    assert [(row.frame, row.value[0]) for row in lanes] == [(0, "tracking"), (2, "lost"), (3, "tracking")]


SOUGHT = Sought()


def test_reasons_are_in_the_log(tmp_path: Path) -> None:
    def sinking(frame: Frame | UnreadableFrame, object_id: int) -> TrackResult:
        found = result(frame, object_id)
        note = "tracking -> weak: quality 0.21"
        return replace(found, state=TrackState.WEAK, note=note, sought=SOUGHT) if frame.index else found

    play([Replay(tmp_path / "run.rrd")], results=sinking)
    recording = Recording.read(tmp_path / "run.rrd")
    texts = [row.value[0] for row in recording.on_frames("/state/obj_000001", "text")]
    assert any("image 1: tracking -> weak: quality 0.21" in text for text in texts)
    # A search is told once, not in every frame that it takes.
    assert [text for text in texts if "searched" in text] == [f"obj_000001, image 1: {SOUGHT}"]
    levels = [row.value[0] for row in recording.on_frames("/state/obj_000001", "level")]
    assert levels[0] == "INFO"
    assert "WARN" in levels


# ---- images ----------------------------------------------------------------------------------------------------


def test_one_image_per_readable_frame(recording: Recording) -> None:
    images = recording.on_frames("/camera/image", "blob")
    assert [row.frame for row in images] == READABLE
    for row, frame in zip(images, [f for f in made_frames() if isinstance(f, Frame)], strict=True):
        decoded = cv2.imdecode(np.array(row.value[0], np.uint8), cv2.IMREAD_COLOR)
        np.testing.assert_allclose(decoded[..., ::-1].astype(float), frame.image, atol=3)
    # The image begins its frame, before the iterations.
    assert [row.step for row in images] == [0, STEPS + 1, 2 * STEPS + 3]


def test_the_distance_map_is_in_its_place(recording: Recording) -> None:
    row = recording.on_frames("/camera/distance_map/obj_000001", "blob")[0]
    picture = cv2.imdecode(np.array(row.value[0], np.uint8), cv2.IMREAD_COLOR)[..., ::-1].astype(float)
    assert picture.shape == (CAMERA.height, CAMERA.width, 3)
    assert picture[65, 80].sum() > 250  # on the edge: yellow
    assert picture[20, 20].sum() < 20  # outside the crop: nothing


def test_a_sequence_may_give_all_its_images_in_one_array(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The encoder is slow here: every image waits until the next one is in the array."""
    may_go_on = threading.Event()

    def waits(image: ByteImage) -> bytes:
        may_go_on.wait()
        return encode_jpeg(image)

    monkeypatch.setattr("acp_lab.display.replay.images.encode_jpeg", waits)
    replay = Replay(tmp_path / "run.rrd")
    replay.on_start(SessionInfo("clip", 1, "acp", (TrackedObject(1, box()),)))
    buffer = np.zeros((CAMERA.height, CAMERA.width, 3), np.uint8)
    levels = [0, 60, 120, 180]
    for number, level in enumerate(levels):
        buffer[:] = level
        frame = Frame(number, buffer, CAMERA)
        replay.on_frame(frame, {1: result(frame, 1)})
    may_go_on.set()
    replay.on_end()
    images = Recording.read(tmp_path / "run.rrd").on_frames("/camera/image", "blob")
    decoded = [cv2.imdecode(np.array(row.value[0], np.uint8), cv2.IMREAD_COLOR) for row in images]
    np.testing.assert_allclose([image.mean() for image in decoded], levels, atol=3)


@pytest.mark.parametrize("noise", [0, 20])
def test_small_jpegs_are_handed_on_as_they_are(tmp_path: Path, noise: int) -> None:
    rng = np.random.default_rng(1)
    image = np.clip(128 + noise * rng.standard_normal((128, 160, 3)), 0, 255).astype(np.uint8)
    source = tmp_path / "000000.jpg"
    cv2.imwrite(str(source), image, [cv2.IMWRITE_JPEG_QUALITY, 97])
    replay = Replay(tmp_path / "run.rrd")
    session = SessionInfo("clip", 1, "acp", (TrackedObject(1, box()),), image_path={0: source}.get)
    replay.on_start(session)
    frame = Frame(0, image, CAMERA)
    replay.on_frame(frame, {1: result(frame, 1)})
    replay.on_end()
    (row,) = Recording.read(tmp_path / "run.rrd").on_frames("/camera/image", "blob")
    logged = bytes(row.value[0])
    if noise:
        assert logged != source.read_bytes()
        assert len(logged) <= MOST_BYTES_PER_PIXEL * image.size / 3
    else:
        assert logged == source.read_bytes()


def test_a_jpeg_that_viewers_would_turn_is_not_handed_on(tmp_path: Path) -> None:
    source = tmp_path / "000000.jpg"
    image = np.full((128, 160, 3), 90, np.uint8)
    source.write_bytes(turned(cv2.imencode(".jpg", image)[1].tobytes(), 6))
    replay = Replay(tmp_path / "run.rrd")
    replay.on_start(SessionInfo("clip", 1, "acp", (TrackedObject(1, box()),), image_path={0: source}.get))
    frame = Frame(0, image, CAMERA)
    replay.on_frame(frame, {1: result(frame, 1)})
    replay.on_end()
    (row,) = Recording.read(tmp_path / "run.rrd").on_frames("/camera/image", "blob")
    assert not is_turned(bytes(row.value[0]))


def test_noisy_images_lose_quality_not_room() -> None:
    rng = np.random.default_rng(2)
    flat = np.full((512, 640, 3), 90, np.uint8)
    noisy = np.clip(90 + 25 * rng.standard_normal(flat.shape), 0, 255).astype(np.uint8)
    _, usual = cv2.imencode(".jpg", noisy, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
    assert len(encode_jpeg(noisy)) < len(usual)
    _, usual = cv2.imencode(".jpg", flat, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
    assert encode_jpeg(flat) == usual.tobytes()


def test_what_fails_in_the_thread_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(image: ByteImage) -> bytes:
        raise cv2.error("no memory")

    monkeypatch.setattr("acp_lab.display.replay.images.encode_jpeg", fails)
    frame = made_frames()[0]
    assert isinstance(frame, Frame)
    replay = Replay(tmp_path / "run.rrd")
    replay.on_start(SessionInfo("clip", 1, "acp", (TrackedObject(1, box()),)))
    for _ in range(3 * MOST_WAITING):  # nobody waits for room in the queue for ever
        replay.on_frame(frame, {1: result(frame, 1)})
    with pytest.raises(cv2.error, match="no memory"):
        replay.on_end()


# ---- iterations ------------------------------------------------------------------------------------------------


def test_iterations_stand_on_their_own_timeline(recording: Recording) -> None:
    frame = made_frames()[1]
    wanted = recorded(frame, 1)
    losses = recording.on_steps_only("/curves/step_loss/obj_000001", "scalars")
    assert [row.step for row in losses] == [1, 2, 3, 5, 6, 7, 10, 11, 12]
    assert [row.value[0] for row in losses[3:6]] == [step.loss for step in wanted.steps]
    corners = recording.on_steps_only("/camera/control_points/obj_000001", "positions")
    assert [row.step for row in corners] == [row.step for row in losses]
    np.testing.assert_allclose(corners[3].value, wanted.steps[0].control_points + 0.5, atol=1e-4)
    shifts = recording.on_steps_only("/mesh/obj_000001", "translation")
    np.testing.assert_allclose(shifts[3].value[0], wanted.steps[0].cam_T_obj[:3, 3], atol=1e-4)
    path = recording.on_frames("/camera/control_points/obj_000001/path", "strips")[1]
    np.testing.assert_allclose(
        np.transpose(path.value, (1, 0, 2)), [step.control_points + 0.5 for step in wanted.steps], atol=1e-4
    )


def test_iterations_of_failures_alone(tmp_path: Path) -> None:
    def failing(frame: Frame | UnreadableFrame, object_id: int) -> TrackResult:
        found = recorded(frame, object_id)
        return replace(found, state=TrackState.WEAK) if frame.index == 1 else found

    play([Replay(tmp_path / "run.rrd", iterations="failures")], results=failing)
    losses = Recording.read(tmp_path / "run.rrd").on_steps_only("/curves/step_loss/obj_000001", "scalars")
    assert [row.step for row in losses] == [2, 3, 4]


def test_without_iterations_every_frame_is_one_step(tmp_path: Path) -> None:
    replay = Replay(tmp_path / "run.rrd")
    assert not replay.wants_steps
    play([replay], results=recorded)
    recording = Recording.read(tmp_path / "run.rrd")
    assert recording.on_steps_only("/mesh/obj_000001", "translation") == []
    assert [row.step for row in recording.on_frames("/mesh/obj_000001", "translation")] == FRAMES


# ---- less than everything --------------------------------------------------------------------------------------


def test_no_truth_no_truth_entities(tmp_path: Path) -> None:
    play([Replay(tmp_path / "run.rrd")], with_truth=False)
    recording = Recording.read(tmp_path / "run.rrd")
    assert not any("truth" in entity for entity in recording.entities)
    assert recording.on_frames("/curves/add_percent/obj_000001", "scalars") == []


def test_a_place_that_cannot_be_written(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(InputFileError, match=r"run\.rrd.*cannot be written"):
        play([Replay(tmp_path / "file" / "run.rrd")])


def test_a_hundred_noisy_frames_stay_below_ten_megabytes(tmp_path: Path) -> None:
    camera = replace(CAMERA, width=640, height=512)
    rng = np.random.default_rng(3)
    noise = (40.0 * rng.standard_normal((512, 640, 3))).astype(np.int16)
    replay = Replay(tmp_path / "run.rrd")
    replay.on_start(SessionInfo("noisy", 1, "acp", (TrackedObject(1, box()),), true_pose))
    edges = rng.uniform(0.0, 500.0, (600, 2))
    for number in range(100):
        image = np.clip(np.roll(noise, number, axis=1) + 120, 0, 255).astype(np.uint8)
        frame = Frame(number, image, camera)
        found = recorded(Frame(number, image[:128, :160], CAMERA), 1)
        assert found.edges is not None
        assert found.target is not None
        many = replace(found.edges, points=edges, tangents=np.tile([0.6, 0.8], (600, 1)), weights=np.ones(600))
        target = replace(found.target, edge_points=rng.uniform(0.0, 500.0, (1200, 2)), distance_map=None)
        residuals = rng.standard_normal(600)
        replay.on_frame(frame, {1: replace(found, edges=many, target=target, residuals_px=residuals)})
    replay.on_end()
    assert (tmp_path / "run.rrd").stat().st_size < 10e6
