"""A film: the browser asks for pictures and says where it is; here the kernel's answers."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from acp_lab.display.widgets.film_canvas import FilmCanvas, Picture
from acp_lab.display.widgets.overlay import Overlay
from acp_lab.errors import SequenceError
from tests.display.node_page import in_node


def picture_of(frame: int) -> Picture:
    if frame == 2:
        raise SequenceError("frame 2: torn")
    dots = Overlay("dots", np.full((frame + 1, 2), 7.0), (1.0, 0.0, 0.0), "dots")
    return Picture(bytes([frame]), (20, 10), f"frame {frame}", "", np.full((4, 2), frame), (dots,))


@pytest.fixture
def sent(monkeypatch: pytest.MonkeyPatch) -> list[tuple[dict[str, Any], list[bytes]]]:
    messages: list[tuple[dict[str, Any], list[bytes]]] = []
    monkeypatch.setattr(FilmCanvas, "send", lambda self, content, buffers=None: messages.append((content, buffers)))
    return messages


def test_pictures_are_sent_when_they_are_asked_for(sent: list[tuple[dict[str, Any], list[bytes]]]) -> None:
    film = FilmCanvas(picture_of, 5)
    assert sent == []
    assert (film.image, film.title, film.image_size) == (b"\0", "frame 0", (20, 10))
    film._hear(None, {"kind": "want", "frames": [1, 3], "edition": film.edition}, [])
    assert [content["frame"] for content, _ in sent] == [1, 3]
    content, (image, dots) = sent[1]
    assert image == b"\3"
    np.testing.assert_allclose(np.frombuffer(dots, np.float32), np.full(8, 7.0))
    assert content["points"] == [[3.0, 3.0]] * 4
    assert content["overlays"][0]["label"] == "dots"


def test_what_was_asked_for_before_everything_changed_is_not_sent(
    sent: list[tuple[dict[str, Any], list[bytes]]],
) -> None:
    film = FilmCanvas(picture_of, 5)
    before = film.edition
    film.renew()
    film._hear(None, {"kind": "want", "frames": [1], "edition": before}, [])
    assert sent == []


def test_a_picture_that_cannot_be_made_says_why(sent: list[tuple[dict[str, Any], list[bytes]]]) -> None:
    film = FilmCanvas(picture_of, 5)
    film._hear(None, {"kind": "want", "frames": [2], "edition": film.edition}, [])
    ((content, buffers),) = sent
    assert content["status"] == "frame 2: torn"
    assert content["image_size"] == (20, 10), "the stage keeps its shape"
    assert buffers == [b""]


def test_a_fault_in_one_picture_is_raised_after_the_others_were_sent(
    sent: list[tuple[dict[str, Any], list[bytes]]],
) -> None:
    def faulty(frame: int) -> Picture:
        if frame == 2:
            raise ZeroDivisionError("a fault")
        return picture_of(frame)

    film = FilmCanvas(faulty, 5)
    with pytest.raises(ZeroDivisionError, match="a fault"):
        film._hear(None, {"kind": "want", "frames": [1, 2, 3], "edition": film.edition}, [])
    assert [content["frame"] for content, _ in sent] == [1, 2, 3]
    assert "a fault" in sent[1][0]["status"]


def test_the_kernel_moves_the_film_and_only_hears_where_the_hand_moved_it() -> None:
    film = FilmCanvas(picture_of, 5)
    times, _ = film.seek
    film.frame = 4
    assert film.seek == (times + 1, 4)
    film._hear(None, {"kind": "at", "frame": 1}, [])
    assert film.frame == 1
    assert film.seek == (times + 1, 4), "a film that plays is not thrown back to where it was"
    film.frame = 99
    assert film.frame == 4


def test_a_view_that_is_made_anew_begins_where_the_film_is() -> None:
    film = FilmCanvas(picture_of, 5)
    assert film.get_state()["place"] == 0
    film._hear(None, {"kind": "at", "frame": 3}, [])
    assert film.get_state()["place"] == 3
    film.frame = 1
    assert film.get_state()["place"] == 1
    film.frame = 4
    film.renew(3)
    assert film.get_state()["place"] == 2


_FILM = """
const state = {
  image: new DataView(new ArrayBuffer(0)), image_size: [20, 10], overlays: [], points: [], labels: [], active: -1,
  closed: false, editable: false, problem: "", title: "", status: "", view: [], axes: [], height_px: 300,
  count: 5, interval_ms: 40, repeat: false, seek: [1, 0], place: 0, leader: "", edition: 1, clickable: false,
};
const wait = async (isTrue) => { while (!isTrue()) await new Promise((done) => setTimeout(done, 5)); };
const picture = (frame) => [
  { kind: "picture", frame, edition: 1, title: `frame ${frame}`, status: "", points: [], view: [], overlays: [] },
  [new DataView(new ArrayBuffer(0))],
];
const pictures = (model, ...frames) => frames.forEach(
  (frame) => model.actions["msg:custom"].forEach((hear) => hear(...picture(frame))),
);
const shown = (el) => {
  const buttons = el.of("acp-button");
  const [bar] = el.of("acp-film");
  const slide = (value) => {
    const slider = bar.of("acp-slider")[0];
    slider.value = value;
    slider.listeners.input();
  };
  return {
    press: (name) => buttons.find((node) => node.title === name).listeners.click(),
    slide,
    count: () => bar.of("acp-place")[0].textContent,
    title: () => el.of("acp-title")[0].textContent,
    status: () => el.of("acp-status")[0].textContent,
    plays: () => buttons.some((node) => node.title === "pause"),
  };
};
"""


def test_a_second_view_asks_for_the_pictures_from_its_place_on(tmp_path: Path) -> None:
    trial = """
    const model = new Model({ ...state, place: 3 });
    const el = page();
    const destroy = widget.render({ model, el });
    const [{ frames }] = model.sent;
    destroy();
    tell({ frames, told: model.sent.slice(1), listeners: model.listeners });
    """
    told = in_node(tmp_path, FilmCanvas._esm, _FILM + trial)
    assert told["frames"][0] == 3
    assert told["told"] == []
    assert told["listeners"] == 0


def test_the_kernel_passes_on_which_view_moved_the_film() -> None:
    film = FilmCanvas(picture_of, 5)
    seek = film.seek

    def tell(view: str, frame: int, by_hand: bool) -> tuple[str, int]:
        film._hear(None, {"kind": "at", "frame": frame, "view": view, "by_hand": by_hand}, [])
        return film.leader, film.place

    assert tell("left", 1, by_hand=True) == ("left", 1)
    assert tell("left", 2, by_hand=False) == ("left", 2), "it plays"
    assert tell("right", 4, by_hand=True) == ("right", 4)
    assert tell("left", 3, by_hand=False) == ("right", 4), "it plays, and has not heard of the other hand yet"
    assert film.seek == seek
    film.frame = 0
    assert tell("right", 1, by_hand=False) == ("right", 1), "a film goes on playing where the kernel put it"


def test_of_two_views_the_one_follows_the_hand_on_the_other(tmp_path: Path) -> None:
    trial = """
    const model = new Model({ ...state, count: 200, interval_ms: 5 });
    const [left, right] = [page(), page()];
    widget.render({ model, el: left });
    widget.render({ model, el: right });
    const [a, b] = [shown(left), shown(right)];
    const at = () => model.sent.filter(({ kind }) => kind === "at");
    const passOn = ({ frame, view }) => {
      model.set("leader", view), model.set("place", frame);
      for (const name of ["leader", "place"]) model.actions[`change:${name}`].forEach((action) => action());
    };
    for (let frame = 0; frame < 200; frame++) pictures(model, frame);
    a.press("play");
    await wait(() => at().length > 1); // it tells without being asked
    const [begin, later] = at();
    passOn(begin);
    passOn(later);
    const first = { plays: a.plays(), with: b.count() === `${later.frame + 1} / 200` };
    b.slide(150);
    passOn({ ...later, frame: later.frame + 1 }); // the hand on the second view is not thrown back
    const held = b.count();
    await wait(() => at().some(({ view }) => view !== begin.view));
    const hand = at().find(({ view }) => view !== begin.view);
    passOn(hand);
    const second = [a.plays(), a.count(), b.count()];
    const told = at().length;
    // Two hands at a time, and the kernel heard that of the first view last.
    passOn({ ...begin, frame: 7 });
    await new Promise((done) => setTimeout(done, 150));
    const hands = [begin, later, hand].map(({ by_hand }) => by_hand);
    tell({ first, held, second, both: [a.count(), b.count()], hands, echoes: at().length - told });
    """
    told = in_node(tmp_path, FilmCanvas._esm, _FILM + trial)
    assert told["first"] == {"plays": True, "with": True}
    assert told["held"] == "151 / 200"
    assert told["second"] == [False, "151 / 200", "151 / 200"]
    assert told["both"] == ["8 / 200", "8 / 200"]
    assert told["hands"] == [True, False, True]
    assert told["echoes"] == 0, "who follows tells nothing"


def test_a_film_without_a_kernel_shows_what_it_has_and_says_so(tmp_path: Path) -> None:
    trial = """
    const model = new Model({ ...state });
    const el = page();
    widget.render({ model, el });
    const film = shown(el);
    pictures(model, 0, 1, 2);
    model.send = () => { throw new Error("Cannot send"); };
    film.press("play");
    await wait(() => !film.plays());
    nextFrame();
    const end = [film.count(), film.title(), film.status()];
    film.slide(1);
    nextFrame();
    const back = [film.count(), film.title()];
    film.slide(4);
    nextFrame();
    tell({ end, back, missing: [film.count(), film.title()] });
    """
    told = in_node(tmp_path, FilmCanvas._esm, _FILM + trial)
    assert told["end"] == ["3 / 5", "frame 2", "no kernel answers: run the cell again"]
    assert told["back"] == ["2 / 5", "frame 1"]
    assert told["missing"] == ["5 / 5 …", "frame 1"]


def test_the_count_says_when_its_picture_is_not_there_yet(tmp_path: Path) -> None:
    trial = """
    const model = new Model({ ...state });
    const el = page();
    widget.render({ model, el });
    const film = shown(el);
    pictures(model, 0);
    const counts = [film.count()];
    film.slide(3);
    counts.push(film.count());
    pictures(model, 3);
    counts.push(film.count());
    model.change("edition", 2);
    counts.push(film.count());
    tell(counts);
    """
    told = in_node(tmp_path, FilmCanvas._esm, _FILM + trial)
    assert told == ["1 / 5", "4 / 5 …", "4 / 5", "4 / 5 …"]


def test_pictures_of_a_new_edition_are_asked_for_once(tmp_path: Path) -> None:
    """The kernel tells of edition and seek in one message, the page hears of them one after the other."""
    trial = """
    const heard = [["seek", "edition"], ["edition", "seek"]].map((order) => {
      const model = new Model({ ...state, count: 12 });
      widget.render({ model, el: page() });
      for (let frame = 0; frame < 12; frame++) pictures(model, frame);
      model.sent.length = 0;
      model.set("count", 20), model.set("seek", [2, 0]), model.set("edition", 2);
      for (const name of order) model.actions[`change:${name}`].forEach((action) => action());
      return model.sent.filter(({ kind }) => kind === "want").flatMap(({ frames }) => frames);
    });
    tell(heard);
    """
    first = list(range(8))
    assert in_node(tmp_path, FilmCanvas._esm, _FILM + trial) == [first, first]
