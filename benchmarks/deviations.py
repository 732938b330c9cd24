"""From the paper's path as it is printed to `acp-paper`, one deviation at a time, and how well its generators paint.

Every step is on the ridges of the painted edge image but these: "true images" has the ridges of the images that the
network should have painted, "exact edges" the visibility network's edges, in the same view regions; both move edges by
the homography alone, unless "rigid direction" is said, the whole path. "without" is the whole path with one deviation
taken away; the residual homography takes the rigid direction with it, which moves on from where it generates, and that
the lengths on the part. Steps before "frame at the pose" need auto-encoders of a frame at the prediction, of the same
length of training. From truth, no resets, the first frame left out, one thread. The bias of a painting is that of the
pose which fits it best at the true pose (`acp_lab.studies.painting_bias`). `--causes` runs the last steps and these
alone, forwards and backwards; `--floor` reads ridges off true images of a hundred views of the first frame's region,
and needs no auto-encoder. `--directions` asks what the literal path's direction costs: the paper takes the homography
for the direction of a step alone, and e(I) of t(I); here edges are generated once per level, and moved by it.

Example: python -m benchmarks.deviations path/to/dataset/test/000001... --parts out/parts --literal-parts out/literal
(prepared before: acp-lab prepare MESH --out out/parts/DATASET, again with --generator autoencoder, and
--generator autoencoder --painting-frame prediction with --out out/literal/DATASET)
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import islice, product
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from acp_lab.commands import machine

# Before NumPy is imported: its linear algebra reads the number of threads once.
machine.limit_threads(1)

import numpy as np  # noqa: E402

if TYPE_CHECKING:
    from acp_lab.geometry.arrays import FloatArray
    from acp_lab.prepared_part import PreparedPart
    from acp_lab.sequences.bop import BopScene
    from acp_lab.sequences.frame import Frame
    from acp_lab.tracking.method import Method
    from acp_lab.tracking.motions import ControlPointVariables
    from acp_lab.tracking.schedule import ShareSchedule
    from acp_lab.tracking.solvers import GaussNewton

SEED = 0
RIGIDITY = 0.2
"""Weight of the rigidity prior, per squared px: the best of 0.05, 0.2 and 1 on eight sequences, exact edges."""
LIMITS = {"@2": 0.02, "@5": 0.05, "@10": 0.10}
CAUSES = (
    "+ lengths on the part",
    "true images, rigid direction",
    "exact edges, rigid direction",
    "+ annealed alpha",
    "true images",
    "exact edges",
)
LITERAL_STEPS = ("literal", "+ residual homography", "without frame at the pose")
UNITS = {
    "@*": "share of frames with ADD (ADD-S for symmetric parts) below 2, 5, 10% of the diameter, mean over sequences",
    "ms": "CPU ms per frame, median over sequences",
}

_STEPS = 12
"""As many as the three levels of `acp-paper` take together."""

PAINTED = {
    "*_px": "canonical px, mean Chamfer distance on held-out views, generated to true and back",
    "f_score": "at one canonical px, held-out views",
    "bias_percent": "ADD of the pose fitted to what is painted at the true pose, % of the diameter, median",
}


def steps() -> dict[str, Method]:
    """The path, cumulative, then its end with one thing taken away or replaced; see the module's head."""
    from acp_lab.tracking.method import METHODS
    from acp_lab.tracking.priors import RigidityPrior
    from acp_lab.tracking.sources.rigid import CadSamples

    literal, paper = METHODS["acp-paper-literal"], METHODS["acp-paper"]
    points = cast("ControlPointVariables", paper.variables)
    residual = replace(literal, variables=replace(points, direction="homography", lengths="image"))
    at_pose = replace(residual, source=paper.source)
    bins = replace(at_pose, targets=paper.targets)
    annealed = replace(paper, variables=residual.variables)
    in_image = replace(paper, variables=replace(points, lengths="image"))
    exact = CadSamples("learned", inset_outlines=True)
    found = {
        "literal": literal,
        "+ residual homography": residual,
        "+ frame at the pose": at_pose,
        "+ orientation bins": bins,
        "+ annealed alpha": annealed,
        "+ rigid direction": in_image,
        "+ lengths on the part": paper,
        "without residual homography": replace(paper, variables=literal.variables),
        "without frame at the pose": replace(paper, source=literal.source),
        "without orientation bins": replace(paper, targets=literal.targets),
        "without annealed alpha": replace(paper, schedule=literal.schedule),
        "true images": annealed,
        "true images, rigid direction": paper,
        "exact edges": replace(annealed, source=exact),
        "exact edges, rigid direction": replace(paper, source=exact),
        "with a rigidity prior": replace(paper, priors=(RigidityPrior(RIGIDITY),)),
        "exact edges, with a rigidity prior": replace(paper, source=exact, priors=(RigidityPrior(RIGIDITY),)),
    }
    return found | {name: METHODS[name] for name in ("direct-6dof", "unoptimised-points", "acp-paper-samples")}


