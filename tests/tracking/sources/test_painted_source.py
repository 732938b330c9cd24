"""Edge points read off a painted image, and how they flow with the control points."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from acp_lab.cad.edges import facing
from acp_lab.cad.part import Part
from acp_lab.control_points.canonical_frame import eye_position
from acp_lab.errors import PreparationError, TrackingError
from acp_lab.generator.painted.autoencoder import Decoder
from acp_lab.generator.painted.config import NetworkShape
from acp_lab.generator.painted.edge_images import PaintingFrame
from acp_lab.generator.painted.edge_points import ridge
from acp_lab.generator.painted.image_generator import POINT_SETS, PointSet, RegionAutoencoder
from acp_lab.generator.painted.latent_regressor import LatentRegressor
from acp_lab.geometry.homography import apply_homography, homography_from_points
from acp_lab.geometry.pose import transform
from acp_lab.geometry.pose_step import move_pose
from acp_lab.prepared_part import PreparedPart, Trained
from acp_lab.tracking.frame_view import View
from acp_lab.tracking.sources.painted import (
    PaintedRidges,
    PaintedSamples,
    RidgeSource,
    SampleSource,
    view_to_canonical,
)
from tests.made_parts import box, looking_at
from tests.tracking.drawn_part import drawn_part
from tests.tracking.lit_part import lit_part
from tests.tracking.rendered import CAMERA, prepared
from tests.tracking.views import LeftHalf, PaintedLines, prior_of, view_at


@pytest.fixture
def view(part: Part) -> View:
    return view_at(part, looking_at(part, np.array([0.8, 0.6, 1.0]), 330.0, 0.3))


@pytest.fixture
def ridges() -> RidgeSource:
    return RidgeSource(PaintedLines(), "regressed", ridge, 0.3, "prediction")  # type: ignore[arg-type]


class CountedLines(PaintedLines):
    """Knows how often it painted."""

    count = 0

    def edge_image(self, points: np.ndarray, region: int, point_set: PointSet = "regressed") -> np.ndarray:
        self.count += 1
        return super().edge_image(points, region, point_set)


def test_the_same_control_points_are_painted_once(view: View) -> None:
    lines = CountedLines()
    ridges = RidgeSource(lines, "regressed", ridge, 0.3, "prediction")  # type: ignore[arg-type]
    at = prior_of(view)
    first, fewer = ridges.generate(at, 400), ridges.generate(at, 50)
    again = ridges.reproject(view.at_points(at.control_points + 1e-9), first)
    assert lines.count == 1
    assert len(fewer) == 50
    np.testing.assert_allclose(again.points, first.points, atol=1e-12)
    moved = ridges.generate(view.at_points(at.control_points + 1e-3), 400)
    assert lines.count == 2
    assert not np.array_equal(moved.points, first.points)
    # Another region has another network.
    ridges.generate(replace(view, region=(view.region + 1) % 6).at_points(at.control_points), 400)
    assert lines.count == 3


@pytest.mark.parametrize("by_differences", [False, True])
def test_painted_edges_come_to_the_image_and_flow_with_the_control_points(
    view: View, ridges: RidgeSource, by_differences: bool
) -> None:
    start = prior_of(view)
    edges = ridges.generate(start, 400)
    flow = ridges.flow(start, edges, by_differences)
    assert flow.shape == (len(edges), 2, 8)
    # The whole quad shifted: each painted line goes along, as far as it is free to.
    shift = np.array([0.6, -0.4])
    moved = ridges.generate(view.at_points(start.control_points + shift), 400)
    across = (edges.normals * (flow @ np.tile(shift, 4))).sum(1)
    pairs = np.linalg.norm(edges.points[:, None] - moved.points[None], axis=2)
    row = pairs.argmin(1)
    # Along each normal to the line through the nearest moved point.
    gap, along = moved.points[row] - edges.points, moved.tangents[row]
    seen = (gap[:, 0] * along[:, 1] - gap[:, 1] * along[:, 0]) / (
        edges.normals[:, 0] * along[:, 1] - edges.normals[:, 1] * along[:, 0]
    )
    # Where the lines cross they have no motion of their own; elsewhere both agree.
    known = np.isfinite(across)
    assert known.mean() > 0.8
    # A ridge's sub-pixel place is off by up to a tenth of a pixel, and so is where it seems to go.
    assert np.median(np.abs(across - seen)[known]) < 0.15
    assert (np.abs(across - seen)[known] < 0.3).mean() > 0.9
    assert np.abs(seen[known]).mean() > 0.4
    assert np.abs(seen).max() > 0.3


def test_painted_points_lie_on_the_ridges(view: View, ridges: RidgeSource) -> None:
    start = prior_of(view)
    canonical = view.canonical.project(view.points_obj)
    found = ridge(PaintedLines().edge_image(canonical, 0).astype(np.float32), 0.3)
    edges = ridges.generate(start, 100_000)
    assert len(edges) == len(found)
    back = homography_from_points(start.control_points, canonical)
    np.testing.assert_allclose(apply_homography(back, edges.points), found.points, atol=1e-3)
    np.testing.assert_allclose(view_to_canonical(view, edges.points), found.points, atol=1e-3)
    assert (edges.sample_ids == -1).all()
    assert len(ridges.generate(start, 50)) == 50


def test_reprojected_ridges_are_painted_anew(view: View, ridges: RidgeSource) -> None:
    before = ridges.generate(prior_of(view), 400)
    moved = view.at_points(prior_of(view).control_points + np.array([0.6, -0.4]))
    after = ridges.reproject(moved, before)
    np.testing.assert_array_equal(after.points, ridges.generate(moved, len(before)).points)


def test_a_painted_image_chooses_among_the_samples_of_the_model(view: View, model: PreparedPart) -> None:
    source = SampleSource(LeftHalf(), "regressed", model.edges, 0.0, 0.05)  # type: ignore[arg-type]
    start = prior_of(view)
    edges = source.generate(start, 300)
    assert 50 < len(edges) <= 300
    assert view_to_canonical(view, edges.points)[:, 0].max() < 64.0
    # Where they are is the model's affair alone.
    points_obj = model.edges.points_obj[edges.sample_ids]
    np.testing.assert_allclose(edges.points, CAMERA.project(transform(view.prior, points_obj)), atol=1e-3)
    by_chain, by_differences = (source.flow(start, edges, way) for way in (False, True))
    np.testing.assert_allclose(by_chain, by_differences, atol=0.02)


@pytest.mark.parametrize("config", [PaintedRidges(), PaintedSamples()], ids=lambda config: config.kind)
def test_the_regressed_or_the_mid_section_points_paint(
    view: View, model: PreparedPart, config: PaintedRidges | PaintedSamples
) -> None:
    """W in use decides which of the generator's two regressors is asked, and the view with which region."""
    lit = lit_part(model)
    point_sets: tuple[PointSet, ...] = ("regressed", "mid-section")
    for point_set in point_sets:
        source = config.open(lit, point_set)
        assert (source.regions, source.canonical_size) == (lit.lit.regions, lit.lit.size)
        source.generate(prior_of(view), 50)
    assert lit.lit.asked == [(view.region, "regressed"), (view.region, "mid-section")]


