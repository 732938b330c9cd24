"""The explorer: its panels follow the points, and say what is rigid by construction."""

from __future__ import annotations

import numpy as np
import pytest

from acp_lab.display.widgets.manipulation_explorer import ManipulationExplorer
from acp_lab.display.widgets.picture import jpeg_bytes
from acp_lab.geometry.planar_pnp import solve_planar_pnp
from acp_lab.geometry.pose import rotation_angle_deg
from tests.display.scripted_hand import drag
from tests.prepared_sample import sample_model, sample_scene


@pytest.fixture
def explorer() -> ManipulationExplorer:
    scene = sample_scene()
    return ManipulationExplorer(sample_model(), scene.camera(0), scene.first_pose)


def test_panels_follow_while_the_picture_waits_for_the_release(explorer: ManipulationExplorer) -> None:
    assert list(explorer.panels) == ["homography", "thin-plate spline", "t(I) view templates"]
    assert "rigid by construction" in explorer.panels["t(I) view templates"].status
    assert "rigid" not in explorer.panels["homography"].status
    picture = explorer.editor.image
    target = explorer.editor.points[0] + (12.0, 9.0)
    explorer.editor.set_state({"points": [target.tolist(), *explorer.editor.points[1:].tolist()], "dragging": True})
    for panel in explorer.panels.values():
        np.testing.assert_allclose(panel.points, explorer.editor.points)
        assert "Chamfer" in panel.status
    assert explorer.editor.image == picture
    explorer.editor.set_state({"dragging": False})
    assert explorer.editor.image != picture


def test_the_picture_shows_the_pose_of_the_last_change(explorer: ManipulationExplorer) -> None:
    def shows_its_pose() -> bool:
        return bool(explorer.editor.image == jpeg_bytes(explorer._shaded()))

    editor = explorer.editor
    moved = [[x + 10.0 * (number == 0), y] for number, (x, y) in enumerate(editor.points.tolist())]
    editor.set_state({"points": moved, "dragging": False})  # an arrow key
    assert shows_its_pose()
    drag(editor, 2, editor.points[2] + (7.0, 12.0))
    assert shows_its_pose()
    editor.undo()
    assert shows_its_pose()
    editor.reset()
    assert shows_its_pose()


def test_rigid_motions_come_from_buttons(explorer: ManipulationExplorer) -> None:
    explorer.move_rigidly((0.0, 12.0, 0.0))
    study = explorer.study
    assert study is not None
    assert study.misfit_px < 1e-6
    found = {way.name: way.distance.symmetric for way in study.ways if way.distance is not None}
    assert found["homography"] > 1.0 > found["t(I) view templates"]
    drag(explorer.editor, 1, explorer.editor.points[1] + (15.0, -4.0))
    assert explorer.study is not None
    assert explorer.study.misfit_px > 0.5
    explorer.move_rigidly()
    assert explorer.study.misfit_px < 1e-6


def test_a_folded_quad_empties_the_panels_and_says_why(explorer: ManipulationExplorer) -> None:
    drag(explorer.editor, 0, explorer.editor.points[2] + (3.0, 30.0))
    assert explorer.study is None
    assert "folded" in explorer.panels["homography"].problem
    assert explorer.panels["homography"].overlays == ()
    explorer.editor.undo()
    assert explorer.panels["homography"].problem == ""


def test_green_is_called_what_it_is(explorer: ManipulationExplorer) -> None:
    """No image says where the part is: green is where PnP puts it."""
    labels = [str(layer) for canvas in (explorer.editor, *explorer.panels.values()) for layer in canvas.overlays]
    assert any("part at the pose of PnP" in label for label in labels)
    assert not any("truth" in label for label in labels)


def test_the_pose_does_not_flip_along_a_drag(explorer: ManipulationExplorer) -> None:
    """Of the two poses that fit, the one nearer to the last is kept, whichever reprojects better."""
    turned, fits_better = [], 0
    first, start = explorer.editor.points[0], explorer.study
    assert start is not None
    pose = start.cam_T_obj
    for share in np.linspace(0.0, 1.0, 15):
        points = explorer.editor.points.copy()
        points[0] = first + share * np.array([40.0, -25.0])
        explorer.editor.set_state({"points": points.tolist(), "dragging": True})
        assert explorer.study is not None
        now = explorer.study.cam_T_obj
        turned.append(rotation_angle_deg(pose[:3, :3], now[:3, :3]))
        best = solve_planar_pnp(explorer.bench.points_obj, points, explorer.bench.camera).poses[0]
        fits_better += rotation_angle_deg(best[:3, :3], now[:3, :3]) > 5.0
        pose = now
    assert max(turned) < 12.0
    assert fits_better > 0, "the drag must come by a place where the other pose fits better"
