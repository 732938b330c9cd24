"""Four control points: what makes them a quad, and what is said when they are none."""

from __future__ import annotations

import numpy as np
import pytest
import traitlets

from acp_lab.display.widgets.control_point_editor import ControlPointEditor, quad_problem
from tests.display.scripted_hand import drag

QUAD = np.array([[20.0, 20.0], [80.0, 22.0], [78.0, 60.0], [22.0, 64.0]])


def editor() -> ControlPointEditor:
    return ControlPointEditor(np.full((80, 100, 3), 120, np.uint8), QUAD)


def test_a_good_quad_is_closed_and_can_be_edited() -> None:
    made = editor()
    assert made.is_good
    assert made.closed
    assert made.editable
    np.testing.assert_array_equal(made.points, QUAD)


def test_other_numbers_of_points_are_refused() -> None:
    with pytest.raises(traitlets.TraitError, match="give four rows"):
        editor().points = QUAD[:3]
    with pytest.raises(traitlets.TraitError, match="give four rows"):
        ControlPointEditor(None, QUAD[:2])


def test_three_points_in_line_are_named_as_they_are_labelled() -> None:
    """check_quad counts rows from 0; on the screen points are counted from 1."""
    made = editor()
    drag(made, 2, 0.5 * (QUAD[1] + QUAD[3]))
    assert "points 2, 3, 4 are collinear" in made.problem
    assert not made.is_good
    made.undo()
    assert made.problem == ""


def test_a_folded_and_a_tiny_quad() -> None:
    assert "folded" in quad_problem(QUAD[[0, 2, 1, 3]])
    assert "tiny" in quad_problem(0.01 * QUAD)
    assert quad_problem(QUAD) == ""
    assert quad_problem(QUAD[::-1]) == ""  # either direction around


@pytest.mark.parametrize("shape", [(1024, 1224, 3), (900, 60), (0, 0)])
def test_any_image_will_do(shape: tuple[int, ...]) -> None:
    made = ControlPointEditor(np.full(shape, 50, np.uint8), QUAD)
    drag(made, 0, np.array([25.0, 26.0]))
    np.testing.assert_allclose(made.settled[0], [25.0, 26.0])
