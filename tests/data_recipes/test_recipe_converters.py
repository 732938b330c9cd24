"""Converters: what comes in comes out in the BOP layout, and what is wrong is one line with its fix."""

from __future__ import annotations

import json
import shutil
import signal
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from acp_lab.geometry.pose import make_pose, so3_exp
from acp_lab.sequences import BopDataset, Frame
from data_recipes import bcot, rbot, rt_less, t_less
from tests.data_recipes.fake_downloads import (
    Views,
    tiny_views,
    write_bcot,
    write_image,
    write_mesh,
    write_rbot,
    write_rt_less,
    write_t_less,
)

Main = Callable[[list[str]], int]


def convert(main: Main, source: Path, out: Path, *options: str) -> BopDataset:
    assert main([str(source), "--out", str(out), *options]) == 0
    assert [path.name for path in out.parent.iterdir() if path.name.startswith(".")] == []
    return BopDataset(out)


def refusal(main: Main, arguments: list[str], capsys: pytest.CaptureFixture[str]) -> str:
    """The one error line; nothing else may be said."""
    assert main(arguments) == 2
    said = capsys.readouterr().err
    assert said.startswith("error: ")
    assert said.count("\n") == 1
    return said


def check_against(dataset: BopDataset, views: Views, scene_id: int = 1, own_cameras: bool = False) -> None:
    """Images, cameras and poses of a scene are those of the views, in their order."""
    scene = dataset.open_scene(scene_id)
    (object_id,) = scene.object_ids
    assert len(scene.frame_ids) == len(views.images)
    for i, frame in enumerate(scene.frames()):
        assert isinstance(frame, Frame)
        np.testing.assert_array_equal(frame.image, views.images[i])
        np.testing.assert_allclose(frame.camera.matrix, views.matrices[i if own_cameras else 0], atol=1e-9)
        truth = scene.truth(frame.index, object_id)
        assert truth is not None
        np.testing.assert_allclose(truth, views.poses[i], atol=1e-9)
    part = dataset.part(object_id)
    np.testing.assert_allclose((part.box_min, part.box_max), (views.vertices.min(0), views.vertices.max(0)), atol=1e-4)


# What comes in comes out


@pytest.mark.parametrize("metres", [True, False])
@pytest.mark.parametrize("keys", [("cam_R_m2c", "cam_t_m2c"), ("m2c_R", "m2c_T")])
def test_rt_less(tmp_path: Path, metres: bool, keys: tuple[str, str], capsys: pytest.CaptureFixture[str]) -> None:
    views = tiny_views()
    write_rt_less(tmp_path / "in", views, metres=metres, keys=keys)
    dataset = convert(rt_less.main, tmp_path / "in", tmp_path / "out", "--group", "2")
    check_against(dataset, views)
    assert dataset.models() == (3,)
    assert not dataset.part_info(3).symmetries
    assert "scene 1: scene 1, object 3, 8 frames, 3.44 degrees" in capsys.readouterr().out
    meta = json.loads((tmp_path / "out" / "test" / "000001" / "scene_meta.json").read_text())
    assert meta["images"][:2] == ["rgb/1.png", "rgb/2.png"]


