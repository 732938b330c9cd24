"""What the notebooks draw: that the right things land at the right places of the axes."""

from __future__ import annotations

from collections.abc import Iterator

import matplotlib as mpl
import numpy as np
import pytest

from acp_lab.display import look
from acp_lab.display.accuracy_plots import LARGEST_SHOWN_PERCENT, draw_errors, draw_recall, draw_table
from acp_lab.display.mesh_lines import MeshLines, draw_projected
from acp_lab.display.pictures import cut_to, draw_dots, draw_edges, draw_quad, panels, show_image
from acp_lab.display.scene_3d import (
    draw_camera,
    draw_lines,
    draw_on_image_plane,
    draw_plane_points,
    draw_rays,
    draw_samples,
    same_scale,
    space,
)
from acp_lab.display.search_plots import draw_finding, draw_profile, profile
from acp_lab.errors import GeometryError
from acp_lab.evaluation.edge_finding import RULES, FindingStudy
from acp_lab.evaluation.metrics import FrameErrors
from acp_lab.evaluation.paper_tables import MethodRow, Table
from acp_lab.evaluation.true_edges import TrueEdges
from acp_lab.geometry.camera import Camera
from acp_lab.tracking.image_edges import image_patch
from tests.made_parts import box, looking_at

CAMERA = Camera(200, 160, 320.0, 320.0, 99.5, 79.5)


@pytest.fixture(autouse=True)
def no_window() -> Iterator[None]:
    """Draw without a display, and leave no figure behind."""
    before = mpl.get_backend()
    mpl.use("agg")
    import matplotlib.pyplot as plt

    yield
    plt.close("all")
    mpl.use(before)


def lines_of(axes):  # type: ignore[no-untyped-def]
    return [np.column_stack(line.get_data()) for line in axes.lines]


def test_the_look_is_white_and_its_meanings_differ() -> None:
    with mpl.rc_context():
        look.use_look()
        assert mpl.rcParams["savefig.facecolor"] == "white"
        assert mpl.rcParams["figure.constrained_layout.use"]
    meanings = (look.TRUTH, look.GENERATED, look.IMAGE, look.POINTS, look.START, look.WRONG, look.UNKNOWN)
    assert len(set(meanings)) == len(meanings)
    assert look.css_colour("right") == "#009e73"


def test_panels_and_images_are_cut_to_what_matters() -> None:
    first, second, third, fourth = panels(2, 2, titles=("one", "two"))
    assert (first.get_title(), second.get_title(), third.get_title()) == ("one", "two", "")
    points = [[50.0, 40.0], [np.nan, 1.0], [90.0, 60.0]]
    show_image(first, np.zeros((160, 200, 3), np.uint8), around=points, margin_px=5)
    assert first.get_xlim() == (45.0, 95.0)
    assert first.get_ylim() == (65.0, 35.0)
    show_image(fourth, np.zeros((160, 200)))
    assert fourth.get_xlim() == (-0.5, 199.5)
    with pytest.raises(GeometryError, match="at least one that is finite"):
        cut_to(first, [[np.nan, 1.0]])


def test_edges_dots_and_quads_are_where_they_belong() -> None:
    (axes,) = panels(1)
    truth = TrueEdges(box((30.0, 30.0, 30.0)))
    edges = truth.at(looking_at(truth.part, np.array([1.0, 0.7, 0.8]), 300.0), CAMERA)
    draw_edges(axes, edges, look.TRUTH, "edges")
    (strokes,) = axes.collections
    segments = np.array(strokes.get_segments())
    np.testing.assert_allclose(segments.mean(1), edges.points, atol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(segments[:, 1] - segments[:, 0], axis=1), 3.0)
    draw_dots(axes, [[1.0, 2.0]], look.IMAGE)
    quad = np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 10.0], [0.0, 10.0]])
    draw_quad(axes, quad)
    dots, ring = lines_of(axes)
    np.testing.assert_array_equal(dots, [[1.0, 2.0]])
    np.testing.assert_array_equal(ring, [*quad, quad[0]])
    assert [text.get_text() for text in axes.texts] == ["1", "2", "3", "4"]


