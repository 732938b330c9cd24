"""Edge map and distance map against brute force, and what is read between their pixels."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from acp_lab.errors import TrackingError
from acp_lab.generator.base import GeneratedEdges
from acp_lab.geometry.arrays import ByteImage
from acp_lab.geometry.camera import Camera
from acp_lab.imaging.distance import distance_map
from acp_lab.tracking.frame_view import FrameView
from acp_lab.tracking.losses import LossForm, edge_loss
from acp_lab.tracking.schedule import Level
from acp_lab.tracking.targets import QUALITY_SIGMA_PX
from acp_lab.tracking.targets.distance_map import (
    DistanceMap,
    DistanceMapTarget,
    DistanceTarget,
    EdgeMapConfig,
    distance_target,
)
from tests.made_parts import box

WHOLE = (0, 0, 90, 70)


@pytest.fixture
def square() -> ByteImage:
    """A bright square from (30, 20) to (59, 49) on a dark ground, with a little noise."""
    grey = np.full((70, 90), 40.0)
    grey[20:50, 30:60] = 180.0
    grey += np.random.default_rng(1).normal(0.0, 2.0, grey.shape)
    return np.repeat(np.clip(grey, 0, 255).astype(np.uint8)[..., None], 3, 2)


def brute_force(edges: np.ndarray, x: int, y: int) -> float:
    rows, columns = np.nonzero(edges)
    return float(np.hypot(columns - x, rows - y).min())


def test_distances_at_pixels_are_those_to_the_nearest_edge_pixel(square: ByteImage) -> None:
    target = distance_target(square, WHOLE, EdgeMapConfig())
    assert target.edges.any()
    points = np.array([[3.0, 5.0], [45.0, 35.0], [80.0, 66.0], [29.0, 20.0]])
    expected = [brute_force(target.edges, int(x), int(y)) for x, y in points]
    found = target.distances(points, np.tile([1.0, 0.0], (4, 1)))
    np.testing.assert_allclose(found.values, expected, rtol=1e-6)


def test_gradients_are_those_of_what_is_read(square: ByteImage, rng: np.random.Generator) -> None:
    target = distance_target(square, WHOLE, EdgeMapConfig())
    # Away from pixel centres, where the bilinear surface has its folds.
    points = np.floor(rng.uniform([2, 2], [86, 66], (200, 2))) + rng.uniform(0.1, 0.9, (200, 2))
    normals = np.tile([1.0, 0.0], (200, 1))
    found = target.distances(points, normals)
    for axis in range(2):
        step = np.zeros(2)
        step[axis] = 1e-4
        difference = (
            target.distances(points + step, normals).values - target.distances(points - step, normals).values
        ) / 2e-4
        np.testing.assert_allclose(found.gradients[:, axis], difference, atol=2e-3)


def test_the_crop_knows_where_it_lies(square: ByteImage) -> None:
    whole = distance_target(square, WHOLE, EdgeMapConfig())
    crop = distance_target(square, (20, 10, 75, 65), EdgeMapConfig())
    assert crop.origin == (20, 10)
    points, normals = np.array([[33.3, 30.1], [58.7, 44.2]]), np.array([[1.0, 0.0], [0.0, 1.0]])
    np.testing.assert_allclose(
        crop.distances(points, normals).values, whole.distances(points, normals).values, atol=0.05
    )


def test_a_point_that_left_the_crop_is_far_and_knows_the_way_out(square: ByteImage) -> None:
    crop = distance_target(square, (20, 10, 75, 65), EdgeMapConfig())
    inside, outside = np.array([[20.0, 30.0]]), np.array([[-10.0, 30.0]])
    normal = np.array([[1.0, 0.0]])
    near, far = crop.distances(inside, normal), crop.distances(outside, normal)
    assert far.values[0] == pytest.approx(near.values[0] + 30.0, abs=0.1)
    np.testing.assert_allclose(far.gradients, [[-1.0, 0.0]], atol=1e-6)


def test_a_point_that_is_nowhere_is_far_from_everything() -> None:
    edges = np.zeros((20, 21), bool)
    edges[5, 5] = True
    target = DistanceTarget(edges, edges[None], (3, 4))
    points = np.array([[8.0, 9.0], [np.nan, np.nan], [np.inf, 2.0], [5.0, -np.inf]])
    found = target.distances(points, np.tile([1.0, 0.0], (4, 1)))
    assert found.values[0] == 0.0
    assert (found.values[1:] == np.inf).all()


def test_a_direction_sees_only_its_own_edges() -> None:
    upright, level = np.zeros((2, 20, 20), bool)
    upright[:, 4], level[15] = True, True
    target = DistanceTarget(upright | level, np.stack([upright, level]), (0, 0))
    point = np.array([[9.0, 9.0]])
    assert target.distances(point, np.array([[1.0, 0.0]])).values[0] == pytest.approx(5.0)
    assert target.distances(point, np.array([[-1.0, 0.02]])).values[0] == pytest.approx(5.0)
    assert target.distances(point, np.array([[0.0, 1.0]])).values[0] == pytest.approx(6.0)


def test_bins_sort_a_square_into_upright_and_level_edges(square: ByteImage) -> None:
    one = distance_target(square, WHOLE, EdgeMapConfig())
    four = distance_target(square, WHOLE, EdgeMapConfig(orientation_bins=4))
    assert four.layers.shape == (4, 70, 90)
    point, upright = np.array([[45.0, 24.0]]), np.array([[1.0, 0.0]])
    # Below the upper side, an edge point of an upright edge looks past it, to the sides left and right.
    assert one.distances(point, upright).values[0] < 6.0
    assert four.distances(point, upright).values[0] > 12.0


@pytest.mark.parametrize("denoise", ["none", "median", "bilateral", "nonlocal-means"])
@pytest.mark.parametrize("thresholds", ["otsu", "median"])
def test_every_denoiser_and_rule_finds_the_square(square: ByteImage, denoise: str, thresholds: str) -> None:
    config = EdgeMapConfig(denoise=denoise, thresholds=thresholds)  # type: ignore[arg-type]
    target = distance_target(square, WHOLE, config)
    sides = np.array([[29.5, 35.0], [59.5, 35.0], [45.0, 19.5], [45.0, 49.5]])
    assert (target.distances(sides, np.tile([1.0, 0.0], (4, 1))).values < 1.1).all()


@pytest.mark.parametrize("denoise", ["median", "bilateral", "nonlocal-means"])
def test_every_denoiser_takes_out_the_edges_that_noise_makes(denoise: str) -> None:
    """A faint square in strong noise: Canny alone finds hundreds of edge pixels that are none."""
    grey = np.full((70, 90), 60.0)
    grey[20:50, 30:60] = 80.0
    grey += np.random.default_rng(0).normal(0.0, 7.0, grey.shape)
    image = np.repeat(np.clip(np.round(grey), 0, 255).astype(np.uint8)[..., None], 3, 2)
    sides = np.zeros((70, 90), bool)
    sides[20:50, [30, 59]] = True
    sides[[20, 49], 30:60] = True
    own = distance_map(sides) <= 3.0
    raw = distance_target(image, WHOLE, EdgeMapConfig()).edges
    clean = distance_target(image, WHOLE, EdgeMapConfig(denoise=denoise)).edges  # type: ignore[arg-type]
    assert (raw & ~own).sum() > 300, "the test's own point is gone"
    assert (clean & ~own).sum() < 0.1 * (raw & ~own).sum()
    assert (clean & own).sum() > 100, "the square's own edges must stay"


def test_the_median_alone_takes_out_single_bright_pixels(square: ByteImage) -> None:
    speckled = square.copy()
    speckled[10:70:15, 8:90:20] = 255
    away = np.s_[:15]
    found = {
        denoise: int(distance_target(speckled, WHOLE, EdgeMapConfig(denoise=denoise)).edges[away].sum())  # type: ignore[arg-type]
        for denoise in ("none", "median", "bilateral", "nonlocal-means")
    }
    assert found["median"] == 0
    assert min(found["none"], found["bilateral"], found["nonlocal-means"]) > 4


def test_a_black_frame_is_far_from_everything() -> None:
    target = distance_target(np.zeros((70, 90, 3), np.uint8), WHOLE, EdgeMapConfig())
    found = target.distances(np.array([[10.0, 10.0]]), np.array([[1.0, 0.0]]))
    assert found.values[0] > 100.0
    assert np.isfinite(found.gradients).all()


# ---- the target of a method ----------------------------------------------------------------------------------


@pytest.fixture
def line() -> tuple[DistanceTarget, GeneratedEdges]:
    """An upright image edge at x = 20, and edge points 0 to 7 px right of it, believed ever less."""
    edges = np.zeros((40, 60), bool)
    edges[:, 20] = True
    points = np.column_stack([20.0 + np.arange(8), 16.3 + np.arange(8)])
    tangents = np.tile([0.0, 1.0], (8, 1))
    return DistanceTarget(edges, edges[None], (0, 0)), GeneratedEdges(
        points, tangents, np.linspace(1.0, 0.3, 8), np.arange(8)
    )


@pytest.mark.parametrize("form", ["logistic", "saturating", "geman-mcclure", "tukey"])
@pytest.mark.parametrize("alpha_px", [3.0, 9.0])
def test_a_measure_weighs_distances_by_its_loss_and_the_levels_alpha(
    line: tuple[DistanceTarget, GeneratedEdges], form: LossForm, alpha_px: float
) -> None:
    target, edges = line
    measure = DistanceMapTarget(target, form).bind(edges, None, Level(5, 0.5 * alpha_px))  # type: ignore[arg-type]
    seen = measure(edges)
    expected = edge_loss(form, seen.residuals, alpha_px)
    np.testing.assert_allclose(seen.residuals, np.arange(8.0), atol=1e-5)
    np.testing.assert_allclose(seen.directions[1:], np.tile([-1.0, 0.0], (7, 1)), atol=1e-5)
    np.testing.assert_allclose(seen.weights, expected.least_squares_weights(seen.residuals) * edges.weights)
    mean = float(expected.values @ edges.weights / edges.weights.sum())
    assert seen.loss == pytest.approx(mean)
    assert measure.reported_loss(edges) == pytest.approx(mean)


def test_a_methods_edge_map_is_made_of_the_views_box_as_it_is_set(square: ByteImage) -> None:
    """Blur, denoiser, bins: each gives another map than the usual one; the crop is the view's."""
    camera = Camera(90, 70, 100.0, 100.0, 44.5, 34.5)
    inside = (20, 10, 75, 65)
    view = FrameView(camera, np.eye(4), 4, np.zeros((4, 3)), box(), image=square, box=inside, edge_box=inside)
    usual = EdgeMapConfig()
    for config in (
        usual,
        EdgeMapConfig(blur_px=3.0),
        EdgeMapConfig(denoise="bilateral"),
        EdgeMapConfig(orientation_bins=4),
    ):
        target = DistanceMap("tukey", config).see(view, None)  # type: ignore[arg-type]
        expected = distance_target(square, view.box, config)
        none = GeneratedEdges(np.zeros((0, 2)), np.zeros((0, 2)), np.zeros(0), np.zeros(0, np.intp))
        bound = target.bind(none, None, Level(5, 2.0))  # type: ignore[arg-type]
        shown = bound.judge(none, none, None).target_view  # type: ignore[arg-type]
        assert shown.origin == expected.origin == (20, 10)
        assert shown.distance_map is not None
        np.testing.assert_array_equal(shown.distance_map, distance_map(expected.edges))
        plain = distance_map(distance_target(square, view.box, usual).edges)
        # Of all directions together, however they are sorted.
        assert np.array_equal(shown.distance_map, plain) == (replace(config, orientation_bins=1) == usual)


