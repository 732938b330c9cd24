"""The explorer: its panels follow the points, and say what is rigid by construction."""

from __future__ import annotations

import numpy as np
import pytest

from acp_lab.display.widgets.manipulation_explorer import ManipulationExplorer
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