def test_the_camera_pyramid_has_the_image_as_its_base() -> None:
    axes = space()
    part = box()
    pose = looking_at(part, np.array([1.0, 0.5, 0.7]), 300.0)
    corners = draw_camera(axes, CAMERA, pose, image_depth_mm=100.0)
    eye, base = corners[0], corners[1:]
    np.testing.assert_allclose(np.linalg.norm(eye - part.box_centre), 300.0)
    axis = (part.box_centre - eye) / 300.0
    np.testing.assert_allclose((base - eye) @ axis, 100.0, atol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(base[1] - base[0]), 100.0 * 200 / 320.0)
    middle = np.array([[99.5, 79.5]])
    draw_on_image_plane(axes, CAMERA, pose, middle, 100.0, look.IMAGE)
    np.testing.assert_allclose(np.ravel(axes.lines[-1].get_data_3d()), eye + 100.0 * axis, atol=1e-9)
    truth = TrueEdges(part)
    draw_samples(axes, truth.edges, np.arange(5))
    draw_plane_points(axes, part.vertices[:4])
    draw_rays(axes, pose, part.vertices[:4])
    draw_lines(axes, np.stack([part.vertices[:2], part.vertices[2:4]], 1), look.TRUTH)
    same_scale(axes, np.vstack([corners, part.vertices]))
    extent = np.array([axes.get_xlim(), axes.get_ylim(), axes.get_zlim()])
    assert (extent[:, 0] < corners.min(0)).all()
    assert (extent[:, 1] > corners.max(0)).all()


def test_mesh_lines_of_a_box() -> None:
    lines = MeshLines.of(box())
    assert len(lines.sharper_than(45.0)) == 12
    assert len(lines.sharper_than(-1.0)) == 18, "with one diagonal per side"
    (axes,) = panels(1)
    pose = looking_at(box(), np.array([1.0, 0.7, 0.8]), 300.0)
    draw_projected(axes, lines.sharper_than(45.0), CAMERA, pose)
    (drawn,) = axes.collections
    assert len(drawn.get_segments()) == 12


def test_a_profile_reads_the_image_along_the_normal() -> None:
    image = np.full((60, 80, 3), 50, np.uint8)
    image[:, 40:] = 150
    patch = image_patch(image, (10, 5, 80, 60), 1.0)
    steps = np.array([-10.0, -0.5, 9.0])
    grey, gradient = profile(patch, np.array([40.0, 30.0]), np.array([1.0, 0.0]), steps)
    np.testing.assert_allclose(grey, [50.0, 100.0, 150.0], atol=1.5)
    assert np.argmax(gradient) == 1
    (axes,) = panels(1)
    draw_profile(axes, patch, np.array([42.0, 30.0]), np.array([1.0, 0.0]), 8, way_px=-2.5)
    labels = axes.get_legend_handles_labels()[1]
    assert labels == ["grey level", "10 x gradient [levels/px]", "candidates", "generated edge point", "its true place"]
    (candidate,) = [line for line in axes.lines if line.get_label() == "candidates"]
    assert candidate.get_xdata()[0] == pytest.approx(-2.5, abs=0.1)


def test_shares_of_the_rules_as_bars() -> None:
    (axes,) = panels(1)
    shares = (0.1, 0.2, 0.3, 0.4, 0.5)
    draw_finding(axes, {"a": FindingStudy(RULES, shares, 3.0, 2), "b": FindingStudy(RULES, shares, 4.0, 2)})
    assert [bar.get_width() for bar in axes.patches] == [*shares, *shares]
    assert [text.get_text() for text in axes.get_yticklabels()] == list(RULES)


def errors(*percent: float) -> FrameErrors:
    values = np.array(percent) / 100.0
    return FrameErrors(tuple(range(len(values))), values, values, values, values)


def test_errors_and_recall() -> None:
    left, right = panels(2)
    runs = {"good": errors(1.0, 1.0, 3.0, 4.0), "bad": errors(1.0, 50.0, np.inf, 300.0)}
    draw_errors(left, runs)
    good, bad = lines_of(left)[:2]
    np.testing.assert_allclose(good[:, 1], [1.0, 1.0, 3.0, 4.0])
    np.testing.assert_allclose(bad[:, 1], [1.0, 50.0, LARGEST_SHOWN_PERCENT, LARGEST_SHOWN_PERCENT])
    draw_recall(right, runs)
    limits, share = lines_of(right)[0].T
    assert share[limits == 2.0] == 0.5
    assert share[limits > 4.0].min() == 1.0
    assert share[0] == 0.0
    # One minus the mean error over the limit: (9 + 9 + 7 + 6) / 40.
    area = float(right.get_legend_handles_labels()[1][0].removeprefix("good: AUC "))
    assert area == pytest.approx(31.0 / 40.0, abs=0.006)


def test_tables_as_dots() -> None:
    (axes,) = panels(1)
    draw_table(axes, Table("made", ("a", "b"), (MethodRow("x", (0.2, 0.4), (0.5, 0.7)),)), "a title")
    bar, near, far = lines_of(axes)[:3]
    np.testing.assert_allclose(bar[:, 0], [0.3, 0.6])
    np.testing.assert_allclose([near[0, 0], far[0, 0]], [0.3, 0.6])
    assert axes.get_title() == "a title"