def test_the_next_commands_can_be_pasted(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_rt_less(tmp_path / "in", tiny_views())
    convert(rt_less.main, tmp_path / "in", tmp_path / "my set")
    said = capsys.readouterr().out
    assert f"acp-lab prepare '{tmp_path}/my set/models'/*.ply --out PARTS_DIR" in said
    assert f"acp-lab track '{tmp_path}/my set'\n" in said


def test_rt_less_orders_images_and_tells_symmetric_parts(tmp_path: Path) -> None:
    views = tiny_views(9)
    shuffled = [0, 5, 2, 7, 1, 8, 4, 3, 6]
    images, poses = [views.images[i] for i in shuffled], [views.poses[i] for i in shuffled]
    mixed = Views(images, views.matrices, poses, *_mesh(views))
    write_rt_less(tmp_path / "in", mixed, object_id=1)
    dataset = convert(rt_less.main, tmp_path / "in", tmp_path / "out")
    check_against(dataset, views)
    assert len(dataset.part_info(1).symmetries.discrete) == 3  # a box
    unordered = convert(rt_less.main, tmp_path / "in", tmp_path / "file", "--order", "file")
    check_against(unordered, mixed)
    assert unordered.open_scene(1).frame_ids == tuple(range(1, 10))  # as in the source
    assert dataset.open_scene(1).frame_ids == tuple(range(9))  # of an order that is ours


def test_rt_less_training_images_are_passed_over(tmp_path: Path) -> None:
    write_rt_less(tmp_path / "in", tiny_views())
    shutil.copytree(tmp_path / "in" / "Testing images(512#512)" / "scene1", tmp_path / "in" / "train" / "obj3")
    assert BopDataset(tmp_path / "in").name == "in"
    assert convert(rt_less.main, tmp_path / "in", tmp_path / "out").scenes() == (1,)


def test_t_less_keeps_the_intrinsics_of_each_image(tmp_path: Path) -> None:
    views = tiny_views()
    write_t_less(tmp_path / "in", views)
    dataset = convert(t_less.main, tmp_path / "in", tmp_path / "out", "--group", "1")
    check_against(dataset, views, own_cameras=True)


def test_t_less_tells_instances_apart_by_their_place_in_the_world(tmp_path: Path) -> None:
    views = tiny_views()
    beside = make_pose(so3_exp(np.array([0.0, 0.0, 1.0])), np.array([80.0, 0.0, 0.0]))
    write_t_less(tmp_path / "in", views, [(6, beside), (9, beside)])
    # In every second image the two instances are listed the other way round.
    path = tmp_path / "in" / "test_primesense" / "000001" / "scene_gt.json"
    truth = json.loads(path.read_text())
    for number in (1, 3, 5, 7):
        entries = truth[str(number)]
        truth[str(number)] = [entries[1], entries[0], entries[2]]
    path.write_text(json.dumps(truth))
    dataset = convert(t_less.main, tmp_path / "in", tmp_path / "out", "--objects", "6,9")
    assert [dataset.open_scene(i).object_ids for i in dataset.scenes()] == [(6,), (6,), (9,)]
    check_against(dataset, views, 1, own_cameras=True)
    second = Views(views.images, views.matrices, [pose @ beside for pose in views.poses], *_mesh(views))
    check_against(dataset, second, 2, own_cameras=True)


def test_t_less_leaves_out_instances_that_cannot_be_told_apart(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    beside = make_pose(np.eye(3), np.array([80.0, 0.0, 0.0]))
    write_t_less(tmp_path / "in", tiny_views(), [(9, beside), (9, np.eye(4))], worlds=False)
    dataset = convert(t_less.main, tmp_path / "in", tmp_path / "out")
    assert dataset.scenes() == (1,)
    assert dataset.open_scene(1).object_ids == (6,)
    assert "note: scene 1: object 9 is there more than once" in capsys.readouterr().err


def test_t_less_leaves_out_images_that_hardly_show_the_part(tmp_path: Path) -> None:
    views = tiny_views()
    write_t_less(tmp_path / "in", views)
    path = tmp_path / "in" / "test_primesense" / "000001" / "scene_gt_info.json"
    path.write_text(json.dumps({str(i): [{"visib_fract": 0.1 if i == 7 else 0.9}] for i in range(8)}))
    assert len(convert(t_less.main, tmp_path / "in", tmp_path / "out").open_scene(1).frame_ids) == 7


def test_images_that_are_left_out_leave_a_gap(tmp_path: Path) -> None:
    write_t_less(tmp_path / "in", tiny_views())
    scene = tmp_path / "in" / "test_primesense" / "000001"
    shares = {str(i): [{"visib_fract": 0.1 if i == 5 else 0.9}] for i in range(8)}
    (scene / "scene_gt_info.json").write_text(json.dumps(shares))
    (scene / "rgb" / "000003.png").unlink()
    dataset = convert(t_less.main, tmp_path / "in", tmp_path / "out", "--order", "file")
    assert dataset.open_scene(1).frame_ids == (0, 1, 2, 4, 6, 7)


def test_t_less_checks_without_writing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_t_less(tmp_path / "in", tiny_views())
    assert t_less.main([str(tmp_path / "in")]) == 0
    assert capsys.readouterr().out.startswith("scene 1: scene 1, object 6, 8 frames")
    assert [path.name for path in tmp_path.iterdir()] == ["in"]


def test_bcot(tmp_path: Path) -> None:
    views = tiny_views()
    write_bcot(tmp_path / "in", views, "Lamp Clamp")
    dataset = convert(bcot.main, tmp_path / "in", tmp_path / "out")
    check_against(dataset, views)
    assert dataset.models() == (bcot.BODIES.index("Lamp Clamp") + 1,)
    (tmp_path / "in" / "easy_static_trans" / "K.txt").write_text("80.0 0 31.5\n0 8.0e1 23.5\n0 0 1\n")
    check_against(convert(bcot.main, tmp_path / "in", tmp_path / "plain", "--bodies", "Lamp Clamp"), views)


def test_rbot_moves_the_principal_point_by_half_a_pixel(tmp_path: Path) -> None:
    views = tiny_views()
    write_rbot(tmp_path / "in", views)  # writes it half a pixel off, as the data set does
    check_against(convert(rbot.main, tmp_path / "in", tmp_path / "out", "--sequences", "a_regular"), views)


def test_archives_do_as_well_as_folders(tmp_path: Path) -> None:
    views = tiny_views()
    write_rt_less(tmp_path / "in", views)
    archive = tmp_path / "set.zip"
    with zipfile.ZipFile(archive, "w") as file:
        for path in (tmp_path / "in").rglob("*"):
            file.write(path, path.relative_to(tmp_path / "in"))
    check_against(convert(rt_less.main, archive, tmp_path / "sub" / "out"), views)
    assert [path.name for path in (tmp_path / "sub").iterdir()] == ["out"]


def test_the_sources_stay_as_they_were(tmp_path: Path) -> None:
    write_bcot(tmp_path / "in", tiny_views())
    before = {path: path.read_bytes() for path in (tmp_path / "in").rglob("*") if path.is_file()}
    convert(bcot.main, tmp_path / "in", tmp_path / "out")
    convert(bcot.main, tmp_path / "in", tmp_path / "out", "--force", "--max-frames", "6")
    assert len(BopDataset(tmp_path / "out").open_scene(1).frame_ids) == 6
    assert {path: path.read_bytes() for path in (tmp_path / "in").rglob("*") if path.is_file()} == before


def _mesh(views: Views) -> tuple[np.ndarray, np.ndarray]:
    return views.vertices, views.faces


# What is wrong is said


def _replace(path: Path, old: str, new: str) -> None:
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))