def directions() -> dict[str, Method]:
    """The literal path, and others by how their edges follow I; with one alpha, as it has."""
    from acp_lab.tracking.method import METHODS

    literal = METHODS["acp-paper-literal"]
    points = cast("ControlPointVariables", literal.variables)
    schedule, solver = cast("ShareSchedule", literal.schedule), cast("GaussNewton", literal.solver)
    longer = replace(solver, steps=_STEPS)
    return {
        "literal": literal,
        "generated at every step": replace(
            literal, schedule=replace(schedule, shares=(1.0,) * _STEPS), solver=replace(solver, steps=1)
        ),
        "through the network": replace(literal, variables=replace(points, direction="autograd"), solver=longer),
        "by differences": replace(literal, variables=replace(points, direction="differences"), solver=longer),
    }


class DecodedScene:
    """A scene whose frames are decoded once for all runs."""

    def __init__(self, scene: BopScene) -> None:
        from benchmarks.runs import readable_frames

        self.scene = scene
        self._frames = readable_frames(scene)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.scene, name)

    def frames(self, max_frames: int | None = None) -> Iterator[Frame]:
        return islice(iter(self._frames), max_frames)


@dataclass(frozen=True)
class Run:
    """One step on one sequence: shares of frames below the limits, CPU ms per frame."""

    sequence: str
    step: str
    shares: dict[str, float]
    ms: float


def track(decoded: DecodedScene, model: PreparedPart, step: str, method: Method, backwards: bool = False) -> Run:
    """One run, from the truth of the first frame, or of the last one."""
    errors, ms = errors_along(decoded, model, method, backwards=backwards)
    return Run(name_of(decoded.scene), step, {key: float((errors < limit).mean()) for key, limit in LIMITS.items()}, ms)


def errors_along(
    decoded: DecodedScene,
    model: PreparedPart,
    method: Method,
    off: tuple[float, float] = (0.0, 0.0),
    backwards: bool = False,
) -> tuple[FloatArray, float]:
    """(n,) ADD of all frames but the first as a share of the diameter, infinite from where there is no pose; CPU ms.

    Args:
        off: degrees and mm by which the first pose is off, see `disturb_pose`.
        backwards: begins at the last frame.
    """
    from acp_lab.errors import TrackingError
    from acp_lab.evaluation import PartMetric
    from acp_lab.geometry.pose import disturb_pose
    from acp_lab.tracking.tracker import Tracker

    metric, object_id = PartMetric(model.part), decoded.object_ids[0]
    first, *others = list(decoded.frames())[:: -1 if backwards else 1]
    rng = np.random.default_rng([SEED, decoded.scene_id, object_id])
    pose = disturb_pose(decoded.truth(first.index, object_id), model.part.box_centre, *off, rng)
    tracker = Tracker(model, method)
    poses: list[FloatArray] = []
    begin = time.process_time()
    try:
        tracker.start(first, pose)
        poses.extend(tracker.track(frame).cam_T_obj for frame in others)
    except TrackingError:
        pass
    ms = 1e3 * (time.process_time() - begin) / (1 + len(others))
    errors = np.full(len(others), np.inf)
    for row, (found, frame) in enumerate(zip(poses, others, strict=False)):
        errors[row] = metric.share(found, decoded.truth(frame.index, object_id))
    return errors, ms


def name_of(scene: BopScene) -> str:
    """Such as "metal_public 1"."""
    return f"{set_of(scene)} {scene.scene_id}"


def set_of(scene: BopScene) -> str:
    """The data set's name; that of the package's own is "sample"."""
    from acp_lab.bench.protocol import dataset_name

    return dataset_name(scene.dataset.root)


def load(parts: Path, scene: BopScene) -> PreparedPart:
    """The prepared part of a scene's first object."""
    from acp_lab.prepared_part import PreparedPart

    object_id = scene.object_ids[0]
    return PreparedPart.load(parts / set_of(scene) / f"obj_{object_id:06d}", scene.dataset.part_path(object_id))