@pytest.mark.parametrize("config", [PaintedRidges(), PaintedSamples()], ids=lambda config: config.kind)
def test_a_missing_auto_encoder_names_the_command(model: PreparedPart, config: PaintedRidges | PaintedSamples) -> None:
    with pytest.raises(PreparationError, match="--generator autoencoder"):
        config.open(model, "regressed")


@pytest.mark.parametrize("level", [0.0, 1.0, -0.2, float("nan")])
@pytest.mark.parametrize("kind", [PaintedRidges, PaintedSamples])
def test_a_brightness_that_no_pixel_or_every_pixel_has_is_refused(kind: type, level: float) -> None:
    with pytest.raises(TrackingError, match=r"source\.level"):
        kind(level=level)


def test_a_frame_at_the_pose_paints_the_rigid_neighbour(view: View, model: PreparedPart) -> None:
    """Whatever was predicted, and wherever I is beside a rigid motion."""
    drawn = drawn_part(model, (view.region,))
    source = PaintedRidges(level=0.3).open(drawn, "regressed")
    w_obj = drawn.control_points(view.region, "regressed")
    at_truth = replace(view, points_obj=w_obj)
    expected = source.generate(prior_of(at_truth), 10_000)
    # Another prediction for the same pose.
    off = move_pose(view.prior, view.part.box_centre, np.array([0.05, -0.04, 0.08, 3.0, -2.0, 9.0]))
    elsewhere = replace(at_truth, prior=off)
    found = source.generate(elsewhere.at_pose(view.prior), 10_000)
    np.testing.assert_allclose(found.points, expected.points, atol=1e-6)
    pulled = elsewhere.at_points(prior_of(at_truth).control_points + np.array([[4.0, -3.0], [0, 2], [1, 1], [-2, 0]]))
    rigid = source.generate(elsewhere.at_pose(pulled.cam_T_obj), 10_000)
    np.testing.assert_allclose(source.generate(pulled, 10_000).points, rigid.points, atol=1e-6)


def test_painted_ridges_in_the_frame_at_the_pose_lie_on_the_edges(model: PreparedPart) -> None:
    """A perfect painter's ridges are the part's edges in the image, to a small part of a pixel."""
    box_model = prepared(box((60.0, 40.0, 20.0)))
    here = view_at(box_model.part, looking_at(box_model.part, np.array([0.3, 0.4, 1.0]), 330.0, 0.3))
    drawn = drawn_part(box_model, (here.region,))
    here = replace(here, points_obj=drawn.control_points(here.region, "regressed"))
    found = PaintedRidges(level=0.3).open(drawn, "regressed").generate(prior_of(here), 10_000)
    edges = drawn.edges
    seen = edges.points_obj[facing(edges, eye_position(here.prior)).shows]
    true = CAMERA.project(transform(here.prior, seen))
    gaps = np.linalg.norm(found.points[:, None] - true[None], axis=2)
    nearest = gaps.argmin(1)
    off = np.abs(((found.points - true[nearest]) * found.normals).sum(1))
    assert len(found) > 100
    assert np.median(off) < 0.1


@pytest.mark.parametrize(("trained", "wanted"), [("prediction", "pose"), ("pose", "prediction")])
def test_an_auto_encoder_of_the_other_frame_names_the_command(
    trained: PaintingFrame, wanted: PaintingFrame, model: PreparedPart
) -> None:
    """Such as one of an earlier version: all of those were trained for a frame at the prediction."""
    shape = NetworkShape(size=32, latent=4, widths=(4, 4, 4), hidden=4)
    networks = {name: LatentRegressor(shape) for name in POINT_SETS}
    points_obj = {name: np.zeros((4, 3)) for name in POINT_SETS}
    stored = RegionAutoencoder.of_networks(shape, Decoder(shape), networks, points_obj, trained)
    painted = replace(model, autoencoders=Trained({4: RegionAutoencoder.from_arrays(stored.arrays())}))
    with pytest.raises(PreparationError, match=rf"at the {trained}, .* --painting-frame {wanted}$"):
        PaintedRidges(frame=wanted).open(painted, "regressed")
    assert PaintedRidges(frame=trained).open(painted, "regressed").regions == (4,)
