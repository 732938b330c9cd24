"""Prepared parts on disk: what goes in comes out, and whatever is wrong with a folder is told in one line."""

from __future__ import annotations

import errno
import json
import os
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from safetensors.numpy import load_file, save_file

from acp_lab.cad.edges import EdgeSamples, sample_edges
from acp_lab.cad.models_info import Symmetries
from acp_lab.cad.part import Part
from acp_lab.cad.raycast import make_caster
from acp_lab.control_points.coplanar_points import mid_section_points
from acp_lab.detection.view_templates import make_views
from acp_lab.errors import InputFileError, PreparationError
from acp_lab.generator.painted.config import AutoencoderReport
from acp_lab.generator.painted.image_generator import RegionAutoencoder
from acp_lab.generator.painted.quality import GenerationQuality
from acp_lab.generator.templates import build_templates
from acp_lab.generator.visibility import RegionNetwork, VisibilityNetwork
from acp_lab.locks import only_writer
from acp_lab.prepared_part import (
    DEFAULT_EDGE_BREAK_MM,
    FORMAT_VERSION,
    PreparedPart,
    PrepareOptions,
    RegionReport,
    Trained,
    part_folder,
    read_header,
)
from acp_lab.prepared_part.integrity import write_header
from tests.made_parts import box, bracket, looking_at


def network(edges: EdgeSamples, seed: int) -> RegionNetwork:
    rng = np.random.default_rng(seed)
    rows = np.arange(seed, len(edges), 2, dtype=np.int32)
    shapes = ((16, 8), (16,), (16, 16), (16,), (len(rows), 16), (len(rows),))
    return RegionNetwork(*(rng.standard_normal(shape).astype(np.float32) for shape in shapes), rows)


def made(part: Part) -> PreparedPart:
    edges = sample_edges(part, spacing_mm=3.0)
    return PreparedPart(
        part,
        edges,
        edge_break_mm=0.4,
        seed=7,
        templates=build_templates(part, edges, make_caster(part), subdivisions=1),
        networks=Trained(
            {0: network(edges, 0), 4: network(edges, 1)},
            {0: RegionReport(0, 0.9, 0.8, 0.7, 0.1, 2.5), 4: RegionReport(4, 0.95, 0.85, 0.75, 0.05, 3.5)},
            "views=10, epochs=2",
        ),
        options={"both": PrepareOptions(fast=True, regions=(4, 0), edge_break_mm=0.4, seed=7)},
    )


def autoencoder(seed: int) -> RegionAutoencoder:
    """Arrays of the right names; nobody uses them here."""
    rng = np.random.default_rng(seed)
    tensors = {
        "decoder.0.weight": rng.standard_normal((6, 4)).astype(np.float16),
        "regressed.centre": rng.standard_normal(8).astype(np.float32),
    }
    return RegionAutoencoder(tensors, np.array([32, 4, 8, 8, 4, 16, 1], np.int32), rng.standard_normal((2, 4, 3)))


def painted(model: PreparedPart) -> PreparedPart:
    """The same part with the paper's generator for regions 1 and 3."""
    quality = GenerationQuality(0.5, 0.7, 0.8)
    report = AutoencoderReport(1, quality, quality, quality, 0.1, 0.2, 0.3, 0.4, 5.0, 0.25)
    return replace(
        model,
        regressed_points=Trained(
            {region: np.full((4, 3), float(region)) for region in (1, 3)},
            {1: {"region": 1, "train_s": 2.5}, 3: {"region": 3, "train_s": 2.0}},
            "steps=3",
        ),
        autoencoders=Trained(
            {region: autoencoder(region) for region in (1, 3)},
            {1: report, 3: replace(report, region=3, bias_percent=None)},
            "views=4",
        ),
    )


@pytest.fixture(scope="module")
def model() -> PreparedPart:
    quarter_turn = np.array([[0.0, -1, 0, 0], [1, 0, 0, 0], [0, 0, 1, 5], [0, 0, 0, 1]])
    symmetries = Symmetries(quarter_turn[None], (((0.0, 0.0, 1.0), (1.0, 2.0, 3.0)),))
    return made(replace(bracket(shift=(10.0, 0.1, -3.3)), symmetries=symmetries))


@pytest.fixture
def folder(model: PreparedPart, tmp_path: Path) -> Path:
    model.save(tmp_path / "parts" / "bracket")
    return tmp_path / "parts" / "bracket"


