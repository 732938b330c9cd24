"""The detector on drawn and on shipped images."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import cv2
import numpy as np
import pytest

from acp_lab.cad.part import Part
from acp_lab.detection import kernels, pose_search
from acp_lab.detection.config import DetectionConfig, usual_depths_mm
from acp_lab.detection.detector import Detector, start_poses
from acp_lab.detection.edge_maps import bands, oriented_edges, removing_specks, resized, without_specks
from acp_lab.detection.pose_prior import PosePrior
from acp_lab.detection.pose_search import DistanceMaps, Poses, distinct
from acp_lab.detection.scan import Candidates, _scan_level, depth_levels, scan
from acp_lab.detection.view_templates import SCAN_BINS, STEP_PX, looking_along, spread
from acp_lab.detection.work import finish
from acp_lab.errors import AcpLabError
from acp_lab.geometry.camera import Camera
from acp_lab.geometry.pose import transform
from tests.prepared_sample import sample_model, sample_scene


@cache
def sample_detector() -> Detector:
    model = sample_model()
    return Detector(model.part, model.best_generator())


def test_features_far_from_the_middle_read_nothing_from_beyond_the_planes(monkeypatch: pytest.MonkeyPatch) -> None:
    """A long corner lies farther from the middle of its part's box than most parts reach."""
    detector, ends = sample_detector(), []

    def reads(planes: np.ndarray, _: object, shifts: np.ndarray, *rest: object) -> None:
        *_, first, length, _, _ = rest
        ends.append((int(first) + int(shifts.min()), planes.shape[1] - int(first) - int(length) - int(shifts.max())))

    monkeypatch.setattr(kernels, "scan_templates", reads)
    templates = replace(detector.templates, offsets=2 * detector.templates.offsets)
    finish(_scan_level(np.zeros((SCAN_BINS, 90, 130), np.float32), templates, detector.groups, detector.config))
    assert ends
    assert np.min(ends) >= 0


@pytest.mark.parametrize("depth_mm", [(0.0, 100.0), (-1.0, 5.0), (500.0, 300.0), (float("nan"), 3.0)])
def test_impossible_depths(depth_mm: tuple[float, float]) -> None:
    with pytest.raises(AcpLabError, match="depth range"):
        DetectionConfig(depth_mm=depth_mm)


@pytest.mark.parametrize("spread_px", [0.0, 31.0, float("nan")])
def test_impossible_spread(spread_px: float) -> None:
    with pytest.raises(AcpLabError, match="spread_px"):
        DetectionConfig(spread_px=spread_px)


@pytest.mark.parametrize("features", [0, 81])
def test_impossible_features(features: int) -> None:
    with pytest.raises(AcpLabError, match="give 1 to 80"):
        DetectionConfig(features=features)


def test_one_depth_alone_may_be_searched_near_a_pose() -> None:
    model, scene = sample_model(), sample_scene()
    frame, truth = scene.frame(0), scene.first_pose
    depth = float(transform(truth, model.part.box_centre)[2])
    config = DetectionConfig(depth_mm=(depth, depth), starts=40, kept=(20, 10), verified=6)
    detector = Detector(model.part, model.best_generator(), config)
    assert detector.candidates(frame.image, frame.camera, PosePrior(truth, 20.0, 1.1)).candidates


def test_points_project_onto_the_map_of_an_image_that_shrinks_unevenly() -> None:
    # 333x100 px shrink to whole px: not by the same share in x and y.
    camera = Camera(333, 100, 400.0, 400.0, 170.0, 52.0)
    maps = DistanceMaps(np.zeros((100, 333, 3), np.uint8), camera, 60.0, DetectionConfig())
    level = int(maps.level(np.array([600.0]))[0]) + 6
    (across, down), distance = maps.scaled(level)
    height, width = distance.shape[1:]
    assert across != down
    fx, fy, cx, cy = maps.intrinsics(level)
    small = Camera(width, height, fx, fy, cx, cy)
    corners = small.project(camera.rays(np.array([[-0.5, -0.5], [332.5, 99.5]])))
    np.testing.assert_allclose(corners, [[-0.5, -0.5], [width - 0.5, height - 0.5]], atol=1e-9)


def test_levels_cover_the_range() -> None:
    levels = depth_levels((300.0, 900.0), 1.15)
    assert 300.0 < levels[0] < 325.0
    assert 830.0 < levels[-1] < 900.0
    assert (levels[1:] / levels[:-1] <= 1.15 + 1e-9).all()
    assert depth_levels((400.0, 400.0), 1.15).tolist() == [400.0]


