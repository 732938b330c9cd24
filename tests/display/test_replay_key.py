"""Ctrl-C while an image is handed to the thread that encodes it: the replay is closed all the same."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
import pytest

from acp_lab.display.replay.clock import Moment
from acp_lab.display.replay.images import MOST_WAITING, ImageWriter
from tests.key_presses import ends_within, pressed_at

MOST_MOMENTS = 400


class Nowhere:
    """A recording that keeps nothing."""

    def send_columns(self, *_: object) -> None:
        pass


def put(writer: ImageWriter) -> None:
    writer.put(Moment(0, 0, 0.0), "/camera/image", np.zeros((4, 4, 3), np.uint8))


def busy(writer: ImageWriter) -> None:
    for _ in range(MOST_WAITING // 2):
        put(writer)


def idle(writer: ImageWriter) -> None:
    writer.flush()
    time.sleep(0.002)  # it waits for the next image by now


@pytest.mark.parametrize("before", [busy, idle])
@pytest.mark.parametrize("call", [put, ImageWriter.flush, ImageWriter.close])
def test_a_key_at_any_moment_leaves_nobody_waiting(
    before: Callable[[ImageWriter], None], call: Callable[[ImageWriter], None]
) -> None:
    for number in range(MOST_MOMENTS):
        writer = ImageWriter(Nowhere())  # type: ignore[arg-type]
        before(writer)
        was_pressed = pressed_at(number, lambda writer=writer: call(writer))  # type: ignore[misc]
        assert ends_within(10.0, writer.close), f"nobody was told, after a key at moment {number}"
        if not was_pressed:
            break
    assert 3 < number < MOST_MOMENTS - 1
