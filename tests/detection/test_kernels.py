"""The compiled loops against slow twins in NumPy."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from acp_lab.detection.edge_maps import NO_EDGE, bands, distances
from acp_lab.detection.kernels import (
    CHUNK,
    climb,
    keep_distinct,
    nearness,
    pose_score,
    scan_templates,
    spread_by_direction,
    strongest_gradients,
    thin_oriented,
)
from acp_lab.detection.work import finish
from acp_lab.geometry.arrays import ByteImage, Float32Array
from acp_lab.geometry.pose import so3_exp


def test_scan_templates(rng: np.random.Generator) -> None:
    planes = rng.integers(-100, 100, (16, 7000 + CHUNK)).astype(np.int8)
    plane_of = rng.integers(0, 16, (9, 11)).astype(np.int32)
    shifts = rng.integers(-40, 40, (9, 11)).astype(np.int32)
    counts, groups = np.arange(3, 12), rng.integers(0, 3, 9)
    gains = rng.uniform(0.5, 2.0, 9).astype(np.float32)
    first, length = 100, 5000  # more than one chunk
    best = np.full((3, length), -1e9, np.float32)
    ids = np.full((3, length), -1, np.int32)
    for begin, end in ((0, 4), (4, 9)):  # in slices
        scan_templates(planes, plane_of, shifts, counts, gains, groups, begin, end, first, length, best, ids)
    places = first + np.arange(length)
    for group in range(3):
        members = np.flatnonzero(groups == group)
        scores = np.array(
            [
                gains[t] * sum(planes[plane_of[t, f], places + shifts[t, f]].astype(int) for f in range(counts[t]))
                for t in members
            ]
        )
        assert np.allclose(best[group], scores.max(0), rtol=1e-5)
        assert (members[scores.argmax(0)] == ids[group]).mean() > 0.999  # equal scores aside


def _slow_score(
    maps: ByteImage,
    camera: tuple[float, ...],
    points: Float32Array,
    tangents: Float32Array,
    pose: tuple[Float32Array, Float32Array],
    table: Float32Array,
) -> float:
    fx, fy, cx, cy = camera
    points_cam = points.astype(np.float64) @ pose[0].T + pose[1]
    along_cam = tangents.astype(np.float64) @ pose[0].T
    ahead = points_cam[:, 2] > 1.0
    points_cam, along_cam = points_cam[ahead], along_cam[ahead]
    flat = points_cam[:, :2] / points_cam[:, 2:]
    along = (along_cam[:, :2] - flat * along_cam[:, 2:]) * (fx, fy)
    bins = np.floor(np.arctan2(along[:, 1], along[:, 0]) / np.pi * len(maps) + 0.5).astype(int) % len(maps)
    column, line = np.floor(flat * (fx, fy) + (cx, cy) + 0.5).astype(int).T
    inside = (column >= 0) & (line >= 0) & (column < maps.shape[2]) & (line < maps.shape[1])
    return float(table[maps[bins[inside], line[inside], column[inside]]].sum() / len(points))


def _fast_score(
    maps: ByteImage,
    camera: tuple[float, ...],
    points: Float32Array,
    tangents: Float32Array,
    pose: tuple[Float32Array, Float32Array],
    table: Float32Array,
) -> np.float32:
    samples = (np.ascontiguousarray(values.T) for values in (points, tangents))
    places = np.empty(len(points), np.int32)
    return pose_score(maps, *map(np.float32, camera), *samples, len(points), *pose, table, places)


@pytest.fixture
def scene(rng: np.random.Generator) -> tuple[ByteImage, Float32Array, Float32Array, Float32Array]:
    maps = rng.integers(0, 255, (16, 90, 120)).astype(np.uint8)
    points = rng.uniform(-30, 30, (60, 3)).astype(np.float32)
    tangents = rng.normal(size=(60, 3)).astype(np.float32)
    return maps, points, tangents, np.linspace(0.0, 1.0, 256).astype(np.float32)


@pytest.mark.parametrize("depth", [110.0, 12.0])
def test_pose_score(
    scene: tuple[ByteImage, Float32Array, Float32Array, Float32Array], rng: np.random.Generator, depth: float
) -> None:
    """Also of a part that is partly behind the camera and beside the image."""
    maps, points, tangents, table = scene
    camera = (150.0, 160.0, 58.0, 44.0)
    differences = []
    for _ in range(20):
        pose = so3_exp(rng.normal(size=3)).astype(np.float32), np.array([5.0, -8.0, depth], np.float32)
        fast = _fast_score(maps, camera, points, tangents, pose, table)
        differences.append(abs(fast - _slow_score(maps, camera, points, tangents, pose, table)))
    # The direction's approximation puts a few samples into the next bin.
    assert np.median(differences) < 0.01
    assert max(differences) < 0.05


def test_climb_finds_the_pose_back(rng: np.random.Generator) -> None:
    points = rng.uniform(-30, 30, (80, 3)).astype(np.float32)
    tangents = rng.normal(size=(80, 3)).astype(np.float32)
    rotation, centre = so3_exp(np.array([0.4, -0.3, 0.2])), np.array([4.0, -3.0, 200.0])
    camera = (400.0, 400.0, 100.0, 80.0)
    points_cam = points @ rotation.T + centre
    along_cam = tangents @ rotation.T
    flat = points_cam[:, :2] / points_cam[:, 2:]
    along = along_cam[:, :2] - flat * along_cam[:, 2:]
    bins = np.floor(np.arctan2(along[:, 1], along[:, 0]) / np.pi * 16 + 0.5).astype(int) % 16
    column, line = np.floor(flat * camera[:2] + camera[2:] + 0.5).astype(int).T
    directions = np.full((170, 220), NO_EDGE, np.uint8)
    directions[line, column] = bins
    maps = np.round(255.0 * (1.0 - finish(distances(directions, 16, 12.0)) / 12.0)).astype(np.uint8)
    table = (np.arange(256) / 255.0).astype(np.float32)
    moved = (so3_exp(np.array([0.03, 0.04, -0.03])) @ rotation).astype(np.float32)
    place = (centre + np.array([2.0, -1.5, 5.0])).astype(np.float32)
    fixed = (*map(np.float32, camera), points, tangents, 80)
    before = _fast_score(maps, camera, points, tangents, (moved, place), table)
    steps = np.float32(0.05), np.float32(2.0), np.float32(0.02)
    after = climb(maps, *fixed, moved, place, table, *steps, 5)
    assert after > before + 0.1
    assert after == pytest.approx(_fast_score(maps, camera, points, tangents, (moved, place), table), abs=1e-5)
    assert np.linalg.norm(place - centre) < 3.0
    assert np.linalg.norm(moved - rotation) < 0.03


@pytest.mark.parametrize("angle_deg", [0, 30, 45, 80, 90, 120, 165])
def test_thin_oriented(angle_deg: float) -> None:
    """A straight step edge is one px wide and lies in the bin of its own direction."""
    angle = np.radians(angle_deg)
    y, x = np.mgrid[-20:21, -20:21]
    side = x * -np.sin(angle) + y * np.cos(angle)
    gradient = 20.0 * np.exp(-0.5 * (side / 1.5) ** 2)
    gx, gy = (np.ascontiguousarray(gradient * k, np.float32) for k in (-np.sin(angle), np.cos(angle)))
    directions = np.full((41, 41), NO_EDGE, np.uint8)
    for first, last in ((0, 17), (17, 41)):
        thin_oriented(gx, gy, np.float32(10.0), 8, first, last, directions)
    rows, columns = np.nonzero(directions != NO_EDGE)
    assert (directions[rows, columns] == int(np.floor(angle_deg / 22.5 + 0.5)) % 8).all()
    assert (np.abs(side[rows, columns]) <= 1.01).all()
    assert 30 <= len(rows) <= 80  # pairs on an exact diagonal


@pytest.mark.parametrize(("bins", "most_px"), [(8, 4.0), (16, 12.0), (3, 30.0)])
def test_distances_are_opencvs_for_each_direction(bins: int, most_px: float, rng: np.random.Generator) -> None:
    """To a fraction of a thousandth of a px for each step; an image of more than one slice."""
    directions = np.full((450, 240), NO_EDGE, np.uint8)
    assert len(list(bands(*directions.shape))) > 1
    some = rng.random(directions.shape) < 0.01
    directions[some] = rng.integers(0, bins, some.sum())
    found = finish(distances(directions, bins, most_px))
    slow = np.stack([cv2.distanceTransform((directions != k).astype(np.uint8), cv2.DIST_L2, 3) for k in range(bins)])
    assert found.shape == (bins, 450, 240)
    assert np.abs(found - np.minimum(slow, most_px)).max() < 1e-4 + 2e-4 * most_px
    assert found.max() == pytest.approx(min(slow.max(), most_px), abs=1e-2)
    near = finish(distances(directions, bins, most_px, per_bin_px=1.5))
    slow = np.minimum.reduce([np.roll(found, by, axis=0) + 1.5 * abs(by) for by in (-2, -1, 0, 1, 2)])
    assert np.allclose(near, slow, atol=1e-3)


@pytest.mark.parametrize("size", [(16, 16), (1, 30), (30, 1)])
def test_distances_without_an_edge(size: tuple[int, int]) -> None:
    found = finish(distances(np.full(size, NO_EDGE, np.uint8), 16, 12.0, 1.5))
    assert found.shape == (16, *size)
    assert (found == 12.0).all()


def test_spread_by_direction(rng: np.random.Generator) -> None:
    distance = rng.uniform(0.0, 4.0, (8, 20, 30)).astype(np.float32)
    response = rng.uniform(0.0, 1.0, distance.shape).astype(np.float32)
    near = 1.0 - distance / 4.0
    slow = response + np.maximum(near, 0.6 * np.maximum(np.roll(near, 1, axis=0), np.roll(near, -1, axis=0)))
    for first, last in ((0, 7), (7, 20)):
        spread_by_direction(distance, np.float32(4.0), np.float32(0.6), first, last, response)
    assert np.allclose(response, slow, atol=1e-6)


def test_strongest_gradients(rng: np.random.Generator) -> None:
    """Those of OpenCV's Scharr in each channel, of which the longest counts; in slices as in one go."""
    image = rng.integers(0, 255, (23, 31, 3)).astype(np.uint8)
    planes = cv2.split(cv2.copyMakeBorder(image, 1, 1, 1, 1, cv2.BORDER_REPLICATE))
    gx, gy = np.full((23, 31), np.nan, np.float32), np.full((23, 31), np.nan, np.float32)
    for first, last in ((0, 9), (9, 23)):
        strongest_gradients(*planes, np.float32(1 / 32), first, last, gx, gy)
    slow = [
        cv2.Scharr(image, cv2.CV_32F, *way, scale=1 / 32, borderType=cv2.BORDER_REPLICATE) for way in ((1, 0), (0, 1))
    ]
    channel = (slow[0] ** 2 + slow[1] ** 2).argmax(2)[..., None]
    assert np.allclose(gx, np.take_along_axis(slow[0], channel, 2)[..., 0], atol=1e-4)
    assert np.allclose(gy, np.take_along_axis(slow[1], channel, 2)[..., 0], atol=1e-4)


