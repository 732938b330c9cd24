"""Every widget in a real browser inside JupyterLab: it shows, a hand drags it, the kernel knows."""

from __future__ import annotations

import numpy as np
import pytest

from tests.browser.lab import Lab

IMPORTS = """
import numpy as np
from acp_lab.display.widgets import ControlPointEditor, LossLandscape, ManipulationExplorer, PoseAligner, TrackPlayer
from tests.prepared_sample import sample_model, sample_scene
model, scene = sample_model(), sample_scene()
frame = scene.frame(0)
"""
EDITORS = """
quad = np.array([[20.0, 30.0], [52.0, 28.0], [50.0, 70.0], [18.0, 74.0]])
images = {
    "empty": None,
    "grey": np.tile(np.arange(100, dtype=np.uint8), (80, 1)),
    "large": np.full((1024, 1224, 3), 130, np.uint8),
    "tall": np.full((900, 70, 3), 200, np.uint8),
    "wide": np.full((60, 4000), 120, np.uint8),
}
from acp_lab.display.widgets import Overlay
label = Overlay("line", quad, (1.0, 0.5, 0.0), "a_label_without_any_space_" * 9)
editors = {name: ControlPointEditor(image, quad, [label], title=name, height_px=330) for name, image in images.items()}
import ipywidgets
ipywidgets.GridBox(list(editors.values()), layout=ipywidgets.Layout(grid_template_columns="1fr 1fr"))
"""

GREEDY = """
import anywidget
from acp_lab.display.widgets.keyboard_guard import guarded

class Greedy(anywidget.AnyWidget):
    _esm = '''export default { render({ el }) {
        const field = document.createElement("input");
        field.className = "greedy";
        field.addEventListener("pointerdown", () => { field.value = "pressed"; });
        el.appendChild(field);
        setInterval(() => field.focus(), 20);
    } };'''

guarded(Greedy())
"""

pytestmark = pytest.mark.usefixtures("closes")


def test_editor_on_any_image(lab: Lab) -> None:
    panel = lab.open("editor", IMPORTS, EDITORS)
    for number, name in enumerate(("empty", "grey", "large", "tall")):
        canvas = panel.locator(".acp-canvas").nth(number)
        canvas.locator(".acp-title", has_text=name).wait_for()
        target = (30.0, 45.0) if name != "large" else (300.0, 200.0)
        lab.pull(canvas.locator(".acp-ring").nth(0), canvas, target)
        lab.until(f"np.abs(editors['{name}'].settled[0] - {target}).max() < 1.5", f"editors['{name}'].settled")
        np.testing.assert_allclose(lab.value(f"editors['{name}'].points[1:]"), [[52, 28], [50, 70], [18, 74]])
        assert not lab.value(f"editors['{name}'].dragging")
    wide = panel.locator(".acp-canvas").nth(4)
    wide.locator(".acp-title", has_text="wide").wait_for()
    size = wide.locator(".acp-stage").bounding_box()
    assert size is not None
    assert size["height"] > 0.095 * size["width"]
    # The drawing fills the stage, and the label that has no space goes on in the next line.
    drawing = wide.locator(".acp-svg").bounding_box()
    assert drawing is not None
    assert abs(drawing["height"] - size["height"]) < 3.0
    assert wide.evaluate("(canvas) => canvas.scrollWidth - canvas.clientWidth") <= 1
    lab.shot("editor_images")
    lab.shot("editor_wide", wide)


