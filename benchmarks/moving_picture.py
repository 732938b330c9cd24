"""The moving picture of the README: the sample is tracked, and each frame drawn with its edges, points and curves.

    python -m benchmarks.moving_picture            # writes docs/images/tracking.webp
    python -m benchmarks.moving_picture --parts acp_lab_demo/parts --out tracking.gif

On the left the frame with the generated edges (light blue on the image's edge, yellow, vermillion from 3 px off) and
the quad of the four control points; on the right ADD and quality so far.
"""

from __future__ import annotations

import argparse
import io
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from PIL import Image

import acp_lab as acp
from acp_lab.display.plots.summary import draw_frame
from acp_lab.evaluation.part_metric import PartMetric
from acp_lab.geometry.arrays import ByteImage, FloatArray
from acp_lab.sample import sample_dataset
from acp_lab.sequences.bop import BopScene
from acp_lab.tracking.result import TrackResult
from acp_lab.tracking.session import TrackRun
from benchmarks.runs import readable_frames

OUT = Path(__file__).resolve().parents[1] / "docs" / "images" / "tracking.webp"
SIZE_IN, DPI = (8.8, 4.0), 90
FRAME_MS, LAST_MS = 120, 1500
MARGIN_PX = 25.0


def main() -> None:
    """Track the sample and write the picture."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--parts", type=Path, default=Path("acp_lab_demo/parts"), help="where make demo prepared it")
    options.add_argument("--out", type=Path, default=OUT, help=".webp or .gif")
    given = options.parse_args()
    scene = acp.open_sequence(sample_dataset())
    model = acp.prepare(scene.dataset.part(1), out=given.parts)
    run = acp.Tracker(model).run(scene, start=scene.first_pose)
    pictures = draw_run(run, scene)
    times = [FRAME_MS] * (len(pictures) - 1) + [LAST_MS]
    pictures[0].save(given.out, save_all=True, append_images=pictures[1:], duration=times, loop=0, quality=70, method=6)
    print(f"{given.out}: {len(pictures)} frames, {given.out.stat().st_size / 1e6:.2f} MB")


def draw_run(run: TrackRun, scene: BopScene) -> list[Image.Image]:
    """One picture per frame of the run's first object."""
    (object_id, results), *_ = run.results.items()
    metric = PartMetric(run.parts[object_id])
    percent = [metric.percent(result.cam_T_obj, scene.truth(result.frame_id, object_id)) for result in results]
    seen = np.vstack([result.edges.points for result in results if result.edges is not None])
    limits = seen.min(0) - MARGIN_PX, seen.max(0) + MARGIN_PX
    return [
        _picture(frame.image, results[: number + 1], percent[: number + 1], len(results), limits)
        for number, frame in enumerate(readable_frames(scene))
    ]


def _picture(
    image: ByteImage, results: Sequence[TrackResult], percent: Sequence[float], count: int,
    limits: tuple[FloatArray, FloatArray],
) -> Image.Image:  # fmt: skip
    """Of the last result, with curves that lead to it; count: of all frames; limits: what is shown, px (x, y)."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=SIZE_IN, dpi=DPI, layout="constrained")
    FigureCanvasAgg(figure)
    left, right = figure.subfigures(1, 2, squeeze=False, width_ratios=[1.5, 1.0])[0]
    axes = left.subplots()
    draw_frame(axes, image, results[-1:], f"frame {len(results) - 1}: {results[-1].state}")
    (x0, y0), (x1, y1) = limits
    axes.set_xlim(x0, x1)
    axes.set_ylim(y1, y0)
    curves = (("ADD [% of diameter]", percent, 3.0), ("quality [0 to 1]", [r.quality for r in results], 1.0))
    for axis, (label, values, top) in zip(right.subplots(2, 1, sharex=True), curves, strict=True):
        axis.plot(values, color="#0072B2", linewidth=1.6)
        axis.plot(len(values) - 1, values[-1], "o", color="#D55E00", markersize=5)
        axis.set(xlim=(0, count - 1), ylim=(0.0, 1.04 * top), ylabel=label)
        axis.grid(alpha=0.3)
        if "ADD" in label:
            axis.axhline(2.0, color="grey", linestyle="--", linewidth=0.8)
    axis.set_xlabel("frame")
    stream = io.BytesIO()
    figure.savefig(stream, format="png")
    return Image.open(stream).convert("RGB")


if __name__ == "__main__":
    main()