def of_painted_regions(model: PreparedPart) -> PreparedPart:
    """Exact edges in the regions of the auto-encoder only, so that both are compared in the same ones."""
    from acp_lab.prepared_part import Trained

    networks = Trained[Any, Any]()
    for region in model.autoencoders.regions:
        networks = networks.with_region(region, model.networks[region], model.networks.reports[region])
    return replace(model, templates=None, networks=networks)


def painting(decoded: DecodedScene, model: PreparedPart, every: int = 3) -> dict[str, float]:
    """How well the part's generators paint: held-out views, and every third frame of a sequence."""
    from acp_lab.errors import PreparationError
    from acp_lab.studies.painting_bias import PaintingBench

    bench, biases = PaintingBench(model), []
    for frame in list(decoded.frames())[::every]:
        pose = decoded.truth(frame.index, decoded.object_ids[0])
        try:
            biases.append(bench.bias(decoded.camera(frame.index), pose).add_share)
        except PreparationError:  # a region that was not trained
            continue
    qualities = [report.generated for report in model.autoencoders.reports.values()]
    return {
        "there_px": float(np.mean([quality.generated_to_true_px for quality in qualities])),
        "back_px": float(np.mean([quality.true_to_generated_px for quality in qualities])),
        "f_score": float(np.mean([quality.f_score for quality in qualities])),
        "bias_percent": 100.0 * float(np.median(biases)),
    }


def floor(decoded: DecodedScene, model: PreparedPart, views: int = 100) -> dict[str, float]:
    """The same of true edge images of views of the region that the first frame shows: the best that can be painted."""
    from acp_lab.cad.raycast import make_caster
    from acp_lab.control_points.canonical_frame import eye_position
    from acp_lab.control_points.view_regions import ALL_REGIONS, choose_region
    from acp_lab.generator.painted.edge_images import (
        OUTLINE_SHARE_OF_BREAK,
        EdgeImageConfig,
        draw_views,
        make_edge_views,
        true_points,
    )
    from acp_lab.generator.painted.edge_points import ridge
    from acp_lab.generator.painted.pose_bias import pose_bias
    from acp_lab.generator.painted.quality import generation_quality

    part, still = model.part, np.eye(3)
    region = ALL_REGIONS[choose_region(eye_position(decoded.first_pose) - part.box_centre, 0.5 * part.box_size)]
    config = EdgeImageConfig(outline_inset_mm=OUTLINE_SHARE_OF_BREAK * model.edge_break_mm)
    drawn = make_edge_views(part, make_caster(part), region, config, views, SEED)
    images = np.concatenate([draw_views([view], still[None], config.line_sigma_px) for view in drawn])
    quality = generation_quality(images, [true_points(view, still) for view in drawn])
    biases = [pose_bias(ridge(image), view, part) for image, view in zip(images, drawn, strict=True)]
    return {
        "there_px": quality.generated_to_true_px,
        "back_px": quality.true_to_generated_px,
        "f_score": quality.f_score,
        "bias_percent": 100.0 * float(np.nanmedian(biases)),
    }