# ---- the round trip ------------------------------------------------------------------------------------------


def test_everything_comes_back(model: PreparedPart, folder: Path) -> None:
    back = PreparedPart.load(folder)
    part = model.part
    assert (back.part.name, back.part.sha256, back.part.diameter) == (part.name, part.sha256, part.diameter)
    for name in ("vertices", "faces", "box_min", "box_max"):
        np.testing.assert_array_equal(getattr(back.part, name), getattr(part, name), err_msg=name)
        assert getattr(back.part, name).dtype == getattr(part, name).dtype
    np.testing.assert_array_equal(back.part.symmetries.discrete, part.symmetries.discrete)
    assert back.part.symmetries.continuous == part.symmetries.continuous
    for name in ("points_obj", "tangents_obj", "normals_obj", "crease", "convex"):
        np.testing.assert_array_equal(getattr(back.edges, name), getattr(model.edges, name), err_msg=name)
        assert getattr(back.edges, name).dtype == getattr(model.edges, name).dtype
    assert back.edges.spacing_mm == model.edges.spacing_mm
    assert (back.edge_break_mm, back.seed, back.networks.settings) == (0.4, 7, "views=10, epochs=2")
    assert back.networks.reports == model.networks.reports
    assert back.options == model.options
    assert back.generator_names == model.generator_names == ("learned", "templates")


def test_templates_answer_the_same_after_loading(model: PreparedPart, folder: Path) -> None:
    back = PreparedPart.load(folder)
    assert model.templates is not None
    assert back.templates is not None
    np.testing.assert_array_equal(back.templates.packed, model.templates.packed)
    for direction in ([1.0, 0.2, 0.3], [-0.5, 0.9, 0.1]):
        pose = looking_at(model.part, np.array(direction), 300.0)
        np.testing.assert_array_equal(
            back.templates.visible(pose, 0, 500).ids, model.templates.visible(pose, 0, 500).ids
        )


def test_networks_come_back_with_the_last_layer_in_half_precision(model: PreparedPart, folder: Path) -> None:
    back = PreparedPart.load(folder)
    assert set(back.networks) == {0, 4}
    for region, network in model.networks.items():
        for name, value in vars(network).items():
            stored = getattr(back.networks[region], name)
            assert stored.dtype == value.dtype
            if name != "weight3":
                np.testing.assert_array_equal(stored, value)
            else:
                np.testing.assert_array_equal(stored, value.astype(np.float16).astype(np.float32))
    # A second trip changes nothing more.
    back.save(folder.parent / "again")
    for name in ("visibility_0.safetensors", "visibility_4.safetensors"):
        assert (folder / name).read_bytes() == (folder.parent / "again" / name).read_bytes()


def test_half_precision_changes_next_to_no_answer(model: PreparedPart, folder: Path) -> None:
    pose = looking_at(model.part, np.array([1.0, 0.2, 0.3]), 300.0)
    before = model.best_generator().visible(pose, 0, 10**6)
    after = PreparedPart.load(folder).best_generator().visible(pose, 0, 10**6)
    assert len(set(before.ids) ^ set(after.ids)) <= 0.02 * len(before.ids) + 1


def test_a_part_without_generators_comes_back_too(tmp_path: Path) -> None:
    part = box()
    PreparedPart(part, sample_edges(part)).save(tmp_path / "box")
    back = PreparedPart.load(tmp_path / "box")
    assert back.generator_names == ()
    assert back.edge_break_mm == DEFAULT_EDGE_BREAK_MM
    assert back.part.symmetries.discrete.shape == (0, 4, 4)
    with pytest.raises(PreparationError, match=r"box: no generator is prepared; run: acp-lab prepare"):
        back.best_generator()


def test_a_part_of_an_earlier_version_without_options_loads(model: PreparedPart, folder: Path) -> None:
    edit_header(lambda header: header.pop("options"))(folder)
    back = PreparedPart.load(folder)
    assert back.options == {}
    assert back.generator_names == model.generator_names


def test_the_regions_of_each_generator(model: PreparedPart) -> None:
    everywhere = (0, 1, 2, 3, 4, 5)
    assert model.regions_by_generator == {"learned": (0, 4), "templates": everywhere, "autoencoder": ()}
    assert painted(model).regions_by_generator["autoencoder"] == (1, 3)
    best = model.best_generator()
    assert isinstance(best, VisibilityNetwork)
    assert best.fallback is model.templates
    assert best.regions == everywhere  # where there is no network, the templates answer
    assert replace(model, templates=None).best_generator().regions == (0, 4)
    assert replace(model, networks=Trained()).best_generator().regions == everywhere
    without = replace(model, networks=Trained(), templates=None)
    assert set(without.regions_by_generator.values()) == {()}