def test_editor_by_keyboard_touch_wheel_and_buttons(lab: Lab) -> None:
    one = "editor = ControlPointEditor(frame.image, scene_points, title='control points'); editor"
    points = "scene_points = np.array([[287.0, 182.0], [168.0, 239.0], [246.0, 314.0], [362.0, 246.0]])"
    panel = lab.open("editor_hand", IMPORTS, f"{points}\n{one}")
    canvas = panel.locator(".acp-canvas")
    canvas.locator("image[href]").wait_for(state="attached")
    handles = canvas.locator(".acp-handle")

    handles.nth(1).focus()
    for key in ("ArrowRight", "Shift+ArrowDown", "ArrowUp"):
        lab.page.keyboard.press(key)
    lab.until("np.allclose(editor.settled[1], [169.0, 248.0])", "editor.settled")
    lab.page.keyboard.press("Shift+ArrowLeft")
    lab.until("np.allclose(editor.settled[1], [159.0, 248.0])", "editor.settled")
    lab.page.keyboard.press("Control+z")
    lab.until("np.allclose(editor.settled[1], [169.0, 248.0])", "editor.settled")
    canvas.get_by_label("reset").click()
    lab.until("np.allclose(editor.settled, scene_points)", "editor.settled")

    # Zoomed in, the same pull on the screen is a shorter one in the image.
    lab.page.mouse.move(*lab.on_screen(canvas, (287.0, 182.0)))
    canvas.locator(".acp-svg").click(position={"x": 5, "y": 5})
    lab.page.mouse.move(*lab.on_screen(canvas, (287.0, 182.0)))
    for _ in range(3):
        lab.page.mouse.wheel(0, -200)
    lab.drag(canvas.locator(".acp-ring").nth(0), 60.0, 0.0)
    lab.until("2.0 < editor.settled[0, 0] - 287.0 < 30.0", "editor.settled")
    canvas.get_by_label("show all").click()

    # A finger, which misses the handle by a little.
    finger = lab.page.context.new_cdp_session(lab.page)
    x, y = lab.on_screen(canvas, (246.0, 314.0))
    for kind, dx in (("touchStart", 8), ("touchMove", 20), ("touchMove", 38), ("touchEnd", None)):
        touches = [] if dx is None else [{"x": x + dx, "y": y + 5}]
        finger.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": touches})
    lab.until("editor.settled[2, 0] > 260.0", "editor.settled")

    # The area between the points moves all four.
    before = np.array(lab.value("editor.points"))
    lab.page.mouse.move(*lab.on_screen(canvas, (250.0, 235.0)))
    lab.page.mouse.down()
    lab.page.mouse.move(*lab.on_screen(canvas, (290.0, 245.0)), steps=4)
    lab.page.mouse.up()
    lab.until("not editor.dragging and editor.settled[1, 0] > 190.0", "editor.settled")
    np.testing.assert_allclose(np.array(lab.value("editor.points")) - before, np.tile([40.0, 10.0], (4, 1)), atol=1.5)


def test_a_folded_quad_is_red_and_told_in_both_themes(lab: Lab) -> None:
    cell = "editor = ControlPointEditor(frame.image, [[200, 150], [400, 150], [400, 350], [200, 350]]); editor"
    panel = lab.open("editor_folded", IMPORTS, cell)
    canvas = panel.locator(".acp-canvas")
    good = canvas.locator(".acp-outline").evaluate("(node) => getComputedStyle(node).stroke")
    lab.pull(canvas.locator(".acp-ring").nth(0), canvas, (430.0, 300.0))
    canvas.locator(".acp-status[role=alert]", has_text="folded").wait_for()
    outline = canvas.locator(".acp-outline").element_handle()
    lab.page.wait_for_function("([node, good]) => getComputedStyle(node).stroke !== good", arg=[outline, good])
    for dark in (False, True):
        lab.theme(dark)
        contrast = canvas.locator(".acp-status").evaluate(CONTRAST)
        assert contrast > 3.0, f"text and ground differ by a ratio of {contrast:.1f} only"
        lab.shot(f"editor_folded_{'dark' if dark else 'light'}")
    lab.theme(False)


def test_explorer_panels_follow_the_hand(lab: Lab) -> None:
    cell = "explorer = ManipulationExplorer(model, frame.camera, scene.first_pose); explorer"
    panel = lab.open("explorer", IMPORTS, cell)
    editor = panel.locator(".acp-canvas").nth(0)
    lab.pull(editor.locator(".acp-ring").nth(0), editor, (310.0, 215.0))
    lab.until("abs(explorer.editor.settled[0, 0] - 310.0) < 2.0 and explorer.study.misfit_px > 1.0")
    panel.get_by_role("button", name="make rigid").click()
    panel.get_by_role("button", name="y +5°").click()
    lab.until("explorer.study.misfit_px < 1e-6")
    told = panel.locator(".acp-canvas").nth(1).locator(".acp-status")
    lab.page.wait_for_function("(node) => /Chamfer [1-9]/.test(node.innerText)", arg=told.element_handle())
    panel.locator(".acp-canvas").nth(3).locator(".acp-status", has_text="rigid by construction").wait_for()
    lab.shot("explorer_light")
    lab.theme(True)
    lab.shot("explorer_dark")
    lab.theme(False)


