"""The page of a bench: one HTML file with all tables, plots and small pictures of failures; it needs no other file.

Only the links to replays point outside, to files beside it. Pictures show the data: pass them on only where you may
pass on the data.
"""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path

import cv2
import numpy as np

from acp_lab.bench.peers import PAPER_TABLES
from acp_lab.bench.record import Run
from acp_lab.bench.report import BASIN_LEGEND, HEAD, LEGEND, Report, basin_tables, cells, paper_lines
from acp_lab.bench.runner import true_pose
from acp_lab.display.colours import GREEN, VERMILLION, to_bytes
from acp_lab.display.mesh_lines import MeshLines
from acp_lab.display.plots.bench import bench_figure, figure_svg
from acp_lab.files import write_whole
from acp_lab.geometry.arrays import ByteImage, FloatArray
from acp_lab.geometry.camera import Camera
from acp_lab.geometry.pose import transform
from acp_lab.pasted import quoted
from acp_lab.sequences.bop import BopDataset, BopScene
from acp_lab.sequences.frame import Frame
from acp_lab.sequences.scene_truth import SceneTruth

_WIDTH_PX = 280
_MARGIN_PX = 30.0
_SHARP_DEG = 25.0
_STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; margin: 2rem auto; max-width: 92rem; padding: 0 1rem; color: #222;
       background: #fff; }