def test_the_best_generator_is_the_learned_one(model: PreparedPart) -> None:
    best = model.best_generator()
    assert isinstance(best, VisibilityNetwork)
    assert replace(model, networks=Trained()).best_generator() is model.templates


def test_the_folder_holds_json_and_safetensors_only(folder: Path) -> None:
    assert sorted(path.name for path in folder.iterdir()) == [
        "edges.safetensors",
        "mesh.safetensors",
        "part.json",
        "templates.safetensors",
        "visibility_0.safetensors",
        "visibility_4.safetensors",
    ]
    header = json.loads((folder / "part.json").read_text())
    assert header["version"] == FORMAT_VERSION
    assert header["generators"]["learned"]["held_out_recall"] == pytest.approx(0.825)
    assert header["box_min_mm"] == [10.0, 0.1, -3.3]


def test_the_mesh_it_was_prepared_from_is_recognised(tmp_path: Path) -> None:
    mesh = tmp_path / "wedge.ply"
    mesh.write_bytes(ply(bracket()))
    part = Part.from_file(mesh)
    PreparedPart(part, sample_edges(part)).save(tmp_path / "parts" / "wedge")
    assert PreparedPart.load(tmp_path / "parts" / "wedge", mesh).part.path == mesh
    mesh.write_bytes(ply(box()))
    told = r"another mesh than .*wedge\.ply; run: acp-lab prepare .*--no-resume .*--parts"
    with pytest.raises(PreparationError, match=told):
        PreparedPart.load(tmp_path / "parts" / "wedge", mesh)
    with pytest.raises(PreparationError, match=r"gone\.ply: the mesh cannot be read"):
        PreparedPart.load(tmp_path / "parts" / "wedge", tmp_path / "gone.ply")


def ply(part: Part) -> bytes:
    lines = ["ply", "format ascii 1.0", f"element vertex {len(part.vertices)}"]
    lines += [f"property float {axis}" for axis in "xyz"]
    lines += [f"element face {len(part.faces)}", "property list uchar int vertex_indices", "end_header"]
    lines += [" ".join(f"{value:g}" for value in vertex) for vertex in part.vertices]
    lines += [f"3 {a} {b} {c}" for a, b, c in part.faces]
    return ("\n".join(lines) + "\n").encode()


def test_the_papers_generator_comes_back(model: PreparedPart, tmp_path: Path) -> None:
    made = painted(model)
    made.save(tmp_path / "bracket")
    back = PreparedPart.load(tmp_path / "bracket")
    assert back.generator_names == ("learned", "templates", "autoencoder")
    assert (back.regressed_points.settings, back.autoencoders.settings) == ("steps=3", "views=4")
    assert back.regressed_points.reports == made.regressed_points.reports
    assert back.autoencoders.reports == made.autoencoders.reports
    told = read_header(tmp_path / "bracket", "")["generators"]["autoencoder"]
    assert told["pose_bias_percent"] == 0.25, "of the region whose bias is known"
    for region in (1, 3):
        np.testing.assert_array_equal(back.control_points(region, "regressed"), np.full((4, 3), float(region)))
        for name, value in made.autoencoders[region].arrays().items():
            loaded = back.autoencoders[region].arrays()[name]
            np.testing.assert_array_equal(loaded, value)
            assert loaded.dtype == value.dtype
    assert back.autoencoder().regions == (1, 3)


def test_what_the_papers_method_lacks_is_told_with_the_command(model: PreparedPart) -> None:
    command = r"run: acp-lab prepare MESH --out PARTS_DIR --generator autoencoder"
    with pytest.raises(PreparationError, match=f"bracket: no auto-encoder is prepared; {command}"):
        model.autoencoder()
    with pytest.raises(PreparationError, match=f"control points of view region 2 are not regressed; {command}"):
        painted(model).control_points(2, "regressed")
    expected = mid_section_points(model.part.box_min, model.part.box_max, 1)
    np.testing.assert_array_equal(model.control_points(2, "mid-section"), expected)


