"""Notebook 10: your own part and your own video."""

from __future__ import annotations

from typing import Any

from acp_lab.course.answers import Hint, as_array, near
from acp_lab.course.grader import exercise
from acp_lab.course.workshop import sample_scene

_FOCAL, _CENTRE_PX = 1e-3, 0.1


@exercise("10.1")
def half_the_pixels(answer: Any) -> str:
    """(fx, fy, cx, cy) of the sample's camera when it records with half the pixels each way."""
    fx, fy, cx, cy = as_array(answer, (4,), "four numbers, fx, fy, cx, cy").tolist()
    camera = sample_scene().camera(0)
    for name, given, full in (("fx", fx, camera.fx), ("fy", fy, camera.fy)):
        if near(given, full, _FOCAL):
            raise Hint(f"{name} is that of the full size. It counts pixels, and these became larger.")
        if near(given, 2.0 * full, _FOCAL):
            raise Hint(f"{name}: the pixels became larger, so there are fewer of them to a focal length.")
        if not near(given, 0.5 * full, _FOCAL):
            raise Hint(f"{name}: the lens is the same; how many of the new, wider pixels make up its focal length?")
    for name, given, full in (("cx", cx, camera.cx), ("cy", cy, camera.cy)):
        if abs(given - full) < _CENTRE_PX:
            raise Hint(f"{name} is that of the full size: where in the smaller picture does the optical axis arrive?")
        if abs(given - 0.5 * full) < _CENTRE_PX:
            raise Hint(
                f"{name}: nearly. Pixel 0 is at its *centre* here. Where is the left border of the picture, in full "
                "and in half size, and how far from that border is the optical axis?"
            )
        if abs(given - (0.5 * (full + 0.5) - 0.5)) > _CENTRE_PX:
            raise Hint(f"{name}: measure from the picture's border, half a pixel before the centre of pixel 0.")
    return (
        "The distortion stays as it is, since it belongs to the lens. The quarter of a pixel is nothing you "
        "would see; a wrong focal length you would, in every depth."
    )
