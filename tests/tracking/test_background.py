"""How the camera turned, by what stands around the part: whatever else moves, and at no cost where nothing does."""

from __future__ import annotations

import math
from functools import lru_cache

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from acp_lab.geometry.arrays import ByteImage, FloatArray
from acp_lab.geometry.camera import Camera
from acp_lab.sequences.frame import Frame
from acp_lab.tracking.background import LONGEST_PX, Background, rotation_between, shifts_px

CAMERA = Camera(640, 512, 800.0, 800.0, 319.5, 255.5)
PART = 250, 180, 390, 330


@lru_cache(maxsize=4)
def ground(camera: Camera = CAMERA, seed: int = 0) -> ByteImage:
    """(h, w, 3) blotches of some px."""
    noise = np.random.default_rng(seed).normal(0.0, 1.0, (camera.height, camera.width))
    smooth = cv2.GaussianBlur(noise, (0, 0), 5.0 * camera.width / 640.0)
    grey = np.clip(120.0 + 45.0 * smooth / smooth.std(), 0, 255).astype(np.uint8)
    return np.repeat(grey[..., None], 3, 2)


def rotation(turn: FloatArray) -> FloatArray:
    return np.asarray(cv2.Rodrigues(np.asarray(turn, np.float64))[0])


def turned(image: ByteImage, turn: FloatArray, camera: Camera = CAMERA) -> ByteImage:
    """What a camera sees after a rotation vector (3,)."""
    moved = camera.matrix @ rotation(turn) @ np.linalg.inv(camera.matrix)
    return np.asarray(cv2.warpPerspective(image, moved, image.shape[1::-1], borderMode=cv2.BORDER_REFLECT), np.uint8)


def frame(image: ByteImage, number: int = 0, camera: Camera = CAMERA) -> Frame:
    return Frame(number, image, camera)


@given(st.integers(0, 10_000), st.floats(0.0, 0.1), st.floats(0.0, 0.4))
def test_most_rays_tell_the_rotation(seed: int, angle: float, outliers: float) -> None:
    rng = np.random.default_rng(seed)
    axis = rng.normal(size=3)
    turn = angle * axis / np.linalg.norm(axis)
    rays = CAMERA.rays(rng.uniform(0, 500, (60, 2)))
    after = rays @ rotation(turn).T
    wrong = rng.choice(60, int(outliers * 60), replace=False)
    after[wrong, :2] += rng.uniform(0.05, 0.2, (len(wrong), 1)) * np.array([1.0, -0.5])
    found = rotation_between(rays, after, CAMERA.fx)
    assert found is not None
    np.testing.assert_allclose(found, turn, atol=2e-4)


def rotation_by_singular_values(before: FloatArray, after: FloatArray, focal_px: float) -> FloatArray:
    """(3,) rotation vector, each round's fit by Kabsch (Acta Cryst. A32, 1976)."""
    before, after = (rays / np.linalg.norm(rays, axis=1, keepdims=True) for rays in (before, after))
    way = after - before
    off_px = focal_px * np.linalg.norm(way - np.median(way, axis=0), axis=1)
    weights, vector = (off_px <= max(3.0, 2.0 * np.median(off_px))).astype(float), np.zeros(3)
    for number in range(6):
        u, _, vt = np.linalg.svd((after * weights[:, None]).T @ before)
        fit = u @ np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt))]) @ vt
        off_px = focal_px * np.linalg.norm(after - before @ fit.T, axis=1)
        vector = cv2.Rodrigues(fit)[0].ravel()
        within_px = max(3.0, 0.25 * focal_px * np.linalg.norm(vector))
        reach = max(within_px, 2.5 * np.median(off_px)) if number < 3 else within_px
        weights = np.maximum(1.0 - (off_px / reach) ** 2, 0.0) ** 2
    return vector