def test_a_step_by_the_measure_goes_down_its_loss(line: tuple[DistanceTarget, GeneratedEdges]) -> None:
    """d e / d shift = - sum of weights times residuals along the shift, over the shares."""
    target, edges = line
    measure = DistanceMapTarget(target, "geman-mcclure").bind(edges, None, Level(5, 2.0))  # type: ignore[arg-type]
    away = replace(edges, points=edges.points + np.array([0.4, 0.0]))
    seen = measure(away)
    slope = (
        measure(replace(away, points=away.points + np.array([1e-4, 0.0]))).loss
        - measure(replace(away, points=away.points - np.array([1e-4, 0.0]))).loss
    ) / 2e-4
    expected = -float((seen.weights * seen.residuals * seen.directions[:, 0]).sum() / edges.weights.sum())
    assert slope == pytest.approx(expected, rel=1e-3)


def test_quality_is_the_weighted_nearness_of_the_estimates_own_edges(
    line: tuple[DistanceTarget, GeneratedEdges],
) -> None:
    target, edges = line
    measure = DistanceMapTarget(target, "tukey").bind(edges, None, Level(5, 2.0))  # type: ignore[arg-type]
    far = replace(edges, points=edges.points + 15.0)
    judged = measure.judge(far, edges, None)  # type: ignore[arg-type]
    near = np.exp(-0.5 * (np.arange(8.0) / QUALITY_SIGMA_PX) ** 2)
    assert judged.quality == pytest.approx(float(near @ edges.weights / edges.weights.sum()), rel=1e-5)
    assert judged.edges is edges
    assert judged.matches is None
    np.testing.assert_allclose(np.abs(judged.residuals_px), np.arange(8.0), atol=1e-5)
    # Signed along the normal: where the point has to go.
    goal = edges.points + judged.residuals_px[:, None] * edges.normals
    np.testing.assert_allclose(goal[:, 0], 20.0, atol=1e-4)
    # The loss is of the level's own edges where its motion put them.
    assert judged.loss == pytest.approx(measure.reported_loss(far))
    wide = DistanceMapTarget(target, "tukey").agreement(edges, None, Level(5, 2.0), 3.0)  # type: ignore[arg-type]
    assert wide == pytest.approx(
        float(np.exp(-0.5 * (np.arange(8.0) / 3.0) ** 2) @ edges.weights / edges.weights.sum()), rel=1e-5
    )


