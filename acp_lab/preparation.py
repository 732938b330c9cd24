"""The offline phase from start to end: from a CAD part to everything that tracking needs.

Resumable: each generator, and each view region of the learned one, is stored as soon as it is
complete, and a second run takes up what is there.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path

from acp_lab.cad.edges import sample_edges
from acp_lab.cad.part import Part
from acp_lab.cad.raycast import RayCaster, make_caster
from acp_lab.control_points.view_regions import ALL_REGIONS, REGION_COUNT
from acp_lab.errors import PreparationError
from acp_lab.generator.templates import build_templates
from acp_lab.prepared_part import PreparedPart, RegionReport, read_header

GENERATORS = ("templates", "learned", "both")
Progress = Callable[[str, int, int], None]


def prepare(
    part: Part,
    *,
    generator: str = "both",
    fast: bool = False,
    regions: tuple[int, ...] | None = None,
    edge_break_mm: float | None = None,
    seed: int = 0,
    out: Path | None = None,
    resume: bool = True,
    progress: Progress | None = None,
) -> PreparedPart:
    """Prepare a part for tracking.

    Args:
        generator: "templates" (seconds), "learned" (minutes) or "both".
        fast: less training, for lessons and tests.
        regions: view regions 0..5 to train; default all. Others fall back to the templates.
        edge_break_mm: how far the real part's edges are broken; default what the folder holds, else 0.25.
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
    trains = generator != "templates"
    model = _take_up(part, folder, seed, trains, resume) if folder is not None else None
    model = model or PreparedPart(part, sample_edges(part), seed=seed)
    if edge_break_mm is not None:
        model = replace(model, edge_break_mm=edge_break_mm)

    caster = make_caster(part)
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
    from acp_lab.generator.training import TrainingConfig, train_region

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


def _store(model: PreparedPart, folder: Path | None) -> None:
    if folder is not None:
        model.save(folder)