def test_aligner_from_a_view_beside_to_a_pose_file(lab: Lab) -> None:
    cell = """
from acp_lab.evaluation import add_mm
from tests.display.scripted_hand import view_from_beside
rng, truth = np.random.default_rng(3), scene.first_pose
aligner = PoseAligner(model, frame, view_from_beside(model, frame, truth, 40.0, 60.0, rng))
def add_percent(): return 100.0 * add_mm(model.part.vertices, aligner.cam_T_obj, truth) / model.part.diameter
aligner"""
    panel = lab.open("aligner", IMPORTS, cell)
    panel.get_by_role("button", name="drag four points").click()
    panel.locator("text=drag the points, or the area").wait_for()
    canvas = panel.locator(".acp-canvas").nth(0)
    canvas.locator("image[href]").wait_for(state="attached")
    lab.shot("aligner_start")
    targets = lab.value("aligner.points_at(truth) + rng.uniform(-5.0, 5.0, (4, 2))")
    for number, target in enumerate(targets):
        lab.pull(canvas.locator(".acp-ring").nth(number), canvas, tuple(target))
    lab.until(f"np.abs(aligner.editor.settled - {targets}).max() < 1.5", "aligner.editor.settled")
    # JupyterLab hands what widgets say to a thread of its own: the pose may come after the points.
    lab.until(f"np.abs(aligner.points_at(aligner.cam_T_obj) - {targets}).max() < 3.0", "aligner.cam_T_obj")
    before, place = lab.value("add_percent()"), canvas.bounding_box()
    panel.get_by_role("button", name="snap", exact=True).click()
    panel.locator("text=searching").wait_for()
    assert panel.get_by_role("button", name="snap", exact=True).is_disabled()
    lab.until("aligner.snapped is not None")
    panel.locator("b", has_text="found").wait_for()
    assert canvas.bounding_box() == place, "words that come must not move the picture below the pointer"
    assert lab.value("add_percent()") < min(2.0, before)
    panel.get_by_role("button", name="save", exact=True).click()
    lab.until("aligner.message.value.startswith('the pose is in')", "aligner.message.value")
    assert (lab.folder / "POSE.json").is_file()
    lab.shot("aligner_snapped")

    panel.get_by_role("button", name="click corners").click()
    # The canvases of the first page leave the page.
    picture, chooser = panel.locator(".acp-canvas").nth(0), panel.locator(".acp-canvas").nth(1)
    chooser.locator("text=corners to choose from").wait_for()
    lab.kernel("aligner.chooser.look(truth[:3, :3])")
    corner, pixel = lab.value(
        "(lambda r: [aligner.chooser.project(aligner.chooser.corners_obj[[r]])[0].tolist(), "
        "frame.camera.project(aligner.chooser.corners_obj[[r]] @ truth[:3, :3].T + truth[:3, 3])[0].tolist()])"
        "(int(aligner.chooser.seen_corners()[0]))"
    )
    lab.page.mouse.click(*lab.on_screen(chooser, tuple(corner)))
    picture.locator("text=now click where the marked corner is").wait_for()
    lab.page.mouse.click(*lab.on_screen(picture, tuple(pixel)))
    lab.until("aligner.pairs.count == 1")
    np.testing.assert_allclose(lab.value("aligner.picture.points[0]"), pixel, atol=1.5)
    # A corner may be seen next to one that is placed already, below its handle.
    beside = lab.value("int(aligner.chooser.seen_corners()[-1])")
    lab.kernel(f"aligner.pairs.choose({beside})")
    lab.page.mouse.click(*lab.on_screen(picture, (pixel[0] + 6.0, pixel[1])))
    lab.until("aligner.pairs.count == 2", "aligner.pairs.count")
    np.testing.assert_allclose(lab.value("aligner.picture.points"), [pixel, [pixel[0] + 6.0, pixel[1]]], atol=1.5)
    panel.get_by_role("button", name="undo").first.click()
    lab.until("aligner.pairs.count == 1", "aligner.pairs.count")

    # The ground below the model turns it; a click there is still a click.
    seen = np.array(lab.value("aligner.chooser.pose[:3, :3]"))
    x, y = lab.on_screen(chooser, (330.0, 30.0))
    lab.page.mouse.move(x, y)
    lab.page.mouse.down()
    lab.page.mouse.move(x - 60.0, y + 25.0, steps=12)
    lab.page.mouse.up()
    lab.until("not aligner.chooser.dragging and aligner.chooser.orbit[0] < -20.0", "aligner.chooser.orbit")
    assert np.abs(np.array(lab.value("aligner.chooser.pose[:3, :3]")) - seen).max() > 0.1
    lab.kernel("aligner.chooser.look(truth[:3, :3])")
    rows = lab.value("aligner.chooser.seen_corners()[1:24:4].tolist()")
    for number, row in enumerate(rows, start=2):
        lab.kernel(f"aligner.pairs.choose({row})")
        lab.kernel(
            f"c = aligner.chooser.corners_obj[[{row}]]; "
            "aligner.pairs.place(frame.camera.project(c @ truth[:3, :3].T + truth[:3, 3])[0] + rng.normal(0, 1.5, 2))"
        )
        lab.until(f"aligner.pairs.count == {number}")
    picture.locator("text=/^2: [0-9.]+ px$/").wait_for()
    assert lab.value("add_percent()") < 5.0
    lab.shot("aligner_corners")


