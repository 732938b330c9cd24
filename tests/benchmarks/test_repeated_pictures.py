"""Which pictures a video of the benchmark shows, and that one comes back whole."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.repeated_pictures import compressed, order_of


@pytest.mark.parametrize("name", ["twice", "twice, compressed"])
def test_every_picture_comes_twice(name: str) -> None:
    assert order_of(name, 3, np.random.default_rng(0)) == [0, 0, 1, 1, 2, 2]


def test_some_pictures_are_held() -> None:
    assert order_of("once", 4, np.random.default_rng(0)) == [0, 1, 2, 3]
    order = order_of("held", 400, np.random.default_rng(0))
    assert len(order) == 400
    assert order[:2] == [0, 1]
    held = [k for k in range(2, 400) if order[k] == order[k - 1]]
    assert 80 < len(held) < 160
    assert all(order[k] == k for k in range(400) if k not in held)


def test_a_video_comes_back_nearly_as_it_was() -> None:
    ramp = np.broadcast_to(np.arange(0, 160, 1, np.uint8)[None, :, None], (120, 160, 3))
    images = [np.ascontiguousarray(np.roll(ramp, 3 * (k // 2), axis=0) + 20) for k in range(6)]
    back = compressed(images)
    assert len(back) == 6
    assert max(float(np.abs(a.astype(float) - b).mean()) for a, b in zip(images, back, strict=True)) < 6.0
