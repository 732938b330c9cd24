"""The recipe as a command: layout, determinism, refusal, and pictures that agree with the truth."""

from __future__ import annotations

import json
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.ndimage import map_coordinates

from acp_lab.cad.part import Part
from acp_lab.cad.raycast import EmbreeCaster
from acp_lab.geometry.pose import check_rotation, inverse, rotation_angle_deg, transform
from data_recipes.metal.cad_parts import make_part
from data_recipes.metal.edge_break import find_creases
from data_recipes.metal.look_alikes import look_alikes_in
from data_recipes.metal.motion import shake
from data_recipes.metal.plan import KINDS, Kind, SceneConfig
from data_recipes.metal.random_parts import asymmetric_parts, part_named, random_part
from data_recipes.metal.render import Renderer, RowByRowRenderer
from data_recipes.metal.scene import Scene, make_scene, scene_truth
from data_recipes.metal_sequences import main
from data_recipes.symmetries import find_symmetry

TINY = ("--size", "96x80", "--frames", "2", "--clutter", "1")


def run(out: Path, *options: str) -> int:
    return main(["--out", str(out), *TINY, *options])


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("recipe") / "set"
    options = (
        "--parts",
        "slot_block,l_bracket",
        "--kinds",
        "regular,occlusion",
        "--edge-break",
        "0,0.3",
        "--seed",
        "5",
        "--contact-sheet",
        str(out.parent / "sheet.png"),
    )
    assert run(out, *options) == 0
    return out


def test_parts_that_nobody_drew(tmp_path: Path) -> None:
    """One per sequence, by their seeds, without those that look alike from two sides."""
    names = [part.name for _, part in zip(range(2), asymmetric_parts(20), strict=False)]
    unlike = [int(name.removeprefix("random ")) for name in names]
    assert unlike == sorted(unlike)
    assert unlike[0] >= 20
    assert run(tmp_path / "set", "--random-parts", "20", "--sequences", "2") == 0
    info = json.loads((tmp_path / "set" / "models" / "models_info.json").read_text())
    assert [entry["name"] for entry in info.values()] == names
    assert not any("symmetries_discrete" in entry or "symmetries_continuous" in entry for entry in info.values())
    stored = Part.from_file(tmp_path / "set" / "models" / "obj_000002.ply").vertices
    np.testing.assert_allclose(np.ptp(stored, axis=0), np.ptp(part_named(names[1]).vertices, axis=0), atol=1e-4)


def test_a_part_with_a_symmetry_is_passed_over() -> None:
    for seed in range(60):
        part = random_part(seed)
        symmetry = find_symmetry(Part.from_mesh(part.vertices, part.faces, part.name))
        if symmetry:
            assert next(asymmetric_parts(seed)).name != part.name
            return
    raise AssertionError("no part with a symmetry among these")


def test_contact_sheet(dataset: Path) -> None:
    sheet = cv2.imread(str(dataset.parent / "sheet.png"))
    # Two scenes below each other; of two frames both, each with its edges.
    assert sheet.shape == (2 * 200 + 2, 4 * 240 + 3 * 2, 3)


def test_layout(dataset: Path) -> None:
    info = json.loads((dataset / "models" / "models_info.json").read_text())
    assert list(info) == ["1", "2"]
    for number in (1, 2):
        folder = dataset / "test" / f"{number:06d}"
        part = Part.from_file(dataset / "models" / f"obj_{number:06d}.ply")
        assert part.diameter == pytest.approx(info[str(number)]["diameter"], abs=1e-4)
        image = cv2.imread(str(folder / "rgb" / "000001.jpg"))
        assert image.shape == (80, 96, 3)
        assert image.std() > 10
        truth = json.loads((folder / "scene_gt.json").read_text())
        assert list(truth) == ["0", "1"]
        assert truth["1"][0]["obj_id"] == number
        check_rotation(np.array(truth["1"][0]["cam_R_m2c"]).reshape(3, 3), "truth")
        assert list(json.loads((folder / "scene_camera.json").read_text())) == ["0", "1"]
    meta = json.loads((dataset / "test" / "000002" / "scene_meta.json").read_text())
    assert (meta["part"], meta["kind"], meta["edge_break_mm"]) == ("l_bracket", "occlusion", 0.3)
    assert not [path for path in dataset.parent.iterdir() if path.name.startswith(".")]


