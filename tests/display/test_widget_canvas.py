"""The canvas under all widgets: what its traits take, when a point counts as put down, and what the browser gets."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import traitlets

from acp_lab.display.colours import GREY, SKY, VERMILLION
from acp_lab.display.widgets.overlay import Overlay, css_colour, residual_strokes, serialised
from acp_lab.display.widgets.picture import jpeg_bytes
from acp_lab.display.widgets.point_canvas import STATIC, Axis, PointCanvas
from acp_lab.errors import AcpLabError
from acp_lab.generator.base import GeneratedEdges
from tests.display.node_page import in_node
from tests.display.scripted_hand import drag

POINTS = np.array([[10.0, 10.0], [60.0, 12.0], [55.0, 40.0]])
GREY_IMAGE = np.full((50, 80), 90, np.uint8)


def canvas() -> PointCanvas:
    return PointCanvas(GREY_IMAGE, POINTS, editable=True)


@pytest.mark.parametrize(
    ("shape", "size"),
    [((50, 80), (80, 50)), ((1024, 1224, 3), (1224, 1024)), ((900, 60, 3), (60, 900)), ((0, 0, 3), (0, 0))],
)
def test_grey_large_tall_and_empty_images(shape: tuple[int, ...], size: tuple[int, int]) -> None:
    made = PointCanvas(np.full(shape, 90, np.uint8))
    assert made.image_size == size
    if size == (0, 0):
        assert made.image == b""
    else:
        decoded = cv2.imdecode(np.frombuffer(made.image, np.uint8), cv2.IMREAD_COLOR)
        assert decoded.shape[:2] == shape[:2]
        assert abs(int(decoded.mean()) - 90) < 3


def test_colours_survive_and_other_types_are_refused() -> None:
    image = np.zeros((8, 8, 3), np.uint8)
    image[..., 0] = 200
    shown = cv2.imdecode(np.frombuffer(jpeg_bytes(image), np.uint8), cv2.IMREAD_COLOR)
    assert np.abs(shown[4, 4].astype(int) - [0, 0, 200]).max() < 5
    for wrong in (np.zeros((4, 4), np.float32), np.zeros((4, 4, 2), np.uint8)):
        with pytest.raises(AcpLabError, match="give uint8 pixels"):
            jpeg_bytes(wrong)


def test_points_are_read_only_arrays() -> None:
    made = canvas()
    made.points = [[1, 2], [3, 4]]
    assert made.points.dtype == np.float64
    with pytest.raises(ValueError, match="read-only"):
        made.points[0, 0] = 5.0
    POINTS_BEFORE = POINTS.copy()
    made.points = POINTS
    made.reset()
    np.testing.assert_array_equal(POINTS, POINTS_BEFORE)


@pytest.mark.parametrize("wrong", [[[1, 2, 3]], [[np.nan, 1]], "abc", [1.0, 2.0], [[1, 2], [3]]])
def test_what_is_no_list_of_points_is_refused(wrong: object) -> None:
    with pytest.raises(traitlets.TraitError):
        canvas().points = wrong


def test_points_settle_once_when_the_hand_lets_go() -> None:
    made, live, settled = canvas(), [], []
    made.observe(lambda change: live.append(change.new.copy()), "points")
    made.observe(lambda change: settled.append(change.new.copy()), "settled")
    drag(made, 1, np.array([70.0, 20.0]), steps=5)
    assert len(live) == 5
    assert len(settled) == 1
    np.testing.assert_allclose(settled[0][1], [70.0, 20.0])
    assert not made.dragging
    # An assignment from Python is not held by anybody.
    made.points = POINTS + 1.0
    assert len(settled) == 2


def test_points_settle_when_all_have_heard_of_them() -> None:
    made, heard = canvas(), []
    made.observe(lambda _: heard.append("settled"), "settled")
    made.observe(lambda _: heard.append("points"), "points")
    for change in (made.undo, made.reset):
        drag(made, 1, np.array([70.0, 20.0]), steps=1)
        change()
        assert heard == ["points", "settled"] * 2
        heard.clear()


def test_a_restart_below_a_hand_that_drags_leaves_no_old_points_to_go_back_to() -> None:
    made = canvas()
    made.dragging = True
    made.points = POINTS + 1.0
    made.restart(POINTS + 20.0)
    made.points = POINTS + 25.0
    made.dragging = False
    made.undo()
    np.testing.assert_allclose(made.points, POINTS + 20.0)
    made.undo()
    np.testing.assert_allclose(made.points, POINTS + 20.0)


def test_undo_and_reset_as_the_buttons_ask_for_them() -> None:
    made = canvas()
    drag(made, 0, np.array([20.0, 25.0]))
    drag(made, 2, np.array([30.0, 45.0]))
    made._handle_custom_msg({"kind": "undo"}, [])
    np.testing.assert_allclose(made.points, [[20, 25], POINTS[1], POINTS[2]])
    made._handle_custom_msg({"kind": "reset"}, [])
    np.testing.assert_allclose(made.points, POINTS)
    made.undo()
    np.testing.assert_allclose(made.points[0], [20, 25])
    for _ in range(5):
        made.undo()
    np.testing.assert_allclose(made.points, POINTS)
    made.restart(POINTS + 3.0)
    made.undo()
    np.testing.assert_allclose(made.points, POINTS + 3.0)


def test_a_long_history_keeps_the_first_points() -> None:
    made = canvas()
    for k in range(300):
        made.points = POINTS + 1.0 + k
    assert len(made._history) < 220
    made.reset()
    np.testing.assert_allclose(made.points, POINTS)


def test_clicks_are_told_only_while_they_are_wanted() -> None:
    made, clicks = canvas(), []
    made.on_click(lambda pixel: clicks.append(pixel.tolist()))
    made._handle_custom_msg({"kind": "click", "x": 3, "y": 4.5}, [])
    made.clickable = True
    made._handle_custom_msg({"kind": "click", "x": 3, "y": 4.5}, [])
    assert clicks == [[3.0, 4.5]]


def test_overlays_go_as_bytes_without_what_is_not_finite() -> None:
    rows = np.array([[[0.0, 0.0], [1.0, 2.0]], [[np.nan, 0.0], [1.0, 2.0]]])
    (sent,) = serialised([Overlay("strokes", rows, SKY, "edges", 2.0)])
    assert np.frombuffer(sent["data"], np.float32).tolist() == [0.0, 0.0, 1.0, 2.0]
    assert sent["colour"] == css_colour(SKY) == "#56b4e9"
    made = canvas()
    made.draw([Overlay("dots", POINTS, SKY)])
    assert len(made.get_state("overlays")["overlays"]) == 1


def test_residual_strokes_are_grouped_by_their_colour() -> None:
    edges = GeneratedEdges(np.arange(14.0).reshape(7, 2), np.tile([1.0, 0.0], (7, 1)), np.ones(7), np.arange(7))
    residuals = np.array([0.0, -0.2, -9.0, 4.0, np.nan, 1.0, -1.0])
    groups = residual_strokes(edges, residuals, "edges")
    assert sum(len(group.coordinates) for group in groups) == 7
    np.testing.assert_allclose(groups[0].colour, SKY)
    assert len(groups[0].coordinates) == 2
    by_colour = {tuple(np.round(group.colour, 3)): len(group.coordinates) for group in groups}
    assert by_colour[tuple(np.round(VERMILLION, 3))] == 2
    assert by_colour[GREY] == 1
    (unknown,) = residual_strokes(edges, None, "edges")
    assert unknown.colour == GREY


def test_an_axis_reads_back_what_it_places() -> None:
    axis = Axis("turn", "°", -8.0, 8.0)
    for value in (-8.0, 0.0, 3.3):
        assert axis.value(axis.place(value, 360), 360) == pytest.approx(value)
    # The rim of the first pixel is the low end, that of the last one the high end.
    assert axis.value(-0.5, 360) == -8.0
    assert axis.value(359.5, 360) == 8.0


def test_the_drawing_is_one_module_that_fetches_nothing() -> None:
    text = PointCanvas._esm if isinstance(PointCanvas._esm, str) else str(PointCanvas._esm)
    assert text.count("export default") == 1
    assert "import " not in text
    for path in STATIC.iterdir():
        addresses = path.read_text().replace("http://www.w3.org/2000/svg", "")
        assert "http" not in addresses, path.name


# ---- fingers on the canvas ---------------------------------------------------------------------------------------

_FINGERS = """
const model = new Model({
  image: new DataView(new ArrayBuffer(0)), image_size: [640, 480], overlays: [], labels: [], active: -1, problem: "",
  points: [[100, 100], [300, 100], [300, 300], [100, 300]], closed: false, editable: true, clickable: true,
  orbits: false, orbit: [0, 0], dragging: false, title: "", status: "", view: [], axes: [], height_px: 480,
});
const el = page();
const destroy = widget.render({ model, el });
const ground = el.of("acp-svg")[0];
const view = () => ground.getAttribute("viewBox").split(" ").map(Number);
const finger = (type, pointerId, clientX, clientY, target = ground) => {
  const event = { type, pointerId, clientX, clientY, target, button: 0, buttons: 1, preventDefault() {} };
  ground.listeners[type](event);
};
"""


def on_the_canvas(folder: Path, trial: str) -> Any:
    return in_node(folder, PointCanvas._esm, _FINGERS + trial)


def test_a_second_finger_beside_a_dragged_point_does_not_throw_the_view(tmp_path: Path) -> None:
    trial = """
    const handle = el.of("acp-handle")[0];
    finger("pointerdown", 1, 100.5, 100.5, handle);
    for (let x = 120; x <= 300; x += 20) finger("pointermove", 1, x + 0.5, 100.5, handle), nextFrame();
    finger("pointermove", 1, 305.5, 100.5, handle); // its animation frame is still to come
    finger("pointerdown", 2, 400.5, 100.5);
    const put = { point: model.get("points")[0], dragging: model.get("dragging") };
    const before = view();
    finger("pointermove", 1, 304.5, 100.5, handle);
    tell({ ...put, before, after: view() });
    """
    told = on_the_canvas(tmp_path, trial)
    assert told["before"] == [-0.5, -0.5, 640, 480]
    np.testing.assert_allclose(told["after"], told["before"], atol=10.0)
    # What was dragged stays where it was last, and the kernel hears that it was let go.
    assert told["point"] == [305, 100]
    assert told["dragging"] is False


def test_a_second_finger_beside_a_turn_does_not_throw_the_view(tmp_path: Path) -> None:
    trial = """
    model.set("orbits", true);
    finger("pointerdown", 1, 500.5, 400.5);
    for (let x = 480; x >= 300; x -= 20) finger("pointermove", 1, x + 0.5, 400.5), nextFrame();
    finger("pointerdown", 2, 200.5, 400.5);
    finger("pointermove", 1, 301.5, 400.5);
    tell({ view: view(), orbit: model.get("orbit"), dragging: model.get("dragging") });
    """
    told = on_the_canvas(tmp_path, trial)
    np.testing.assert_allclose(told["view"], [-0.5, -0.5, 640, 480], atol=10.0)
    assert told["orbit"] == [-200, 0]
    assert told["dragging"] is False


def test_two_fingers_pinch_and_never_click(tmp_path: Path) -> None:
    trial = """
    const tap = (id) => (finger("pointerdown", id, 200.5, 200.5), finger("pointerup", id, 200.5, 200.5));
    tap(1);
    const one = model.sent.length;
    finger("pointerdown", 2, 200.5, 200.5);
    finger("pointerdown", 3, 400.5, 200.5);
    finger("pointerup", 2, 200.5, 200.5);
    finger("pointerup", 3, 400.5, 200.5);
    const two = model.sent.length - one;
    tap(4);
    finger("pointerdown", 5, 200.5, 200.5);
    finger("pointerdown", 6, 400.5, 200.5);
    finger("pointermove", 6, 600.5, 200.5);
    tell({ one, two, three: model.sent.length, width: view()[2] });
    """
    told = on_the_canvas(tmp_path, trial)
    assert (told["one"], told["two"], told["three"]) == (1, 0, 2)
    assert told["width"] == pytest.approx(320.0)


def test_an_image_of_another_size_keeps_the_view_that_the_kernel_wants(tmp_path: Path) -> None:
    trial = """
    model.set("view", [40, 30, 64, 48]);
    model.change("image_size", [320, 240]);
    const wanted = view();
    model.set("view", []);
    model.change("image_size", [300, 200]);
    tell({ wanted, whole: view() });
    """
    told = on_the_canvas(tmp_path, trial)
    assert told == {"wanted": [40, 30, 64, 48], "whole": [-0.5, -0.5, 300, 200]}


_HELD = """
const handle = el.of("acp-handle")[0];
const held = () => {
  finger("pointerdown", 1, 100.5, 100.5, handle);
  finger("pointermove", 1, 120.5, 100.5, handle);
  nextFrame();
};
const root = el.of("acp-canvas")[0];
const undo = (target) => root.listeners.keydown(
  { key: "z", ctrlKey: true, target, preventDefault() {}, stopPropagation() {} },
);
const buttons = Object.fromEntries(el.of("acp-button").map((node) => [node.title, node.listeners.click]));
"""


def test_nothing_is_undone_below_a_hand_that_drags(tmp_path: Path) -> None:
    trial = """
    held();
    undo(handle);
    buttons.undo();
    const during = model.sent.length;
    finger("pointerup", 1, 120.5, 100.5, handle);
    undo(handle);
    buttons.undo();
    tell({ during, after: model.sent.map((message) => message.kind) });
    """
    assert on_the_canvas(tmp_path, _HELD + trial) == {"during": 0, "after": ["undo", "undo"]}


def test_undo_is_heard_anywhere_in_the_canvas_but_where_one_writes(tmp_path: Path) -> None:
    trial = """
    undo(ground);
    const field = { closest: (selector) => (selector.includes("input") ? field : null) };
    undo(field);
    const editable = model.sent.length;
    model.set("editable", false);
    undo(ground);
    tell([editable, model.sent.length]);
    """
    assert on_the_canvas(tmp_path, _HELD + trial) == [1, 1]


def test_a_drag_ends_when_other_points_come_below_it(tmp_path: Path) -> None:
    trial = """
    held();
    finger("pointermove", 1, 130.5, 100.5, handle); // its animation frame is still to come
    model.change("points", [[1, 1], [2, 2]]);
    nextFrame();
    finger("pointermove", 1, 140.5, 100.5, handle);
    nextFrame();
    finger("pointerup", 1, 140.5, 100.5, handle);
    tell({ points: model.get("points"), dragging: model.get("dragging"), view: view() });
    """
    told = on_the_canvas(tmp_path, _HELD + trial)
    assert told == {"points": [[1, 1], [2, 2]], "dragging": False, "view": [-0.5, -0.5, 640, 480]}


def test_a_canvas_that_is_taken_away_lets_go_of_what_it_holds(tmp_path: Path) -> None:
    trial = """
    held();
    finger("pointermove", 1, 130.5, 100.5, handle); // its animation frame is still to come
    destroy();
    const saved = model.saved;
    nextFrame();
    tell({ point: model.get("points")[0], dragging: model.get("dragging"), late: model.saved - saved });
    """
    assert on_the_canvas(tmp_path, _HELD + trial) == {"point": [130, 100], "dragging": False, "late": 0}
    trial = """
    model.set("orbits", true);
    finger("pointerdown", 1, 500.5, 400.5);
    finger("pointermove", 1, 480.5, 400.5);
    nextFrame();
    finger("pointermove", 1, 470.5, 400.5);
    destroy();
    tell({ orbit: model.get("orbit"), dragging: model.get("dragging") });
    """
    assert on_the_canvas(tmp_path, trial) == {"orbit": [-30, 0], "dragging": False}
    trial = """
    held();
    model.save_changes = () => { throw new Error("closed"); };
    destroy();
    tell(model.listeners);
    """
    assert on_the_canvas(tmp_path, _HELD + trial) == 0


@pytest.mark.parametrize("dragging", [True, False])
def test_a_page_that_is_loaded_anew_holds_nothing(tmp_path: Path, dragging: bool) -> None:
    """The one before it could not say any more that it let go; a second view in the same page does not ask again."""
    trial = f"""
    model.set("dragging", {str(dragging).lower()});
    widget.initialize({{ model }});
    const told = model.saved;
    model.set("dragging", true);
    widget.render({{ model, el: page() }});
    tell([told, model.saved - told, model.get("dragging")]);
    """
    assert on_the_canvas(tmp_path, trial) == [int(dragging), 0, True]


@pytest.mark.parametrize("restart", [True, False])
def test_without_a_kernel_nothing_moves_and_that_is_told(tmp_path: Path, restart: bool) -> None:
    """The page says that the kernel restarts; else it shows when something is to be sent."""
    gone = "model.actions.comm_live_update.forEach((action) => action());" if restart else "el.of('acp-button')[0]"
    gone += "" if restart else ".listeners.click();"
    trial = f"""
    model.send = () => {{ throw new Error("Cannot send"); }};
    {gone}
    held();
    finger("pointermove", 1, 130.5, 100.5, handle);
    nextFrame();
    finger("pointerup", 1, 130.5, 100.5, handle);
    finger("pointerdown", 2, 50.5, 50.5);
    finger("pointerup", 2, 50.5, 50.5);
    tell([model.get("points")[0], model.saved, el.of("acp-status")[0].textContent]);
    """
    told = on_the_canvas(tmp_path, _HELD + trial)
    assert told == [[100, 100], 0, "no kernel answers: run the cell again"]


def test_a_click_with_an_unsteady_hand_turns_nothing(tmp_path: Path) -> None:
    trial = """
    model.set("orbits", true);
    finger("pointerdown", 1, 500.5, 400.5);
    finger("pointermove", 1, 501.5, 401.5);
    nextFrame();
    finger("pointerup", 1, 501.5, 401.5);
    tell({ orbit: model.get("orbit"), saved: model.saved, kinds: model.sent.map((message) => message.kind) });
    """
    assert on_the_canvas(tmp_path, trial) == {"orbit": [0, 0], "saved": 0, "kinds": ["click"]}


def test_points_stay_on_a_map(tmp_path: Path) -> None:
    trial = """
    const far = () => {
      held();
      finger("pointermove", 1, 2000.5, -3000.5, handle);
      nextFrame();
      finger("pointerup", 1, 2000.5, -3000.5, handle);
      return model.get("points")[0];
    };
    const picture = far();
    const axis = { label: "turn", unit: "°", low: -8, high: 8 };
    model.change("axes", [axis, axis]);
    model.change("points", [[100, 100], [300, 100], [300, 300], [100, 300]]);
    tell({ picture, map: far() });
    """
    assert on_the_canvas(tmp_path, _HELD + trial) == {"picture": [1280, -480], "map": [639.5, -0.5]}


def test_show_all_goes_back_to_the_view_that_was_first(tmp_path: Path) -> None:
    trial = """
    model.change("view", [40, 30, 64, 48]);
    const seen = [];
    for (let k = 0; k < 3; k++) buttons["show all"](), seen.push(view());
    buttons["zoom in"]();
    buttons["show all"]();
    seen.push(view());
    ground.listeners.dblclick();
    const clickable = view();
    model.set("clickable", false);
    ground.listeners.dblclick();
    tell({ seen, clickable, other: view() });
    """
    whole, part = [-0.5, -0.5, 640, 480], [40, 30, 64, 48]
    told = on_the_canvas(tmp_path, _HELD + trial)
    assert told == {"seen": [whole, part, whole, whole], "clickable": whole, "other": part}


def test_a_stage_is_never_too_low_to_be_hit(tmp_path: Path) -> None:
    trial = """
    const stage = el.of("acp-stage")[0];
    const usual = stage.style.aspectRatio;
    model.change("image_size", [4000, 60]);
    tell([usual, stage.style.aspectRatio]);
    """
    assert on_the_canvas(tmp_path, trial) == ["640 / 480", "4000 / 400"]
