"""Renews the screenshots in docs/images: every widget, a replay, an explanation; part of `make pictures`.

    python -m tests.browser.pictures acp_lab_demo/parts                # all, with the part that make demo prepared
    python -m tests.browser.pictures acp_lab_demo/parts widget_player  # one
"""

from __future__ import annotations

import shutil
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

from PIL import Image

from tests.browser.lab import CHROMIUM_FLAGS, PROJECT, Lab, lab_server

OUT = PROJECT / "docs" / "images"
WIDTH_PX = 1200
"""Of the page; a widget is then about 1050 px wide."""
WEBGL = ["--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist"]

SAMPLE = """
import numpy as np
import acp_lab as acp
from acp_lab.display.widgets import ControlPointEditor, LossLandscape, ManipulationExplorer, PoseAligner, TrackPlayer
from acp_lab.sample import sample_dataset
scene = acp.open_sequence(sample_dataset())
model = acp.prepare(scene.dataset.part(1), out={parts!r})
frame, truth = scene.frame(0), scene.first_pose
"""
CORNERS = """
aligner = PoseAligner(model, frame)
aligner.chooser.look(truth[:3, :3])
rng = np.random.default_rng(3)
for row in aligner.chooser.seen_corners()[1:24:4]:
    aligner.pairs.choose(int(row))
    at = frame.camera.project(aligner.chooser.corners_obj[[row]] @ truth[:3, :3].T + truth[:3, 3])[0]
    aligner.pairs.place(at + rng.normal(0.0, 1.0, 2))
aligner
"""
PLAYER = """
tracker = acp.Tracker(model)
tracker.records_steps = True
player = TrackPlayer(tracker.run(scene, truth))
player.frame = 22
player
"""
HIDDEN = """
from dataclasses import replace
from pathlib import Path
from acp_lab.sequences.altered import AlteredSequence

def board(frame):
    image = frame.image.copy()
    image[:, 270 : 270 + max(0, 6 * (frame.index - 8))] = (90, 80, 70)
    return replace(frame, image=image)

run = acp.Tracker(model).run(AlteredSequence(scene, board), truth)
Path({out!r}).write_bytes(acp.explain(run, 25).picture())
"""


@dataclass(frozen=True)
class Shot:
    """A picture: the cell that shows it, and what has to be there before it is taken.

    then: Python for the kernel once it is shown. until: a selector in the page. wait_ms: for what draws by itself.
    """

    cell: str
    then: str = ""
    until: str = ".acp-canvas image[href]"
    wait_ms: int = 1500


SHOTS = {
    "widget_editor": Shot("ControlPointEditor(frame.image, [[287, 182], [168, 239], [246, 314], [362, 246]])"),
    "widget_explorer": Shot(
        "explorer = ManipulationExplorer(model, frame.camera, truth); explorer",
        then="explorer.move_rigidly((0.0, 5.0, 0.0))",
        wait_ms=4000,
    ),
    "widget_aligner": Shot(CORNERS),
    "widget_found": Shot(
        "aligner = PoseAligner(model, frame); aligner",
        then="aligner.finder.find()",
        until="text=/score [0-9.]+, found/",
    ),
    "widget_landscape": Shot(
        "landscape = LossLandscape(model, frame, truth); landscape",
        then="landscape.space.value, landscape.anneal.value = 'pose', True; landscape.map.points = [[80.0, 300.0]]",
        wait_ms=5000,
    ),
    "widget_player": Shot(PLAYER, until="text=image 22"),
    "widget_live": Shot(
        "from tests.plugged_camera import plug_in\nplug_in(10.0)\n"
        "window = acp.live(model, scene.camera(0), start=truth); window",
        then="import time; time.sleep(6)",
        until="text=/tracking, quality/",
    ),
    "replay_viewer": Shot(
        "viewer = acp.show(acp.Tracker(model).run(scene, truth)); viewer",
        then="viewer.frame = 25",
        until="canvas",
        wait_ms=30_000,
    ),
}


def main() -> None:
    """Take the pictures that are named, all by default."""
    from playwright.sync_api import sync_playwright

    parts, *names = sys.argv[1:]
    sample = SAMPLE.format(parts=str(Path(parts).resolve()))
    wanted = names or [*SHOTS, "replay_explain"]
    chromium = shutil.which("chromium") or shutil.which("google-chrome")
    with tempfile.TemporaryDirectory() as folder, lab_server(Path(folder)) as url, sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=[*CHROMIUM_FLAGS, *WEBGL])
        page = browser.new_page(viewport={"width": WIDTH_PX, "height": 1600})
        lab = Lab(page, url, Path(folder), OUT)
        for name in wanted:
            take(lab, name, sample)
            lab.close()
            print(OUT / f"{name}.png", flush=True)
        browser.close()


def take(lab: Lab, name: str, sample: str) -> None:
    """Open a notebook that shows it, and save what its last cell shows."""
    if name == "replay_explain":
        lab.open(name, sample, HIDDEN.format(out=str(OUT / f"{name}.png")))
        return
    shot = SHOTS[name]
    panel = lab.open(name, sample, shot.cell)
    if shot.then:
        lab.page.wait_for_timeout(shot.wait_ms)
        lab.kernel(shot.then)
    panel.locator(shot.until).first.wait_for(state="attached")
    lab.page.wait_for_timeout(shot.wait_ms)
    _shrink(lab.shot(name, panel.locator(".jp-OutputArea-output").last))
    if name == "widget_live":
        lab.kernel("window.stop()")


def _shrink(path: Path) -> None:
    """To 256 colours: half the bytes, which every wheel carries."""
    with Image.open(path) as picture:
        few = picture.convert("RGB").quantize(256)
    few.save(path, optimize=True)


if __name__ == "__main__":
    main()
