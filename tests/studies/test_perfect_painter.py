"""A painter without errors: its ridges lie on the edges that the part shows, hidden ones left out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from acp_lab.cad.edges import sample_edges
from acp_lab.cad.raycast import make_caster
from acp_lab.control_points.canonical_frame import canonical_frame, eye_position
from acp_lab.control_points.coplanar_points import mid_section_points
from acp_lab.control_points.view_regions import ALL_REGIONS
from acp_lab.generator.painted.edge_images import analytic_view, true_points
from acp_lab.generator.painted.quality import generation_quality
from acp_lab.geometry.pose import transform
from acp_lab.geometry.pose_step import move_pose
from acp_lab.prepared_part import PreparedPart, Trained
from acp_lab.studies.painting_bias import PaintingBench, PaintingBias
from acp_lab.studies.perfect_painter import PerfectlyPainted, PerfectPainter, perfectly_painted
from acp_lab.tracking.method import METHODS
from acp_lab.tracking.sources.residual import ResidualHomography
from tests.made_parts import bracket, looking_at
from tests.tracking.lit_part import lit_part
from tests.tracking.rendered import CAMERA, prepared

REGION = 4


@pytest.fixture(scope="module")
def model() -> PreparedPart:
    made = prepared(bracket())
    return replace(made, regressed_points=lit_part(made, (REGION,)).regressed_points)


@pytest.fixture(scope="module")
def painted(model: PreparedPart) -> PerfectlyPainted:
    return perfectly_painted(model, (REGION,))


DIRECTIONS = ((0.4, 0.3), (-0.8, 0.1), (0.05, -0.7), (-0.6, 0.1), (-0.7, 0.3), (0.2, 0.2), (0.7, 0.7), (-0.3, -0.5))


def biases(painted: PerfectlyPainted) -> list[PaintingBias]:
    """Of views from many directions: the part hides some of its edges, and is seen from steep."""
    bench = PaintingBench(painted)
    return [bench.bias(CAMERA, looking_at(painted.part, np.array([*d, 1.0]), 330.0, 0.3)) for d in DIRECTIONS]


def test_its_ridges_show_the_true_pose(model: PreparedPart, painted: PerfectlyPainted) -> None:
    """Nearly always; where two lines touch in the picture they pull each other, more so in a smaller one."""
    found = biases(painted)
    for bias in found:
        assert len(bias.edges) > 150
        assert bias.add_share < 0.01
        assert bias.mean_off_px < 0.25
        assert np.isnan(bias.off_px).mean() < 0.1
    smaller = biases(perfectly_painted(model, (REGION,), 128))
    assert np.median([bias.add_share for bias in found]) < 0.001
    assert np.median([bias.add_share for bias in found]) < 0.7 * np.median([bias.add_share for bias in smaller])


def test_it_paints_what_the_control_points_say(painted: PerfectlyPainted) -> None:
    """Not what was seen before: edges of another pose are those of that pose."""
    pose = looking_at(painted.part, np.array([0.4, 0.3, 1.0]), 330.0, 0.3)
    other = move_pose(pose, painted.part.box_centre, np.array([0.1, -0.15, 0.2, 2.0, 1.0, 40.0]))
    bench = PaintingBench(painted)
    for at in (pose, other):
        assert bench.bias(CAMERA, at).add_share < 0.004
    shift = transform(other, painted.part.box_centre) - transform(pose, painted.part.box_centre)
    assert np.linalg.norm(shift) == pytest.approx(np.linalg.norm([2.0, 1.0, 40.0]))


@pytest.mark.parametrize("aside", [(0.98, 0.35), (1.05, 0.35), (-1.1, 0.2), (0.3, 1.1)])
def test_it_finds_the_eye_at_the_border_of_its_region(model: PreparedPart, aside: tuple[float, float]) -> None:
    """A region is kept a little beyond its border, and there a search from its axis may end elsewhere."""
    part, region = model.part, ALL_REGIONS[REGION]
    w_obj = mid_section_points(part.box_min, part.box_max, region.axis)
    painter = PerfectPainter(replace(model, regressed_points=Trained({REGION: w_obj}, {REGION: {}})), (REGION,), 128)
    eye_obj = eye_position(looking_at(part, np.array([*aside, 1.0]) * part.box_size, 330.0, 0.3))
    frame = canonical_frame(eye_obj, part.box_centre, part.radius, region)
    image = painter.edge_image(frame.project(w_obj), REGION)
    view = analytic_view(part, sample_edges(part), make_caster(part), eye_obj, frame)
    quality = generation_quality(image[None], [true_points(view, np.eye(3))])
    assert quality.generated_to_true_px < 0.4
    assert quality.f_score > 0.95


def test_a_painting_method_takes_it(painted: PerfectlyPainted) -> None:
    source = METHODS["acp-paper"].open_source(painted)
    assert isinstance(source, ResidualHomography)
    assert source.regions == (REGION,)
    with pytest.raises(AssertionError):
        METHODS["acp-paper-literal"].open_source(painted)
