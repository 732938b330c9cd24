"""The offline phase: what is made, what is taken up again, and what is refused."""

from __future__ import annotations

import errno
import json
import os
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from acp_lab import preparation
from acp_lab.cad.edges import sample_edges
from acp_lab.cad.part import Part
from acp_lab.control_points.coplanar_points import mid_section_points
from acp_lab.control_points.regression import RegressionConfig
from acp_lab.errors import InputFileError, PartError, PreparationError
from acp_lab.generator.painted.config import AutoencoderConfig, NetworkShape
from acp_lab.generator.painted.edge_images import EdgeImageConfig
from acp_lab.generator.templates import build_templates
from acp_lab.generator.visibility_training import TrainingConfig
from acp_lab.prepared_part import DEFAULT_EDGE_BREAK_MM, PreparedPart, PrepareOptions
from tests.made_parts import box, bracket, sheet


class Told:
    """A progress bar that remembers, and that can stop the work like Ctrl-C, once a file is there if one is given."""

    def __init__(self, stop_at: str = "", once: Path | None = None) -> None:
        self.stages: list[str] = []
        self.last = (0, 0)
        self._stop_at = stop_at
        self._once = once

    def __call__(self, stage: str, done: int, total: int) -> None:
        if stage not in self.stages:
            self.stages.append(stage)
        self.last = (done, total)
        if stage == self._stop_at and (self._once is None or self._once.exists()):
            raise KeyboardInterrupt


@pytest.fixture(scope="module", autouse=True)
def quick_work() -> Iterator[None]:
    """Trainings of a blink, in one thread, so that the tests are about what is kept and not about what is learnt."""
    import torch

    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    patch = pytest.MonkeyPatch()
    patch.setattr(TrainingConfig, "fast", lambda: TrainingConfig(views=20, held_out=5, epochs=2, batch=10, hidden=8))
    tiny = AutoencoderConfig(
        images=EdgeImageConfig(size=32, views=8, held_out=2),
        shape=NetworkShape(latent=8, widths=(8, 8, 4), hidden=16),
        autoencoder_epochs=1,
        latent_epochs=1,
        fine_tune_epochs=1,
        second_epochs=1,
    )
    patch.setattr(AutoencoderConfig, "fast", lambda: tiny)
    patch.setattr(RegressionConfig, "fast", lambda: RegressionConfig(views=4, steps=2))
    patch.setattr("acp_lab.preparation.build_templates", partial(build_templates, subdivisions=1))
    patch.setattr("acp_lab.preparation.sample_edges", lambda part: sample_edges(part, spacing_mm=2.0))
    yield
    patch.undo()
    torch.set_num_threads(threads)


def prepare(part: Part, *, out: Path | None = None, progress: Told | None = None, **wishes: Any) -> PreparedPart:
    return preparation.prepare(part, PrepareOptions(**wishes), out=out, progress=progress)


def folder_bytes(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir()) if path.suffix == ".safetensors"}


def header(folder: Path) -> dict:  # type: ignore[type-arg]
    """part.json without what differs from run to run: the seconds, and the checksum over them."""
    values: dict = json.loads((folder / "part.json").read_text())  # type: ignore[type-arg]
    values.pop("checksum")
    values.pop("cpu_s")
    makers = [*values["generators"].values(), values.get("control_points", {})]
    for region in [region for maker in makers for region in maker.get("regions", ())]:
        region.pop("train_s")
    return values


# ---- what is made --------------------------------------------------------------------------------------------


def test_templates_alone(tmp_path: Path) -> None:
    told = Told()
    model = prepare(bracket(), generator="templates", out=tmp_path, progress=told)
    assert model.generator_names == ("templates",)
    assert model.edge_break_mm == DEFAULT_EDGE_BREAK_MM
    assert told.stages == ["view templates"]
    assert told.last[0] == told.last[1] > 0
    back = PreparedPart.load(tmp_path / "bracket")
    assert back.templates is not None
    assert model.templates is not None
    np.testing.assert_array_equal(back.templates.packed, model.templates.packed)