def test_find_it_for_me_while_the_page_stays_alive(lab: Lab) -> None:
    panel = lab.open("aligner_find", IMPORTS, "aligner = PoseAligner(model, frame); aligner")
    seen = np.array(lab.value("aligner.chooser.pose[:3, :3]"))
    panel.get_by_role("button", name="find it for me").click()
    panel.locator("text=looking for the part").wait_for()
    panel.get_by_role("button", name="z +15°").click()
    lab.until(f"np.abs(aligner.chooser.pose[:3, :3] - {seen.tolist()}).max() > 0.1")
    assert lab.value("aligner.finder.children == ()"), "the page answers while the search runs"
    panel.locator("b", has_text="found").wait_for()
    first = panel.get_by_role("button", name="1: score")
    first.wait_for()
    lab.shot("aligner_found")
    thumb = panel.locator(".acp-canvas").nth(0)
    thumb.locator("image[href]").wait_for(state="attached")
    thumb.locator(".acp-svg").click()
    panel.locator("text=taken: look whether the edges sit").wait_for()
    off = "np.linalg.norm(aligner.cam_T_obj[:3, 3] - scene.first_pose[:3, 3])"
    assert lab.value(off) < 10.0
    lab.shot("aligner_found_taken")
    for dark in (True, False):
        lab.theme(dark)
        lab.shot(f"aligner_found_{'dark' if dark else 'light'}")


def test_player_scrubs_plays_and_steps(lab: Lab) -> None:
    cell = """
from acp_lab.tracking.tracker import Tracker
tracker = Tracker(model)
tracker.records_steps = True
run = tracker.run(scene, scene.first_pose)
player, sent = TrackPlayer(run), []
send_picture = player.canvas._send_picture
def counted(number, picture):
    sent.append((player.canvas.edition, number))
    send_picture(number, picture)
player.canvas._send_picture = counted
player"""
    panel = lab.open("player", IMPORTS, cell)
    curves = panel.locator(".acp-curves")
    curves.scroll_into_view_if_needed()
    box = curves.bounding_box()
    assert box is not None
    lab.page.mouse.click(box["x"] + 0.55 * box["width"], box["y"] + 60)
    lab.until("15 < player.frame < 25 and player.canvas.frame == player.frame", "player.frame")
    slider = panel.locator(".acp-film .acp-slider")
    lab.page.wait_for_function("() => 15 < Number(document.querySelector('.acp-film .acp-slider').value)")
    before = lab.value("player.frame")
    lab.page.keyboard.press("ArrowRight")
    lab.until(f"player.frame == {before} + 1", "player.frame")
    panel.locator(".acp-canvas .acp-title", has_text=f"image {before + 1}").wait_for()
    panel.get_by_text("follow the part").click()
    panel.get_by_role("button", name="repeat").click()
    lab.until("player.canvas.repeat")
    panel.get_by_role("button", name="play").click()
    lab.until(f"player.frame > {before} + 3", "player.frame")
    lab.until("sum(edition == player.canvas.edition for edition, _ in sent) == 40", "len(sent)")
    shown, ticks = lab.page.evaluate(BESIDE_A_TIMER, 4000)
    print(f"player: {shown / 4.0:.1f} pictures per second, a timer of its interval {ticks / 4.0:.1f} ticks")
    assert shown > 0.6 * ticks > 0, "a page with little time draws less often, but then its timer ticks less often too"
    assert len(sent_of_frames := lab.value("sent")) == len(set(map(tuple, sent_of_frames))), "made and sent once each"
    panel.get_by_role("button", name="pause").click()
    at = int(slider.input_value())
    lab.until(f"player.frame == player.curves.cursor == {at}", "player.frame")
    panel.get_by_role("button", name="step back").click()
    lab.until(f"player.frame == {(at - 1) % 40 if at else 0}", "player.frame")
    lab.shot("player_light")
    lab.theme(True)
    lab.shot("player_dark")
    lab.theme(False)