def assert_same(path: Path, expected: Path) -> None:
    """To the byte; images but for rounding, which libraries do not promise: a grey that tips over moves a block."""
    if path.suffix != ".jpg":
        assert path.read_bytes() == expected.read_bytes(), path
        return
    image, other = (cv2.imread(str(each)).astype(int) for each in (path, expected))
    off = np.abs(image - other)
    assert off.max() <= 8, path
    assert (off > 0).mean() < 0.1, path


@pytest.mark.slow
def test_two_processes_render_what_one_renders(dataset: Path, tmp_path: Path) -> None:
    options = ("--parts", "slot_block,l_bracket", "--kinds", "regular,occlusion", "--edge-break", "0,0.3")
    assert run(tmp_path / "two", *options, "--seed", "5", "--jobs", "2") == 0
    paths = [path.relative_to(dataset) for path in dataset.rglob("*") if path.is_file()]
    assert len(paths) == 3 + 2 * (2 + 4)
    for path in paths:
        assert_same(tmp_path / "two" / path, dataset / path)


def test_same_seed_same_truth_and_another_seed_another(dataset: Path, tmp_path: Path) -> None:
    options = ("--parts", "slot_block", "--kinds", "regular")
    assert run(tmp_path / "same", *options, "--seed", "5") == 0
    assert run(tmp_path / "other", *options, "--seed", "6") == 0
    names = ("scene_gt.json", "scene_camera.json", "rgb/000001.jpg")
    scene = "test/000001"
    for name in names:
        assert_same(tmp_path / "same" / scene / name, dataset / scene / name)
    assert (tmp_path / "other" / scene / names[0]).read_bytes() != (dataset / scene / names[0]).read_bytes()


