"""Methods side by side on the same frames, chosen with the mouse: table, curves and film, all of one moment."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from typing import Any

import ipywidgets
import numpy as np
import traitlets

from acp_lab.bench.protocol import SequenceKey, Variant
from acp_lab.bench.record import Run
from acp_lab.bench.report import HEAD, Report, cells
from acp_lab.bench.workbench import Workbench
from acp_lab.display.colours import GREEN, OBJECT_COLOURS
from acp_lab.display.look import TRUTH
from acp_lab.display.mesh_lines import MeshLines
from acp_lab.display.widgets.controls import button, close_with_parts, row, side_by_side
from acp_lab.display.widgets.curve_plot import Curve, CurvePlot, Mark
from acp_lab.display.widgets.frame_shelf import FrameShelf
from acp_lab.display.widgets.overlay import Colour, Overlay
from acp_lab.display.widgets.point_canvas import PointCanvas
from acp_lab.errors import AcpLabError
from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.camera import Camera
from acp_lab.geometry.pose import transform
from acp_lab.sequences.bop import BopDataset, BopScene
from acp_lab.sequences.scene_truth import SceneTruth, instance_truths

STARTS = {"the truth": 0.0, "0.5° and 0.5 mm off": 0.5, "2° and 2 mm off": 2.0, "5° and 5 mm off": 5.0}
STEPS = {"every frame": 1, "every 2nd": 2, "every 3rd": 3, "every 4th": 4}
ADD_ROW, SHARE_ROW = "ADD [% of diameter]", "share of frames"
LARGEST_SHOWN_ADD = 20.0
"""Percent; a lost part would flatten the rest of the curve."""
COLOURS = tuple(colour for colour in OBJECT_COLOURS if colour != GREEN)
"""Of methods, in the order in which they can be chosen; green is the truth's."""
PLAY_MS, FILM_HEIGHT_PX = 80, 300
_COLUMNS = ("method", "runs", "@2%", "@5%", "@10%", "until lost", "ms")
_SHARP_DEG, _ROOM = 25.0, 0.15
_LIMITS = np.linspace(0.0, 10.0, 101)


