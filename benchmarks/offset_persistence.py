"""How long an edge's offset beside the CAD's edge lasts: what a tracker can remember of it.

    python -m benchmarks.offset_persistence metal_public metal_hard metal_dev --parts out/parts --record

Image edges are measured at the true poses of all frames, as `acp` finds them (`acp_lab.studies.pose_bound`). Of every
sequence the correlation of a sample's offset in two frames, by the turn of the view between them, and of two samples in
one frame, by the distance between them (`acp_lab.studies.offset_persistence`); then the median and the quartiles over
the sequences that have such frames. Frames that show less than 30% of the part, and parts with symmetries, are left
out.
"""

from __future__ import annotations

import argparse
from itertools import pairwise
from pathlib import Path

from acp_lab.commands.machine import limit_threads

limit_threads(1)  # before NumPy is imported

import numpy as np  # noqa: E402

from acp_lab.control_points.canonical_frame import eye_position  # noqa: E402
from acp_lab.geometry.arrays import FloatArray  # noqa: E402
from acp_lab.sequences.bop import BopDataset, BopScene  # noqa: E402
from acp_lab.sequences.frame import Frame  # noqa: E402
from acp_lab.studies.offset_persistence import (  # noqa: E402
    SeenOffsets,
    persistence_by_distance,
    persistence_by_turn,
    seen_offsets,
)
from acp_lab.studies.pose_bound import WITHOUT_PROFILES, edge_evidence  # noqa: E402
from acp_lab.tracking.frame_solver import FrameSolver  # noqa: E402
from benchmarks import measured  # noqa: E402
from benchmarks.runs import prepared_part_of, visible_frames  # noqa: E402

TURNS_DEG = (0.0, 2.0, 5.0, 10.0, 20.0, 40.0)
SHARES = (0.0, 0.01, 0.02, 0.04, 0.08, 0.16)
"""Distances between two samples, as shares of the diameter."""
UNIT = {"sequences": "sequences that have such pairs", "*": "correlation of offsets, no unit, over these sequences"}


def of_scene(scene: BopScene, parts: Path) -> tuple[FloatArray, FloatArray] | None:
    """(k,) correlations by turn, and by distance; None for a part with symmetries."""
    object_id, model = scene.object_ids[0], prepared_part_of(scene, parts)
    if model.part.symmetries:
        return None
    solver, seen = FrameSolver(model, WITHOUT_PROFILES), list[SeenOffsets]()
    visible = visible_frames(scene.folder, object_id, scene.frame_ids)
    for frame in scene.frames():
        truth = scene.truth(frame.index, object_id)
        if not isinstance(frame, Frame) or truth is None or not visible[frame.index]:
            continue
        evidence = edge_evidence(solver, frame, truth)
        if evidence is not None:
            seen.append(seen_offsets(evidence, eye_position(truth) - model.part.box_centre))
    distances_mm = [share * model.part.diameter for share in SHARES]
    return persistence_by_turn(seen, TURNS_DEG), persistence_by_distance(seen, distances_mm)


def rows_of(names: list[str], found: list[FloatArray]) -> dict[str, dict[str, float]]:
    """Median and quartiles over the sequences, by bin; bins that no sequence has are left out."""
    rows = {}
    for name, column in zip(names, np.array(found).T, strict=True):
        known = column[np.isfinite(column)]
        if len(known):
            low, middle, high = np.percentile(known, (25, 50, 75)).tolist()
            rows[name] = {"median": middle, "low": low, "high": high, "sequences": len(known)}
    return rows


def main() -> None:
    """See the module."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("datasets", nargs="+", type=Path)
    parser.add_argument("--parts", type=Path, required=True)
    parser.add_argument("--record", action="store_true")
    args = parser.parse_args()
    turns, distances = list[FloatArray](), list[FloatArray]()
    for root in args.datasets:
        for scene_id in BopDataset(root).scenes():
            found = of_scene(BopDataset(root).open_scene(scene_id), args.parts)
            if found is not None:
                turns.append(found[0])
                distances.append(found[1])
                print(root.name, scene_id, *(np.round(values, 2) for values in found), flush=True)
    rows = rows_of([f"turn {low:g} to {high:g} deg" for low, high in pairwise(TURNS_DEG)], turns)
    rows |= rows_of([f"apart {low:.0%} to {high:.0%}" for low, high in pairwise(SHARES)], distances)
    for name, row in rows.items():
        print(name, {field: round(value, 2) for field, value in row.items()})
    if args.record:
        names = ", ".join(root.name for root in args.datasets)
        about = "how long an edge's offset lasts as the view turns, and how far along the part it is shared"
        measured.record("offset_persistence", about, UNIT, names, rows)


if __name__ == "__main__":
    main()