SCENE = Path("Testing images(512#512)/scene1")


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda root: shutil.rmtree(root / "CADmodels"), "no CAD models"),
        (lambda root: shutil.rmtree(root / SCENE), "no scenes"),
        (lambda root: (root / SCENE / "Intrinsic.yml").unlink(), "Intrinsic.yml: no such file"),
        (lambda root: (root / SCENE / "rgb" / "4.png").unlink(), "image 4 is missing"),
        (lambda root: (root / SCENE / "rgb" / "4.png").write_bytes(b"\x89PNG\r\n\x1a\n"), "4.png: PNG is cut short"),
        (lambda root: (root / SCENE / "gt.yml").write_text("'1':\n- cam_R_m2c: ["), "gt.yml: not valid YAML"),
        (lambda root: (root / SCENE / "gt.yml").write_text(""), "gt.yml: is empty"),
        (lambda root: (root / SCENE / "Intrinsic.yml").write_text("Intrinsic: [[80, 0], [0, 80]]"), "9 finite numbers"),
        (lambda root: (root / SCENE / "Intrinsic.yml").write_text("Intrinsic: [900, 0, 512, 0, 900, 384, 0, 0, 1]"),
         "principal point (512, 384) lies outside the image of 64 x 48"),
        (lambda root: _replace(root / SCENE / "gt.yml", "cam_R_m2c: [[1.0", "cam_R_m2c: [[1.5"), "rotation"),
        (lambda root: _replace(root / SCENE / "gt.yml", "cam_t_m2c", "cam_x_m2c"), "has neither cam_t_m2c nor m2c_T"),
        (lambda root: write_mesh(root / "CADmodels" / "ply" / "obj3.ply", tiny_views(1), 1e-6), "give --unit"),
        (lambda root: (root / "CADmodels" / "ply" / "obj3.ply").rename(root / "CADmodels" / "ply" / "obj4.ply"),
         "no CAD model of object 3: there are 4"),
    ],
)  # fmt: skip
def test_bad_rt_less(
    tmp_path: Path, spoil: Callable[[Path], object], words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    write_rt_less(tmp_path / "in", tiny_views())
    spoil(tmp_path / "in")
    assert words in refusal(rt_less.main, [str(tmp_path / "in"), "--out", str(tmp_path / "out")], capsys)
    assert [path.name for path in tmp_path.iterdir()] == ["in"]


TEST = Path("test_primesense/000001")


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda root: shutil.rmtree(root / "models_cad"), "no models_cad or models with models_info.json"),
        (lambda root: shutil.rmtree(root / "test_primesense"), "no scene with scene_gt.json: give the images"),
        (lambda root: shutil.copytree(root / "test_primesense", root / "test_kinect"), "name one of them with --split"),
        (lambda root: (root / TEST / "scene_camera.json").unlink(), "scene_camera.json: no such file"),
        (lambda root: _replace(root / TEST / "scene_camera.json", '"cam_K": [80.0, ', '"cam_K": ['), "cam_K is"),
        (lambda root: _replace(root / TEST / "scene_gt.json", '"cam_R_m2c": [1.0', '"cam_R_m2c": [0.5'), "cam_R_m2c"),
        (lambda root: _replace(root / TEST / "scene_gt.json", '"obj_id": 6', '"id": 6'), "without obj_id"),
        (lambda root: write_mesh(root / "models_cad" / "obj_000006.ply", tiny_views(1), 0.001), "looks like metres"),
    ],
)  # fmt: skip
def test_bad_t_less(
    tmp_path: Path, spoil: Callable[[Path], object], words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    write_t_less(tmp_path / "in", tiny_views())
    spoil(tmp_path / "in")
    assert words in refusal(t_less.main, [str(tmp_path / "in"), "--out", str(tmp_path / "out")], capsys)
    assert [path.name for path in tmp_path.iterdir()] == ["in"]


BODY = Path("easy_static_trans/Lego")


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda root: (root / "models" / "Lego.obj").unlink(), "no models/Lego.obj"),
        (lambda root: (root / BODY / "pose.txt").unlink(), "pose.txt: no such file"),
        (lambda root: (root / BODY / "0003.png").unlink(), "0003.png: no such image"),
        (lambda root: (root / BODY / "pose.txt").write_text("1 2 3\n"), "line 1 is '1 2 3': must hold 12 numbers"),
        (lambda root: (root / BODY / "pose.txt").write_text("0.5 0 0 0 1 0 0 0 1 0 0 300\n" * 8), "line 1"),
        (lambda root: (root / BODY.parent / "K.txt").write_text("80 0 31\n"), "K.txt: holds 3 numbers"),
        (lambda root: shutil.rmtree(root / BODY), "none of the bodies asked for"),
    ],
)
def test_bad_bcot(
    tmp_path: Path, spoil: Callable[[Path], object], words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    write_bcot(tmp_path / "in", tiny_views())
    spoil(tmp_path / "in")
    assert words in refusal(bcot.main, [str(tmp_path / "in"), "--out", str(tmp_path / "out")], capsys)
    assert [path.name for path in tmp_path.iterdir()] == ["in"]


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda root: (root / "poses_first.txt").unlink(), "no poses_first.txt"),
        (lambda root: (root / "camera_calibration.txt").unlink(), "camera_calibration.txt: no such file"),
        (lambda root: (root / "camera_calibration.txt").write_text("heading\n80 80\n"), "must hold at least 4 numbers"),
        (lambda root: (root / "cat" / "frames" / "a_regular0002.png").unlink(), "a_regular0002.png: no such image"),
        (lambda root: (root / "cat" / "cat.obj").unlink(), "holds none of its bodies"),
    ],
)
def test_bad_rbot(
    tmp_path: Path, spoil: Callable[[Path], object], words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    write_rbot(tmp_path / "in", tiny_views())
    spoil(tmp_path / "in")
    arguments = [str(tmp_path / "in"), "--out", str(tmp_path / "out"), "--sequences", "a_regular"]
    assert words in refusal(rbot.main, arguments, capsys)
    assert [path.name for path in tmp_path.iterdir()] == ["in"]


def test_fewer_poses_than_images_are_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_rbot(tmp_path / "in", tiny_views())
    poses = tmp_path / "in" / "poses_first.txt"
    poses.write_text("".join(poses.read_text().splitlines(keepends=True)[:-1]))
    arguments = [str(tmp_path / "in"), "--out", str(tmp_path / "out"), "--sequences", "a_regular"]
    assert "a_regular has 8 images, but poses_first.txt 7 poses" in refusal(rbot.main, arguments, capsys)


@pytest.mark.parametrize(
    ("main", "write", "names"),
    [
        (bcot.main, write_bcot, ("--bodies", "Lego,Lego", "--sequences", "easy_static_trans,easy_static_trans")),
        (rbot.main, write_rbot, ("--bodies", "cat,cat", "--sequences", "a_regular,a_regular")),
    ],
)
def test_what_is_named_twice_comes_once(
    tmp_path: Path, main: Main, write: Callable[[Path, Views], Path], names: tuple[str, ...]
) -> None:
    write(tmp_path / "in", tiny_views())
    assert convert(main, tmp_path / "in", tmp_path / "out", *names).scenes() == (1,)


def test_a_body_that_a_sequence_lacks_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_bcot(tmp_path / "in", tiny_views())
    convert(bcot.main, tmp_path / "in", tmp_path / "out", "--bodies", "Lego,Cat")
    assert "easy_static_trans: has no Cat: left out" in capsys.readouterr().err


def test_two_sequences_of_one_name_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Each has its camera matrix, and its frames."""
    write_bcot(tmp_path / "in" / "first", tiny_views())
    write_bcot(tmp_path / "in" / "second", tiny_views())
    said = refusal(bcot.main, [str(tmp_path / "in"), "--out", str(tmp_path / "out")], capsys)
    assert "sequence easy_static_trans is in " in said


def test_fewer_images_than_poses_are_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_rbot(tmp_path / "in", tiny_views())
    (tmp_path / "in" / "cat" / "frames" / "a_regular0007.png").unlink()
    convert(rbot.main, tmp_path / "in", tmp_path / "out", "--sequences", "a_regular")
    assert "a_regular has 7 of 8 images" in capsys.readouterr().err


@pytest.mark.parametrize("how", ["terminated", "interrupted"])
def test_a_recipe_that_is_stopped_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, how: str) -> None:
    write_bcot(tmp_path / "in", tiny_views())

    def stop(*_: object) -> None:
        assert any(path.name.startswith(".out.") for path in tmp_path.iterdir())
        if how == "interrupted":
            raise KeyboardInterrupt
        signal.raise_signal(signal.SIGTERM)

    monkeypatch.setattr("data_recipes.convert.write_scene", stop)
    arguments = [str(tmp_path / "in"), "--out", str(tmp_path / "out")]
    if how == "interrupted":
        assert bcot.main(arguments) == 130
    else:
        with pytest.raises(SystemExit) as ended:
            bcot.main(arguments)
        assert ended.value.code == 128 + signal.SIGTERM
    assert [path.name for path in tmp_path.iterdir()] == ["in"]


@pytest.mark.parametrize("main", [rt_less.main, t_less.main, bcot.main, rbot.main])
def test_what_holds_for_all(main: Main, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    missing = tmp_path / "missing.zip"
    assert "no such file or folder" in refusal(main, [str(missing), "--out", str(tmp_path / "out")], capsys)
    inside = tmp_path / "in"
    inside.mkdir()
    assert "holds the source" in refusal(main, [str(inside), "--out", str(inside)], capsys)
    assert "holds the source" in refusal(main, [str(inside), "--out", str(tmp_path), "--force"], capsys)
    for wrong in ([str(inside), "--max-frames", "0"], [], [str(inside), "--nonsense"]):
        with pytest.raises(SystemExit) as stop:
            main(wrong)
        assert stop.value.code == 2
        said = capsys.readouterr().err
        assert said.startswith("error: ")
        assert said.count("\n") == 1


@pytest.mark.parametrize(("options", "words"), [
    (("--objects", "5"), "none of its 1 scenes shows one of the objects asked for"),
    (("--scenes", "2"), "no scene 2: there are 1"),
    (("--min-frames", "20"), "no sequence of at least 20 frames"),
])  # fmt: skip
def test_what_is_not_there(
    tmp_path: Path, options: tuple[str, ...], words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    write_rt_less(tmp_path / "in", tiny_views())
    main_arguments = [str(tmp_path / "in"), "--out", str(tmp_path / "out"), *options]
    assert rt_less.main(main_arguments) == 2
    assert words in capsys.readouterr().err


def test_raw_pictures_keep_what_says_how_they_are_meant(tmp_path: Path) -> None:
    views = tiny_views()
    images = [np.repeat(image[..., :1], 3, 2) for image in views.images]
    grey = Views(images, views.matrices, views.poses, *_mesh(views))
    write_t_less(tmp_path / "in", grey)
    folder = tmp_path / "in" / "test_primesense" / "000001"
    for i, image in enumerate(grey.images):
        write_image(folder / "rgb" / f"{i:06d}.png", image[..., 0].astype(np.uint16)[..., None] * 16)
    (folder / "rgb" / "pixels.json").write_text('{"bits": 12}')
    dataset = convert(t_less.main, tmp_path / "in", tmp_path / "out")
    frame = dataset.open_scene(1).frame(0)
    assert isinstance(frame, Frame)
    assert np.abs(frame.image.astype(int) - grey.images[0]).max() <= 1
