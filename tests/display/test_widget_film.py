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


def test_a_second_view_asks_for_the_pictures_from_its_place_on(tmp_path: Path) -> None:
    trial = """
    const state = {
      image: new DataView(new ArrayBuffer(0)), image_size: [20, 10], overlays: [], points: [], labels: [], active: -1,
      closed: false, editable: false, problem: "", title: "", status: "", view: [], axes: [], height_px: 300,
      count: 5, interval_ms: 40, repeat: false, seek: [1, 0], place: 3, edition: 1,
    };
    const model = new Model(state);
    const el = page();
    const destroy = widget.render({ model, el });
    const [{ frames }] = model.sent;
    destroy();
    tell({ frames, told: model.sent.slice(1), listeners: model.listeners });
    """
    told = in_node(tmp_path, FilmCanvas._esm, trial)
    assert told["frames"][0] == 3
    assert told["told"] == []
    assert told["listeners"] == 0
