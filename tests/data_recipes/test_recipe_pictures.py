"""Short cuts of the renderer change nothing that matters, the path tracer shows the same scene, sheets the truth."""

from __future__ import annotations

import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from acp_lab.sample import sample_dataset
from acp_lab.sequences import BopDataset, Frame
from data_recipes import contact_sheet as sheets
from data_recipes.metal import primary_hits, render_pass
from data_recipes.metal.cad_parts import make_part
from data_recipes.metal.path_traced import path_tracer
from data_recipes.metal.plan import SceneConfig
from data_recipes.metal.render import Picture, Renderer
from data_recipes.metal.scene import Scene, make_scene
from data_recipes.metal.sensor import tone
from data_recipes.metal_sequences import main as metal_sequences
from tests.sequences.tiny_dataset import write_dataset


@pytest.fixture(scope="module")
def scene() -> Scene:
    return make_scene(make_part("v_block"), SceneConfig("occlusion", 4, 96, 80, seed=2, clutter=4))


@pytest.fixture(scope="module")
def picture(scene: Scene) -> Picture:
    return Renderer(scene).frame(1)


def test_rays_are_only_cast_where_a_body_may_be_seen_and_none_is_missed(
    scene: Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    moment, camera = scene.at(1.0), scene.camera
    u, v = np.meshgrid(np.arange(96.0), np.arange(80.0))
    rays = camera.rays(np.stack([u.ravel(), v.ravel()], 1)) @ moment.world_T_cam[:3, :3].T
    quick = primary_hits.nearest_hits(moment, rays, camera)
    monkeypatch.setattr(primary_hits, "_NEAR_MM", np.inf)  # every pixel is asked about every body
    whole = primary_hits.nearest_hits(moment, rays, camera)
    for name in ("distance", "owner", "face", "alone"):
        np.testing.assert_array_equal(getattr(quick, name), getattr(whole, name))
    again = primary_hits.nearest_hits(moment, rays, camera, quick.bench)
    np.testing.assert_array_equal(again.owner, whole.owner)
    assert {0, len(moment.bodies) - 1} <= set(whole.owner.tolist())


def test_colours_kept_from_pass_to_pass_only_change_the_grain(
    scene: Scene, picture: Picture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(render_pass, "_KEPT_SAMPLES", 100)  # shade everything anew
    anew = Renderer(scene).frame(1)
    np.testing.assert_array_equal(anew.part_seen, picture.part_seen)
    bench = ~cv2.dilate(picture.part_alone.astype(np.uint8), np.ones((3, 3))).astype(bool)
    difference = (anew.image - picture.image).mean(2)
    assert 0 < np.abs(difference)[bench].mean() < 0.01
    assert abs(difference[bench].mean()) < 1e-3


def test_the_second_frame_does_not_remember_the_first(scene: Scene, picture: Picture) -> None:
    renderer = Renderer(scene)
    renderer.frame(0)
    np.testing.assert_array_equal(renderer.frame(1).image, picture.image)


def test_the_path_tracer_shows_the_same_scene(scene: Scene, picture: Picture) -> None:
    pytest.importorskip("mitsuba", reason="path tracing needs Mitsuba: pip install acp_lab[path-traced]")
    traced = path_tracer(scene, 16).frame(1)
    assert traced.image.shape == picture.image.shape
    assert np.isfinite(traced.image).all()
    disagree = (traced.part_seen != picture.part_seen).mean()
    assert disagree < 0.01
    grey = [cv2.GaussianBlur(tone(p.image.mean(2)).astype(np.float32), (0, 0), 1.5) for p in (traced, picture)]
    assert np.corrcoef(grey[0].ravel(), grey[1].ravel())[0, 1] > 0.5
    assert 0.5 < traced.image.mean() / picture.image.mean() < 1.5


def test_pixels_of_the_path_tracer_look_where_those_of_the_camera_do(scene: Scene) -> None:
    """A principal point on the wrong side of the middle shifts the image by a few px beside the truth."""
    mi = pytest.importorskip("mitsuba", reason="path tracing needs Mitsuba: pip install acp_lab[path-traced]")
    camera, world_T_cam = scene.camera, scene.at(1.0).world_T_cam
    assert abs(camera.cx - 47.5) > 0.05
    assert abs(camera.cy - 39.5) > 0.05
    sensor = mi.load_dict(path_tracer(scene, 16)._sensor(world_T_cam))
    pixels = np.array([[0.0, 0.0], [95.0, 3.0], [40.0, 79.0], [camera.cx, camera.cy]])
    film = (pixels + 0.5) / (camera.width, camera.height)
    looked = np.array([np.ravel(sensor.sample_ray(0.0, 0.5, place.tolist(), [0.5, 0.5])[0].d) for place in film])
    rays = camera.rays(pixels) @ world_T_cam[:3, :3].T
    np.testing.assert_allclose(looked, rays / np.linalg.norm(rays, axis=1)[:, None], atol=1e-5)


def test_without_mitsuba_the_extra_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "mitsuba", None)
    options = ("--size", "48x40", "--frames", "1", "--clutter", "0", "--parts", "slot_block")
    assert metal_sequences(["--out", str(tmp_path / "set"), "--path-traced", *options]) == 2
    assert capsys.readouterr().err == "error: --path-traced needs Mitsuba: pip install -e '.[path-traced]'\n"
    assert list(tmp_path.iterdir()) == []


def test_edges_are_drawn_where_the_part_is() -> None:
    dataset = BopDataset(sample_dataset())
    scene = dataset.open_scene(1)
    frame = scene.frame(20)
    assert isinstance(frame, Frame)
    drawn = sheets.with_edges(dataset, scene, frame)
    changed = (drawn != frame.image).any(2)
    part, pose = dataset.part(1), scene.truth(20, 1)
    assert pose is not None
    pixels = frame.camera.project(part.vertices @ pose[:3, :3].T + pose[:3, 3])
    y, x = np.nonzero(changed)
    np.testing.assert_allclose([x.min(), y.min()], pixels.min(0), atol=2.5)
    np.testing.assert_allclose([x.max(), y.max()], pixels.max(0), atol=2.5)
    assert (frame.image == scene.frame(20).image).all()  # type: ignore[union-attr]


def test_a_sheet_of_any_data_set(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    root = write_dataset(tmp_path / "set")
    out = tmp_path / "pictures" / "sheet.png"
    assert sheets.main([str(root), "--out", str(out), "--columns", "2", "--width", "50", "--edges"]) == 0
    image = cv2.imread(str(out))
    assert image.shape == (38, 4 * 50 + 3 * 2, 3)
    assert f"{out}: written, 206 x 38 px" in capsys.readouterr().out
    assert sheets.main([str(tmp_path / "none"), "--out", str(out)]) == 2
    assert capsys.readouterr().err.startswith("error: ")
    assert sheets.main([str(root), "--out", str(tmp_path / "sheet.xyz")]) == 2
    assert "give a .png or .jpg file" in capsys.readouterr().err


@pytest.mark.parametrize("name", ["sheet.png", "sheet.jpg"])
def test_a_sheet_replaces_sheets_alone(tmp_path: Path, name: str, capsys: pytest.CaptureFixture[str]) -> None:
    root, out = write_dataset(tmp_path / "set"), tmp_path / name
    assert sheets.main([str(root), "--out", str(out)]) == 0
    assert sheets.main([str(root), "--out", str(out), "--width", "50"]) == 0
    assert cv2.imwrite(str(out), np.zeros((8, 8, 3), np.uint8))
    photo = out.read_bytes()
    capsys.readouterr()
    assert sheets.main([str(root), "--out", str(out)]) == 2
    assert "would replace a file that is no contact sheet" in capsys.readouterr().err
    assert out.read_bytes() == photo


def test_a_picture_of_the_data_set_and_what_it_is_linked_to_stay(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    root = write_dataset(tmp_path / "set")
    picture = sorted((root / "test" / "000001" / "rgb").iterdir())[0]
    original = tmp_path / "original.png"
    original.hardlink_to(picture)
    before = original.read_bytes()
    assert sheets.main([str(root), "--out", str(picture)]) == 2
    assert "lies in the data set" in capsys.readouterr().err
    out = tmp_path / "sheet.png"
    assert sheets.main([str(root), "--out", str(out)]) == 0
    linked = tmp_path / "linked.png"
    linked.hardlink_to(out)
    kept = linked.read_bytes()
    assert sheets.main([str(root), "--out", str(out), "--width", "50"]) == 0
    assert (original.read_bytes(), linked.read_bytes()) == (before, kept)


@pytest.mark.parametrize(
    ("sheet", "words"), [("set/sheet.png", "lies in the data set"), ("sheet.gif", "give a .png or .jpg file"),
                         ("folder.png", "is a folder")],
)  # fmt: skip
def test_the_place_of_a_sheet_is_looked_at_before_anything_is_rendered(
    sheet: str, words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("data_recipes.metal.dataset.render_dataset", None)
    (tmp_path / "folder.png").mkdir()
    assert metal_sequences(["--out", str(tmp_path / "set"), "--contact-sheet", str(tmp_path / sheet)]) == 2
    assert words in capsys.readouterr().err


@pytest.mark.parametrize(("option", "most"), [("--columns", 50), ("--width", 2000)])
def test_a_sheet_has_a_size_that_can_be(option: str, most: int, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        sheets.main(["set", "--out", "sheet.png", option, "1000000000000"])
    assert f"give {most} at most" in capsys.readouterr().err
    assert sheets._small(np.zeros((20, 900, 3), np.uint8), 10).shape == (1, 10, 3)