def test_refuses_what_is_there_without_force(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "set"
    out.mkdir()
    (out / "precious.txt").write_text("keep me")
    assert run(out, "--parts", "slot_block") == 2
    assert capsys.readouterr().err.startswith(f"error: {out} exists")
    assert (out / "precious.txt").exists()
    assert run(out, "--parts", "slot_block", "--force") == 2
    told = f"error: {out}: holds precious.txt, which no recipe writes: --force replaces a data set only"
    assert capsys.readouterr().err.startswith(told)
    assert (out / "precious.txt").read_text() == "keep me"
    (out / "precious.txt").unlink()
    (out / "models").mkdir()
    (out / "models" / "old.ply").write_text("")
    assert run(out, "--parts", "slot_block", "--force") == 0
    assert not (out / "models" / "old.ply").exists()
    assert [path.name for path in tmp_path.iterdir()] == ["set"]


@pytest.mark.parametrize(
    ("options", "word"),
    [
        (["--parts", "spoon"], "spoon"),
        (["--kinds", "slow"], "slow"),
        (["--size", "640"], "640"),
        (["--edge-break", "-1"], "-1"),
        (["--frames", "0"], "0"),
        (["--frames", "99999999"], "give 5000 at most"),
        (["--frames", "9" * 5000], "give a whole number"),
        (["--size", "16x512"], "give 32 to 4096 px"),
        (["--size", "640x100000"], "give 32 to 4096 px"),
        (["--size", "9" * 5000 + "x512"], "give WIDTHxHEIGHT"),
        (["--rot-deg-per-frame", "1e300"], "give 20 at most"),
        (["--trans-mm-per-frame", "1e300"], "give 100 at most"),
        (["--shake-deg", "1e300"], "give 10 at most"),
        (["--clutter", "1000000"], "give 100 at most"),
        (["--look-alikes", "1000000"], "give 50 at most"),
        (["--sequences", "1000000000"], "give 10000 at most"),
        (["--rot-deg-per-frame", "nan"], "nan"),
        ([], "--out"),
    ],
)
def test_bad_usage_is_one_line(options: list[str], word: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as stop:
        main(options)
    message = capsys.readouterr().err
    assert stop.value.code == 2
    assert message.startswith("error: ")
    assert message.count("\n") == 1
    assert len(message) < 1000
    assert word in message


@pytest.mark.parametrize("kind", ["regular", "rotation"])
def test_the_most_that_a_part_may_turn_can_be_planned(kind: Kind) -> None:
    part = make_part("lever_arm")
    truth = scene_truth(part, SceneConfig(kind, 5000, 640, 512, seed=2, rot_deg=20.0, trans_mm=100.0, shake_deg=10.0))
    turns_deg = [rotation_angle_deg(a[:3, :3], b[:3, :3]) for a, b in pairwise(truth.poses)]
    assert np.mean(turns_deg) > 15.0


def test_too_little_memory_is_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def fail(*_: object) -> None:
        raise MemoryError("Unable to allocate 3.05 TiB for an array")

    monkeypatch.setattr("data_recipes.metal.dataset.write_image", fail)
    assert run(tmp_path / "set", "--parts", "slot_block") == 2
    told = "error: out of memory (Unable to allocate 3.05 TiB for an array): ask for smaller or fewer pictures\n"
    assert capsys.readouterr().err == told
    assert list(tmp_path.iterdir()) == []


def test_failure_leaves_nothing_behind(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object) -> None:
        raise OSError("disk full")

    monkeypatch.setattr("data_recipes.metal.dataset.write_image", fail)
    assert run(tmp_path / "set", "--parts", "slot_block") == 2
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_shows_the_part(kind: Kind) -> None:
    scene = make_scene(make_part("lever_arm"), SceneConfig(kind, 3, 96, 80, seed=2, clutter=1))
    picture = Renderer(scene).frame(1)
    assert picture.image.shape == (80, 96, 3)
    assert np.isfinite(picture.image).all()
    assert picture.image.min() >= 0
    assert picture.part_alone.sum() > 150
    assert 0.3 < picture.part_seen.sum() / picture.part_alone.sum() <= 1.0


def test_a_camera_in_a_hand_goes_to_and_fro_about_where_it_would_be() -> None:
    hand = shake(np.random.default_rng(0), 200, 0.5)
    turns_deg = [rotation_angle_deg(np.eye(3), pose[:3, :3]) for pose in hand.poses]
    assert np.sqrt(np.square(turns_deg).mean()) == pytest.approx(0.5, rel=1e-3)
    steps_deg = [rotation_angle_deg(a[:3, :3], b[:3, :3]) for a, b in pairwise(hand.poses)]
    assert 0.2 < np.mean(steps_deg) < 1.0


@pytest.mark.parametrize("kind", ["regular", "rotation"])
def test_only_the_camera_shakes(kind: Kind) -> None:
    config = SceneConfig(kind, 8, 96, 80, seed=2, clutter=1)
    part = make_part("lever_arm")
    steady, shaken = make_scene(part, config), make_scene(part, replace(config, shake_deg=0.5))
    assert shaken.shake is not None
    for frame in range(8):
        now, before = shaken.at(frame), steady.at(frame)
        np.testing.assert_allclose(now.part.world_T_body, before.part.world_T_body, atol=1e-9)
        turned = now.world_T_cam @ shaken.shake.poses[frame]
        np.testing.assert_allclose(turned, before.world_T_cam, atol=1e-5)
        # The part's resting rotation is rounded, so its inverse is not exact.
        seen = now.world_T_cam @ shaken.cam_T_part(frame)
        np.testing.assert_allclose(seen, now.part.world_T_body, atol=1e-4)


def test_the_truth_is_the_pose_when_the_row_of_the_parts_middle_is_read() -> None:
    config = SceneConfig("fast", 6, 320, 256, seed=3, clutter=0, trans_mm=15.0)
    part = make_part("lever_arm")
    at_once, row_by_row = make_scene(part, config), make_scene(part, replace(config, readout=0.8))
    middle, apart = part.vertices.min(0) / 2 + part.vertices.max(0) / 2, []
    for frame in range(1, 5):
        np.testing.assert_array_equal(at_once.cam_T_part(frame), at_once.truth.poses[frame])
        pose = row_by_row.cam_T_part(frame)
        row = row_by_row.camera.project(transform(pose, middle)[None])[0, 1]
        time = frame + 0.8 * (row - 127.5) / 256
        np.testing.assert_allclose(pose, row_by_row.truth.at(time), atol=1e-3)
        apart.append(np.linalg.norm(transform(pose, middle) - transform(at_once.cam_T_part(frame), middle)))
    assert max(apart) > 0.5


def test_each_row_of_a_rolling_shutter_shows_its_own_moment() -> None:
    config = SceneConfig("regular", 5, 160, 128, seed=3, clutter=1, trans_mm=15.0, readout=0.8)
    scene = make_scene(make_part("lever_arm"), config)
    whole, read = Renderer(scene), RowByRowRenderer(scene).frame(2)
    light = whole.table_light(2)
    for rows in (slice(0, 16), slice(48, 64), slice(112, 128)):
        time = 2 + 0.8 * (0.5 * (rows.start + rows.stop - 1) - 63.5) / 128
        then, other = (whole.picture(2, at, light) for at in (time, 4.0 - time))
        off = np.abs(read.image[rows] - then.image[rows]).mean()
        if abs(time - 2.0) > 0.2:
            assert off < 0.5 * np.abs(read.image[rows] - other.image[rows]).mean()
        np.testing.assert_array_equal(read.part_alone[rows], then.part_alone[rows])
        np.testing.assert_array_equal(read.part_seen[rows], then.part_seen[rows])


def test_the_path_tracer_has_no_rolling_shutter(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(tmp_path / "set", "--path-traced", "--rolling-shutter", "0.8") == 2
    assert "--rolling-shutter 0.8 is not for --path-traced" in capsys.readouterr().err
    assert not (tmp_path / "set").exists()


@pytest.mark.parametrize(("kind", "seed"), [("regular", 2), ("regular", 3), ("rotation", 2)])
def test_parts_like_the_tracked_one_lie_around_it_and_touch_nothing(kind: Kind, seed: int) -> None:
    config, part = SceneConfig(kind, 3, 96, 80, seed=seed, clutter=2), make_part("lever_arm")
    alone, scene = make_scene(part, config), make_scene(part, replace(config, look_alikes=4))
    np.testing.assert_array_equal(scene.truth.poses, alone.truth.poses)
    np.testing.assert_array_equal(scene.anchor, alone.anchor)
    size = len(part.vertices)
    lying = scene.bench.vertices[: 4 * size].reshape(4, size, 3)
    assert (scene.bench.material[: 4 * len(part.faces)] == scene.part.material[0]).all()
    np.testing.assert_allclose(lying[:, :, 2].min(1), 0.0, atol=1e-9)
    lengths = [np.linalg.norm(one - one[:1], axis=1) for one in (part.vertices, *lying)]
    for other in lengths[1:]:
        np.testing.assert_allclose(other, lengths[0], rtol=1e-3)  # resting rotations are rounded
    there = list(lying) if scene.held else [transform(scene.anchor, part.vertices), *lying]
    gaps_mm = [
        min(np.linalg.norm(a[:, None, :2] - b[None, :, :2], axis=2).min() for b in there if b is not a) for a in there
    ]
    assert min(gaps_mm) > 2.9
    assert max(gaps_mm) < part.diameter


@pytest.mark.parametrize(("kind", "seed"), [("regular", 2), ("rotation", 2)])
def test_it_is_known_where_parts_like_the_tracked_one_lie_and_what_is_seen_of_them(kind: Kind, seed: int) -> None:
    config, part = SceneConfig(kind, 3, 96, 80, seed=seed, clutter=2, look_alikes=4), make_part("lever_arm")
    scene = make_scene(part, config)
    size, moment = len(part.vertices), scene.at(1.0)
    lying = scene.bench.vertices[: 4 * size].reshape(4, size, 3)
    found = look_alikes_in(scene, 1)
    for one, vertices in zip(found, lying, strict=True):
        in_camera = transform(inverse(moment.world_T_cam), vertices)
        # Resting rotations are rounded, what is told is one.
        np.testing.assert_allclose(transform(one.cam_T_obj, scene.part.vertices), in_camera, atol=0.2)
        np.testing.assert_allclose(one.cam_T_obj[:3, :3] @ one.cam_T_obj[:3, :3].T, np.eye(3), atol=1e-9)
        pixels = scene.camera.project(in_camera)
        if (pixels.max(0) < 0).any() or (pixels.min(0) > [95, 79]).any():
            assert one.visible == 0.0
    # As much as is seen in a picture without anything else.
    alone = make_scene(part, replace(config, clutter=0))
    assert all(a.visible >= b.visible for a, b in zip(look_alikes_in(alone, 1), found, strict=True))
    assert max(one.visible for one in found) > 0.5


def test_a_part_that_hides_another_is_seen_of_that_one() -> None:
    """The tracked part counts as what hides."""
    part = make_part("lever_arm")
    scene = make_scene(part, SceneConfig("regular", 2, 96, 80, seed=2, clutter=0, look_alikes=1))
    there = scene.anchor.copy()
    there[:3, 3] -= 2.0 * scene.at(0.0).world_T_cam[:3, 2]  # towards the camera, in front of the part
    there[:3, 3] += 4.0 * scene.at(0.0).world_T_cam[:3, 2]  # and behind it: its own shape hides it
    (hidden,) = look_alikes_in(replace(scene, look_alikes=(there,)), 0)
    assert hidden.visible < 0.35


def test_what_passes_in_front_is_a_part_lying_where_such_lie_around() -> None:
    config, part = SceneConfig("occlusion", 3, 96, 80, seed=2, clutter=1), make_part("lever_arm")
    scene, usual = make_scene(part, replace(config, look_alikes=2)), make_scene(part, config)
    assert scene.occluder is not None
    assert usual.occluder is not None
    np.testing.assert_array_equal(scene.occluder.vertices[: len(scene.part.vertices)], scene.part.vertices)
    assert not np.array_equal(usual.occluder.vertices[:3], scene.part.vertices[:3])
    *_, passing = look_alikes_in(scene, 1)
    np.testing.assert_allclose(passing.cam_T_obj, scene.occluder_path.at(1.0), atol=1e-9)  # type: ignore[union-attr]
    assert passing.visible > 0.5
    picture = Renderer(scene).frame(1)
    assert 0.3 < picture.part_seen.sum() / picture.part_alone.sum() < 0.9


def outline_offsets_px(scene: Scene, frame: int, radius_px: float = 3.0) -> np.ndarray:
    """Where the picture has its strongest edge across the CAD's outline at the true pose, px, outward positive (n,)."""
    part = make_part(scene.part.name)
    pose = scene.cam_T_part(frame)
    eye = inverse(pose)[:3, 3]
    creases = find_creases(part.vertices, part.faces)
    start, end = part.vertices[creases.edges[:, 0]], part.vertices[creases.edges[:, 1]]
    front_a = np.einsum("ij,ij->i", creases.normal_a, eye - start) > 0
    front_b = np.einsum("ij,ij->i", creases.normal_b, eye - start) > 0
    long = np.linalg.norm(end - start, axis=1) > 6
    keep = creases.convex & (front_a != front_b) & long
    share = np.linspace(0.1, 0.9, 9)[:, None, None]
    points = (start[keep] * (1 - share) + end[keep] * share).reshape(-1, 3)
    out = np.tile(creases.normal_a[keep] + creases.normal_b[keep], (9, 1))
    along = np.tile(end[keep] - start[keep], (9, 1))
    ray = points + 0.1 * out - eye
    clear = ~EmbreeCaster(part.vertices, part.faces).occluded(np.broadcast_to(eye, ray.shape), ray, 0.999)
    points, out, along = points[clear], out[clear], along[clear]

    def pixel(p: np.ndarray) -> np.ndarray:
        return scene.camera.project(transform(pose, p))

    centre = pixel(points)
    tangent = pixel(points + 1e-3 * along) - centre
    normal = np.stack([tangent[:, 1], -tangent[:, 0]], 1)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    normal *= np.sign(np.einsum("ij,ij->i", pixel(points + 0.1 * out) - centre, normal))[:, None]
    offsets = np.arange(-radius_px, radius_px + 0.01, 0.1)
    grey = cv2.GaussianBlur(Renderer(scene).frame(frame).image.mean(2), (0, 0), 0.8)
    at = centre[:, None] + offsets[:, None] * normal[:, None]
    profile = map_coordinates(grey, [at[..., 1], at[..., 0]], order=3, mode="nearest")
    slope = np.abs(np.gradient(profile, axis=1))
    strong = slope.max(1) > np.median(slope.max(1))
    return offsets[slope.argmax(1)][strong]


def test_outline_lies_on_the_image_edge_when_sharp_and_inside_when_broken() -> None:
    median = {}
    for edge_break in (0.0, 0.8):
        config = SceneConfig("regular", 3, 320, 256, seed=5, edge_break_mm=edge_break, clutter=0, table="print")
        scene = make_scene(make_part("slot_block"), config)
        median[edge_break] = float(np.median(outline_offsets_px(scene, 1)))
    assert abs(median[0.0]) < 0.11  # the search itself has steps of 0.1 px
    # 0.8 mm are about 0.85 px here, and outlines move inward by 0.3 to 1 of that.
    assert -0.95 < median[0.8] < -0.2
