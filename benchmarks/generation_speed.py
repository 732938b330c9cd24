"""The paper's speed claim: t(I) against rendering, for the same part with more and more faces.

Every method gives the same output, the 128 x 128 edge image of a view in its canonical frame, one view at a time, in
one process on one thread; times are medians over views, the best of three of each. Subdividing a mesh adds faces and
no shape, so that only the face count changes. Networks are untrained: their arithmetic does not depend on the weights
(every sample that the visibility network is asked about is then drawn, its dearest case). OpenGL draws on the CPU where
there is no graphics card; the mesh is uploaded once. What a mesh costs before tracking is in the second table: training
takes some 1000 true edge images per view region, at the price of "edge samples, a ray each"; the rest of it never sees
a face.

Example: python -m benchmarks.generation_speed --pictures out/generation.png
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Callable
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING, Any

from acp_lab.commands import machine

if TYPE_CHECKING:
    import numpy as np

    from acp_lab.cad.part import Part
    from benchmarks.edge_drawers import Draw, MeshUnderTest, View

DISTANCE_IN_DIAMETERS = 5.0


def subdivided(part: Part, times: int) -> Part:
    """The part with every face cut in four, `times` times."""
    import numpy as np
    import trimesh

    from acp_lab.cad.part import Part

    vertices, faces = part.vertices, part.faces
    for _ in range(times):
        vertices, faces = trimesh.remesh.subdivide(vertices, faces)
    return Part.from_mesh(np.asarray(vertices), np.asarray(faces), part.name)


def make_mesh(part: Part, clock: Callable[[], float]) -> MeshUnderTest:
    """The search tree and the edge samples of a part, timed."""
    from acp_lab.cad.edges import sample_edges
    from acp_lab.cad.raycast import make_caster
    from benchmarks.edge_drawers import MeshUnderTest

    begin = clock()
    caster = make_caster(part)
    between = clock()
    edges = sample_edges(part)
    return MeshUnderTest(part, caster, edges, between - begin, clock() - between)


def make_views(part: Part, count: int) -> list[View]:
    """Views all around the part, each in the region that trackers would use."""
    from acp_lab.control_points.canonical_frame import canonical_frame
    from acp_lab.control_points.view_regions import ALL_REGIONS, choose_region, sphere_directions
    from benchmarks.edge_drawers import View

    views = []
    for direction in sphere_directions(count, turn_rad=0.3):
        region = choose_region(direction, 0.5 * part.box_size)
        eye_obj = part.box_centre + DISTANCE_IN_DIAMETERS * part.diameter * direction
        views.append(View(region, canonical_frame(eye_obj, part.box_centre, part.radius, ALL_REGIONS[region])))
    return views


def time_ms(draw: Draw, views: list[View], clock: Callable[[], float]) -> float:
    """Median ms per image over the views, each the best of three: what else the machine does is not of interest."""

    def once(view: View) -> float:
        begin = clock()
        draw(view)
        return 1e3 * (clock() - begin)

    return median(min(once(view) for _ in range(3)) for view in views)


def methods(mesh: MeshUnderTest, fixed: dict[str, Draw], renderer: Any) -> dict[str, Draw]:
    """All methods that work here, in the order of the table."""
    from acp_lab.generator.templates import build_templates
    from benchmarks import edge_drawers

    found = dict(fixed)
    found["templates"] = edge_drawers.stored_visibility(build_templates(mesh.part, mesh.edges, mesh.caster))
    found["visibility network"] = edge_drawers.stored_visibility(edge_drawers.untrained_network(mesh))
    found["edge samples, a ray each"] = edge_drawers.edge_samples(mesh)
    found["ray-cast normals + Canny"] = edge_drawers.ray_cast_normals(mesh)
    if renderer is not None:
        found["OpenGL normals + Canny"] = edge_drawers.rendered_normals(mesh, renderer)
    return found


def write_pictures(path: Path, by_name: dict[str, list[np.ndarray]]) -> None:
    """A row of edge images per method, to see that all show the same; an untrained network's row stays dark."""
    import cv2
    import numpy as np

    rows = []
    for name, images in by_name.items():
        row = np.concatenate([np.pad(np.uint8(255) * (image > 0.5), 2, constant_values=60) for image in images], 1)
        cv2.putText(row, name, (4, 12), cv2.FONT_HERSHEY_SIMPLEX, 0.35, 200, 1, cv2.LINE_AA)
        rows.append(row)
    path.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(path), np.concatenate(rows))