def mean_rows(runs: list[Run]) -> dict[str, dict[str, float]]:
    """Per step the mean over sequences."""
    rows = {}
    for step in dict.fromkeys(run.step for run in runs):
        own = [run for run in runs if run.step == step]
        shares = {key: float(np.mean([run.shares[key] for run in own])) for key in LIMITS}
        rows[step] = shares | {"ms": float(np.median([run.ms for run in own]))}
    return rows


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scenes", nargs="+", type=Path, help="scene folders of BOP data sets")
    parser.add_argument("--parts", type=Path, required=True, help="prepared parts, one folder per data set")
    parser.add_argument("--literal-parts", type=Path, help="the same for a frame at the prediction")
    parser.add_argument("--causes", action="store_true", help="painted ridges, true images and exact edges only")
    parser.add_argument("--floor", action="store_true", help="how exact ridges of true images are; no auto-encoder")
    parser.add_argument("--directions", action="store_true", help="the literal path by its direction of a step")
    parser.add_argument("--record", action="store_true", help="write to docs/measured.json")
    options = parser.parse_args()
    from acp_lab.sequences import open_sequence
    from acp_lab.studies.perfect_painter import perfectly_painted

    if options.directions:
        print_directions(options.scenes, options.literal_parts or options.parts, options.record)
        return
    if options.floor:
        print_floor(options.scenes, options.parts, options.record)
        return
    if options.literal_parts is None and not options.causes:
        parser.error("give --literal-parts, or --causes or --floor, which need none")
    runs, painted = list[Run](), {}
    for folder in options.scenes:
        decoded = DecodedScene(open_sequence(folder))
        model = load(options.parts, decoded.scene)
        true_images = perfectly_painted(model, model.autoencoder().regions, model.autoencoder().size)
        by_step: dict[str, PreparedPart] = dict.fromkeys(
            (step for step in steps() if step.startswith("true")), true_images
        )
        by_step |= dict.fromkeys((step for step in steps() if step.startswith("exact")), of_painted_regions(model))
        if options.causes:
            for step, backwards in product(CAUSES, (False, True)):
                runs.append(track(decoded, by_step.get(step, model), step, steps()[step], backwards))
                print(runs[-1], flush=True)
            continue
        literal = load(options.literal_parts, decoded.scene)
        by_step |= dict.fromkeys(LITERAL_STEPS, literal)
        for step, method in steps().items():
            runs.append(track(decoded, by_step.get(step, model), step, method))
            print(runs[-1], flush=True)
        name = name_of(decoded.scene)
        painted[name] = painting(decoded, model)
        painted[f"{name}, at the prediction"] = painting(decoded, literal)
        print(painted[name], flush=True)
    rows = mean_rows(runs)
    for step, row in rows.items():
        print(f"| {step} | " + " | ".join(f"{value:.2f}" for value in row.values()) + " |")
    if options.record and options.causes:
        record_causes(runs, rows)
    elif options.record:
        record_path(runs, rows, painted)


def print_directions(scenes: list[Path], parts: Path, to_record: bool) -> None:
    """Of the literal path; into docs/measured.json if wanted. parts: prepared for a frame at the prediction."""
    from acp_lab.sequences import open_sequence
    from benchmarks.measured import record

    runs = list[Run]()
    for folder in scenes:
        decoded = DecodedScene(open_sequence(folder))
        model = load(parts, decoded.scene)
        for step, method in directions().items():
            runs.append(track(decoded, model, step, method))
            print(runs[-1], flush=True)
    if to_record:
        about = "acp-paper-literal by how edges follow I within a level, from truth, no resets"
        names = dict.fromkeys(run.sequence for run in runs)
        record("deviations.directions", about, UNITS, ", ".join(names), mean_rows(runs))


def print_floor(scenes: list[Path], parts: Path, to_record: bool) -> None:
    """Of each sequence's part; into docs/measured.json if wanted."""
    from acp_lab.sequences import open_sequence
    from benchmarks.measured import record

    rows = {}
    for folder in scenes:
        decoded = DecodedScene(open_sequence(folder))
        rows[name_of(decoded.scene)] = floor(decoded, load(parts, decoded.scene))
        print(name_of(decoded.scene), rows[name_of(decoded.scene)], flush=True)
    if to_record:
        about = "ridges of true edge images, 100 views of the region that a sequence begins in"
        record("painting.floor", about, PAINTED, ", ".join(rows), rows)


def record_causes(runs: list[Run], rows: dict[str, dict[str, float]]) -> None:
    """Into docs/measured.json, each sequence as the mean of its two orders."""
    from benchmarks.measured import record

    names = list(dict.fromkeys(run.sequence for run in runs))
    about = (
        "acp-paper on painted ridges, on those of true images and on exact edges; from truth, forwards and backwards"
    )
    record("deviations.causes", about, UNITS, ", ".join(names), rows)
    each = {
        f"{name}: {step}": {k: v for k, v in row.items() if k != "ms"}
        for name in names
        for step, row in mean_rows([run for run in runs if run.sequence == name]).items()
    }
    record(
        "deviations.causes.each", "the same, each sequence", {"@*": UNITS["@*"].split(",")[0]}, ", ".join(names), each
    )


def record_path(runs: list[Run], rows: dict[str, dict[str, float]], painted: dict[str, dict[str, float]]) -> None:
    """Into docs/measured.json."""
    from benchmarks.measured import record

    data = ", ".join(dict.fromkeys(run.sequence for run in runs))
    record("deviations", "acp-paper-literal to acp-paper, cumulative, from truth, no resets", UNITS, data, rows)
    each = {f"{run.sequence}: {run.step}": run.shares for run in runs}
    record("deviations.each", "the same, each sequence", {"@*": UNITS["@*"].split(",")[0]}, data, each)
    record("painting", "the auto-encoders of the parts of these sequences", PAINTED, data, painted)


if __name__ == "__main__":
    main()