@given(st.integers(0, 10_000), st.floats(0.0, 0.4), st.floats(0.0, 0.4))
def test_the_fit_is_that_of_a_slow_twin(seed: int, angle: float, outliers: float) -> None:
    rng = np.random.default_rng(seed)
    axis = rng.normal(size=3)
    rays = CAMERA.rays(rng.uniform(0, 500, (41, 2)))
    after = rays @ rotation(angle * axis / np.linalg.norm(axis)).T + rng.normal(0.0, 0.5 / CAMERA.fx, (41, 3))
    after[: int(outliers * 41)] += rng.uniform(-0.2, 0.2, (int(outliers * 41), 3))
    found = rotation_between(rays, after, CAMERA.fx)
    if found is not None:
        np.testing.assert_allclose(found, rotation_by_singular_values(rays, after, CAMERA.fx), atol=1e-8)


@pytest.mark.parametrize("count", [0, 1, 2, 12])
def test_rays_that_are_one_and_the_same_break_nothing(count: int) -> None:
    rays = np.tile([[0.1, -0.2, 1.0]], (count, 1))
    found = rotation_between(rays, rays, CAMERA.fx)
    assert found is None if count < 12 else np.isfinite(found).all()


@pytest.mark.parametrize("value", [0.0, np.nan, np.inf])
def test_what_is_no_ray_tells_nothing(value: float) -> None:
    rays = CAMERA.rays(np.random.default_rng(0).uniform(0, 500, (40, 2)))
    wrong = rays.copy()
    wrong[3] = value
    assert rotation_between(rays, rays, CAMERA.fx) is not None
    assert rotation_between(rays, wrong, CAMERA.fx) is None


def test_rays_that_go_anywhere_tell_nothing() -> None:
    rng = np.random.default_rng(1)
    rays = CAMERA.rays(rng.uniform(0, 500, (60, 2)))
    assert rotation_between(rays, rays + rng.uniform(-0.1, 0.1, rays.shape), CAMERA.fx) is None


def test_nobody_knows_in_the_first_frame_nor_without_corners() -> None:
    background = Background()
    assert background.turn(frame(ground()), PART) is None
    background.forget()
    plain = np.full((512, 640, 3), 90, np.uint8)
    assert background.turn(frame(plain), PART) is None
    assert background.turn(frame(plain), PART) is None
    assert background.turn(frame(plain), None) is None


@pytest.mark.parametrize("size", [(320, 256), (640, 512), (1224, 1024)])
def test_the_turn_is_found(size: tuple[int, int]) -> None:
    width, height = size
    camera = Camera(width, height, 1.3 * width, 1.3 * width, 0.5 * width - 3.0, 0.5 * height + 2.0)
    background, total = Background(), np.zeros(3)
    rng = np.random.default_rng(0)
    background.turn(frame(ground(camera), 0, camera), None)
    for number in range(1, 8):
        turn = rng.uniform(-0.03, 0.03, 3)
        total = cv2.Rodrigues(rotation(turn) @ rotation(total))[0].ravel()
        found = background.turn(frame(turned(ground(camera), total, camera), number, camera), None)
        assert found is not None
        # To half a pixel of the picture in which corners are followed.
        assert camera.fx * np.linalg.norm(found - turn) < 0.5 * max(1.0, width / LONGEST_PX)


def test_a_still_picture_is_still_whatever_its_light_and_noise() -> None:
    background, rng = Background(), np.random.default_rng(0)
    background.turn(frame(ground()), PART)
    for number in range(1, 6):
        noisy = ground() * rng.uniform(0.8, 1.0) + rng.normal(0.0, 3.0, ground().shape)
        found = background.turn(frame(noisy.clip(0, 255).astype(np.uint8), number), PART)
        np.testing.assert_array_equal(found, np.zeros(3))


