"""`acp.explain(run, frame)`: why the tracker did badly in a frame, in words and as a picture.

The words come from `diagnosis.diagnosis`. The picture shows the measured image with the part's edges: found
ones sky blue, missing ones grey, probably occluded ones vermillion, the tracked edges white below them. Beside it the
quality over the run, with the frame and the beginning of the problem marked.
"""

from __future__ import annotations

import base64
import html
import io
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from acp_lab.diagnosis.causes import DiagnosisConfig
from acp_lab.diagnosis.diagnosis import Diagnosis, diagnose
from acp_lab.diagnosis.frame_evidence import NEAR_PX
from acp_lab.display.colours import BLUE, GREY, SKY, VERMILLION
from acp_lab.files import write_whole
from acp_lab.geometry.arrays import FloatArray
from acp_lab.sequences.protocol import Sequence
from acp_lab.tracking.session import TrackRun

if TYPE_CHECKING:
    from matplotlib.axes import Axes

STROKE_PX = 3.5
MARGIN = 0.2
"""Around the part, in shares of its size in the image."""
DPI = 110


@dataclass(frozen=True, eq=False, repr=False)
class Explanation:
    """A diagnosis as text, as a picture in a notebook, or in a file.

    diagnosis: its findings. qualities: (n,) of the whole run.
    """

    diagnosis: Diagnosis
    qualities: FloatArray

    def __str__(self) -> str:
        return str(self.diagnosis)

    # The default one, with all arrays of the diagnosis, would fill pages.
    __repr__ = __str__

    def picture(self) -> bytes:
        """The picture as PNG."""
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure

        figure = Figure(figsize=(10.0, 4.2), dpi=DPI, layout="constrained")
        FigureCanvasAgg(figure)
        left, right = figure.subplots(1, 2, width_ratios=[3, 2])
        _draw_image(left, self.diagnosis)
        _draw_quality(right, self.diagnosis, self.qualities)
        png = io.BytesIO()
        figure.savefig(png, format="png")
        return png.getvalue()

    def save(self, path: str | Path) -> None:
        """Write the picture; raises InputFileError where it cannot be written."""
        write_whole(Path(path), self.picture(), "the picture")

    def _repr_html_(self) -> str:
        diagnosis = self.diagnosis
        rows = "".join(
            f"<li><b>{html.escape(str(finding.cause))}</b>: {html.escape(finding.text)}<br>"
            f"<i>What helps:</i> {html.escape(finding.advice)}</li>"
            for finding in diagnosis.findings
        )
        words = f"<ol>{rows}</ol>" if rows else f"<p>{html.escape(diagnosis.conclusion)}</p>"
        png = base64.b64encode(self.picture()).decode()
        return f'<p>{html.escape(diagnosis.summary)}</p>{words}<img src="data:image/png;base64,{png}">'


def explain(
    run: TrackRun,
    frame: int,
    object_id: int | None = None,
    sequence: Sequence | None = None,
    config: DiagnosisConfig | None = None,
) -> Explanation:
    """Explain what the tracker did in a frame: prints as text, shows a picture in a notebook.

    Args:
        frame: counted from 0, as the viewers count; negative ones from the end.
        object_id: by default the run's first object.
        sequence: where the images are, by default the one that was tracked.

    Raises:
        SequenceError: the run has no such frame or object, or does not know its part.
    """
    diagnosis = diagnose(run, frame, object_id, sequence, config)
    qualities = np.array([result.quality for result in run.results[diagnosis.object_id]])
    return Explanation(diagnosis, qualities)


