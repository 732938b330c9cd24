"""Figures of one moment each."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from acp_lab.display.plots.motion import draw_step, draw_two_poses
from acp_lab.geometry.camera import Camera
from acp_lab.studies.true_edges import TrueEdges
from acp_lab.studies.two_poses import tilt_past_the_camera
from tests.made_parts import box, looking_at

CAMERA = Camera(320, 240, 400.0, 400.0, 159.5, 119.5)


def test_both_poses_are_drawn_up_to_the_moment() -> None:
    part = box()
    moments = tilt_past_the_camera(part, CAMERA, 300.0, [-30.0, 0.0, 30.0], noise_px=0.0)
    figure = Figure()
    draw_two_poses(figure, moments, 1, TrueEdges(part), CAMERA)
    left, right = figure.axes
    assert "right one" in left.get_title()
    assert len(left.collections) == 2
    lines = {line.get_label(): line for line in right.lines}
    assert len(lines["true"].get_xdata()) == 3
    assert len(lines["fits better"].get_xdata()) == len(lines["fits less"].get_xdata()) == 2
    figure.canvas.draw()


def test_a_step_shows_its_edges_and_the_errors_so_far() -> None:
    truth = TrueEdges(box())
    pose = looking_at(truth.part, np.array([1.0, 0.8, 0.9]), 300.0)
    figure = Figure()
    image = np.zeros((240, 320, 3), np.uint8)
    draw_step(figure, image, truth, CAMERA, [pose] * 4, [9.0, 4.0, 3.0, 1.0], [0, 0, 1], 2)
    left, right = figure.axes
    assert left.get_title() == "step 2, level 1"
    assert len(left.collections[0].get_segments()) == len(truth.at(pose, CAMERA))
    curve = next(line for line in right.lines if len(line.get_xdata()) == 3)
    np.testing.assert_allclose(curve.get_ydata(), [9.0, 4.0, 3.0])
    assert any(np.allclose(line.get_xdata(), 2.5) for line in right.lines), "where the second level begins"
    figure.canvas.draw()