def print_table(title: str, head: list[str], rows: list[list[str]]) -> None:
    """A Markdown table."""
    print(f"\n**{title}**\n")
    print("| " + " | ".join(head) + " |")
    print("|" + "---|" * len(head))
    for row in rows:
        print("| " + " | ".join(row) + " |")


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--mesh", type=Path, help="a mesh file in mm; the sample part by default")
    parser.add_argument("--levels", type=int, default=5, help="how often each face is cut in four (default 5)")
    parser.add_argument("--views", type=int, default=20, help="views that are timed (default 20)")
    parser.add_argument("--pictures", type=Path, help="PNG of the first views by every method")
    parser.add_argument(
        "--cpu-time",
        action="store_true",
        help="CPU time in place of wall time: for busy machines without graphics card",
    )
    parser.add_argument("--record", action="store_true", help="write to docs/measured.json")
    options = parser.parse_args()
    clock = time.process_time if options.cpu_time else time.perf_counter
    # Before NumPy and OpenGL are loaded: they read the number of threads once.
    machine.limit_threads(1)
    os.environ["LP_NUM_THREADS"] = "0"
    os.environ.setdefault("PYOPENGL_PLATFORM", "egl")
    import torch

    from acp_lab.cad.part import Part
    from acp_lab.control_points.canonical_frame import CANONICAL_SIZE
    from acp_lab.sample import sample_dataset
    from acp_lab.sequences.bop import BopDataset
    from benchmarks.edge_drawers import autoencoder, make_renderer

    torch.set_num_threads(1)
    part = Part.from_file(options.mesh) if options.mesh else BopDataset(sample_dataset()).part(1)
    views = make_views(part, options.views)
    fixed = {"auto-encoder t(I)": autoencoder(part)}
    what = "CPU time" if options.cpu_time else "wall time"
    print(f"CPU: {machine.cpu_model()}; one process, one thread, {what}; {len(views)} views; {part.name}")
    renderer = make_renderer(CANONICAL_SIZE)
    rows, once = [], []
    kept: dict[str, dict[str, float]] = {}
    head = ["faces"]
    for level in range(options.levels + 1):
        mesh = make_mesh(subdivided(part, level), clock)
        draws = methods(mesh, fixed, renderer)
        head = ["faces", *draws]
        faces = f"{len(mesh.part.faces):,}"
        times = {name: time_ms(draw, views, clock) for name, draw in draws.items()}
        kept[str(len(mesh.part.faces))] = times
        rows.append([faces, *(f"{time:.2f}" for time in times.values())])
        once.append([faces, f"{len(mesh.edges):,}", f"{mesh.tree_s:.2f}", f"{mesh.edges_s:.2f}"])
        if options.pictures and level == 0:
            write_pictures(options.pictures, {name: [draw(v) for v in views[:6]] for name, draw in draws.items()})
    print_table("One 128 x 128 edge image, median ms", head, rows)
    print_table("Once per mesh", ["faces", "edge samples", "ray tree, s", "edge samples, s"], once)
    if options.record:
        from benchmarks.measured import record

        about = "t(I) against rendering, 128x128, untrained networks of the right size, OpenGL in software"
        record("speed.generators", about, f"ms of {what} per edge image, median", f"{part.name}, subdivided", kept)
    print(f"\nPeak memory of this process: {machine.peak_memory_mb():.0f} MB")


if __name__ == "__main__":
    main()
