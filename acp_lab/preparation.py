"""The offline phase from start to end: from a CAD part to everything that tracking needs.

Resumable: each generator, and each view region of those that are trained, is stored as soon as it is complete, and a
second run keeps what is there. A region of the auto-encoder, minutes of work, is also resumed within its training.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2

from acp_lab.cad.edges import sample_edges
from acp_lab.cad.near_turns import near_turns
from acp_lab.cad.part import Part
from acp_lab.cad.raycast import RayCaster, make_caster
from acp_lab.cad.symmetry import find_symmetries
from acp_lab.control_points.view_regions import ALL_REGIONS, REGION_COUNT
from acp_lab.detection.view_templates import SUBDIVISIONS, make_views
from acp_lab.errors import PreparationError, check_kind
from acp_lab.files import write_whole
from acp_lab.generator.device import torch_device
from acp_lab.generator.painted.config import AutoencoderConfig
from acp_lab.generator.painted.edge_images import OUTLINE_SHARE_OF_BREAK
from acp_lab.generator.templates import build_templates
from acp_lab.generator.two_at_a_time import two_at_a_time
from acp_lab.generator.visibility import RegionNetwork
from acp_lab.input_file import path_of
from acp_lab.locks import only_writer
from acp_lab.pasted import quoted
from acp_lab.prepared_part import (
    DEFAULT_EDGE_BREAK_MM,
    FORMAT_VERSION,
    UNSEALED_VERSION,
    PreparedPart,
    PrepareOptions,
    RegionReport,
    Trained,
    add_checksums,
    part_folder,
    read_header,
)

if TYPE_CHECKING:
    from acp_lab.control_points.regression import RegressionConfig

CHECKPOINT_SUFFIX = ".checkpoint.safetensors"
LARGEST_EDGE_BREAK = 0.05
"""Of the diameter: beyond that it is a slip of a unit, and no edge is where the CAD model says."""
Progress = Callable[[str, int, int], None]


def prepare(
    part: Part,
    options: PrepareOptions | None = None,
    *,
    out: str | Path | None = None,
    progress: Progress | None = None,
) -> PreparedPart:
    """Prepare a part for tracking.

    Args:
        part: its symmetries are looked for where nobody told them, see `symmetry.find_symmetries`.
        options: what to prepare, and how; by default templates and visibility networks for all regions.
        out: folder of prepared parts; the part is stored in out / part.name. Nothing is stored by default.
        progress: called with (stage, done, total).

    Raises:
        PreparationError: the folder holds another mesh of that name, the name is no folder's, or there is no GPU
            where one was asked for.
        PartError: the mesh has no edges.
        InputFileError: a file cannot be written, or another program is preparing a part of that name there.
    """
    check_kind(part, Part, "part", "acp.Part.from_file('bracket.ply')")
    options = options or PrepareOptions()
    check_kind(options, PrepareOptions, "options", "acp.PrepareOptions('both', fast=True) or the like")
    check_device(options)  # before anything is stored: a refusal leaves no trace
    if out is None:
        return _prepare(part, options, None, progress)
    folder = part_folder(path_of(out, "a folder of prepared parts", "parts"), part.name, part.path)
    if _is_complete_for_good(part, options, folder):  # nothing is written: no lock, which could not be made there
        return _prepare(part, options, folder, progress)
    with only_writer(folder, "this part"):
        return _prepare(part, options, folder, progress)


def _is_complete_for_good(part: Part, options: PrepareOptions, folder: Path) -> bool:
    """Whether a folder that cannot be written, such as a shared one, holds a part as it is asked for already."""
    if not folder.is_dir() or all(os.access(place, os.W_OK) for place in (folder, folder.parent)):
        return False
    stored = _stored(part, folder, options)
    return stored is not None and stored.options.get(options.generator) == options and not stored.lacks


def check_device(options: PrepareOptions) -> None:
    """PreparationError where the auto-encoder is to be trained on a GPU that this machine lacks."""
    if options.generator == "autoencoder" and options.device == "cuda":  # the others are never refused, nor need torch
        torch_device(options.device)


def _prepare(part: Part, options: PrepareOptions, folder: Path | None, progress: Progress | None) -> PreparedPart:
    trains = options.generator in ("learned", "both")
    if folder is not None and not options.resume:
        for checkpoint in folder.glob(f"*{CHECKPOINT_SUFFIX}"):
            checkpoint.unlink()
    stored = None if folder is None else _stored(part, folder, options)
    model = stored or _with_edges(part, options.seed)
    if not part.symmetries.told:
        part = replace(part, symmetries=find_symmetries(part, model.edges))
        model = replace(model, part=part)
    model = replace(model, near_turns=near_turns(part, model.edges))
    if trains and model.seed != options.seed:  # only the networks depend on it
        model = replace(model, seed=options.seed, networks=Trained(), cpu_s=_without(model.cpu_s, "networks"))
    if options.edge_break_mm is not None:
        if options.edge_break_mm > LARGEST_EDGE_BREAK * part.diameter:
            raise PreparationError(
                f"{part.name}: --edge-break {options.edge_break_mm:g}: its edges cannot be broken by more than "
                f"{LARGEST_EDGE_BREAK:g} of its diameter, {part.diameter:.1f} mm: give millimetres, such as 0.3"
            )
        model = replace(model, edge_break_mm=options.edge_break_mm)
    model = replace(model, options={**model.options, options.generator: options})

    job = _Job(options, make_caster(part), folder, progress)
    if options.generator == "autoencoder":
        job.store(model)
        return _train_autoencoders(_regress_points(model, job), job)
    # Regions without a network of their own need the templates to fall back on.
    if (options.generator != "learned" or len(options.wanted_regions) < REGION_COUNT) and model.templates is None:
        begin_s = time.process_time()
        templates = build_templates(part, model.edges, job.caster, job.progress_of("view templates"))
        model = replace(model, templates=templates).took("templates", time.process_time() - begin_s)
        job.store(model)
    if trains:
        model = _train_networks(model, job)
    if model.views is None:
        # By rays, not by a generator, which may gain regions or be trained anew.
        begin_s = time.process_time()
        seen = build_templates(part, model.edges, job.caster, subdivisions=SUBDIVISIONS)
        model = replace(model, views=make_views(part, seen)).took("views", time.process_time() - begin_s)
    job.store(model)
    return model


def _with_edges(part: Part, seed: int) -> PreparedPart:
    begin_s = time.process_time()
    model = PreparedPart(part, sample_edges(part), usual_edge_break_mm(part), seed)
    return model.took("edges", time.process_time() - begin_s)


def usual_edge_break_mm(part: Part) -> float:
    """How far the edges of a part of that size are expected to be broken, where nobody tells."""
    return part.times_usual * DEFAULT_EDGE_BREAK_MM


def _without(cpu_s: Mapping[str, float], stage: str) -> dict[str, float]:
    return {name: value for name, value in cpu_s.items() if name != stage}


@dataclass(frozen=True)
class _Job:
    """What every stage needs: the options, rays against the part, where to store, whom to tell."""

    options: PrepareOptions
    caster: RayCaster
    folder: Path | None
    progress: Progress | None

    def store(self, model: PreparedPart) -> None:
        if self.folder is not None:
            model.save(self.folder)

    def progress_of(self, stage: str) -> Callable[[int, int], None] | None:
        progress = self.progress
        return None if progress is None else (lambda done, total: progress(stage, done, total))


def check_same_mesh(part: Part, folder: Path) -> Mapping[str, Any]:
    """What part.json of a prepared part says; PreparationError where it was made from another mesh than this part."""
    header = read_header(folder, f"run: acp-lab prepare {quoted(part.path or 'MESH')} --out {quoted(folder.parent)}")
    if header["mesh"]["sha256"] != part.sha256:
        raise PreparationError(
            f"{folder}: holds a part prepared from another mesh of the same name; "
            "give another --out to keep both, --no-resume to replace it, or rename the mesh"
        )
    return header


def _stored(part: Part, folder: Path, options: PrepareOptions) -> PreparedPart | None:
    """What a folder holds of this very part; None to start anew."""
    if not options.resume or not (folder / "part.json").exists():
        return None
    header = check_same_mesh(part, folder)
    if header["version"] == UNSEALED_VERSION:
        add_checksums(folder, header, FORMAT_VERSION)
    return replace(PreparedPart.load(folder, part.path), part=part)


def _train_networks(model: PreparedPart, job: _Job) -> PreparedPart:
    """The visibility network of each region."""
    # torch takes seconds to import; preparing templates alone does without.
    from acp_lab.generator.visibility_training import TrainingConfig, train_region

    config = TrainingConfig.fast() if job.options.fast else TrainingConfig()
    networks = model.networks.under(_in_words(config))
    if networks is not model.networks:
        model = replace(model, networks=networks, cpu_s=_without(model.cpu_s, "networks"))

    part, edges, seed = model.part, model.edges, model.seed

    def train(region: int, tell: Callable[[int, int], None]) -> tuple[int, RegionNetwork, RegionReport]:
        begin = time.perf_counter()
        network, report = train_region(part, edges, job.caster, ALL_REGIONS[region], config, seed, tell)
        return region, network, RegionReport(**asdict(report), train_s=time.perf_counter() - begin)

    missing = [region for region in job.options.wanted_regions if region not in model.networks]
    before_s = time.process_time()
    for region, network, report in two_at_a_time(train, missing, job.progress_of("visibility networks")):
        now_s = time.process_time()
        model = replace(model, networks=model.networks.with_region(region, network, report))
        model, before_s = model.took("networks", now_s - before_s), now_s
        job.store(model)
    return model


def _regress_points(model: PreparedPart, job: _Job) -> PreparedPart:
    """The control points W of each region, paper IV-C."""
    from acp_lab.control_points.regression import RegressionConfig, regress_points

    config, seed = RegressionConfig.fast() if job.options.fast else RegressionConfig(), job.options.seed
    regressed = model.regressed_points.under(_seeded(config, seed))
    if regressed is not model.regressed_points:  # the auto-encoders were trained for the old points
        model = replace(model, regressed_points=regressed, autoencoders=Trained())
        model = replace(model, cpu_s=_without(_without(model.cpu_s, "control points"), "auto-encoder"))
    for region in job.options.wanted_regions:
        if region in model.regressed_points:
            continue
        view, begin_s = ALL_REGIONS[region], time.process_time()
        tell = job.progress_of(f"control points, region {view.name}")
        points, report = regress_points(model.part, model.edges, job.caster, view, config, seed, tell)
        model = replace(model, regressed_points=model.regressed_points.with_region(region, points, asdict(report)))
        model = model.took("control points", time.process_time() - begin_s)
        job.store(model)
    return model


def _train_autoencoders(model: PreparedPart, job: _Job) -> PreparedPart:
    """The edge image generator of each region, paper IV-A."""
    from acp_lab.generator.painted.training import train_autoencoder

    config, seed = _autoencoder_config(job.options, model.edge_break_mm), job.options.seed
    autoencoders = model.autoencoders.under(_seeded(config, seed))
    if autoencoders is not model.autoencoders:
        model = replace(model, autoencoders=autoencoders, cpu_s=_without(model.cpu_s, "auto-encoder"))
    for region in job.options.wanted_regions:
        checkpoint = None if job.folder is None else job.folder / f"autoencoder_{region}{CHECKPOINT_SUFFIX}"
        if region not in model.autoencoders:
            view, points, begin_s = ALL_REGIONS[region], model.regressed_points[region], time.process_time()
            tell = job.progress_of(f"auto-encoder, region {view.name}")
            trained = train_autoencoder(
                model.part, job.caster, view, points, config, seed, tell, checkpoint, device=job.options.device
            )
            autoencoders = model.autoencoders.with_region(region, trained.autoencoder, trained.report)
            model = replace(model, autoencoders=autoencoders).took("auto-encoder", time.process_time() - begin_s)
            if job.folder is not None:
                picture = cv2.imencode(".png", trained.grid)[1]
                write_whole(job.folder / f"autoencoder_{region}.png", picture.tobytes(), "the picture")
            job.store(model)
        if checkpoint is not None:  # also that of a run that was stopped in its very last moment
            checkpoint.unlink(missing_ok=True)
    return model


def _autoencoder_config(options: PrepareOptions, edge_break_mm: float) -> AutoencoderConfig:
    if options.fast:
        config = AutoencoderConfig.fast()
    else:  # the paper's frame goes with the paper's number of views
        config = AutoencoderConfig.as_printed() if options.painting_frame == "prediction" else AutoencoderConfig()
    if options.painting_px is not None:
        config = config.painting(options.painting_px)
    inset_mm = OUTLINE_SHARE_OF_BREAK * edge_break_mm if options.edge_source == "analytic" else 0.0
    images = replace(config.images, source=options.edge_source, frame=options.painting_frame, outline_inset_mm=inset_mm)
    return replace(config, images=images)


def _in_words(config: object) -> str:
    """Identifies the settings of a training, on one line."""
    return ", ".join(f"{key}={value}" for key, value in asdict(config).items())  # type: ignore[call-overload]


def _seeded(config: RegressionConfig | AutoencoderConfig, seed: int) -> str:
    """Identifies settings and seed of a training, on one line."""
    return f"seed={seed}, {_in_words(config)}"
