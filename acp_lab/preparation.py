"""The offline phase from start to end: from a CAD part to everything that tracking needs.

Resumable: each generator, and each view region of those that are trained, is stored as soon as it is
complete, and a second run takes up what is there. A region of the auto-encoder, minutes of work, also
goes on within its training.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING

from acp_lab.cad.edges import sample_edges
from acp_lab.cad.part import Part
from acp_lab.cad.raycast import RayCaster, make_caster
from acp_lab.control_points.view_regions import ALL_REGIONS, REGION_COUNT
from acp_lab.errors import PreparationError
from acp_lab.generator.painted.config import AutoencoderConfig
from acp_lab.generator.painted.edge_images import OUTLINE_SHARE_OF_BREAK, Source
from acp_lab.generator.templates import build_templates
from acp_lab.prepared_part import PreparedPart, RegionReport, read_header, write_picture

if TYPE_CHECKING:
    from acp_lab.control_points.regression import RegressionConfig

GENERATORS = ("templates", "learned", "both", "autoencoder")
CHECKPOINT_SUFFIX = ".checkpoint.safetensors"
Progress = Callable[[str, int, int], None]


def prepare(
    part: Part,
    *,
    generator: str = "both",
    fast: bool = False,
    regions: tuple[int, ...] | None = None,
    edge_break_mm: float | None = None,
    edge_source: Source = "analytic",
    seed: int = 0,
    out: Path | None = None,
    resume: bool = True,
    progress: Progress | None = None,
) -> PreparedPart:
    """Prepare a part for tracking.

    Args:
        generator: "templates" (seconds), "learned" (minutes), "both", or "autoencoder", the paper's own, with its
            regressed control points (minutes per region). What the folder holds of other generators is kept.
        fast: less training, for lessons and tests.
        regions: view regions 0..5 to train; default all. Others fall back to the templates; the auto-encoder does
            without them.
        edge_break_mm: how far the real part's edges are broken; default what the folder holds, else 0.25.
        edge_source: what the auto-encoder learns to paint: the mesh's "analytic" edges, or rendered "normals"
            through Canny, as the paper's authors did; those know no broken edges.
        seed: of all random choices.
        out: folder of prepared parts; the part is stored in out / part.name. Nothing is stored by default.
        resume: take up what is stored there; False starts anew.
        progress: called with (stage, done, total).

    Raises:
        PreparationError: unknown generator or region, or the folder holds another mesh of that name.
        PartError: the mesh has no edges.
    """
    if generator not in GENERATORS:
        raise PreparationError(f"--generator {generator}: choose one of {', '.join(GENERATORS)}")
    wanted = tuple(range(REGION_COUNT)) if regions is None else tuple(sorted(set(regions)))
    if not wanted or not set(wanted) <= set(range(REGION_COUNT)):
        raise PreparationError(f"--regions {regions}: choose from 0 to {REGION_COUNT - 1}, or all")
    if seed < 0:
        raise PreparationError(f"--seed {seed}: give 0 or more")
    folder = None if out is None else out / part.name
    trains = generator in ("learned", "both")
    if folder is not None and not resume:
        for checkpoint in folder.glob(f"*{CHECKPOINT_SUFFIX}"):
            checkpoint.unlink()
    model = _take_up(part, folder, seed, trains, resume) if folder is not None else None
    model = model or PreparedPart(part, sample_edges(part), seed=seed)
    if edge_break_mm is not None:
        model = replace(model, edge_break_mm=edge_break_mm)

    caster = make_caster(part)
    if generator == "autoencoder":
        _store(model, folder)
        model = _regress(model, caster, wanted, fast, seed, folder, progress)
        config = AutoencoderConfig.fast() if fast else AutoencoderConfig()
        inset_mm = OUTLINE_SHARE_OF_BREAK * model.edge_break_mm if edge_source == "analytic" else 0.0
        images = replace(config.images, source=edge_source, outline_inset_mm=inset_mm)
        return _paint(model, caster, wanted, replace(config, images=images), seed, folder, progress)
    # Regions without a network of their own need the templates to fall back on.
    if (generator != "learned" or len(wanted) < REGION_COUNT) and model.templates is None:
        tell = None if progress is None else (lambda done, total: progress("view templates", done, total))
        model = replace(model, templates=build_templates(part, model.edges, caster, tell))
        _store(model, folder)
    if trains:
        model = _train(model, caster, wanted, fast, folder, progress)
    _store(model, folder)
    return model


def _take_up(part: Part, folder: Path, seed: int, trains: bool, resume: bool) -> PreparedPart | None:
    """What a folder holds of this very part; None to start anew."""
    if not resume or not (folder / "part.json").exists():
        return None
    again = "give --no-resume to prepare it anew, or rename the mesh"
    command = f"run: acp-lab prepare {part.path or 'MESH'} --out {folder.parent}"
    if read_header(folder, command)["mesh"]["sha256"] != part.sha256:
        raise PreparationError(f"{folder}: holds a part prepared from another mesh of the same name; {again}")
    stored = PreparedPart.load(folder, part.path)
    if trains and stored.seed != seed:  # only the networks depend on it
        return replace(stored, part=part, seed=seed, networks={}, reports=(), training="")
    return replace(stored, part=part)


def _train(
    model: PreparedPart,
    caster: RayCaster,
    regions: tuple[int, ...],
    fast: bool,
    folder: Path | None,
    progress: Progress | None,
) -> PreparedPart:
    # torch takes seconds to import; preparing templates alone does without.
    from acp_lab.generator.visibility_training import TrainingConfig, train_region

    config = TrainingConfig.fast() if fast else TrainingConfig()
    settings = ", ".join(f"{key}={value}" for key, value in asdict(config).items())
    if model.training != settings:  # networks trained otherwise are no part of this result
        model = replace(model, networks={}, reports=(), training=settings)
    for region in regions:
        if region in model.networks:
            continue
        begin, stage = time.perf_counter(), f"visibility network, region {ALL_REGIONS[region].name}"
        tell = None if progress is None else (lambda done, total, stage=stage: progress(stage, done, total))
        network, report = train_region(model.part, model.edges, caster, ALL_REGIONS[region], config, model.seed, tell)
        stored = RegionReport(
            region,
            report.precision,
            report.recall,
            report.hidden_found,
            report.final_loss,
            time.perf_counter() - begin,
        )
        model = replace(model, networks={**model.networks, region: network}, reports=(*model.reports, stored))
        _store(model, folder)
    return model


def _regress(
    model: PreparedPart,
    caster: RayCaster,
    regions: tuple[int, ...],
    fast: bool,
    seed: int,
    folder: Path | None,
    progress: Progress | None,
) -> PreparedPart:
    """The control points W of each region, paper IV-C."""
    from acp_lab.control_points.regression import RegressionConfig, regress_points

    config = RegressionConfig.fast() if fast else RegressionConfig()
    settings = _settings(config, seed)
    if model.regression != settings:  # the auto-encoders were trained for the old points
        model = replace(model, regressed_points={}, regression_reports=(), regression=settings)
        model = replace(model, autoencoders={}, autoencoder_reports=())
    for region in regions:
        if region in model.regressed_points:
            continue
        tell = _stage_progress(progress, f"control points, region {ALL_REGIONS[region].name}")
        points, report = regress_points(model.part, model.edges, caster, ALL_REGIONS[region], config, seed, tell)
        model = replace(
            model,
            regressed_points={**model.regressed_points, region: points},
            regression_reports=(*model.regression_reports, asdict(report)),
        )
        _store(model, folder)
    return model


def _paint(
    model: PreparedPart,
    caster: RayCaster,
    regions: tuple[int, ...],
    config: AutoencoderConfig,
    seed: int,
    folder: Path | None,
    progress: Progress | None,
) -> PreparedPart:
    """The edge image generator of each region, paper IV-A."""
    from acp_lab.generator.painted.training import train_autoencoder

    settings = _settings(config, seed)
    if model.autoencoder_training != settings:
        model = replace(model, autoencoders={}, autoencoder_reports=(), autoencoder_training=settings)
    for region in regions:
        checkpoint = None if folder is None else folder / f"autoencoder_{region}{CHECKPOINT_SUFFIX}"
        if region in model.autoencoders:
            if checkpoint is not None:  # of a run that was stopped in its very last moment
                checkpoint.unlink(missing_ok=True)
            continue
        tell = _stage_progress(progress, f"auto-encoder, region {ALL_REGIONS[region].name}")
        points = model.regressed_points[region]
        trained = train_autoencoder(model.part, caster, ALL_REGIONS[region], points, config, seed, tell, checkpoint)
        model = replace(
            model,
            autoencoders={**model.autoencoders, region: trained.autoencoder},
            autoencoder_reports=(*model.autoencoder_reports, trained.report),
        )
        if folder is not None:
            write_picture(folder / f"autoencoder_{region}.png", trained.grid)
        _store(model, folder)
        if checkpoint is not None:
            checkpoint.unlink(missing_ok=True)
    return model


def _settings(config: RegressionConfig | AutoencoderConfig, seed: int) -> str:
    """Identifies a training: all settings and the seed, on one line."""
    return f"seed={seed}, " + ", ".join(f"{key}={value}" for key, value in asdict(config).items())


def _stage_progress(progress: Progress | None, stage: str) -> Callable[[int, int], None] | None:
    return None if progress is None else (lambda done, total: progress(stage, done, total))


def _store(model: PreparedPart, folder: Path | None) -> None:
    if folder is not None:
        model.save(folder)