def test_the_command_for_what_a_part_lacks_names_where_it_was_loaded_from(model: PreparedPart, tmp_path: Path) -> None:
    model.save(tmp_path / "bracket")
    back = PreparedPart.load(tmp_path / "bracket")
    with pytest.raises(PreparationError) as caught:
        back.autoencoder()
    assert str(caught.value).endswith(f"run: acp-lab prepare MESH --out {tmp_path} --generator autoencoder")


def test_the_command_that_mends_a_part_asks_for_what_it_lacks(model: PreparedPart) -> None:
    command = "acp-lab prepare MESH --out PARTS_DIR"
    wanted = PrepareOptions("autoencoder", fast=True, regions=(1, 2), device="cuda")
    half_painted = replace(painted(model), options={"autoencoder": wanted})
    assert half_painted.lacks == "auto-encoders of view regions 2"
    assert half_painted.mend_command == f"run: {command} --generator autoencoder --regions 1,2 --fast"
    networks = PrepareOptions("both", regions=(1,), seed=model.seed)
    neither = replace(half_painted, options={"both": networks, "autoencoder": wanted})
    assert neither.lacks == "visibility networks of view regions 1 and auto-encoders of view regions 2"
    assert neither.mend_command == f"run: {command} && {command} --generator autoencoder --regions 1,2 --fast"
    whole = replace(half_painted, options={"autoencoder": replace(wanted, regions=(1, 3))})
    assert (whole.lacks, whole.mend_command) == ("", f"run: {command}")


@pytest.mark.parametrize("damage", ["no file", "cut", "another format", "no points", "a report lacks a number"])
def test_a_damaged_auto_encoder_is_told(model: PreparedPart, tmp_path: Path, damage: str) -> None:
    folder = tmp_path / "bracket"
    painted(model).save(folder)
    file = folder / "autoencoder_3.safetensors"
    if damage == "no file":
        file.unlink()
    elif damage == "cut":
        file.write_bytes(file.read_bytes()[:-20])
    elif damage == "another format":
        edit_tensors(file.name, lambda tensors: tensors.update(sizes=tensors["sizes"] + 5))(folder)
    elif damage == "no points":
        (folder / "control_points_1.safetensors").unlink()
    else:
        edit_header(lambda header: header["generators"]["autoencoder"]["regions"][0].pop("generated"))(folder)
    with pytest.raises(PreparationError, match=r"damaged .*run: acp-lab prepare MESH .*--no-resume") as caught:
        PreparedPart.load(folder)
    assert "\n" not in str(caught.value)


def with_views(model: PreparedPart) -> PreparedPart:
    return replace(model, views=make_views(model.part, model.best_generator()))


def test_the_views_come_back(model: PreparedPart, tmp_path: Path) -> None:
    seen = with_views(model)
    seen.save(tmp_path / "bracket")
    views, again = seen.views, PreparedPart.load(tmp_path / "bracket").views
    assert views is not None
    assert again is not None
    for name in ("directions_obj", "samples", "points_obj", "tangents_obj", "counts", "lengths"):
        np.testing.assert_allclose(getattr(again, name), getattr(views, name), rtol=1e-6)


@pytest.mark.parametrize(
    ("key", "row"), [("counts", 50_080), ("counts", 0), ("samples", 10_000_000), ("samples", -1), ("lengths", -2.0)]
)
def test_views_that_point_outside_are_told(model: PreparedPart, tmp_path: Path, key: str, row: float) -> None:
    """Compiled loops read as many samples as a view counts, without asking."""
    folder = tmp_path / "bracket"
    with_views(model).save(folder)

    def change(tensors: dict[str, np.ndarray]) -> None:
        tensors[key] = tensors[key].copy()
        tensors[key].flat[3] = row

    edit_tensors("views.safetensors", change)(folder)
    with pytest.raises(PreparationError, match=r"damaged .*view.*run: acp-lab prepare MESH"):
        PreparedPart.load(folder)


# ---- damage --------------------------------------------------------------------------------------------------


def reseal(folder: Path, header: dict) -> None:  # type: ignore[type-arg]
    """Checksums that agree with what was changed, so that what is read next is what is tested."""
    write_header(folder, header, {path.name: path.read_bytes() for path in folder.glob("*.safetensors")})


def edit_header(change: Callable[[dict], None]) -> Callable[[Path], None]:  # type: ignore[type-arg]
    def damage(folder: Path) -> None:
        header = json.loads((folder / "part.json").read_text())
        change(header)
        reseal(folder, header)

    return damage


