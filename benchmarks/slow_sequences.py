"""`acp-paper` on slow sequences of parts that next to nothing was chosen on: what painted edges carry and cost.

On the same view regions: `acp-paper` on the ridges of painted images, the same on the CAD's exact edges,
both with edges that follow the homography of the control points alone, as in the paper (`direction = "homography"`),
both with a prior that keeps I near what a rigid part can show, and the paper's two ablations on painted ridges, a pose
varied (w/o CP) and points of the middle section (w/o opt); and `acp-paper` with painted edges that count by their
length in the image. `--methods` runs some of these alone. Defaults, no resets, the first frame left out, one thread;
forwards and backwards, since single runs scatter. Intervals are 95% from a hierarchical block bootstrap over the
sequences, each with its two orders one after the other. (Lengths on the part were looked for on sequence 9 of
slow_checking; nothing else was chosen on these.)

`--true-images` needs no auto-encoder: the paintings are true edge images in the regions that a sequence shows, from
truth. What is lost then no generator can win back.

Example: python -m benchmarks.slow_sequences path/to/dataset/test/000001... --parts out/parts
(prepared before: acp-lab prepare MESH --out out/parts/DATASET, again with --generator autoencoder)
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any

from acp_lab.commands import machine

# Before NumPy is imported: its linear algebra reads the number of threads once.
machine.limit_threads(1)

import numpy as np  # noqa: E402

from acp_lab.cad.raycast import make_caster  # noqa: E402
from acp_lab.evaluation.bootstrap import bootstrap_mean  # noqa: E402
from acp_lab.generator.painted.edge_images import PAINTING_SIZE  # noqa: E402
from benchmarks.ablation import STARTS  # noqa: E402
from benchmarks.deviations import (  # noqa: E402
    LIMITS,
    PAINTED,
    SEED,
    DecodedScene,
    errors_along,
    load,
    name_of,
    of_painted_regions,
    painting,
    steps,
)

METHODS = {
    "painted edges": "+ lengths on the part",
    "exact edges": "exact edges, rigid direction",
    "painted edges, by homography": "+ annealed alpha",
    "exact edges, by homography": "exact edges",
    "painted edges, rigidity prior": "with a rigidity prior",
    "exact edges, rigidity prior": "exact edges, with a rigidity prior",
    "direct-6dof": "direct-6dof",
    "unoptimised-points": "unoptimised-points",
    "painted edges, lengths in the image": "+ rigid direction",
}
"""By the names of `deviations.steps`."""


@dataclass(frozen=True)
class SlowRun:
    """One method on one sequence: ADD of its frames as shares of the diameter, forwards and then backwards."""

    sequence: str
    start: str
    method: str
    errors: np.ndarray


def tracked(folder: Path, parts: Path, methods: dict[str, str]) -> Iterator[SlowRun]:
    """Methods, some of `METHODS`, from all starts on one sequence."""
    from acp_lab.sequences import open_sequence

    decoded = DecodedScene(open_sequence(folder))
    model = load(parts, decoded.scene)
    exact = of_painted_regions(model)
    for (start, off), (name, step) in product(STARTS.items(), methods.items()):
        shown = exact if name.startswith("exact") else model
        both = [errors_along(decoded, shown, steps()[step], off, way)[0] for way in (False, True)]
        yield SlowRun(name_of(decoded.scene), start, name, np.concatenate(both))


def tracked_on_true_images(folder: Path, parts: Path, methods: dict[str, str], size: int) -> Iterator[SlowRun]:
    """Methods, some of `METHODS`, from truth on one sequence, true edge images of `size` px instead of painted ones."""
    from acp_lab.control_points.canonical_frame import eye_position
    from acp_lab.control_points.regression import RegressionConfig, regress_points
    from acp_lab.control_points.view_regions import ALL_REGIONS, choose_region
    from acp_lab.prepared_part import Trained
    from acp_lab.sequences import open_sequence
    from acp_lab.studies.perfect_painter import perfectly_painted

    decoded = DecodedScene(open_sequence(folder))
    model = load(parts, decoded.scene)
    part, object_id = model.part, decoded.object_ids[0]
    eyes = [eye_position(decoded.truth(frame_id, object_id)) for frame_id in decoded.frame_ids]
    regions = sorted({choose_region(eye - part.box_centre, 0.5 * part.box_size) for eye in eyes})
    points, networks, caster = model.regressed_points, Trained[Any, Any](), make_caster(part)
    for k in regions:
        w_obj, _ = regress_points(part, model.edges, caster, ALL_REGIONS[k], RegressionConfig(), SEED, None)
        points = points.with_region(k, w_obj, {})
        networks = networks.with_region(k, model.networks[k], model.networks.reports[k])
    model = replace(model, regressed_points=points, templates=None, networks=networks)
    painted = perfectly_painted(model, tuple(regions), size)
    for name, step in methods.items():
        shown = model if name.startswith("exact") else painted
        both = [errors_along(decoded, shown, steps()[step], backwards=way)[0] for way in (False, True)]
        yield SlowRun(name_of(decoded.scene), "truth", name.replace("painted", "true"), np.concatenate(both))


def pooled_rows(runs: list[SlowRun]) -> dict[str, dict[str, list[float]]]:
    """Per start and method the mean over sequences and its interval."""
    rows = {}
    for start, method in dict.fromkeys((run.start, run.method) for run in runs):
        own = [run.errors for run in runs if (run.start, run.method) == (start, method)]
        shares = {key: bootstrap_mean([(one < limit).astype(float) for one in own]) for key, limit in LIMITS.items()}
        rows[f"{start}: {method}"] = {key: [share.mean, share.low, share.high] for key, share in shares.items()}
    return rows


def sequence_rows(runs: Iterable[SlowRun]) -> dict[str, dict[str, float]]:
    """Per sequence and method, from truth."""
    return {
        f"{run.sequence}: {run.method}": {key: float((run.errors < limit).mean()) for key, limit in LIMITS.items()}
        for run in runs
        if run.start == "truth"
    }


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scenes", nargs="+", type=Path, help="scene folders of BOP data sets")
    parser.add_argument("--parts", type=Path, required=True, help="prepared parts, one folder per data set")
    parser.add_argument("--true-images", action="store_true", help="in place of painted ones; no auto-encoder")
    parser.add_argument("--painting-px", type=int, default=PAINTING_SIZE, help="side of the true images")
    parser.add_argument("--methods", nargs="+", choices=METHODS, metavar="NAME", help="some alone")
    parser.add_argument("--record", metavar="KEY", help="write to docs/measured.json, as slow.KEY")
    options = parser.parse_args()
    if options.methods and options.record:
        parser.error("--record replaces all rows of an entry: leave out --methods")

    methods = {name: METHODS[name] for name in options.methods or METHODS}
    runs, painted = list[SlowRun](), dict[str, dict[str, float]]()
    for folder in options.scenes:
        if options.true_images:
            found = tracked_on_true_images(folder, options.parts, methods, options.painting_px)
        else:
            found = tracked(folder, options.parts, methods)
        for run in found:
            runs.append(run)
            shares = " ".join(f"{(run.errors < limit).mean():.2f}" for limit in LIMITS.values())
            print(f"{run.sequence}, {run.start}: {run.method} {shares}", flush=True)
        if not options.true_images:
            painted |= paintings(folder, options.parts)
    pooled, each = pooled_rows(runs), sequence_rows(runs)
    for name, row in pooled.items():
        print(f"| {name} | " + " | ".join(f"{m:.2f} [{low:.2f}, {high:.2f}]" for m, low, high in row.values()) + " |")
    if options.record:
        record_all(f"slow.{options.record}", pooled, each, painted)


def paintings(folder: Path, parts: Path) -> dict[str, dict[str, float]]:
    """How well the part of a sequence is painted."""
    from acp_lab.sequences import open_sequence

    decoded = DecodedScene(open_sequence(folder))
    found = {name_of(decoded.scene): painting(decoded, load(parts, decoded.scene))}
    print(found, flush=True)
    return found


def record_all(
    entry: str,
    pooled: dict[str, dict[str, list[float]]],
    each: dict[str, dict[str, float]],
    painted: dict[str, dict[str, float]],
) -> None:
    """Into docs/measured.json."""
    from benchmarks.measured import record

    unit = "share of frames with ADD (ADD-S for symmetric parts) below 2, 5, 10% of the diameter"
    about = "acp-paper on painted and on exact edges, and its ablations, slow sequences, forwards and backwards"
    data = ", ".join(dict.fromkeys(name.split(":")[0] for name in each))
    about = about if painted else about.replace("painted", "true edge images")
    record(entry, about, {"@*": f"{unit}, mean over sequences, and its 95% interval"}, data, pooled)
    record(f"{entry}.each", "the same, each sequence, from truth", {"@*": unit}, data, each)
    if not painted:
        return
    record(f"{entry}.painting", "the auto-encoders of these parts, over the regions trained", PAINTED, data, painted)


if __name__ == "__main__":
    main()
