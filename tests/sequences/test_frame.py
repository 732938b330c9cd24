"""What a frame may hold."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from acp_lab.errors import SequenceError
from acp_lab.geometry.camera import Camera, Undistorter
from acp_lab.sequences.frame import Frame

CAMERA = Camera(16, 12, 20.0, 20.0, 7.5, 5.5)
RGB = np.zeros((12, 16, 3), np.uint8)


@pytest.mark.parametrize(
    ("image", "told"),
    [
        (RGB[..., 0], r"uint8 \(12, 16\): .*np\.dstack\(\[grey\] \* 3\)"),
        (np.dstack([RGB, RGB[..., :1]]), r"uint8 \(12, 16, 4\)"),
        (RGB.astype(float), r"float64 \(12, 16, 3\)"),
        (RGB.astype(np.uint16), r"uint16 \(12, 16, 3\)"),
        (RGB.tolist(), "list: "),
        (None, "NoneType: "),
        (RGB[:5], "16 x 5 px but its camera 16 x 12"),
        (RGB[:0], "16 x 0 px but its camera 16 x 12"),
        (RGB.swapaxes(0, 1), "12 x 16 px but its camera 16 x 12"),
    ],
)
def test_an_image_that_is_none_is_refused_with_what_it_should_be(image: Any, told: str) -> None:
    with pytest.raises(SequenceError, match=rf"^frame 7: its image is {told}") as caught:
        Frame(7, image, CAMERA)
    assert "\n" not in str(caught.value)


def test_any_memory_layout_will_do() -> None:
    for image in (RGB, RGB[:, ::-1], RGB[..., ::-1], np.asfortranarray(RGB)):
        assert Frame(0, image, CAMERA).image is image


def test_a_camera_with_lens_distortion_is_refused(distorted_camera: Camera) -> None:
    """Everything behind takes its camera for a pinhole: poses would be wrong without a word."""
    image = np.zeros((distorted_camera.height, distorted_camera.width, 3), np.uint8)
    with pytest.raises(SequenceError, match=r"^frame 7: its camera has lens distortion: .*camera\.pinhole\(\)"):
        Frame(7, image, distorted_camera)
    assert Frame(7, Undistorter(distorted_camera)(image), distorted_camera.pinhole()).index == 7