def edit_tensors(name: str, change: Callable[[dict[str, np.ndarray]], None]) -> Callable[[Path], None]:
    def damage(folder: Path) -> None:
        tensors = load_file(folder / name)
        change(tensors)
        save_file(tensors, folder / name)
        reseal(folder, json.loads((folder / "part.json").read_text()))

    return damage


DAMAGE: dict[str, Callable[[Path], object]] = {
    "no folder": lambda folder: folder.rename(folder.with_name("elsewhere")),
    "no part.json": lambda folder: (folder / "part.json").unlink(),
    "part.json is a folder": lambda folder: ((folder / "part.json").unlink(), (folder / "part.json").mkdir()),
    "part.json is empty": lambda folder: (folder / "part.json").write_text(""),
    "part.json is a list": lambda folder: (folder / "part.json").write_text("[1, 2]"),
    "part.json is no text": lambda folder: (folder / "part.json").write_bytes(b"\xff\xfe\x00\x01"),
    "another format": edit_header(lambda header: header.update(format="something else")),
    "another version": edit_header(lambda header: header.update(version=FORMAT_VERSION + 1)),
    "no mesh": edit_header(lambda header: header.pop("mesh")),
    "no diameter": edit_header(lambda header: header.pop("diameter_mm")),
    "a diameter that is no number": edit_header(lambda header: header.update(diameter_mm="wide")),
    "generators are a list": edit_header(lambda header: header.update(generators=["learned"])),
    "a report lacks a number": edit_header(lambda header: header["generators"]["learned"]["regions"][0].pop("recall")),
    "a report names another region": edit_header(
        lambda header: header["generators"]["learned"]["regions"][0].update(region=3)
    ),
    "options are a list": edit_header(lambda header: header.update(options=["fast"])),
    "an option that is none": edit_header(lambda header: header["options"]["both"].update(colour="red")),
    "an option out of range": edit_header(lambda header: header["options"]["both"].update(seed=-1)),
    "no mesh file": lambda folder: (folder / "mesh.safetensors").unlink(),
    "no edges file": lambda folder: (folder / "edges.safetensors").unlink(),
    "no templates file": lambda folder: (folder / "templates.safetensors").unlink(),
    "no network file": lambda folder: (folder / "visibility_4.safetensors").unlink(),
    "a cut file": lambda folder: (folder / "edges.safetensors").write_bytes(
        (folder / "edges.safetensors").read_bytes()[:-100]
    ),
    "an empty file": lambda folder: (folder / "templates.safetensors").write_bytes(b""),
    "a file of something else": lambda folder: (folder / "mesh.safetensors").write_bytes(b"PK\x03\x04" * 50),
    "edges lack an array": edit_tensors("edges.safetensors", lambda tensors: tensors.pop("crease")),
    "a network lacks an array": edit_tensors("visibility_0.safetensors", lambda tensors: tensors.pop("bias2")),
    "a network has one too many": edit_tensors(
        "visibility_0.safetensors", lambda tensors: tensors.update(more=np.zeros(1))
    ),
}


CHANGED: dict[str, tuple[str, Callable[[Path], object]]] = {
    "edges that are 5% larger": ("edges.safetensors", lambda folder: scale_edges(folder, 1.05)),
    "one bit": ("visibility_4.safetensors", lambda folder: flip_bit(folder / "visibility_4.safetensors")),
    "another diameter": ("part.json", lambda folder: swap_text(folder, '"diameter_mm": ', '"diameter_mm": 1')),
    "another seed": ("part.json", lambda folder: swap_text(folder, '"seed": ', '"seed": 7')),
    "no checksum": ("part.json", lambda folder: swap_text(folder, '"checksum"', '"sum"')),
    "no checksum of a file": ("part.json", lambda folder: swap_text(folder, '"edges.safetensors"', '"other"')),
    "a file of another part": (
        "templates.safetensors",
        lambda folder: shutil.copy(folder / "mesh.safetensors", folder / "templates.safetensors"),
    ),
}


def scale_edges(folder: Path, factor: float) -> None:
    tensors = load_file(folder / "edges.safetensors")
    save_file({**tensors, "points_obj": factor * tensors["points_obj"]}, folder / "edges.safetensors")


def flip_bit(path: Path) -> None:
    content = bytearray(path.read_bytes())
    content[-3] ^= 1
    path.write_bytes(bytes(content))