@pytest.mark.parametrize(("size", "times"), [(30.0, 0.5), (320.0, 2.0)])
def test_edges_of_small_and_large_parts_are_expected_to_be_broken_in_proportion(size: float, times: float) -> None:
    part = box((0.6 * size, 0.8 * size, 1e-3 * size))
    assert prepare(part, generator="templates").edge_break_mm == pytest.approx(times * DEFAULT_EDGE_BREAK_MM, rel=1e-3)


def test_the_folder_may_be_words(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As in the README."""
    monkeypatch.chdir(tmp_path)
    preparation.prepare(bracket(), PrepareOptions(generator="templates"), out="parts")
    assert (tmp_path / "parts" / bracket().name / "part.json").is_file()


def test_both_generators_for_all_regions(tmp_path: Path) -> None:
    told = Told()
    model = prepare(bracket(), fast=True, out=tmp_path, progress=told)
    assert model.generator_names == ("learned", "templates")
    assert sorted(model.networks) == [0, 1, 2, 3, 4, 5]
    assert [report.region for report in model.networks.reports.values()] == [0, 1, 2, 3, 4, 5]
    assert all(report.train_s > 0.0 for report in model.networks.reports.values())
    assert told.stages == ["view templates", "visibility networks"]
    assert told.last == (12, 12)
    assert PreparedPart.load(tmp_path / "bracket").generator_names == ("learned", "templates")


def test_learned_alone_for_some_regions(tmp_path: Path) -> None:
    model = prepare(bracket(), generator="learned", fast=True, regions=(4, 0, 4), out=tmp_path)
    # The other regions fall back to the templates.
    assert model.generator_names == ("learned", "templates")
    assert sorted(model.networks) == [0, 4]
    assert sorted(PreparedPart.load(tmp_path / "bracket").networks) == [0, 4]


def test_nothing_is_stored_unless_asked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert prepare(bracket(), generator="templates").templates is not None
    assert not list(tmp_path.iterdir())


def test_the_same_seed_gives_the_same_files(tmp_path: Path) -> None:
    for name in ("first", "again"):
        prepare(bracket(), fast=True, regions=(1,), seed=5, out=tmp_path / name)
    assert folder_bytes(tmp_path / "first" / "bracket") == folder_bytes(tmp_path / "again" / "bracket")
    assert header(tmp_path / "first" / "bracket") == header(tmp_path / "again" / "bracket")


def test_the_options_are_recorded_by_the_generator_that_was_asked_for(tmp_path: Path) -> None:
    prepare(bracket(), generator="templates", out=tmp_path)
    prepare(bracket(), fast=True, regions=(3,), seed=2, out=tmp_path)
    model = prepare(bracket(), fast=True, regions=(5, 3), seed=2, out=tmp_path)
    expected = {
        "templates": PrepareOptions("templates"),
        "both": PrepareOptions("both", fast=True, regions=(3, 5), seed=2),
    }
    assert model.options == expected
    assert PreparedPart.load(tmp_path / "bracket").options == expected
    assert header(tmp_path / "bracket")["options"]["both"]["regions"] == [3, 5]


def test_the_regions_of_each_generator_are_known(tmp_path: Path) -> None:
    prepare(bracket(), fast=True, regions=(5,), out=tmp_path)
    paint(tmp_path, regions=(4, 1))
    model = PreparedPart.load(tmp_path / "bracket")
    assert model.regions_by_generator == {"learned": (5,), "templates": (0, 1, 2, 3, 4, 5), "autoencoder": (1, 4)}
    assert model.best_generator().regions == (0, 1, 2, 3, 4, 5), "templates answer for the others"
    assert model.autoencoder().regions == (1, 4)


def test_a_finished_region_leaves_the_other_files_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    prepare(bracket(), fast=True, regions=(0,), out=tmp_path)
    written: list[str] = []

    def count(source: Path, target: Path, really: Any = os.replace) -> None:
        written.append(Path(target).name)
        really(source, target)

    monkeypatch.setattr(os, "replace", count)
    prepare(bracket(), fast=True, regions=(0, 1, 2), out=tmp_path)
    assert written == ["visibility_1.safetensors", "part.json", "visibility_2.safetensors", "part.json"]
    written.clear()
    prepare(bracket(), fast=True, regions=(0, 1, 2), out=tmp_path)
    assert written == []


# ---- what is taken up again ----------------------------------------------------------------------------------


def test_an_interrupted_run_goes_on_to_the_same_numbers(tmp_path: Path) -> None:
    prepare(bracket(), fast=True, regions=(0, 1, 2), out=tmp_path / "one_go")
    with pytest.raises(KeyboardInterrupt):
        prepare(
            bracket(),
            fast=True,
            regions=(0, 1, 2),
            out=tmp_path / "two_goes",
            progress=Told("visibility networks", once=tmp_path / "two_goes" / "bracket" / "visibility_0.safetensors"),
        )
    assert sorted(PreparedPart.load(tmp_path / "two_goes" / "bracket").networks) == [0]
    told = Told()
    prepare(bracket(), fast=True, regions=(0, 1, 2), out=tmp_path / "two_goes", progress=told)
    assert told.last == (4, 4)
    assert folder_bytes(tmp_path / "one_go" / "bracket") == folder_bytes(tmp_path / "two_goes" / "bracket")
    assert header(tmp_path / "one_go" / "bracket") == header(tmp_path / "two_goes" / "bracket")


def test_interrupted_templates_leave_nothing_half_done(tmp_path: Path) -> None:
    with pytest.raises(KeyboardInterrupt):
        prepare(bracket(), generator="templates", out=tmp_path, progress=Told(stop_at="view templates"))
    assert not (tmp_path / "bracket" / "part.json").exists()
    assert prepare(bracket(), generator="templates", out=tmp_path).templates is not None


def test_each_run_adds_its_generator(tmp_path: Path) -> None:
    prepare(bracket(), generator="templates", out=tmp_path)
    told = Told()
    model = prepare(bracket(), generator="learned", fast=True, regions=(3,), out=tmp_path, progress=told)
    assert model.generator_names == ("learned", "templates")
    assert told.stages == ["visibility networks"]
    assert told.last == (2, 2)
    model = prepare(bracket(), generator="both", fast=True, regions=(5,), out=tmp_path)
    assert sorted(model.networks) == [3, 5]
    told = Told()
    prepare(bracket(), generator="both", fast=True, regions=(3, 5), out=tmp_path, progress=told)
    assert told.stages == []


def test_networks_trained_otherwise_are_no_part_of_the_result(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    prepare(bracket(), fast=True, regions=(0, 1), out=tmp_path)
    other = TrainingConfig(views=30, held_out=5, epochs=1, batch=10, hidden=8)
    monkeypatch.setattr(TrainingConfig, "fast", lambda: other)
    model = prepare(bracket(), fast=True, regions=(1,), out=tmp_path)
    assert sorted(model.networks) == [1]
    assert sorted(PreparedPart.load(tmp_path / "bracket").networks) == [1]
    assert "views=30" in header(tmp_path / "bracket")["generators"]["learned"]["training"]


def test_an_edge_break_of_another_unit_is_refused() -> None:
    with pytest.raises(PreparationError, match=r"bracket: --edge-break 50: .*diameter, \d+\.\d mm"):
        prepare(bracket(), generator="templates", edge_break_mm=50.0)


def test_a_part_that_is_complete_need_not_be_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    prepare(bracket(), generator="templates", out=tmp_path)
    before = (tmp_path / "bracket" / "part.json").read_bytes()

    def refused(*_: Any, **__: Any) -> None:
        raise PermissionError(errno.EACCES, "Permission denied")

    monkeypatch.setattr("acp_lab.locks.FileLock.acquire", refused)
    monkeypatch.setattr(os, "access", lambda path, mode: mode != os.W_OK)
    assert prepare(bracket(), generator="templates", out=tmp_path).generator_names == ("templates",)
    assert (tmp_path / "bracket" / "part.json").read_bytes() == before
    for wishes in ({"generator": "both"}, {"generator": "templates", "resume": False}):
        with pytest.raises(InputFileError, match="Permission denied"):
            prepare(bracket(), out=tmp_path, **wishes)


def test_the_edge_break_is_kept_until_another_is_given(tmp_path: Path) -> None:
    prepare(bracket(), generator="templates", edge_break_mm=0.4, out=tmp_path)
    assert prepare(bracket(), generator="templates", out=tmp_path).edge_break_mm == 0.4
    assert prepare(bracket(), generator="templates", edge_break_mm=0.0, out=tmp_path).edge_break_mm == 0.0
    assert PreparedPart.load(tmp_path / "bracket").edge_break_mm == 0.0


def test_another_seed_trains_and_no_resume_starts_anew(tmp_path: Path) -> None:
    prepare(bracket(), fast=True, regions=(0,), out=tmp_path)
    told = Told()
    prepare(bracket(), fast=True, regions=(0,), seed=1, out=tmp_path, progress=told)
    # Templates are made without chance.
    assert told.stages == ["visibility networks"]
    told = Told()
    model = prepare(bracket(), generator="templates", seed=1, out=tmp_path, resume=False, progress=told)
    assert told.stages == ["view templates"]
    assert model.generator_names == PreparedPart.load(tmp_path / "bracket").generator_names == ("templates",)


# ---- the paper's generator -----------------------------------------------------------------------------------


def paint(out: Path, told: Told | None = None, **wishes: Any) -> PreparedPart:
    return prepare(bracket(), generator="autoencoder", fast=True, out=out, progress=told, **wishes)


def test_control_points_and_auto_encoders(tmp_path: Path) -> None:
    told = Told()
    model = paint(tmp_path, told, regions=(4, 1))
    assert told.stages == [
        f"{what}, region {name}" for what in ("control points", "auto-encoder") for name in ("-x", "+z")
    ]
    assert model.generator_names == ("autoencoder",)
    folder = tmp_path / "bracket"
    assert sorted(path.name for path in folder.iterdir()) == [
        *(f"autoencoder_{region}.{kind}" for region in (1, 4) for kind in ("png", "safetensors")),
        *(f"control_points_{region}.safetensors" for region in (1, 4)),
        "edges.safetensors",
        "mesh.safetensors",
        "part.json",
    ]
    info = header(folder)
    assert [region["region"] for region in info["control_points"]["regions"]] == [1, 4]
    painted = info["generators"]["autoencoder"]
    assert [region["region"] for region in painted["regions"]] == [1, 4]
    assert set(painted["held_out_chamfer_px"]) == {"generated_to_true", "true_to_generated"}
    # What has learnt next to nothing shows no pose.
    assert [region["bias_percent"] for region in painted["regions"]] == [None, None]
    assert painted["pose_bias_percent"] is None
    # Outlines are painted where broken edges show them.
    assert f"'outline_inset_mm': {0.6 * DEFAULT_EDGE_BREAK_MM}" in painted["training"]
    with pytest.raises(PreparationError, match="no generator is prepared"):
        model.best_generator()

    back = PreparedPart.load(folder)
    generator = back.autoencoder()
    assert generator.regions == (1, 4)
    for region in (1, 4):
        np.testing.assert_array_equal(back.control_points(region, "regressed"), generator.points_obj(region))
        middle = mid_section_points(back.part.box_min, back.part.box_max, region // 2)
        np.testing.assert_array_equal(back.control_points(region, "mid-section"), middle)
        np.testing.assert_array_equal(generator.points_obj(region, "mid-section"), middle)
    at = np.array([[8.0, 8.0], [24.0, 8.0], [24.0, 24.0], [8.0, 24.0]])
    np.testing.assert_array_equal(generator.edge_image(at, 4), model.autoencoder().edge_image(at, 4))


def test_each_generator_keeps_the_others(tmp_path: Path) -> None:
    prepare(bracket(), fast=True, regions=(3,), out=tmp_path)
    kept = folder_bytes(tmp_path / "bracket")
    # Another seed: the visibility networks stay, for nothing was asked of them.
    model = paint(tmp_path, regions=(3,), seed=8)
    assert model.generator_names == ("learned", "templates", "autoencoder")
    assert {name: data for name, data in folder_bytes(tmp_path / "bracket").items() if name in kept} == kept
    painted = folder_bytes(tmp_path / "bracket")
    told = Told()
    again = prepare(bracket(), fast=True, regions=(3,), out=tmp_path, progress=told)
    assert told.stages == []
    assert again.generator_names == ("learned", "templates", "autoencoder")
    assert folder_bytes(tmp_path / "bracket") == painted


def test_an_interrupted_region_goes_on_from_its_checkpoint(tmp_path: Path) -> None:
    paint(tmp_path / "one_go", regions=(0, 2))
    with pytest.raises(KeyboardInterrupt):
        paint(tmp_path / "two_goes", Told(stop_at="auto-encoder, region +y"), regions=(0, 2))
    folder = tmp_path / "two_goes" / "bracket"
    assert (folder / "autoencoder_2.checkpoint.safetensors").is_file()
    assert not (folder / "autoencoder_0.checkpoint.safetensors").exists()
    assert PreparedPart.load(folder).autoencoder().regions == (0,)
    counts: list[int] = []
    told = Told()

    def count(stage: str, done: int, total: int) -> None:
        told(stage, done, total)
        counts.append(done)

    paint(tmp_path / "two_goes", count, regions=(0, 2))  # type: ignore[arg-type]
    assert told.stages == ["auto-encoder, region +y"]
    assert counts == [2, 3, 4]
    assert not (folder / "autoencoder_2.checkpoint.safetensors").exists()
    assert folder_bytes(tmp_path / "one_go" / "bracket") == folder_bytes(folder)
    assert header(tmp_path / "one_go" / "bracket") == header(folder)


@pytest.mark.parametrize(
    "wish",
    [
        {"seed": 1},
        {"edge_break_mm": 0.4},
        {"edge_source": "normals"},
        {"painting_frame": "prediction"},
        {"painting_px": 64},
        {"resume": False},
    ],
    ids=str,
)
def test_other_wishes_train_anew(tmp_path: Path, wish: dict[str, Any]) -> None:
    paint(tmp_path, regions=(0,))
    with pytest.raises(KeyboardInterrupt):
        paint(tmp_path, Told(stop_at="auto-encoder, region -x"), regions=(1,))
    told = Told()
    model = paint(tmp_path, told, regions=(1,), **wish)
    assert told.stages[-1] == "auto-encoder, region -x"
    only_painting = {"edge_break_mm", "edge_source", "painting_frame", "painting_px"} & set(wish)
    assert ("control points, region -x" in told.stages) == (not only_painting)
    assert model.autoencoder().frame == wish.get("painting_frame", "pose")
    assert model.autoencoder().size == wish.get("painting_px", 32)
    assert sorted(model.autoencoders) == [1]
    assert sorted(PreparedPart.load(tmp_path / "bracket").autoencoders) == [1]


# ---- what is refused -----------------------------------------------------------------------------------------


def test_another_mesh_of_the_same_name_is_refused_unless_told(tmp_path: Path) -> None:
    prepare(bracket(), generator="templates", out=tmp_path)
    before = (tmp_path / "bracket" / "part.json").read_bytes()
    other = Part.from_mesh(box().vertices, box().faces, "bracket")
    with pytest.raises(PreparationError, match=r"bracket: holds a part prepared from another mesh .*--no-resume"):
        prepare(other, generator="templates", out=tmp_path)
    assert (tmp_path / "bracket" / "part.json").read_bytes() == before
    prepare(other, generator="templates", out=tmp_path, resume=False)
    assert PreparedPart.load(tmp_path / "bracket").part.sha256 == other.sha256


def test_a_damaged_folder_is_refused_unless_told(tmp_path: Path) -> None:
    prepare(bracket(), generator="templates", out=tmp_path)
    (tmp_path / "bracket" / "edges.safetensors").write_bytes(b"")
    with pytest.raises(PreparationError, match=r"damaged .*--no-resume"):
        prepare(bracket(), generator="templates", out=tmp_path)
    (tmp_path / "bracket" / "part.json").write_text("{")
    with pytest.raises(PreparationError, match="cannot be read as a prepared part") as caught:
        prepare(bracket(), generator="templates", out=tmp_path)
    assert str(caught.value).count("--no-resume") == 1
    assert prepare(bracket(), generator="templates", out=tmp_path, resume=False).templates is not None


@pytest.mark.parametrize(
    ("wish", "message"),
    [
        ({"generator": "magic"}, "--generator magic: choose one of templates, learned, both, autoencoder"),
        ({"regions": ()}, "--regions"),
        ({"regions": (6,)}, "--regions"),
        ({"regions": (-1, 2)}, "--regions"),
    ],
    ids=str,
)
def test_unknown_wishes_are_refused(wish: dict, message: str, tmp_path: Path) -> None:  # type: ignore[type-arg]
    with pytest.raises(PreparationError, match=message):
        prepare(bracket(), out=tmp_path, **wish)
    assert not list(tmp_path.iterdir())


def test_a_flat_part_is_refused(tmp_path: Path) -> None:
    with pytest.raises(PartError, match="one plane"):
        prepare(sheet(), out=tmp_path)
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_templates_are_made_without_torch() -> None:
    """It takes seconds to import, and templates are for those in a hurry."""
    code = (
        "import sys; from tests.made_parts import box; from acp_lab.preparation import prepare; "
        "from acp_lab.prepared_part import PrepareOptions; "
        "prepare(box(), PrepareOptions('templates')).best_generator(); assert 'torch' not in sys.modules"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=Path(__file__).parents[1], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr


# ---- one writer, and earlier versions --------------------------------------------------------------------------


def test_a_part_without_checksums_gets_them_and_is_kept(tmp_path: Path) -> None:
    prepare(bracket(), fast=True, regions=(0,), out=tmp_path)
    folder = tmp_path / "bracket"
    before = folder_bytes(folder)
    values = json.loads((folder / "part.json").read_text())
    (folder / "part.json").write_text(
        json.dumps({key: value for key, value in values.items() if key not in ("files", "checksum")} | {"version": 1})
    )
    with pytest.raises(PreparationError, match=r"without checksums; run: acp-lab prepare MESH .*it adds them"):
        PreparedPart.load(folder)
    told = Told()
    prepare(bracket(), fast=True, regions=(0,), out=tmp_path, progress=told)
    assert told.stages == []
    assert folder_bytes(folder) == before
    assert PreparedPart.load(folder).generator_names == ("learned", "templates")


def test_two_at_once_into_one_folder(tmp_path: Path) -> None:
    """The second is refused while the first works, and nothing of the first is lost."""
    errors = []

    def second(stage: str, done: int, total: int) -> None:
        if not errors:
            with pytest.raises(InputFileError) as caught:
                prepare(replace(box(), name="bracket"), generator="templates", out=tmp_path)
            errors.append(str(caught.value))

    model = prepare(bracket(), generator="templates", out=tmp_path, progress=second)  # type: ignore[arg-type]
    assert errors == [
        f"{tmp_path / 'bracket'}: another acp-lab is writing this part: wait until it is done, or choose another place"
    ]
    assert PreparedPart.load(tmp_path / "bracket").part.sha256 == model.part.sha256
    with pytest.raises(PreparationError, match="another mesh of the same name"):
        prepare(replace(box(), name="bracket"), generator="templates", out=tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["bracket"]


def test_what_a_killed_run_left_is_removed(tmp_path: Path) -> None:
    prepare(bracket(), generator="templates", out=tmp_path)
    left = tmp_path / "bracket" / ".templates.safetensors.4711.tmp"
    left.write_bytes(b"half")
    prepare(bracket(), generator="templates", out=tmp_path)
    assert not left.exists()


def test_a_name_that_leads_out_of_the_folder_is_refused(tmp_path: Path) -> None:
    with pytest.raises(PreparationError, match="cannot be named"):
        prepare(replace(box(), name=".."), generator="templates", out=tmp_path / "parts")
    assert list(tmp_path.iterdir()) == []