@pytest.mark.parametrize("small_px", [0.05, 0.17, 0.28])
@pytest.mark.parametrize("width", [640, 1920])
def test_a_slow_turn_is_none(small_px: float, width: int) -> None:
    """It has no jerks, and seen only when enough has added up it would seem to have some."""
    camera = Camera(width, width * 4 // 5, 1.3 * width, 1.3 * width, 0.5 * width, 0.4 * width)
    background, per_frame = Background(), small_px * math.ceil(width / LONGEST_PX) / camera.fx
    background.turn(frame(ground(camera), 0, camera), None)
    for number in range(1, 13):
        image = turned(ground(camera), np.array([0.0, number * per_frame, 0.0]), camera)
        np.testing.assert_array_equal(background.turn(frame(image, number, camera), None), np.zeros(3))


def test_a_jerk_after_long_rest_is_one() -> None:
    background, turn = Background(), np.array([0.0, 0.02, 0.0])
    background.turn(frame(ground()), None)
    for number in range(1, 10):
        background.turn(frame(ground(), number), None)
    np.testing.assert_allclose(background.turn(frame(turned(ground(), turn), 10), None), turn, atol=1.0 / CAMERA.fx)


def test_what_moves_beside_the_camera_does_not_matter() -> None:
    """The part's corners are left out, and those of other things are outliers."""
    other, turn = ground(seed=1), np.array([0.008, -0.01, 0.004])
    x0, y0, x1, y1 = PART

    def seen(number: int) -> ByteImage:
        image = turned(ground(), number * turn).copy()
        image[y0:y1, x0:x1] = other[y0 + 9 * number : y1 + 9 * number, x0:x1]
        image[:120, :200] = other[:120, 40 + 12 * number : 240 + 12 * number]
        return image

    background = Background()
    background.turn(frame(seen(0)), PART)
    for number in range(1, 5):
        found = background.turn(frame(seen(number), number), PART)
        assert found is not None
        assert CAMERA.fx * np.linalg.norm(found - turn) < 1.0


def test_whoever_gave_the_image_may_write_into_it() -> None:
    background, buffer, turn = Background(), ground().copy(), np.array([0.0, 0.02, 0.0])
    background.turn(frame(buffer), None)
    buffer[:] = turned(ground(), turn)
    found = background.turn(frame(buffer, 1), None)
    np.testing.assert_allclose(found, turn, atol=1.0 / CAMERA.fx)


@pytest.mark.parametrize("size", [(320, 256), (960, 768)])
def test_another_size_begins_anew(size: tuple[int, int]) -> None:
    """Whatever small picture corners are followed in: it may be as large."""
    background, other = Background(), CAMERA.resized(*size)
    background.turn(frame(ground()), PART)
    assert background.turn(frame(ground(other), 1, other), None) is None
    for number in range(2, 4):
        np.testing.assert_array_equal(background.turn(frame(ground(other), number, other), None), np.zeros(3))
    assert background._step == math.ceil(size[0] / LONGEST_PX)


# ---- patches -------------------------------------------------------------------------------------------------


def shifts_of(small: ByteImage, places: np.ndarray, looks: np.ndarray) -> list[float]:
    """The slow twin."""
    found, half = [], looks.shape[1] // 2
    for (x, y), look in zip(places, looks.astype(np.float64), strict=True):
        change = (small[y - half : y + half + 1, x - half : x + half + 1] - look)[1:-1, 1:-1]
        down, across = (slope[1:-1, 1:-1] for slope in np.gradient(look))
        inner = look[1:-1, 1:-1]
        change, down, across, inner = (part - part.mean() for part in (change, down, across, inner))
        slopes = np.stack([across.ravel(), down.ravel()], 1)
        matrix = slopes.T @ slopes
        determinant = np.linalg.det(matrix) + 1e-3
        moved_px = np.array([[matrix[1, 1], -matrix[0, 1]], [-matrix[0, 1], matrix[0, 0]]]) @ slopes.T @ change.ravel()
        far = np.square(change).sum() > 0.5 * np.square(inner).sum()
        found.append(np.inf if far else float(np.linalg.norm(moved_px / determinant)))
    return found


def test_patches_have_moved_as_their_slow_twin_says() -> None:
    places = np.random.default_rng(0).integers(10, np.array([630, 500]), (40, 2))
    around = np.arange(-4, 5)
    looks = ground()[..., 1][places[:, 1][:, None, None] + around[:, None], places[:, 0][:, None, None] + around]
    for turn in (np.zeros(3), np.array([0.0, 0.3 / CAMERA.fx, 0.0]), np.array([0.05, 0.02, 0.1])):
        small = np.ascontiguousarray(turned(ground(), turn)[..., 1])
        found = shifts_px(small, places, np.ascontiguousarray(looks))
        np.testing.assert_allclose(found, shifts_of(small, places, looks), rtol=1e-6, atol=1e-9)
    assert np.isinf(found).mean() > 0.5