def test_nearness() -> None:
    distance = np.array([[0.0, 1.0, 2.0, 3.9, 4.0, 12.0]], np.float32)
    near = np.full((1, 6), 7, np.uint8)
    nearness(distance, np.float32(4.0), near)
    assert np.abs(near.astype(int) - 255 * np.maximum(1.0 - distance / 4.0, 0.0)).max() <= 0.5
    assert near[0, -2:].tolist() == [0, 0]


def test_keep_distinct(rng: np.random.Generator) -> None:
    count = 120
    centres = rng.uniform(-10, 10, (count, 3)).astype(np.float32)
    rotations = np.array([so3_exp(rng.normal(scale=0.2, size=3)) for _ in range(count)], np.float32)
    near, least_trace = 6.0, 1.0 + 2.0 * np.cos(0.3)
    slow = list[int]()
    for i in range(count):
        alike = (
            np.linalg.norm(centres[i] - centres[j]) < near and np.trace(rotations[i].T @ rotations[j]) > least_trace
            for j in slow
        )
        if not any(alike):
            slow.append(i)
    assert 10 < len(slow) < 110
    for most in (count, 9):
        kept, number = np.zeros(most, np.int64), 0
        for first in range(0, count, 32):
            last = min(first + 32, count)
            number = keep_distinct(
                centres, rotations, np.float32(near), np.float32(least_trace), first, last, most, kept, number
            )
        assert kept[:number].tolist() == slow[:most]