table { border-collapse: collapse; margin: .5rem 0 1.5rem; font-size: 13px; display: block; overflow-x: auto; }
th, td { padding: .25rem .45rem; border-bottom: 1px solid #ddd; text-align: right; white-space: nowrap; }
th:first-child, td:first-child { text-align: left; }
svg { width: 100%; height: auto; }
figure { display: inline-block; margin: 0 .8rem 1rem 0; width: 280px; vertical-align: top; font-size: 12px; }
figure img { width: 100%; border-radius: 3px; }
.note { color: #666; font-size: 13px; }
"""


@dataclass(frozen=True, eq=False)
class Thumbnail:
    """A small picture of a run's worst frame. jpeg: its bytes; told: the line below it."""

    jpeg: bytes
    told: str


def failures(runs: Sequence[Run], most: int = 3) -> list[Run]:
    """Of each method the runs that went worst, lost ones first, at most so many; none that stayed below 10%."""
    chosen = []
    for method in dict.fromkeys(run.method for run in runs):
        own = [run for run in runs if run.method == method and len(run.distance) and run.distance.max() > 0.1]
        own.sort(key=lambda run: (not run.is_lost, -float(np.mean(~(run.distance <= 0.1)))))
        seen = {run.sequence: run for run in reversed(own)}  # of each sequence the worst
        chosen += sorted(seen.values(), key=own.index)[:most]
    return chosen


def thumbnail(run: Run, root: Path, split: str) -> Thumbnail | None:
    """The frame in which a run was lost, else its worst: the part as tracked, and as it truly was.

    None where the image cannot be read or the truth is not known.
    """
    dataset, sequence = BopDataset(root), run.sequence
    row = run.worst
    frame_id = run.frame_ids[row]
    truth = true_pose(dataset.scene_folder(sequence.scene_id, split), sequence, frame_id)
    frame = dataset_frame(dataset, sequence.scene_id, split, frame_id)
    if truth is None or frame is None:
        return None
    lines_obj = MeshLines.of(dataset.part(sequence.object_id)).sharper_than(_SHARP_DEG)
    image = np.array(frame.image)
    corners = [_draw(image, lines_obj, frame.camera, truth, GREEN)]
    if np.isfinite(run.poses[row]).all():
        tracked = np.vstack([run.poses[row], [0.0, 0.0, 0.0, 1.0]])
        corners.append(_draw(image, lines_obj, frame.camera, tracked, VERMILLION))
    shown = _cut(image, corners[0])
    good, jpeg = cv2.imencode(".jpg", shown[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 80])
    error = run.distance[row]
    far = f"{run.metric} {100 * error:.0f}% of the diameter" if np.isfinite(error) else run.note or "no pose"
    told = f"{run.method}: {sequence}, image {frame_id}; {far}; {run.variant}"
    return Thumbnail(jpeg.tobytes(), told) if good else None


def dataset_frame(dataset: BopDataset, scene_id: int, split: str, frame_id: int) -> Frame | None:
    """One image of a scene, None where it cannot be read."""
    # The truth is not asked for here, and may hold several instances.
    frame = BopScene(dataset.scene_folder(scene_id, split), SceneTruth({})).frame(frame_id)
    return frame if isinstance(frame, Frame) else None


def write_page(report: Report, path: Path, pictures: Sequence[Thumbnail], replays: Mapping[str, Path]) -> None:
    """Write the page; replays: files below the page's folder by what they show. InputFileError."""
    svg = figure_svg(bench_figure(report.runs, report.rows, report.basins))
    tables = "".join(
        f"<h2>{escape(group)}: {escape(how)}</h2>{_table(HEAD, [cells(row) for row in rows])}"
        for group, how, rows in report.blocks()
    )
    tables += "".join(
        f"<h2>{escape(group)}: basin of convergence</h2><p class='note'>{escape(BASIN_LEGEND)}</p>{_table(head, rows)}"
        for group, head, rows in basin_tables(report)
    )
    shown = "".join(
        f'<figure><img alt="" src="data:image/jpeg;base64,{base64.b64encode(picture.jpeg).decode()}">'
        f"<figcaption>{escape(picture.told)}</figcaption></figure>"
        for picture in pictures
    )
    links = "".join(
        f'<li><a href="{escape(file.relative_to(path.parent).as_posix())}">{escape(told)}</a>: '
        f"<code>acp-lab replay {escape(quoted(file))}</code></li>"
        for told, file in replays.items()
    )
    head = ("method", "reported @2%", "reported @5%", "here", "@2%", "@5%", "where from")
    paper = "".join(
        f"<h3>{escape(table.data)}</h3>{_table(head, paper_lines(table, report))}" for table in PAPER_TABLES
    )
    html = f"""<!doctype html><html lang="en"><head><meta charset="utf-8"><title>Trackers side by side</title>
<meta name="viewport" content="width=device-width"><style>{_STYLE}</style></head><body>
<h1>Trackers side by side</h1><p class="note">{escape(LEGEND)}<br>Machine: {escape(report.machine)}</p>
{svg}{tables}
<h2>Failures</h2><p class="note">Green: the truth. Vermillion: as tracked.</p>{shown or "<p>None above 10%.</p>"}
<h2>Replays</h2><ul>{links or "<li>None.</li>"}</ul>
<h2>The paper's tables</h2><p class="note">Reported numbers are means over the paper's groups, on the paper's own
images: look at them side by side, do not subtract them.</p>{paper}</body></html>
"""
    write_whole(path, html.encode(), "the page")


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    top = "".join(f"<th>{escape(name)}</th>" for name in head)
    body = "".join(f"<tr>{''.join(f'<td>{escape(cell)}</td>' for cell in row)}</tr>" for row in rows)
    return f"<table><thead><tr>{top}</tr></thead><tbody>{body}</tbody></table>"


def _draw(
    image: ByteImage, lines_obj: FloatArray, camera: Camera, cam_T_obj: FloatArray, colour: tuple[float, ...]
) -> FloatArray:
    """Draw lines (n, 2, 3) mm into the image; their ends (2 n, 2) px."""
    points_cam = transform(cam_T_obj, lines_obj.reshape(-1, 3))
    pixels = camera.project(points_cam)
    seen = np.isfinite(pixels).all(1) & (np.abs(pixels) < 1e4).all(1)
    strokes = np.round(16 * np.nan_to_num(pixels)).astype(np.int32).reshape(-1, 2, 2)[seen.reshape(-1, 2).all(1)]
    cv2.polylines(image, list(strokes), False, to_bytes(colour).tolist(), 1, cv2.LINE_AA, 4)
    return pixels[seen]


def _cut(image: ByteImage, around: FloatArray) -> ByteImage:
    """What lies around points (n, 2) px, made `_WIDTH_PX` wide; all of the image without any."""
    size = np.array(image.shape[1::-1], float)
    if len(around) == 0:
        around = np.stack([np.zeros(2), size])
    low = np.clip(around.min(0) - _MARGIN_PX, 0.0, size)
    high = np.clip(around.max(0) + _MARGIN_PX, 0.0, size)
    # Of a part that has left the image a sliver is seen, or nothing: it would be enlarged beyond measure.
    least = max(0.5 * float((high - low).max()), 2.0 * _MARGIN_PX)
    sides = np.minimum(np.maximum(high - low, least), size)
    x, y = np.clip(0.5 * (low + high - sides), 0.0, size - sides).astype(int)
    width, height = np.ceil(sides).astype(int)
    cut = image[y : y + height, x : x + width]
    scale = _WIDTH_PX / cut.shape[1]
    shape = (_WIDTH_PX, max(1, round(scale * cut.shape[0])))
    return np.asarray(cv2.resize(cut, shape, interpolation=cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR), np.uint8)
