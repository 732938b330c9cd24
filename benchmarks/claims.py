"""The paper's claims about control points, computed: its Figure 1, the homography of a motion, its Figure 7b.

Sensitivity and conditioning on the first part given; the other two over all parts given.

Example: python -m benchmarks.claims acp_lab/sample/data path/to/dataset --parts out/parts --record
(parts prepared before: acp-lab prepare MESH --out out/parts/DATASET)
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path
from statistics import mean
from typing import TYPE_CHECKING

from acp_lab.commands import machine

# Before NumPy is imported: its linear algebra reads the number of threads once.
machine.limit_threads(1)

import numpy as np  # noqa: E402

if TYPE_CHECKING:
    from acp_lab.cad.part import Part
    from acp_lab.studies.ambiguity import AmbiguousPair
    from acp_lab.studies.true_edges import TrueEdges

MOTIONS = ((1.0, 0.0), (2.0, 0.0), (3.0, 0.0), (0.0, 4.0), (0.5, 5.0))
CLOSEST_PAIRS = 2
DISTANCE_MM = 400.0


def parts(roots: list[Path], folder: Path) -> Iterator[tuple[Part, TrueEdges]]:
    """All prepared parts of the data sets."""
    from acp_lab.prepared_part import PreparedPart
    from acp_lab.sequences.bop import BopDataset
    from acp_lab.studies.true_edges import TrueEdges

    for root in roots:
        dataset = BopDataset(root)
        for path in sorted((folder / dataset.name).glob("obj_*")):
            model = PreparedPart.load(path, dataset.part_path(int(path.name.removeprefix("obj_"))))
            yield model.part, TrueEdges(model.part, model.edges)


def sensitivity(part: Part, truth: TrueEdges) -> dict[str, dict[str, float]]:
    """Figure 1: per set of parameters medians over views; tilt: mean over turns about the image's axes alone."""
    from acp_lab.studies.sensitivity import sensitivity_study

    study = sensitivity_study(part, truth.edges, truth.caster)
    print(study)
    return {
        one.name: {
            "gradient_cosine": float(np.median(one.gradient_cosine[:, 6:])),
            "step_cosine": float(np.median(one.step_cosine[:, 6:])),
            "tilt_cosine": float(np.median(one.step_cosine[:, :2])),
            "condition": float(np.median(one.condition)),
            "variation": float(one.variation.max()),
        }
        for one in study.sets
    }


def homography(all_parts: list[tuple[Part, TrueEdges]]) -> dict[str, dict[str, float]]:
    """px that edges move and that the homography of W leaves unexplained, mean over parts and regions."""
    from acp_lab.control_points.coplanar_points import mid_section_points
    from acp_lab.control_points.homography_residual import homography_residual
    from acp_lab.control_points.regression import regress_points
    from acp_lab.control_points.view_regions import ALL_REGIONS
    from acp_lab.sample import sample_dataset
    from acp_lab.sequences.bop import BopDataset

    camera = BopDataset(sample_dataset()).open_scene(1).camera(0)
    found: dict[str, list[tuple[float, float, float]]] = {}
    lower = []
    for part, truth in all_parts:
        for region in ALL_REGIONS:
            middle = mid_section_points(part.box_min, part.box_max, region.axis)
            regressed, report = regress_points(part, truth.edges, truth.caster, region)
            lower.append(1.0 - report.residual_after / report.residual_before)
            for turn, shift in MOTIONS:
                both = [
                    homography_residual(
                        part, truth.edges, truth.caster, region, points, camera, DISTANCE_MM, turn, shift
                    )
                    for points in (middle, regressed)
                ]
                row = (both[0].moved_px, both[0].unexplained_px, both[1].unexplained_px)
                found.setdefault(f"{turn:g} deg, {shift:g} mm", []).append(row)
    print("e_3d lower by", np.round(sorted(lower), 3))
    rows = {
        name: dict(zip(("moved", "middle", "regressed"), np.mean(values, axis=0).tolist(), strict=True))
        for name, values in found.items()
    }
    return rows | {"e_3d lower": {"least": min(lower), "most": max(lower), "mean": mean(lower)}}


def ambiguity(all_parts: list[tuple[Part, TrueEdges]]) -> dict[str, dict[str, float]]:
    """Figure 7b: pairs of poses with one outer contour, and which of the two a loss prefers in a rendered image."""
    from acp_lab.studies.ambiguity import find_ambiguities
    from acp_lab.studies.distinction import shaded_picture, tells_apart

    pairs: list[AmbiguousPair] = []
    wrong = {"outline": 0, "edges": 0, "image": 0}
    images = 0
    for part, truth in all_parts:
        found = find_ambiguities(part, truth.edges, truth.caster)
        closest = found.pairs[:CLOSEST_PAIRS]
        pairs += closest
        for pair in closest:
            for right, other in ((pair.first_T_obj, pair.second_T_obj), (pair.second_T_obj, pair.first_T_obj)):
                image = shaded_picture(part, truth.caster, found.camera, right)
                told = tells_apart(part, truth.edges, truth.caster, image, found.camera, right, other)
                images += 1
                for name in wrong:
                    wrong[name] += getattr(told, name).margin_px <= 0.0
    ranges = {
        name: {"least": float(min(values)), "most": float(max(values))}
        for name, values in (
            ("turn", [pair.turn_deg for pair in pairs]),
            ("outline", [100.0 * pair.outline_share for pair in pairs]),
            ("edges", [100.0 * pair.edges_share for pair in pairs]),
        )
    }
    return ranges | {f"{name} wrong": {"wrong": count, "of": images} for name, count in wrong.items()}


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("datasets", nargs="+", type=Path)
    parser.add_argument("--parts", type=Path, required=True, help="prepared parts, one folder per data set")
    parser.add_argument("--record", action="store_true", help="write to docs/measured.json")
    options = parser.parse_args()
    all_parts = list(parts(options.datasets, options.parts))
    names = ", ".join(f"{root}" if not root.is_absolute() else root.name for root in options.datasets)
    measured = (
        (
            "claims.sensitivity",
            "Figure 1: gradient and Gauss-Newton step against the true motion, 200 views",
            {
                "*_cosine": "cosine, median over views and motions",
                "condition": "condition number of the edges' Jacobian, median over views",
                "variation": "95% over 5% quantile over the views of one parameter's sensitivity, worst parameter",
            },
            f"the first part of {names}",
            sensitivity(*all_parts[0]),
        ),
        (
            "claims.homography",
            "how far edges move under a motion, and how much of it the homography of W leaves, 400 mm away",
            {"moved": "px", "middle": "px", "regressed": "px", "*": "share"},
            f"{len(all_parts)} parts of {names}, six view regions each",
            homography(all_parts),
        ),
        (
            "claims.ambiguity",
            "Figure 7b: the two closest pairs of each part; rendered images in which the wrong pose wins",
            "degrees (turn), % of the diameter (outline, edges), images",
            f"{len(all_parts)} parts of {names}",
            ambiguity(all_parts),
        ),
    )
    for key, about, unit, data, values in measured:
        print(f"\n**{key}**: {about}\n")
        for name, row in values.items():
            print(f"- {name}: " + ", ".join(f"{field} {value:.3g}" for field, value in row.items()))
        if options.record:
            from benchmarks.measured import record

            record(key, about, unit, data, values)


if __name__ == "__main__":
    main()
