"""The files that stand in for a reader's own."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from acp_lab.cad.mesh_file import read_mesh_file
from acp_lab.cad.part import Part
from acp_lab.course.made_boards import board_views, camera_rays
from acp_lab.course.stand_ins import BOARD, BOARD_COUNT, StandIns, stand_ins
from acp_lab.course.workshop import sample_part, sample_scene
from acp_lab.errors import InputFileError, PartError
from acp_lab.geometry.camera import Camera
from acp_lab.sequences import Frame, VideoFile
from acp_lab.sequences.calibration import Chessboard, board_images, calibrate

SMALL = Camera(240, 180, 300.0, 302.0, 121.0, 88.5, (-0.2, 0.05, 0.001, 0.0, 0.0))
SMALL_BOARD = Chessboard(5, 4, 20.0)


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> StandIns:
    return stand_ins(tmp_path_factory.mktemp("stand_ins") / "here")


def test_the_mesh_is_the_sample_in_metres(made: StandIns) -> None:
    with pytest.raises(PartError, match="looks like metres"):
        Part.from_file(made.mesh)
    raw = read_mesh_file(made.mesh)
    part = Part.from_mesh(1000.0 * raw.vertices, raw.faces, "bracket")
    assert part.is_closed
    assert len(part.faces) == len(sample_part().faces)
    np.testing.assert_allclose(part.box_min, sample_part().box_min, atol=1e-3)
    np.testing.assert_allclose(part.box_max, sample_part().box_max, atol=1e-3)


def test_the_video_straightened_is_the_sample(made: StandIns) -> None:
    video = VideoFile(made.video, made.camera)
    assert len(video.frame_ids) == len(sample_scene().frame_ids)
    for number, frame in enumerate(video.frames(2)):
        original = sample_scene().frame(number)
        assert isinstance(frame, Frame)
        assert isinstance(original, Frame)
        assert frame.camera == sample_scene().camera(number)
        inner = (slice(40, -40), slice(40, -40))
        difference = np.abs(frame.image[inner].astype(float) - original.image[inner])
        assert difference.mean() < 4.0
        # Not without a lens: bent frames differ more.
        bent = next(VideoFile(made.video, original.camera).frames(1))
        assert isinstance(bent, Frame)
        if number == 0:
            assert np.abs(bent.image[inner].astype(float) - original.image[inner]).mean() > 1.5 * difference.mean()


@pytest.mark.slow
def test_the_boards_give_the_camera_back(made: StandIns) -> None:
    found = calibrate(BOARD, board_images(made.boards), "boards")
    assert len(found.view_errors_px) == BOARD_COUNT
    assert found.warnings == ()
    assert found.camera.fx == pytest.approx(made.camera.fx, rel=0.002)
    assert found.camera.cx == pytest.approx(made.camera.cx, abs=1.0)


def test_what_is_there_is_not_made_again(made: StandIns) -> None:
    before = [path.stat().st_mtime_ns for path in (made.mesh, made.video, *made.boards.iterdir())]
    again = stand_ins(made.mesh.parent)
    assert again == made
    assert [path.stat().st_mtime_ns for path in (made.mesh, made.video, *made.boards.iterdir())] == before


def test_a_folder_that_cannot_be_written(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("no folder")
    with pytest.raises(InputFileError, match="choose another place"):
        stand_ins(tmp_path / "file")


def test_flat_boards_leave_the_focal_length_open() -> None:
    tilted = calibrate(SMALL_BOARD, board_views(SMALL_BOARD, SMALL, 6), "tilted")
    flat = calibrate(SMALL_BOARD, board_views(SMALL_BOARD, SMALL, 6, tilt_deg=2.0), "flat")
    assert abs(tilted.camera.fx - SMALL.fx) < 0.01 * SMALL.fx
    # Either it says so, or it is sure of something else altogether; the reprojection error is small all the same.
    is_unsure = flat.focal_sigma_px > 5.0 * tilted.focal_sigma_px
    assert is_unsure or abs(flat.camera.fx - SMALL.fx) > 0.05 * SMALL.fx
    assert flat.error_px < 0.2


def test_views_are_the_same_every_time_and_fit() -> None:
    first, again = (board_views(SMALL_BOARD, SMALL, 2, seed=3) for _ in range(2))
    np.testing.assert_array_equal(first, again)
    assert all(SMALL_BOARD.find(view) is not None for view in first)
    strip = Camera(400, 30, 300.0, 300.0, 200.0, 15.0)
    with pytest.raises(ValueError, match="never fits"):
        board_views(SMALL_BOARD, strip, 1)


def test_rays_of_a_lens_are_those_of_its_pixels() -> None:
    plain = camera_rays(SMALL.pinhole())
    y, x = 40, 200
    np.testing.assert_allclose(plain[y, x], SMALL.rays(np.array([[x, y]]))[0], atol=1e-12)
    fine = camera_rays(SMALL.pinhole(), 2)
    np.testing.assert_allclose(fine[2 * y : 2 * y + 2, 2 * x : 2 * x + 2].mean((0, 1)), plain[y, x], atol=1e-12)
    # A barrel lens squeezes: the corner pixel looks further outward.
    assert np.linalg.norm(camera_rays(SMALL)[0, 0, :2]) > np.linalg.norm(plain[0, 0, :2])