class RunComparison(ipywidgets.VBox):
    """Chooses what a `Workbench` compares, and shows what came of it.

    methods, sequences, start, step: what is chosen; `compare` runs what is missing, and shows. film: the sequence that
    is shown, of those compared; frame: which of its frames, counted from 0. report: of the last comparison.
    canvases: a picture per method; errors, shares: the curves.
    """

    frame = traitlets.Int(0)

    def __init__(self, bench: Workbench, methods: Sequence[str], chosen: Sequence[str] = (), seeds: int = 2) -> None:
        """methods: to choose from; chosen: of these at first, the first two by default; seeds: starts that are off."""
        self._bench, self._seeds = bench, seeds
        self.report: Report | None = None
        self.canvases: tuple[PointCanvas, ...] = ()
        self._runs: tuple[Run, ...] = ()
        tall = ipywidgets.Layout(width="220px", height="120px")
        self.methods = ipywidgets.SelectMultiple(
            options=list(methods), value=list(chosen or methods[:2]), description="methods", layout=tall
        )
        names = {str(key): key for key in bench.sequences}
        self.sequences = ipywidgets.SelectMultiple(
            options=names, value=list(bench.sequences[:1]), description="sequences", layout=tall
        )
        narrow = ipywidgets.Layout(width="260px")
        self.start = ipywidgets.Dropdown(options=STARTS, value=0.0, description="start", layout=narrow)
        self.step = ipywidgets.Dropdown(options=STEPS, value=1, description="frames", layout=narrow)
        self.go = button("compare", "run what is missing, and show it", self.compare, "primary")
        self.told = ipywidgets.Label()
        self.table = ipywidgets.HTML()
        self.errors = CurvePlot((), (), x_label="image id")
        self.shares = CurvePlot(_LIMITS, (), x_label="limit of ADD(-S), % of the diameter", limits=(0.0, 1.0))
        self.shares.cursor = 20
        self.film = ipywidgets.Dropdown(options=[], description="film of", layout=narrow)
        self.play = ipywidgets.Play(min=0, max=0, interval=PLAY_MS, show_repeat=True)
        self.slider = ipywidgets.IntSlider(min=0, max=0, description="frame", layout=ipywidgets.Layout(flex="1"))
        self._screen = row(())
        how = ipywidgets.VBox([self.start, self.step, self.go])
        super().__init__([
            row([self.methods, self.sequences, how], gap="4px 16px"), self.told, self.table,
            side_by_side((self.errors, "3 1 420px"), (self.shares, "2 1 300px")),
            row([self.film, self.play, self.slider], gap="4px 12px"), self._screen,
        ])  # fmt: skip
        # No link of the page's own from one to the other: what the kernel, which comes behind, says of the one would
        # throw the other back.
        for widget, trait in ((self.play, "value"), (self.slider, "value"), (self.errors, "cursor")):
            traitlets.link((self, "frame"), (widget, trait))
        self.film.observe(lambda _: self._show_film(), "value")
        self.observe(lambda _: self._show_frame(), "frame")
        self.compare()

    def compare(self) -> Report | None:
        """Run what is missing of what is chosen, and show all of it; None, with a message, where that cannot be."""
        off, step = self.start.value, self.step.value
        variants = [Variant(step, off, off, seed) for seed in range(self._seeds if off else 1)]
        self.go.disabled = True
        try:
            self.report = self._bench.compare(self.methods.value, self.sequences.value, variants, self._tell_progress)
        except AcpLabError as error:
            self._tell_failure(str(error))
            return None
        except KeyboardInterrupt:
            self._tell_failure("the comparison was interrupted; another one goes on with the runs that are missing")
            raise
        finally:
            self.go.disabled = False
        self.told.value = (
            "▲ better, ▼ worse than the first method, = a tie. In brackets: 95% intervals, which with one sequence say "
            "nothing of others."
        )
        self.table.value = _table(self.report)
        self._show_shares(variants[0])
        shown = self.film.value
        self.film.options = {str(key): key for key in self.sequences.value}
        self.film.value = shown if shown in self.sequences.value else self.sequences.value[0]
        self._show_film()
        return self.report

    def _tell_progress(self, done: int, total: int) -> None:
        self.told.value = f"{done} of {total} runs …"

    def _tell_failure(self, why: str) -> None:
        """What is shown is what was compared before, which is no more what is chosen above it."""
        before = "" if self.report is None else f" (below: {' and '.join(self.report.methods)}, compared before)"
        self.told.value = f"{why}{before}"

    def _show_shares(self, variant: Variant) -> None:
        assert self.report is not None
        curves = []
        for name in self.report.methods:
            own = [run for run in self.report.runs if run.method == name and run.variant.group == variant.group]
            percent = 100.0 * np.concatenate([run.distance for run in own])
            if not len(percent):  # sequences of one image, which is where the part was given
                continue
            shares = np.array([(percent < limit).mean() for limit in _LIMITS])
            curves.append(Curve(shares, self._colour(name), SHARE_ROW, name))
        self.shares.curves = tuple(curves)

    def _show_film(self) -> None:
        """Another sequence, or other runs of it: those of the first start."""
        if self.report is None or self.film.value is None:
            return
        own = [run for run in self.report.runs if run.sequence == self.film.value]
        # A shorter film moves the slider, which asks for a picture: none until all is there.
        self._runs = ()
        runs = tuple(next(run for run in own if run.method == name) for name in self.report.methods)
        ids = runs[0].frame_ids
        self.slider.max = self.play.max = max(len(ids) - 1, 0)
        percent = [np.minimum(100.0 * run.distance, LARGEST_SHOWN_ADD) for run in runs]
        curves = [
            Curve(shown, self._colour(run.method), ADD_ROW, run.method, LARGEST_SHOWN_ADD)
            for shown, run in zip(percent, runs, strict=True)
        ]
        with self.errors.hold_sync():
            self.errors.x = tuple(map(float, ids))
            self.errors.curves = tuple(curves)
            self.errors.marks = (Mark(2.0, ADD_ROW, "2%"), Mark(5.0, ADD_ROW, "5%"))
        self._reel = _Reel(self._bench, self.film.value)
        if len(self.canvases) != len(runs):
            before = self.canvases
            self.canvases = tuple(PointCanvas(height_px=FILM_HEIGHT_PX) for _ in runs)
            for canvas in self.canvases:
                canvas.layout.flex, canvas.layout.min_width = "1 1 300px", "0"
            self._screen.children = self.canvases
            close_with_parts(*before)
        self.frame = min(self.frame, self.slider.max)
        self._runs = runs
        self._show_frame()

    def _show_frame(self) -> None:
        if not self._runs:
            return
        if not self._runs[0].frame_ids:
            self._show_nothing()
            return
        at = min(self.frame, len(self._runs[0].frame_ids) - 1)
        frame_id = self._runs[0].frame_ids[at]
        shelved, camera, truth = self._reel.shelf(frame_id), self._reel.camera(frame_id), self._reel.truth(frame_id)
        for canvas, run in zip(self.canvases, self._runs, strict=True):
            drawn = []
            if truth is not None:
                drawn.append(self._reel.drawn(truth, camera, TRUTH, "the truth", 1.0))
            if np.isfinite(run.poses[at]).all():
                drawn.append(self._reel.drawn(run.poses[at], camera, self._colour(run.method), run.method, 1.5))
            error = 100.0 * run.distance[at]
            far = f"{run.metric} {error:.1f}%" if np.isfinite(error) else run.note or "no pose"
            with canvas.hold_sync():
                if shelved.content:
                    canvas.image_size = shelved.size
                canvas.image, canvas.title = shelved.content, f"{run.method}, image {frame_id}: {far}"
                canvas.draw(drawn)
                canvas.view = _around(drawn[0].coordinates, shelved.size) if drawn else ()
                canvas.status = shelved.note

    def _show_nothing(self) -> None:
        for canvas, run in zip(self.canvases, self._runs, strict=True):
            with canvas.hold_sync():
                canvas.show(None)
                canvas.draw(())
                canvas.title, canvas.view, canvas.status = f"{run.method}: no frame to compare", (), ""

    def _colour(self, method: str) -> Colour:
        return COLOURS[list(self.methods.options).index(method) % len(COLOURS)]


