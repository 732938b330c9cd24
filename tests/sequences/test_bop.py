"""The BOP layout: what opens, what is refused, and that damage in the middle does not stop a sequence."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from acp_lab.errors import AcpLabError, InputFileError, SequenceError
from acp_lab.sequences import BopDataset, BopScene, Frame, UnreadableFrame, open_sequence
from acp_lab.sequences.image_file import read_rgb
from acp_lab.sequences.pixel_coding import PixelCoding
from tests.sequences.tiny_dataset import (
    DIAMETER,
    HEIGHT,
    WIDTH,
    K,
    pose,
    pose_entry,
    write_dataset,
    write_image,
    write_json,
    write_models,
    write_scene,
)


@pytest.fixture
def scene_folder(tmp_path: Path) -> Path:
    return write_dataset(tmp_path / "set") / "test" / "000001"


def _edit(path: Path, change: Callable[[dict], object]) -> None:
    values = json.loads(path.read_text())
    change(values)
    write_json(path, values)


def _one_line(error: BaseException, path: Path) -> None:
    assert "\n" not in str(error)
    assert str(path) in str(error)


# What opens


def test_a_dataset_tells_its_models_and_scenes(tmp_path: Path) -> None:
    root = write_dataset(tmp_path / "set", object_ids=(1, 12))
    write_scene(root / "test" / "000007")
    (root / "test" / "notes").mkdir()
    dataset = BopDataset(root)
    assert dataset.name == "set"
    assert dataset.models() == (1, 12)
    assert dataset.scenes() == (1, 7)
    assert dataset.open_scene(7).scene_id == 7
    assert dataset.part_info(12).diameter == DIAMETER
    assert dataset.part_path(12).name == "obj_000012.ply"
    assert dataset.part(1).vertices.shape == (8, 3)


def test_a_scene_yields_its_frames_with_cameras_and_truth(scene_folder: Path) -> None:
    scene = open_sequence(scene_folder)
    assert (scene.name, scene.scene_id, scene.split) == ("set/test/000001", 1, "test")
    assert scene.frame_ids == (0, 1, 2)
    assert scene.object_ids == (1,)
    frames = list(scene.frames())
    assert [frame.index for frame in frames] == [0, 1, 2]
    for frame in frames:
        assert isinstance(frame, Frame)
        assert frame.image.shape == (HEIGHT, WIDTH, 3)
        assert frame.image[0, 0].tolist() == [200, 0, 0]
        assert frame.image[0, -1].tolist() == [10 * frame.index] * 3
        np.testing.assert_array_equal(frame.camera.matrix.ravel(), K)
        assert not frame.camera.is_distorted
        truth = scene.truth(frame.index, 1)
        assert truth is not None
        np.testing.assert_allclose(truth, pose(frame.index), atol=1e-12)
    np.testing.assert_allclose(scene.first_pose, pose(0), atol=1e-12)
    assert scene.truth(0, 2) is None
    assert scene.truth(9, 1) is None


def test_ids_have_gaps_and_suffixes_mix(tmp_path: Path) -> None:
    folder = write_scene(tmp_path / "test" / "000001", (30, 4, 9), suffix=".jpg")
    write_image(folder / "rgb" / "10.PNG")
    _edit(folder / "scene_camera.json", lambda cameras: cameras.update({"10": {"cam_K": K}}))
    (folder / "rgb" / "Thumbs.db").write_text("no image")
    (folder / "rgb" / "000011 (copy).png").write_text("no image id")
    scene = BopScene(folder)
    assert scene.frame_ids == (4, 9, 10, 30)
    assert [frame.index for frame in scene.frames()] == [4, 9, 10, 30]
    np.testing.assert_allclose(scene.first_pose, pose(4), atol=1e-12)
    assert isinstance(scene.frame(10), Frame)


def test_intrinsics_may_differ_from_frame_to_frame(scene_folder: Path) -> None:
    other = [90.0, 0.0, 20.0, 0.0, 91.0, 22.0, 0.0, 0.0, 1.0]
    _edit(scene_folder / "scene_camera.json", lambda cameras: cameras["1"].update(cam_K=other))
    cameras = [frame.camera for frame in BopScene(scene_folder).frames()]
    assert cameras[0] == cameras[2]
    assert cameras[1] is not None
    np.testing.assert_array_equal(cameras[1].matrix.ravel(), other)


def test_a_folder_of_grey_images_is_a_scene(scene_folder: Path) -> None:
    (scene_folder / "rgb").rename(scene_folder / "gray")
    for path in (scene_folder / "gray").iterdir():
        cv2.imwrite(str(path), np.full((HEIGHT, WIDTH), 77, np.uint8))
    frame = BopScene(scene_folder).frame(1)
    assert isinstance(frame, Frame)
    assert (frame.image == 77).all()


def test_relative_paths_and_links_keep_their_names(
    scene_folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    link = scene_folder.parent / "000005"
    link.symlink_to(scene_folder, target_is_directory=True)
    monkeypatch.chdir(link.parent)
    scene = open_sequence("000005")
    assert (scene.name, scene.scene_id) == ("set/test/000005", 5)
    assert scene.dataset.models() == (1,)


def test_a_dataset_with_one_scene_opens_it(scene_folder: Path) -> None:
    root = scene_folder.parent.parent
    assert open_sequence(root).scene_id == 1
    write_scene(root / "test" / "000002")
    with pytest.raises(SequenceError, match=r"scenes 1, 2: open one, as .*000001"):
        open_sequence(root)


def test_frames_are_read_only_when_asked_for(scene_folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    scene = BopScene(scene_folder)
    read: list[str] = []

    def noting(path: Path, coding: PixelCoding) -> np.ndarray:
        read.append(path.stem)
        return read_rgb(path, coding)

    monkeypatch.setattr("acp_lab.sequences.bop.read_rgb", noting)
    frames = scene.frames()
    assert read == []
    next(frames)
    assert read == ["000000"]
    assert len(list(scene.frames(max_frames=2))) == 2
    assert read == ["000000", "000000", "000001"]
    with pytest.raises(SequenceError, match="max_frames is 0"):
        scene.frames(0)


# Truth


def test_several_objects_have_first_poses_but_no_first_pose(tmp_path: Path) -> None:
    scene = BopScene(write_scene(tmp_path / "test" / "000001", object_ids=(5, 3)))
    assert scene.object_ids == (3, 5)
    assert list(scene.first_poses) == [3, 5]
    np.testing.assert_allclose(scene.first_poses[5], pose(0, 5), atol=1e-12)
    with pytest.raises(SequenceError, match=r"objects 3, 5: take first_poses\[object_id\]"):
        _ = scene.first_pose


def test_the_objects_are_those_of_the_first_frame(scene_folder: Path) -> None:
    _edit(scene_folder / "scene_gt.json", lambda truth: truth["1"].append(pose_entry(pose(1, 2), 2)))
    scene = BopScene(scene_folder)
    assert scene.object_ids == (1,)
    assert scene.ground_truth is not None
    assert scene.ground_truth.object_ids == (1, 2)


@pytest.mark.parametrize("change", [lambda truth: truth.pop("0"), lambda truth: truth.update({"0": []})])
def test_without_truth_in_the_first_frame_only_the_start_fails(
    scene_folder: Path, change: Callable[[dict], object]
) -> None:
    _edit(scene_folder / "scene_gt.json", change)
    scene = BopScene(scene_folder)
    assert len(list(scene.frames())) == 3
    assert scene.object_ids == ()
    assert scene.truth(1, 1) is not None
    with pytest.raises(SequenceError, match="no pose for the first image, 0"):
        _ = scene.first_poses


def test_a_scene_without_truth_opens(scene_folder: Path) -> None:
    (scene_folder / "scene_gt.json").unlink()
    scene = BopScene(scene_folder)
    assert scene.object_ids == ()
    assert scene.truth(0, 1) is None
    with pytest.raises(SequenceError, match=r"scene_gt\.json: no such file"):
        _ = scene.first_pose


def test_truth_is_handed_out_as_a_copy(scene_folder: Path) -> None:
    scene = BopScene(scene_folder)
    scene.first_pose[:] = 0
    np.testing.assert_allclose(scene.first_pose, pose(0), atol=1e-12)


@pytest.mark.parametrize("frame", ["0", "2"])
def test_two_instances_of_an_object_are_refused(scene_folder: Path, frame: str) -> None:
    _edit(scene_folder / "scene_gt.json", lambda truth: truth[frame].append(pose_entry(pose(7))))
    with pytest.raises(SequenceError, match=f"image {frame} shows object 1 more than once") as error:
        BopScene(scene_folder)
    _one_line(error.value, scene_folder / "scene_gt.json")
    with pytest.raises(SequenceError):
        BopScene(scene_folder, asked=(1, 2))
    # Whoever asks for no pose of it, or for the ids alone, need not care.
    assert 1 in BopScene(scene_folder, asked=(2,)).object_ids
    assert 1 in BopScene(scene_folder, asked=()).object_ids


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda truth: truth["1"][0].pop("obj_id"), "image 1 has a pose without obj_id"),
        (lambda truth: truth["1"][0].update(obj_id="x"), "obj_id is 'x': give a whole number"),
        (lambda truth: truth["1"][0].update(obj_id=-1), "obj_id is -1"),
        (lambda truth: truth["1"][0].update(obj_id=10**400), "obj_id is 1000"),
        (lambda truth: truth["1"][0].update(cam_t_m2c=[10**400, 0, 0]), "cam_t_m2c holds 1000"),
        (lambda truth: truth["1"][0].pop("cam_R_m2c"), "image 1, object 1 lacks cam_R_m2c"),
        (lambda truth: truth["1"][0].update(cam_t_m2c=[1, 2]), "give a list of 3 numbers"),
        (lambda truth: truth["1"][0].update(cam_R_m2c=[0] * 9), "image 1, object 1: cam_R_m2c: not a rot"),
        (lambda truth: truth.update({"1": {}}), "image 1 has no list of poses"),
        (lambda truth: truth.update({"one": []}), "the image id is 'one'"),
    ],
)
def test_malformed_truth_is_refused(
    scene_folder: Path, change: Callable[[dict], object], message: str
) -> None:
    _edit(scene_folder / "scene_gt.json", change)
    with pytest.raises(InputFileError, match=message) as error:
        BopScene(scene_folder)
    _one_line(error.value, scene_folder / "scene_gt.json")


# Cameras


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda cameras: cameras.pop("2"), "image 2 has no cam_K"),
        # The file is checked whole: a run must not end at the frame where the fault is.
        (lambda cameras: cameras["2"].update(cam_K=[1e-300, 0, 30, 0, 600, 20, 0, 0, 1]), "image 2: fx is 1e-300 px"),
        (lambda cameras: cameras["2"].update(cam_K=[600, 0, 30, 0, 1e9, 20, 0, 0, 1]), r"image 2: fy is 1e\+09 px"),
        (lambda cameras: cameras["2"].update(cam_K=[10**400] * 9), "image 2: cam_K holds 1000"),
        (lambda cameras: cameras["1"].pop("cam_K"), "image 1 has no cam_K"),
        (lambda cameras: cameras["1"].update(cam_K=K[:8]), "image 1: cam_K is .*: give a list of 9 numbers"),
        (lambda cameras: cameras["1"].update(cam_K=[0] * 9), "image 1: camera matrix"),
        (lambda cameras: cameras["1"].update(cam_K=[-1.0, *K[1:]]), "image 1: camera focal lengths"),
        (
            lambda cameras: cameras["0"].update(cam_K=[160, 0, 63.5, 0, 160, 47.5, 0, 0, 1]),
            "do not fit the im",
        ),
        (lambda cameras: cameras["0"].update(cam_K=[80, 0, 31, 0, 80, -1, 0, 0, 1]), "do not fit the image"),
    ],
)
def test_cameras_that_do_not_fit_are_refused(
    scene_folder: Path, change: Callable[[dict], object], message: str
) -> None:
    _edit(scene_folder / "scene_camera.json", change)
    with pytest.raises(InputFileError, match=message) as error:
        BopScene(scene_folder)
    _one_line(error.value, scene_folder / "scene_camera.json")


# Images


@pytest.mark.parametrize("content", [b"", b"junk", None])
def test_an_unreadable_frame_in_the_middle_is_yielded(scene_folder: Path, content: bytes | None) -> None:
    path = scene_folder / "rgb" / "000001.png"
    path.write_bytes(path.read_bytes()[:-30] if content is None else content)
    frames = list(BopScene(scene_folder).frames())
    assert [type(frame) for frame in frames] == [Frame, UnreadableFrame, Frame]
    bad = frames[1]
    assert isinstance(bad, UnreadableFrame)
    assert bad.index == 1
    assert bad.camera == frames[0].camera
    assert str(path) in bad.reason
    assert "\n" not in bad.reason


def test_a_frame_of_another_size_is_unreadable(scene_folder: Path) -> None:
    write_image(scene_folder / "rgb" / "000002.png", width=50)
    bad = list(BopScene(scene_folder).frames())[2]
    assert isinstance(bad, UnreadableFrame)
    assert "000002.png: image is 50 x 48 px but the first one of the scene is 64 x 48" in bad.reason


def test_a_frame_that_vanishes_after_opening_is_unreadable(scene_folder: Path) -> None:
    scene = BopScene(scene_folder)
    (scene_folder / "rgb" / "000001.png").unlink()
    assert isinstance(scene.frame(1), UnreadableFrame)


def test_an_unreadable_first_image_is_an_error(scene_folder: Path) -> None:
    (scene_folder / "rgb" / "000000.png").write_bytes(b"")
    with pytest.raises(InputFileError, match="the file is empty") as error:
        BopScene(scene_folder)
    _one_line(error.value, scene_folder / "rgb" / "000000.png")


def test_two_files_for_one_image_are_refused(scene_folder: Path) -> None:
    write_image(scene_folder / "rgb" / "000001.jpg")
    with pytest.raises(InputFileError, match=r"image 1 has another file"):
        BopScene(scene_folder)


# Missing things


def _without(name: str) -> Callable[[Path], object]:
    return lambda folder: (folder / name).unlink()


def _emptied(folder: Path) -> None:
    for path in (folder / "rgb").iterdir():
        path.unlink()


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (_without("scene_camera.json"), r"scene_camera\.json: no such file: it gives per image"),
        (
            lambda folder: (folder / "scene_camera.json").write_text(""),
            r"scene_camera\.json: the file is empty",
        ),
        (
            lambda folder: (folder / "scene_camera.json").write_text("{"),
            r"scene_camera\.json: not valid JSON",
        ),
        (lambda folder: (folder / "scene_gt.json").write_text("[]"), r"scene_gt\.json: holds no JSON object"),
        (lambda folder: (folder / "rgb").rename(folder / "images"), "rgb: no such folder"),
        (_emptied, "rgb: holds no images"),
    ],
)
def test_missing_or_empty_files_are_one_line(
    scene_folder: Path, damage: Callable[[Path], object], message: str
) -> None:
    damage(scene_folder)
    with pytest.raises(AcpLabError, match=message) as error:
        BopScene(scene_folder)
    _one_line(error.value, scene_folder)


def test_unknown_scenes_objects_splits_and_images(scene_folder: Path) -> None:
    dataset = BopDataset(scene_folder.parent.parent)
    with pytest.raises(SequenceError, match="no scene 4: it has scene 1"):
        dataset.open_scene(4)
    with pytest.raises(SequenceError, match=r"obj_000009\.ply: no such model: the data set has object 1"):
        dataset.part_path(9)
    with pytest.raises(SequenceError, match=r"models_info\.json: no object 9: it has object 1"):
        dataset.part_info(9)
    with pytest.raises(InputFileError, match="train: no such folder"):
        dataset.scenes("train")
    with pytest.raises(SequenceError, match="no image 8: it has 3, ids 0 to 2"):
        dataset.open_scene(1).frame(8)


def test_paths_that_are_no_sequence(tmp_path: Path) -> None:
    with pytest.raises(InputFileError, match="no such folder"):
        BopDataset(tmp_path / "none")
    with pytest.raises(InputFileError, match="no such folder: give a scene folder"):
        open_sequence(tmp_path / "none")
    with pytest.raises(InputFileError, match="neither a scene"):
        open_sequence(tmp_path)
    (tmp_path / "clip.mp4").write_bytes(b"")
    with pytest.raises(InputFileError, match="a file needs its camera"):
        open_sequence(tmp_path / "clip.mp4")
    (tmp_path / "test").mkdir()
    with pytest.raises(InputFileError, match="holds no scene"):
        open_sequence(tmp_path)
    with pytest.raises(InputFileError, match="named by its id"):
        BopScene(write_scene(tmp_path / "test" / "kitchen"))


def test_a_model_without_info_or_info_without_model(tmp_path: Path) -> None:
    write_models(tmp_path, {1: {}})
    (tmp_path / "models" / "models_info.json").unlink()
    with pytest.raises(InputFileError, match=r"models_info\.json"):
        BopDataset(tmp_path).part(1)


def test_the_shared_sequences_open(shared_data: Path) -> None:
    for root in (shared_data / "metal_public", shared_data / "bcot_cat"):
        dataset = BopDataset(root)
        for scene_id in dataset.scenes():
            scene = dataset.open_scene(scene_id)
            assert scene.first_pose.shape == (4, 4)
            assert len(scene.frame_ids) >= 30
            frame = next(iter(scene.frames(1)))
            assert isinstance(frame, Frame)
            assert frame.image.shape == (512, 640, 3)
