"""What the profile of an image edge tells: how far edges lie beside the CAD's at true poses, as they are and as told.

    python -m benchmarks.edge_profiles DATASET... [--step 4] [--record]

Of each sequence every `step`-th frame, every edge sample that rays find visible, and the strongest image edge beside it
(`acp_lab.studies.edge_break`). Needs no prepared parts. Rows are means over the sequences of a data set, and of those
of parts that only check (`benchmarks.robustness.CHECKING`).
"""

from __future__ import annotations

import argparse
from pathlib import Path

from acp_lab.commands.machine import limit_threads

limit_threads(1)  # before NumPy is imported

import numpy as np  # noqa: E402

from acp_lab.sequences.bop import BopDataset, BopScene  # noqa: E402
from acp_lab.studies.edge_break import EdgeOffsets, edge_offsets, offsets_beside_profiles  # noqa: E402
from acp_lab.studies.true_edges import TrueEdges  # noqa: E402
from benchmarks import measured  # noqa: E402
from benchmarks.robustness import is_in_split  # noqa: E402
from benchmarks.runs import part_name, visible_frames  # noqa: E402

UNIT = {
    "sequences": "sequences",
    "bias*": "mm: median offset of a sequence's outlines beside the CAD's, its size, mean over sequences",
    "outline*": "mm: median size of the offsets of a sequence's outlines, mean over sequences",
    "inner*": "mm: the same of convex creases inside",
}


def of_scene(scene: BopScene, step: int) -> dict[str, float]:
    """The fields of one sequence."""
    object_id = scene.object_ids[0]
    truth = TrueEdges(scene.dataset.part(object_id))
    visible = visible_frames(scene.folder, object_id, scene.frame_ids)
    frames = [frame_id for frame_id in scene.frame_ids[::step] if visible[frame_id]]
    fields: dict[str, float] = {}
    for name, measure in (("as they are", edge_offsets), ("told", offsets_beside_profiles)):
        found: EdgeOffsets = measure(truth, scene, object_id, frames)
        fields |= {
            f"bias {name}": abs(float(np.median(found.outline_mm))),
            f"outline {name}": float(np.median(np.abs(found.outline_mm))),
            f"inner {name}": float(np.median(np.abs(found.inner_mm))),
        }
    return fields


def mean_of(rows: list[dict[str, float]]) -> dict[str, float]:
    """Over sequences."""
    return {"sequences": len(rows)} | {name: float(np.mean([row[name] for row in rows])) for name in rows[0]}


def main() -> None:
    """See the module."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("datasets", nargs="+", type=Path)
    parser.add_argument("--step", type=int, default=4)
    parser.add_argument("--record", action="store_true")
    args = parser.parse_args()
    groups: dict[str, list[dict[str, float]]] = {}
    for root in args.datasets:
        data = BopDataset(root)
        for scene_id in data.scenes():
            scene = data.open_scene(scene_id)
            fields = of_scene(scene, args.step)
            print(f"{data.name} {scene_id}", {name: round(value, 3) for name, value in fields.items()}, flush=True)
            groups.setdefault(data.name, []).append(fields)
            if is_in_split(part_name(root, scene.object_ids[0]), "checking"):
                groups.setdefault("checking", []).append(fields)
    rows = {name: mean_of(found) for name, found in groups.items()}
    for name, row in rows.items():
        print(name, {field: round(value, 3) for field, value in row.items()})
    if args.record:
        about = "how far image edges lie beside the CAD's at true poses, as they are and as their profiles tell"
        measured.record("edge_profiles", about, UNIT, ", ".join(root.name for root in args.datasets), rows)


if __name__ == "__main__":
    main()