def _draw_image(axes: Axes, diagnosis: Diagnosis) -> None:
    axes.set_xticks([])
    axes.set_yticks([])
    if diagnosis.image is None:
        axes.text(0.5, 0.5, "no image", ha="center", va="center", transform=axes.transAxes, color=GREY)
        return
    axes.imshow(diagnosis.image)
    tracked = diagnosis.result.edges if diagnosis.measured_frame == diagnosis.frame else None
    if tracked is not None:
        label = "white dots: edges at the tracked pose"
        axes.plot(*tracked.points.T, ".", color="white", markersize=2.0, alpha=0.8, label=label)
    shown = [np.zeros((0, 2))] if tracked is None else [tracked.points]
    evidence = diagnosis.evidence
    if evidence is not None:
        along = np.stack([-evidence.normals[:, 1], evidence.normals[:, 0]], 1)
        missing = ~evidence.found & ~diagnosis.hidden
        where = ", outside that region" if diagnosis.hidden.any() else ""
        for rows, colour, label in (
            (evidence.found & ~diagnosis.hidden, SKY, f"image edge within {NEAR_PX:g} px{where}"),
            (missing, GREY, f"no image edge there{where}"),
            (diagnosis.hidden, VERMILLION, "in one region: most are missing there"),
        ):
            share = f"{100.0 * float(np.mean(rows)):.0f}%: {label}" if len(rows) else label
            _draw_strokes(axes, evidence.points[rows], along[rows], colour, share)
        shown.append(evidence.points)
    _cut_to(axes, np.vstack(shown), diagnosis.image.shape)
    where = f"image of frame {diagnosis.measured_frame}"
    axes.set_title(f"{where}, edges at {diagnosis.measured_at}", fontsize=9)
    if axes.get_legend_handles_labels()[0]:
        axes.legend(fontsize=7, loc="upper center", bbox_to_anchor=(0.5, -0.01), ncols=2)


def _draw_strokes(
    axes: Axes, points: FloatArray, along: FloatArray, colour: tuple[float, ...], label: str
) -> None:
    from matplotlib.collections import LineCollection

    if len(points):
        half = 0.5 * STROKE_PX * along
        strokes = list(np.stack([points - half, points + half], axis=1))
        axes.add_collection(LineCollection(strokes, colors=[colour], linewidths=1.6, label=label))


def _cut_to(axes: Axes, points: FloatArray, shape: tuple[int, ...]) -> None:
    points = points[np.isfinite(points).all(axis=1)]
    low, high = np.zeros(2) - 0.5, np.array(shape[1::-1]) - 0.5
    inside = points[((points >= low) & (points <= high)).all(axis=1)]
    if len(inside):
        margin = MARGIN * max(float(np.ptp(inside, axis=0).max()), 40.0)
        low, high = np.maximum(low, inside.min(0) - margin), np.minimum(high, inside.max(0) + margin)
    axes.set_xlim(low[0], high[0])
    axes.set_ylim(high[1], low[1])


def _draw_quality(axes: Axes, diagnosis: Diagnosis, qualities: FloatArray) -> None:
    axes.plot(np.arange(len(qualities)), qualities, color=BLUE, linewidth=1.4)
    if diagnosis.has_good_before:
        axes.axhline(diagnosis.usual_quality, color=GREY, linestyle="--", linewidth=0.8)
        place = (len(qualities) - 1, diagnosis.usual_quality)
        # Inside the axes: a good quality is at their upper end.
        below = {"xytext": (-4, -4), "va": "top"} if diagnosis.usual_quality > 0.5 else {"xytext": (-4, 3)}
        axes.annotate("good frames before", place, textcoords="offset points", fontsize=7, ha="right", **below)
    if diagnosis.onset < diagnosis.frame:
        axes.axvspan(diagnosis.onset, diagnosis.frame, color=VERMILLION, alpha=0.15, linewidth=0.0)
    axes.axvline(diagnosis.frame, color=VERMILLION, linewidth=1.2)
    axes.set_ylim(0.0, 1.03)
    axes.set_xlim(0, max(len(qualities) - 1, 1))
    axes.set_xlabel("frame")
    axes.set_ylabel("quality [0 to 1]")
    axes.grid(alpha=0.3)
    named = ",\n".join(str(finding.cause) for finding in diagnosis.findings[:2])
    named = named or diagnosis.conclusion.partition(".")[0]
    axes.set_title(f"frame {diagnosis.frame}, {diagnosis.state}: {named}", fontsize=9)