@pytest.mark.parametrize(
    ("diameter", "expected"),
    [
        (80.0, (250.0, 1200.0)),  # appears 67 to 320 px long there
        (20.0, (62.5, 1200.0)),
        (500.0, (250.0, 4167.0)),
    ],
)
def test_a_part_is_looked_for_where_it_appears_large_enough_whatever_its_size(
    diameter: float, expected: tuple[float, float]
) -> None:
    camera = Camera(800, 640, 1000.0, 1000.0, 399.5, 319.5)
    assert usual_depths_mm(diameter, camera) == pytest.approx(expected, abs=1.0)
    model = sample_model()
    detector = Detector(replace(model.part, diameter=diameter), model.best_generator())
    assert detector.depths(camera)[[0, -1]] == pytest.approx(expected, rel=0.08)
    told = Detector(model.part, model.best_generator(), DetectionConfig(depth_mm=(300.0, 400.0)))
    assert told.depths(camera)[[0, -1]] == pytest.approx([300.0, 400.0], rel=0.08)


def test_parallel_edges_in_one_cell_count_once() -> None:
    line = np.column_stack([np.arange(0.0, 100.0, 1.0), np.zeros(100)])
    points = np.concatenate([line, line + np.array([0.0, 0.5]), line + np.array([0.0, 1.0])])
    tangents = np.tile([1.0, 0.0], (300, 1))
    rows = spread(points, tangents, np.ones(300, bool), 5.0)
    assert len(rows) == 20


def test_rare_directions_come_early() -> None:
    points = np.column_stack([np.arange(400.0) * 10.0, np.zeros(400)])
    tangents = np.tile([1.0, 0.0], (400, 1))
    tangents[::20] = (0.0, 1.0)  # 20 of 400
    first = spread(points, tangents, np.ones(400, bool), 5.0)[:50]
    assert (tangents[first, 1] == 1.0).sum() >= 8  # by the root of their number: 9 of 50, not 2 or 3


@pytest.mark.parametrize("direction", [(0, 0, 1), (0, 0, -1), (1, 0, 0), (0.6, -0.8, 0)])
def test_looking_along(direction: tuple[float, float, float]) -> None:
    rotation = looking_along(np.array(direction, np.float64))
    assert np.allclose(rotation @ direction, (0, 0, 1))
    assert np.linalg.det(rotation) == pytest.approx(1.0)


def test_start_poses_show_the_view_at_its_place(camera: Camera) -> None:
    """The part's centre appears where the template was found, seen from the template's side."""
    detector = sample_detector()
    count = 20
    rng = np.random.default_rng(1)
    chosen = rng.integers(0, len(detector.templates), count)
    centres, depths = rng.uniform((50, 50), (590, 460), (count, 2)), rng.uniform(300, 900, count)
    found = Candidates(np.ones(count, np.float32), chosen, centres, depths)
    poses = start_poses(found, detector.templates, detector.views, camera)
    assert np.allclose(camera.project(poses.centres.astype(np.float64)), centres, atol=0.01)
    assert np.allclose(poses.centres[:, 2], depths, rtol=1e-5)
    eyes = -np.einsum("nji,nj->ni", poses.rotations, poses.centres)
    eyes /= np.linalg.norm(eyes, axis=1, keepdims=True)
    views = detector.views.directions_obj[detector.templates.views[chosen]]
    assert np.allclose(eyes, views, atol=1e-4)


def test_distinct() -> None:
    turn = np.tile(np.eye(3, dtype=np.float32), (3, 1, 1))
    centres = np.array([[0, 0, 500], [1, 0, 500], [40, 0, 500]], np.float32)
    kept = finish(distinct(Poses(turn, centres, np.array([3, 2, 1], np.float32)), 100.0, 10))
    assert kept.scores.tolist() == [3.0, 1.0]
    assert len(finish(distinct(Poses(turn, centres, np.ones(3, np.float32)), 100.0, 1))) == 1


def test_templates_are_bounded() -> None:
    detector = sample_detector()
    templates = detector.templates
    assert len(templates) == len(detector.views.counts) * detector.config.turns
    assert np.abs(templates.offsets).max() <= 0.65 * detector.config.scan_px
    assert templates.bins.min() >= 0
    assert templates.bins.max() < SCAN_BINS
    assert sum(a.nbytes for a in (templates.offsets, templates.bins, detector.views.points_obj)) < 30e6