class _Reel:
    """The images of a sequence, and its part's sharp edges to draw over them."""

    def __init__(self, bench: Workbench, sequence: SequenceKey) -> None:
        dataset = BopDataset(bench.roots[sequence.dataset])
        folder = dataset.scene_folder(sequence.scene_id, bench.split)
        # The truth of the scene may hold several instances; that of this one is asked for elsewhere.
        scene = BopScene(folder, SceneTruth({}))
        self.shelf, self.camera = FrameShelf(scene), scene.camera
        self._truth = instance_truths(folder / "scene_gt.json")[sequence.object_id][sequence.instance]
        self._object_id = sequence.object_id
        self._lines_obj = MeshLines.of(dataset.part(sequence.object_id)).sharper_than(_SHARP_DEG)

    def truth(self, frame_id: int) -> FloatArray | None:
        """The true pose (4, 4) in an image, None where it is not told."""
        return self._truth.pose(frame_id, self._object_id)

    def drawn(self, cam_T_obj: FloatArray, camera: Camera, colour: Colour, label: str, width_px: float) -> Overlay:
        """The part's edges at a pose (3, 4) or (4, 4), hidden or not."""
        pose = np.vstack([cam_T_obj[:3], [0.0, 0.0, 0.0, 1.0]])
        pixels = camera.project(transform(pose, self._lines_obj.reshape(-1, 3))).reshape(-1, 2, 2)
        seen = np.isfinite(pixels).all((1, 2)) & (np.abs(np.nan_to_num(pixels)) < 1e4).all((1, 2))
        return Overlay("strokes", pixels[seen], colour, label, width_px)


def _around(strokes: FloatArray, size: tuple[int, int]) -> tuple[float, ...]:
    """What a film shows of an image (width, height): strokes (n, 2, 2) px with some room; () for all of it."""
    if not len(strokes) or not size[0]:
        return ()
    low, high = strokes.min((0, 1)), strokes.max((0, 1))
    wide = float((high - low).max()) * (1.0 + 2.0 * _ROOM)
    # In the proportions of the image, which may stand upright: then its width is what must hold the part.
    height = min(max(wide, wide * size[1] / size[0]), size[1])
    width = height * size[0] / size[1]
    left, top = 0.5 * (low + high) - 0.5 * np.array([width, height])
    return float(left), float(top), width, height


def _table(report: Report) -> str:
    """The report's tables, those of several sequences first, as HTML."""
    kept = [HEAD.index(name) for name in _COLUMNS]

    def line(values: Sequence[str], tag: str) -> str:
        shown: Any = (f"<{tag} style='padding:1px 10px;text-align:right'>{escape(values[n])}</{tag}>" for n in kept)
        return f"<tr>{''.join(shown)}</tr>"

    blocks = [
        f"<b>{escape(group)}: {escape(how)}</b><table>{line(HEAD, 'th')}"
        f"{''.join(line(cells(one), 'td') for one in rows)}</table>"
        for group, how, rows in report.blocks()
    ]
    return "".join(blocks)