def test_a_film_goes_on_after_a_fault_and_a_lost_question(lab: Lab) -> None:
    cell = """
from acp_lab.display.widgets.film_canvas import FilmCanvas, Picture
def picture_of(number):
    if number == 3:
        raise ZeroDivisionError("a fault")
    return Picture(b"", (64, 48), f"number {number}", points=np.full((4, 2), 10.0 + number))
class Deaf(FilmCanvas):
    heard = 0
    def _hear(self, widget, content, buffers):
        self.heard += content.get("kind") == "want"
        if content.get("kind") != "want" or self.heard != 2:
            super()._hear(widget, content, buffers)
film = Deaf(picture_of, 40)
film"""
    panel = lab.open("film", IMPORTS, cell)
    panel.get_by_role("button", name="play").click()
    lab.until("film.heard > 2 and film.frame == 39", "[film.heard, film.frame]")
    panel.locator(".acp-canvas .acp-title", has_text="number 39").wait_for()
    panel.locator(".acp-film .acp-slider").fill("3")
    panel.locator(".acp-canvas .acp-status", has_text="a fault").wait_for()

    # After a restart of the kernel the page's messages go nowhere; what is there can still be looked at.
    lab.page.evaluate("() => window.jupyterapp.shell.currentWidget.sessionContext.session.kernel.restart()")
    panel.locator(".acp-film .acp-slider").fill("20")
    panel.locator(".acp-canvas .acp-title", has_text="number 20").wait_for()
    panel.locator(".acp-canvas .acp-status", has_text="no kernel answers: run the cell again").wait_for()
    lab.shot("film_without_kernel")


def test_landscape_starts_the_optimiser_where_the_hand_lets_go(lab: Lab) -> None:
    cell = "landscape = LossLandscape(model, frame, scene.first_pose); landscape"
    panel = lab.open("landscape", IMPORTS, cell)
    canvas = panel.locator(".acp-canvas").nth(0)
    canvas.locator("image[href]").wait_for(state="attached")
    lab.pull(canvas.locator(".acp-ring").nth(0), canvas, (100.0, 250.0))
    lab.until("not landscape.map.dragging and np.abs(landscape.map.settled[0] - [100.0, 250.0]).max() < 2.0")
    np.testing.assert_allclose(
        np.array(lab.value("landscape.descent.offsets[0]"))[:2], lab.value("landscape.start_offsets[:2]")
    )
    lab.shot("landscape_light")
    panel.get_by_role("button", name="pose", exact=True).click()
    lab.until("landscape.map.axes[0].unit == '°'")
    lab.theme(True)
    lab.shot("landscape_dark")
    lab.theme(False)


BESIDE_A_TIMER = """async (ms) => {
    // How many pictures the film shows while a plain timer of the same interval ticks beside it.
    const shown = () => Number(document.querySelector('.acp-canvas').dataset.pictures);
    const first = shown();
    const end = performance.now() + ms;
    let ticks = 0;
    for (let due = performance.now(); due < end; ticks++) {
        due = Math.max(due + 40, performance.now());
        await new Promise((done) => setTimeout(done, Math.max(due - performance.now(), 4)));
        await new Promise(requestAnimationFrame);
    }
    return [shown() - first, ticks];
}"""
CONTRAST = """(node) => {
    const channels = (colour) => colour.match(/[0-9.]+/g).slice(0, 3).map((v) => {
        const share = v / 255;
        return share <= 0.04045 ? share / 12.92 : ((share + 0.055) / 1.055) ** 2.4;
    });
    const luminance = (colour) => channels(colour).reduce((sum, v, i) => sum + v * [0.2126, 0.7152, 0.0722][i], 0);
    let ground = node;
    while (ground && /rgba\\(0, 0, 0, 0\\)|transparent/.test(getComputedStyle(ground).backgroundColor)) {
        ground = ground.parentElement;
    }
    const back = luminance(ground ? getComputedStyle(ground).backgroundColor : "rgb(255, 255, 255)");
    const front = luminance(getComputedStyle(node).color);
    return (Math.max(back, front) + 0.05) / (Math.min(back, front) + 0.05);
}"""


def test_the_keyboard_stays_with_the_notebook_until_a_click(lab: Lab) -> None:
    panel = lab.open("greedy", GREEDY, "after = 1")
    field = panel.locator(".greedy")
    has_it = "(field) => document.activeElement === field"
    lab.page.wait_for_function("() => document.querySelector('.greedy')?.closest('[inert]')")
    lab.page.wait_for_timeout(200)  # ten times as long as the greedy one waits
    assert not field.evaluate(has_it)
    field.scroll_into_view_if_needed()
    box = field.bounding_box()
    assert box is not None
    lab.page.mouse.click(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    assert field.input_value() == "pressed", "the click that wakes it counts"
    lab.page.wait_for_function("() => document.activeElement.className === 'greedy'")