def swap_text(folder: Path, old: str, new: str) -> None:
    text = (folder / "part.json").read_text()
    assert old in text
    (folder / "part.json").write_text(text.replace(old, new, 1))


@pytest.mark.parametrize(("name", "change"), CHANGED.values(), ids=CHANGED.keys())
def test_a_change_after_preparation_is_told_with_its_file(
    folder: Path, name: str, change: Callable[[Path], object]
) -> None:
    change(folder)
    with pytest.raises(PreparationError, match=rf"{name} has changed .*run: acp-lab prepare MESH .*--no-resume"):
        PreparedPart.load(folder)


def test_spaces_in_part_json_are_no_change(folder: Path) -> None:
    values = json.loads((folder / "part.json").read_text())
    (folder / "part.json").write_text(json.dumps(dict(reversed(values.items()))))
    PreparedPart.load(folder)


@pytest.mark.parametrize(
    ("name", "key"),
    [("mesh", "vertices"), ("edges", "points_obj"), ("templates", "views_obj"), ("visibility_0", "weight1")],
)
def test_numbers_that_are_none_are_told(folder: Path, name: str, key: str) -> None:
    def spoil(tensors: dict[str, np.ndarray]) -> None:
        tensors[key] = tensors[key].copy()
        tensors[key].flat[0] = np.nan

    edit_tensors(f"{name}.safetensors", spoil)(folder)
    with pytest.raises(PreparationError, match=rf"{name}\.safetensors: {key} holds NaN or infinity"):
        PreparedPart.load(folder)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no pipes in folders")
@pytest.mark.parametrize("name", ["part.json", "edges.safetensors"])
def test_a_pipe_in_the_folder_is_not_waited_for(folder: Path, name: str) -> None:
    (folder / name).unlink()
    os.mkfifo(folder / name)
    with pytest.raises(PreparationError, match=r"run: acp-lab prepare"):
        PreparedPart.load(folder)


@pytest.mark.parametrize("name", ["", ".", "..", ".hidden", "a/b", "a\\b", "../up", "a\nb", "nul\0"])
def test_a_name_that_is_no_plain_folder_is_refused(tmp_path: Path, name: str) -> None:
    with pytest.raises(PreparationError, match="cannot be named"):
        part_folder(tmp_path, name)


@pytest.mark.parametrize(
    ("file", "shown"),
    [(".hidden.stl", "parts/.hidden.stl"), ("...stl", "parts/...stl"), ("a\x1b[31m.stl", r"'parts/a\x1b[31m.stl'")],
)
def test_such_a_name_is_told_with_the_file_that_has_it(tmp_path: Path, file: str, shown: str) -> None:
    mesh = Path("parts") / file
    with pytest.raises(PreparationError) as caught:
        part_folder(tmp_path, mesh.stem, mesh)
    assert str(caught.value).startswith(f"{shown}: a part cannot be named ")
    assert str(caught.value).endswith(": rename its mesh file")


def test_a_name_that_is_too_long_for_a_folder(tmp_path: Path) -> None:
    """Of bytes, not of letters; its lock has to find a place, too."""
    for name in ("x" * 249, "ß" * 124):
        with only_writer(part_folder(tmp_path, name), "this part"):
            part_folder(tmp_path, name).mkdir()
    for name in ("x" * 250, "ß" * 125):
        with pytest.raises(PreparationError, match=r"250 bytes are too many .*: rename its mesh file"):
            part_folder(tmp_path, name, Path(f"{name}.stl"))


@pytest.mark.parametrize("name", ["obj_000001", "Halter 3 (links)", "größe", "v1.2"])
def test_other_names_are_fine(tmp_path: Path, name: str) -> None:
    assert part_folder(tmp_path, name) == tmp_path / name


@pytest.mark.parametrize("damage", DAMAGE.values(), ids=DAMAGE.keys())
def test_a_damaged_folder_is_told_in_one_line_with_the_fix(folder: Path, damage: Callable[[Path], object]) -> None:
    damage(folder)
    with pytest.raises(PreparationError) as caught:
        PreparedPart.load(folder)
    message = str(caught.value)
    assert "\n" not in message
    assert message.startswith(str(folder))
    assert f"run: acp-lab prepare MESH --out {folder.parent}" in message


def test_a_folder_that_was_never_prepared_is_told_so(tmp_path: Path) -> None:
    with pytest.raises(
        PreparationError, match=r"bolt: this part is not prepared; run: acp-lab prepare bolt\.stl --out"
    ):
        PreparedPart.load(tmp_path / "bolt", Path("bolt.stl"))


