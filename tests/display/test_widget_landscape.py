"""The landscape widget: its map belongs to its controls, and the way starts where the hand lets go."""

from __future__ import annotations

import numpy as np
import pytest

from acp_lab.display.widgets.loss_landscape import BCE, LossLandscape, map_picture, range_in_words
from acp_lab.display.widgets.point_canvas import Axis
from acp_lab.sequences.frame import Frame
from tests.display.scripted_hand import drag
from tests.prepared_sample import sample_model, sample_scene


@pytest.fixture(scope="module")
def widget() -> LossLandscape:
    frame = sample_scene().frame(0)
    assert isinstance(frame, Frame)
    return LossLandscape(sample_model(), frame, sample_scene().first_pose)


def test_the_way_starts_where_the_point_was_let_go(widget: LossLandscape) -> None:
    before = widget.descent
    drag(widget.map, 0, np.array([100.0, 250.0]))
    assert widget.descent is not None
    assert widget.descent is not before
    np.testing.assert_allclose(widget.descent.offsets[0], widget.start_offsets)
    u, v = widget.map.axes
    np.testing.assert_allclose(widget.start_offsets[:2], [u.value(100.0, 360), v.value(250.0, 360)])


def test_a_value_is_drawn_where_the_axes_have_it(widget: LossLandscape) -> None:
    count = 33
    offsets = np.linspace(-8.0, 8.0, count)
    axis = Axis("turn", "°", -8.0, 8.0)
    for number in (3, 16, 28):
        ridge = np.zeros((count, count))
        ridge[:, number] = 1.0
        bright = map_picture(ridge)[0].astype(int).sum(2)
        columns = np.flatnonzero(bright[180] > 0.9 * bright.max())
        assert columns.mean() == pytest.approx(axis.place(offsets[number], 360), abs=1.0)
        np.testing.assert_array_equal(map_picture(ridge.T)[0], map_picture(ridge)[0].transpose(1, 0, 2))
    # The cuts go through the value nearest to the start, also near the rim.
    for number in (3, 28):
        u, v = widget.map.axes
        offset = u.low + number / (count - 1) * (u.high - u.low)
        widget.map.points = [[u.place(offset, 360) - 4.5, v.place(0.0, 360) + 4.5]]
        assert [cut.cursor for cut in widget.cuts] == [number, 16]


def test_coordinates_that_are_the_same_are_swapped(widget: LossLandscape) -> None:
    """On a map of one variable across and down, map and descent disagreed."""
    u, v = widget.u.value, widget.v.value
    widget.v.value = u
    assert (widget.u.value, widget.v.value) == (v, u)
    assert widget._slice is not None
    assert (widget._slice.u, widget._slice.v) == (v, u)
    widget.u.value = u
    assert (widget.u.value, widget.v.value) == (u, v)
    x, y = widget.map.points[0]
    across, down = widget.map.axes
    np.testing.assert_allclose(widget.start_offsets[:2], [across.value(x, 360), down.value(y, 360)])


def test_form_and_alpha_change_the_map_without_asking_the_frame_again(widget: LossLandscape) -> None:
    before, picture = widget._slice, widget.map.image
    widget.alpha.value = 4.0
    assert widget._slice is before
    assert widget.map.image != picture


def test_pose_and_images(widget: LossLandscape) -> None:
    widget.reach.value = 0.5
    widget.space.value = "pose"
    assert [axis.unit for axis in widget.map.axes] == ["°", "°"]
    assert widget.start_offsets.shape == (6,)
    assert np.abs(widget.start_offsets).max() < np.radians(5.0)
    widget.form.value = BCE
    assert widget.descent is None
    of_the_descent = (widget.alpha, widget.anneal, widget.solver)
    assert all(control.disabled for control in of_the_descent)
    widget.form.value = "printed"
    assert not any(control.disabled for control in of_the_descent)


@pytest.mark.parametrize(
    ("low", "high", "told"),
    [
        (0.99912, 1.00034, "from 0.99912 (dark) to 1.00034 (bright)"),
        (0.1234, 12.3456, "from 0.123 (dark) to 12.3 (bright)"),
        (1234.5, 1236.5, "from 1234.5 (dark) to 1236.5 (bright)"),
        (-2.0, 2.0, "from -2 (dark) to 2 (bright)"),
        (1.0, 1.0, "from 1 (dark) to 1 (bright)"),
    ],
)
def test_the_ends_of_a_range_can_be_told_apart(low: float, high: float, told: str) -> None:
    assert range_in_words(low, high) == told


def test_the_map_says_what_its_colours_leave_out(widget: LossLandscape) -> None:
    assert widget.map.status.startswith("from ")
    assert "2% cut off at each end" in widget.map.status


def test_a_map_with_a_pole_still_shows_the_rest() -> None:
    values = np.add.outer(np.arange(33.0), np.arange(33.0))
    values[5, 5], values[6, 6], values[7, 7] = 1e9, -1e9, np.nan
    picture, low, high = map_picture(values)
    assert picture.shape == (360, 360, 3)
    assert -1.0 < low < high < 70.0
    assert len(np.unique(picture.reshape(-1, 3), axis=0)) > 15
    assert map_picture(np.full((33, 33), np.nan))[0].shape == (360, 360, 3)
