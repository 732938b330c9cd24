"""What a generator is shown: the same camera every time in a frame at the pose, a jittered one at a prediction."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from acp_lab.cad.part import Part
from acp_lab.cad.raycast import RayCaster
from acp_lab.control_points.coplanar_points import mid_section_points
from acp_lab.control_points.view_regions import ALL_REGIONS
from acp_lab.generator.painted.edge_images import EdgeImageConfig, PaintingFrame, draw_views, make_edge_views
from acp_lab.generator.painted.training_set import Jittered, TrainingSet

REGION = ALL_REGIONS[4]
CONFIG = EdgeImageConfig(size=64, views=6, held_out=2)


def training_set(part: Part, caster: RayCaster, frame: PaintingFrame) -> TrainingSet:
    w_obj = mid_section_points(part.box_min, part.box_max, REGION.axis)
    config = replace(CONFIG, frame=frame)
    return TrainingSet(part, caster, REGION, {"regressed": w_obj, "mid-section": w_obj + 1.0}, config, 4, 0)


def epoch(data: TrainingSet, number: int) -> dict[int, Jittered]:
    """Every view of an epoch with its camera, by the identity of the view."""
    return {id(one[0]): one for batch in data.batches(0, number) for one in batch}


def test_a_frame_at_the_pose_shows_each_view_by_its_own_camera(part: Part, caster: RayCaster) -> None:
    data = training_set(part, caster, "pose")
    first, later = epoch(data, 0), epoch(data, 1)
    assert len(first) == CONFIG.views
    assert [id(one[0]) for batch in data.batches(0, 0) for one in batch] != list(later), "the order is drawn anew"
    for key, (view, homography) in first.items():
        np.testing.assert_array_equal(homography, np.eye(3))
        seen = data.control_points([later[key]])
        for name, w_obj in data.points_obj.items():
            np.testing.assert_allclose(seen[name][0], view.frame.project(w_obj).ravel(), rtol=1e-5)
    views = make_edge_views(part, caster, REGION, CONFIG, CONFIG.views + CONFIG.held_out, 0)[: CONFIG.views]
    eyes = np.array([view.frame.canonical_T_obj for view in views])
    for view, homography in later.values():
        (row,) = np.flatnonzero((eyes == view.frame.canonical_T_obj).all((1, 2)))
        image = draw_views([views[row]], np.eye(3)[None], 0.8)
        np.testing.assert_allclose(data.images([(view, homography)]), image, atol=5e-4)
    # All that the eight numbers can say is where the eye is: three degrees of freedom.
    spread = np.linalg.svd(data.typical_points()["regressed"] - data.typical_points()["regressed"].mean(0))[1]
    assert spread[4:].max() < 0.05 * spread[0]


def test_a_frame_at_a_prediction_shows_each_view_by_a_new_camera(part: Part, caster: RayCaster) -> None:
    data = training_set(part, caster, "prediction")
    first, later = epoch(data, 0), epoch(data, 1)
    assert first.keys() == later.keys()
    for key, one in first.items():
        assert np.abs(one[1] - later[key][1]).max() > 1e-3
        assert np.abs(data.images([one]) - data.images([later[key]])).max() > 0.1


@pytest.mark.parametrize("frame", ["pose", "prediction"])
def test_held_out_views_are_always_the_same(part: Part, caster: RayCaster, frame: PaintingFrame) -> None:
    data = training_set(part, caster, frame)
    once, again = data.held_out(), data.held_out()
    assert len(once) == CONFIG.held_out
    np.testing.assert_array_equal(data.images(once), data.images(again))
