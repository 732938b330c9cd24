"""Moving pictures: as many moments as were drawn, in a page of their own."""

from __future__ import annotations

import io

import pytest
from matplotlib.figure import Figure
from PIL import Image

from acp_lab.display.film import film
from acp_lab.errors import ParameterError


def test_a_film_has_a_picture_per_moment_and_no_ground() -> None:
    drawn = []

    def draw(figure: Figure, number: int) -> None:
        drawn.append(number)
        figure.subplots().bar([number], [1.0])

    made = film(draw, 4, width_in=2.0, height_in=1.5)
    assert drawn == [0, 1, 2, 3]
    picture = Image.open(io.BytesIO(made.webp))
    assert (picture.format, picture.n_frames) == ("WEBP", 4)
    assert picture.size == made.size
    assert picture.convert("RGBA").getpixel((0, 0))[3] == 0
    assert "data:image/webp;base64," in made._repr_html_()
    assert f'width="{made.size[0]}"' in made._repr_html_()


def test_a_film_has_moments_and_a_speed() -> None:
    def draw(figure: Figure, number: int) -> None:
        raise AssertionError("nothing is drawn")

    with pytest.raises(ParameterError, match="count = 0: a film has one moment or more"):
        film(draw, 0)
    for speed in (0.0, -1.0, float("nan"), float("inf")):
        with pytest.raises(ParameterError, match=f"moments_per_s = {speed}: give a number above 0"):
            film(draw, 2, moments_per_s=speed)