def test_the_target_view_is_the_edge_map(line: tuple[DistanceTarget, GeneratedEdges]) -> None:
    target, edges = line
    shifted = replace(target, origin=(7, 3))
    view = DistanceMapTarget(shifted, "tukey").bind(edges, None, Level(5, 2.0)).judge(edges, edges, None).target_view  # type: ignore[arg-type]
    assert (view.origin, view.size) == ((7, 3), (60, 40))
    np.testing.assert_array_equal(np.unique(view.edge_points[:, 0]), [27])
    assert view.edge_points[:, 1].min() == 3
    assert view.distance_map is not None
    np.testing.assert_array_equal(view.distance_map, distance_map(shifted.edges))


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"blur_px": -1.0}, "edge_map.blur_px = -1: give px from 0 to 20"),
        ({"blur_px": float("nan")}, "edge_map.blur_px = nan"),
        ({"orientation_bins": 0}, "edge_map.orientation_bins = 0: give 1 to 32"),
        ({"orientation_bins": 33}, "edge_map.orientation_bins = 33"),
    ],
)
def test_settings_that_make_no_edge_map_are_refused(settings: dict[str, float], words: str) -> None:
    with pytest.raises(TrackingError) as caught:
        EdgeMapConfig(**settings)  # type: ignore[arg-type]
    assert words in str(caught.value)