def test_what_the_scan_reads_is_laid_out_before_a_frame_needs_it() -> None:
    """Once per template, not per level of a scan: of all templates it takes milliseconds that no work counts."""
    detector = sample_detector()
    detector.prepare()
    templates = detector.templates
    assert "reads" in templates.__dict__
    taken = templates.take(np.arange(3, len(templates), 7))
    assert "reads" in taken.__dict__
    plane, steps = taken.reads
    for made, wanted in zip(taken.reads, replace(taken).reads, strict=True):
        np.testing.assert_array_equal(made, wanted)
    x, y = np.moveaxis(taken.offsets, -1, 0)
    np.testing.assert_array_equal(plane % STEP_PX, x - STEP_PX * steps[..., 0])
    np.testing.assert_array_equal(plane // STEP_PX % STEP_PX, y - STEP_PX * steps[..., 1])
    np.testing.assert_array_equal(plane // STEP_PX**2, taken.bins)


def test_the_sample_is_among_the_candidates() -> None:
    scene = sample_scene()
    frame = scene.frame(scene.frame_ids[0])
    truth = scene.first_pose
    part: Part = sample_model().part
    look = sample_detector().candidates(frame.image, frame.camera)
    assert 0 < len(look.candidates) <= sample_detector().config.verified
    scores = [candidate.score for candidate in look.candidates]
    assert scores == sorted(scores, reverse=True)
    errors = [
        np.linalg.norm(transform(c.cam_T_obj, part.vertices) - transform(truth, part.vertices), axis=1).mean()
        for c in look.candidates[:5]
    ]
    assert min(errors) < 0.1 * part.diameter
    at_truth = look.witness.look(truth)
    assert at_truth is not None
    assert at_truth.score > 0.9
    turned = truth @ np.diag([1.0, -1.0, -1.0, 1.0])
    wrong = look.witness.look(turned)
    assert wrong is None or wrong.score < 0.5 * at_truth.score


@pytest.mark.parametrize("grey", [0, 128, 255])
def test_nothing_in_an_empty_image(grey: int, camera: Camera) -> None:
    image = np.full((camera.height, camera.width, 3), grey, np.uint8)
    assert sample_detector().candidates(image, camera).candidates == ()


def test_tiny_image() -> None:
    image = np.random.default_rng(0).integers(0, 255, (6, 9, 3)).astype(np.uint8)
    look = sample_detector().candidates(image, Camera(9, 6, 10.0, 10.0, 4.0, 2.5))
    assert all(candidate.score < 0.9 for candidate in look.candidates)


def test_a_part_too_far_to_be_seen(camera: Camera) -> None:
    """Levels on which it would be smaller than the scan can tell are left out, not enlarged without bound."""
    detector = sample_detector()
    image = np.random.default_rng(0).integers(0, 255, (camera.height, camera.width, 3)).astype(np.uint8)
    none = finish(
        scan(
            image,
            camera,
            detector.part.diameter,
            detector.templates,
            detector.groups,
            depth_levels((50_000.0, 60_000.0), 1.15),
            DetectionConfig(),
        )
    )
    assert len(none) == 0


@pytest.mark.parametrize("prior", [None, PosePrior(np.eye(4), 180.0, 1.6)])
def test_no_slice_is_large(prior: PosePrior | None) -> None:
    """A tracker that spreads a search over frames stops at slices only: none may be worth a frame."""
    rng = np.random.default_rng(0)
    image = cv2.GaussianBlur(rng.integers(0, 255, (1024, 1224, 3)).astype(np.uint8), (0, 0), 2.0)
    if prior is not None:
        prior = replace(prior, cam_T_obj=sample_scene().first_pose)
    steps = sample_detector().search(image, Camera(1224, 1024, 1200.0, 1200.0, 611.5, 511.5), prior)
    assert max(steps) < 8_000.0


def test_the_maps_that_a_look_needs_are_made_in_slices_before(monkeypatch: pytest.MonkeyPatch) -> None:
    """A pose that was aligned may be of a size at which nothing was looked at before: its maps are work, too."""
    detector, scene = sample_detector(), sample_scene()
    frame = scene.frame(scene.frame_ids[0])
    witness = detector.candidates(np.zeros_like(frame.image), frame.camera).witness
    pose = scene.first_pose.copy()
    pose[:3, 3] *= 0.7
    work = list(witness.making_maps(pose))
    assert len(work) > 16
    assert max(work) < 8_000.0
    monkeypatch.setattr(pose_search, "oriented_edges", None)
    monkeypatch.setattr(pose_search, "distances", None)
    witness.look(pose)
    assert not list(witness.making_maps(pose))
    pose[2, 3] = -100.0
    assert not list(witness.making_maps(pose))


def test_in_slices_as_in_one_go() -> None:
    rng = np.random.default_rng(0)
    image = rng.integers(0, 255, (700, 400, 3)).astype(np.uint8)
    assert len(list(bands(700, 400))) == 3
    assert np.array_equal(finish(removing_specks(image)), without_specks(image))
    upper, whole = (finish(oriented_edges(part, 8)) for part in (image[:400], image))
    assert np.array_equal(upper[:390], whole[:390])


def test_halving_an_image_keeps_places() -> None:
    """A step edge lies where it should at any scale, also where the image is halved on the way."""
    image = np.zeros((200, 400, 3), np.uint8)
    image[:, 240:] = 200
    for scale in (0.8, 0.5, 0.4, 0.21):
        small = resized(image, scale)
        bright = small[len(small) // 2, :, 0].astype(float) / 200.0
        ratio = small.shape[1] / 400
        assert small.shape[1] == round(400 * scale)
        assert len(bright) - bright.sum() == pytest.approx(240 * ratio, abs=0.3)