def test_a_part_where_the_folder_of_parts_is_wanted_and_the_reverse(folder: Path) -> None:
    with pytest.raises(PreparationError) as caught:
        PreparedPart.load(folder / "box")
    assert str(caught.value) == f"{folder}: is a prepared part itself: --parts is the folder above, {folder.parent}"
    with pytest.raises(PreparationError, match=f"parts: is no part, it holds some: name one of them: {folder}"):
        PreparedPart.load(folder.parent)


# ---- whole or not at all -------------------------------------------------------------------------------------


def test_only_what_changed_is_written(model: PreparedPart, folder: Path) -> None:
    def times() -> dict[str, int]:
        return {path.name: path.stat().st_mtime_ns for path in folder.iterdir()}

    for path in folder.iterdir():
        os.utime(path, (1.0, 1.0))
    before = times()
    model.save(folder)
    PreparedPart.load(folder).save(folder)
    assert times() == before
    (folder / "visibility_0.safetensors").unlink()
    replace(model, networks=Trained(dict(model.networks), model.networks.reports, "other")).save(folder)
    assert {name for name, when in times().items() if when != before[name]} == {"part.json", "visibility_0.safetensors"}


def test_no_temporary_files_stay(folder: Path) -> None:
    assert not [path for path in folder.iterdir() if path.name.startswith(".")]


def test_an_interrupted_first_save_leaves_no_part(
    model: PreparedPart, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    fail_at(monkeypatch, "visibility_4.safetensors")
    with pytest.raises(KeyboardInterrupt):
        model.save(tmp_path / "parts" / "bracket")
    with pytest.raises(PreparationError, match="not prepared"):
        PreparedPart.load(tmp_path / "parts" / "bracket")


def test_an_interrupted_save_of_other_files_leaves_no_part(
    folder: Path, model: PreparedPart, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Half of the files are new, and part.json would tell of the old ones."""
    other = replace(model.networks[0], bias1=model.networks[0].bias1 + 1.0)
    networks = Trained({**model.networks, 0: other}, model.networks.reports, "other")
    fail_at(monkeypatch, "visibility_0.safetensors")
    with pytest.raises(KeyboardInterrupt):
        replace(model, networks=networks).save(folder)
    with pytest.raises(PreparationError, match="not prepared"):
        PreparedPart.load(folder)


def test_an_interrupted_save_keeps_the_part_that_was_there(
    model: PreparedPart, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    fail_at(monkeypatch, "part.json")
    more = replace(
        model, networks=model.networks.with_region(2, network(model.edges, 2), RegionReport(2, 0.9, 0.8, 0.7, 0.1, 1.5))
    )
    with pytest.raises(KeyboardInterrupt):
        more.save(folder)
    assert set(PreparedPart.load(folder).networks) == {0, 4}


@pytest.mark.parametrize("name", ["mesh", "edges", "templates", "visibility_4"])
def test_an_interrupted_save_of_another_mesh_never_mixes_the_two(
    folder: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    fail_at(monkeypatch, f"{name}.safetensors")
    with pytest.raises(KeyboardInterrupt):
        made(box()).save(folder)
    with pytest.raises(PreparationError):
        PreparedPart.load(folder)


def fail_at(monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    """Ctrl-C while the file of that name is put in place."""
    really = os.replace

    def replace_or_stop(source: Path, target: Path) -> None:
        if Path(target).name == name:
            raise KeyboardInterrupt
        really(source, target)

    monkeypatch.setattr(os, "replace", replace_or_stop)


def test_a_full_disk_keeps_the_part_that_was_there(
    model: PreparedPart, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """All of a part is written beside it before anything is replaced."""
    other = replace(model.networks[0], bias1=model.networks[0].bias1 + 1.0)
    networks = Trained({**model.networks, 0: other}, model.networks.reports, "other")
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    really = Path.write_bytes

    def full(path: Path, content: bytes) -> int:
        if "visibility_0" in path.name:
            raise OSError(errno.ENOSPC, "No space left on device")
        return really(path, content)

    monkeypatch.setattr(Path, "write_bytes", full)
    with pytest.raises(InputFileError, match=r"visibility_0\.safetensors: .*No space left"):
        replace(model, networks=networks).save(folder)
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == before
    assert set(PreparedPart.load(folder).networks) == {0, 4}
