"""Searches along normals: sub-pixel positions, signs, borders, and the fast search against a slow twin."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import norm

from acp_lab.errors import TrackingError
from acp_lab.geometry.arrays import ByteImage, FloatArray
from acp_lab.imaging.edge_search import (
    AS_THEY_ARE,
    Candidates,
    ImagePatch,
    SearchConfig,
    half_widths,
    image_patch,
    search_along_normals,
)
from acp_lab.imaging.edge_search_kernel import FLANK_PX

CONFIG = AS_THEY_ARE
# As `acp` searches.
ACP = SearchConfig()
WIDTH, HEIGHT = 64, 48


def half_plane(
    at: FloatArray, normal: FloatArray, low: float = 60.0, high: float = 180.0, blur_px: float = 0.0,
    smear_px: float = 0.0,
) -> ByteImage:  # fmt: skip
    """An image that is bright where normal . (x - at) > 0; pixels on the edge have the mean light of what they cover.

    blur_px: standard deviation of where the edge was while it was exposed; smear_px: or how far it moved, evenly.
    """
    fine = 16
    y, x = np.mgrid[0 : HEIGHT * fine, 0 : WIDTH * fine]
    x, y = (x + 0.5) / fine - 0.5, (y + 0.5) / fine - 0.5
    off = normal[0] * (x - at[0]) + normal[1] * (y - at[1])
    bright = np.clip(off / smear_px + 0.5, 0.0, 1.0) if smear_px else norm.cdf(off, scale=max(blur_px, 1e-9))
    dark_light, bright_light = (255.0 * (grey / 255.0) ** CONFIG.gamma for grey in (low, high))
    light = dark_light + (bright_light - dark_light) * bright.reshape(HEIGHT, fine, WIDTH, fine).mean((1, 3))
    grey = 255.0 * (light / 255.0) ** (1.0 / CONFIG.gamma)
    return np.repeat(np.round(grey).astype(np.uint8)[..., None], 3, 2)


def whole(image: ByteImage, config: SearchConfig = CONFIG) -> ImagePatch:
    return image_patch(image, (0, 0, image.shape[1], image.shape[0]), config)


def best_offset(candidates: Candidates, row: int = 0) -> float:
    return float(candidates.offsets[row, candidates.scores[row].argmax()])


# ---- known edges ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("angle_deg", [0.0, 20.0, 90.0, 135.0, 250.0])
@pytest.mark.parametrize("offset", [-6.3, -0.5, 0.0, 0.26, 4.75])
def test_a_step_edge_is_found_to_a_tenth_of_a_pixel(angle_deg: float, offset: float) -> None:
    normal = np.array([np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))])
    at = np.array([31.3, 23.6])
    image = half_plane(at, normal)
    found = search_along_normals(whole(image), (at - offset * normal)[None], normal[None], 10, CONFIG)
    assert best_offset(found) == pytest.approx(offset, abs=0.1)
    best = found.scores[0].argmax()
    # 120 grey levels behind a blur of 1 px (and the pixel's own) rise by some 45 per px at the steepest.
    assert 30.0 < found.gradients[0, best] < 50.0
    assert found.scores[0, best] > 0.95
    assert found.before[0, best] == pytest.approx(60.0, abs=3.0)
    assert found.after[0, best] == pytest.approx(180.0, abs=3.0)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_blurred_edge_is_found_in_its_middle(sign: float) -> None:
    """In linear light; encoded grey is steepest towards the dark side, wherever that is."""
    at, normal = np.array([31.3, 23.6]), np.array([sign, 0.0])
    image = half_plane(at, normal, 20.0, 220.0, blur_px=3.0)
    offsets = {}
    for gamma in (1.0, CONFIG.gamma):
        patch = whole(image, replace(CONFIG, gamma=gamma))
        found = search_along_normals(patch, at[None], normal[None], 10, CONFIG)
        offsets[gamma] = best_offset(found)
    assert abs(offsets[CONFIG.gamma]) < 0.1
    assert offsets[1.0] < -1.0


@pytest.mark.parametrize("angle_deg", [0.0, 20.0, 135.0])
def test_a_smeared_edge_is_found_in_its_middle_where_the_smear_is_known(angle_deg: float) -> None:
    normal = np.array([np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))])
    at, tangent = np.array([31.3, 23.6]), np.array([-normal[1], normal[0]])
    noise = np.random.default_rng(3).normal(0.0, 3.0, (HEIGHT, WIDTH, 1))
    image = np.clip(half_plane(at, normal, 40.0, 200.0, smear_px=11.0) + noise, 0, 255).astype(np.uint8)
    points, normals = at + np.linspace(-9, 9, 19)[:, None] * tangent, np.repeat(normal[None], 19, 0)
    away = {}
    for smear_px in (0.0, 11.0, 8.0):
        found = search_along_normals(whole(image), points, normals, 8, CONFIG, np.full(19, smear_px))
        away[smear_px] = np.abs(found.offsets[np.arange(19), found.scores.argmax(1)])
    # All over the smear the slope is the same, but for noise.
    assert np.median(away[0.0]) > 1.2
    assert np.median(away[11.0]) < 0.4
    assert away[11.0].max() < 1.2
    assert np.median(away[8.0]) < 0.8  # nearly right is nearly as good


def test_no_smear_is_the_same_as_none_known() -> None:
    at, normal = np.array([31.3, 23.6]), np.array([0.6, 0.8])
    patch = whole(half_plane(at, normal))
    plain, known = (search_along_normals(patch, at[None], normal[None], 8, CONFIG, b) for b in (None, np.array([1.9])))
    for name, values in vars(plain).items():
        np.testing.assert_array_equal(values, getattr(known, name))


def test_a_smear_of_any_length_is_averaged_within_limits() -> None:
    halves = half_widths(np.array([0.0, 1.9, 2.0, -7.5, 23.0, 1e9]))
    np.testing.assert_array_equal(halves, [0, 0, 1, 3, 11, 12])


def test_the_grey_beside_a_smeared_edge_is_read_beyond_the_smear() -> None:
    at, normal = np.array([31.3, 23.6]), np.array([1.0, 0.0])
    patch = whole(half_plane(at, normal, 60.0, 180.0, smear_px=12.0))
    found = search_along_normals(patch, at[None], normal[None], 8, CONFIG, np.array([12.0]))
    best = found.scores[0].argmax()
    assert found.before[0, best] == pytest.approx(60.0, abs=3.0)
    assert found.after[0, best] == pytest.approx(180.0, abs=3.0)


def test_the_sign_of_the_gradient_turns_with_the_normal() -> None:
    at, normal = np.array([31.3, 23.6]), np.array([1.0, 0.0])
    patch = whole(half_plane(at, normal))
    there, back = (search_along_normals(patch, at[None], s * normal[None], 8, CONFIG) for s in (1.0, -1.0))
    first, second = there.scores[0].argmax(), back.scores[0].argmax()
    assert there.gradients[0, first] == pytest.approx(-back.gradients[0, second], rel=0.02)
    assert there.before[0, first] == pytest.approx(back.after[0, second], abs=3.0)


def test_an_edge_along_the_normal_scores_nothing() -> None:
    at, normal = np.array([31.3, 23.6]), np.array([1.0, 0.0])
    patch = whole(half_plane(at, normal))
    across = search_along_normals(patch, at[None], np.array([[0.0, 1.0]]), 8, CONFIG)
    assert across.scores.max() < 0.01
    slanted = search_along_normals(patch, at[None], np.array([[np.sqrt(0.5), np.sqrt(0.5)]]), 8, CONFIG)
    assert 0.3 < slanted.scores.max() < 0.55  # the squared cosine of 45 degrees is a half


def test_contrast_decides_the_score() -> None:
    at, normal = np.array([31.3, 23.6]), np.array([1.0, 0.0])
    scores = [
        search_along_normals(whole(half_plane(at, normal, 100.0, 100.0 + step)), at[None], normal[None], 8, CONFIG)
        .scores[0]
        .max()
        for step in (4.0, 16.0, 120.0)
    ]
    assert scores == sorted(scores)
    # 6 grey levels per px are worth a half; a step of 16 rises by about 6.
    assert scores[1] == pytest.approx(0.5, abs=0.1)


def test_two_edges_of_a_bar_are_both_found() -> None:
    image = np.full((HEIGHT, WIDTH, 3), 50, np.uint8)
    image[:, 25:35] = 200  # from 24.5 to 34.5
    found = search_along_normals(whole(image), np.array([[30.0, 20.0]]), np.array([[1.0, 0.0]]), 12, CONFIG)
    strong = found.scores[0] > 0.5
    np.testing.assert_allclose(np.sort(found.offsets[0][strong]), [-5.5, 4.5], atol=0.1)
    assert set(np.sign(found.gradients[0][strong])) == {-1.0, 1.0}


# ---- where there is nothing ----------------------------------------------------------------------------------


def test_a_uniform_image_has_no_candidates() -> None:
    patch = whole(np.full((HEIGHT, WIDTH, 3), 90, np.uint8))
    found = search_along_normals(patch, np.array([[30.0, 20.0], [0.0, 0.0]]), np.array([[1.0, 0.0]] * 2), 10, CONFIG)
    assert found.scores.max() == 0.0
    assert np.isfinite(found.offsets).all()


@pytest.mark.parametrize("normal", [(1.0, 0.0), (0.0, -1.0), (-0.6, 0.8)], ids=str)
@pytest.mark.parametrize("point", [(0.0, 20.0), (WIDTH - 1.0, 20.0), (30.0, 0.0), (-3.0, -3.0), (500.0, 1e5)], ids=str)
def test_the_image_border_is_no_edge(point: tuple[float, float], normal: tuple[float, float]) -> None:
    patch = whole(np.full((HEIGHT, WIDTH, 3), 200, np.uint8))
    found = search_along_normals(patch, np.array([point]), np.array([normal]), 12, CONFIG)
    assert found.scores.max() == 0.0
    for values in vars(found).values():
        assert np.isfinite(values).all()


def test_an_edge_near_the_border_keeps_its_place() -> None:
    at, normal = np.array([2.2, 20.0]), np.array([1.0, 0.0])
    found = search_along_normals(whole(half_plane(at, normal)), np.array([[5.0, 20.0]]), normal[None], 10, CONFIG)
    assert best_offset(found) == pytest.approx(-2.8, abs=0.1)


def test_no_points_give_no_candidates() -> None:
    found = search_along_normals(
        whole(half_plane(np.ones(2), np.ones(2))), np.zeros((0, 2)), np.zeros((0, 2)), 5, CONFIG
    )
    for values in vars(found).values():
        assert values.shape == (0, 3)


# ---- patches -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("box", "origin", "size"),
    [
        ((10, 5, 30, 25), (10, 5), (20, 20)),
        ((-5, -7, 20, 10), (0, 0), (20, 10)),
        ((50, 40, 500, 500), (50, 40), (WIDTH - 50, HEIGHT - 40)),
        ((-9000, -9000, 9000, 9000), (0, 0), (WIDTH, HEIGHT)),
        ((1000, 20, 1010, 30), (WIDTH - 2, 20), (2, 10)),
        ((-50, 20, -40, 30), (0, 20), (2, 10)),
    ],
    ids=str,
)
def test_a_patch_is_cut_to_the_image(
    box: tuple[int, int, int, int], origin: tuple[int, int], size: tuple[int, int]
) -> None:
    patch = image_patch(half_plane(np.array([30.0, 20.0]), np.array([1.0, 0.0])), box)
    assert patch.origin == origin
    assert patch.channels.shape == (size[1], size[0], 3)
    assert patch.channels.dtype == np.float32


@pytest.mark.parametrize("gamma", [1.0, 1.8])
def test_gradients_are_levels_of_light_per_pixel(gamma: float) -> None:
    ramp = np.tile((3 * np.arange(WIDTH)).astype(np.uint8), (HEIGHT, 1))
    patch = whole(np.repeat(ramp[..., None], 3, 2), replace(CONFIG, gamma=gamma))
    channels = patch.channels[10:-10, 10:-10]
    expected = 3.0 * gamma * (ramp[10:-10, 10:-10] / 255.0) ** (gamma - 1.0)
    np.testing.assert_allclose(channels[..., 0], expected, atol=0.05)
    np.testing.assert_allclose(channels[..., 1], 0.0, atol=0.05)
    np.testing.assert_allclose(channels[..., 2], ramp[10:-10, 10:-10], atol=0.05)
    # What a search reports of an edge are grey levels again.
    step = whole(half_plane(np.array([31.3, 23.6]), np.array([1.0, 0.0])), replace(CONFIG, gamma=gamma))
    found = search_along_normals(step, np.array([[31.3, 23.6]]), np.array([[1.0, 0.0]]), 5, CONFIG)
    assert found.gradients[0, 0] == pytest.approx(40.0, rel=0.15)


def test_a_patch_and_the_whole_image_say_the_same() -> None:
    at, normal = np.array([31.3, 23.6]), np.array([0.8, 0.6])
    image = half_plane(at, normal)
    inner = image_patch(image, (12, 6, 52, 42), CONFIG)
    first, second = (search_along_normals(patch, at[None], normal[None], 6, CONFIG) for patch in (whole(image), inner))
    assert best_offset(first) == pytest.approx(best_offset(second), abs=1e-3)


# ---- the slow twin -------------------------------------------------------------------------------------------


def bilinear(channels: FloatArray, x: float, y: float) -> FloatArray:
    """Value between four pixels, 0 outside."""
    height, width = channels.shape[:2]
    left, top = int(np.floor(x)), int(np.floor(y))
    value = np.zeros(3)
    for row, share_y in ((top, top + 1 - y), (top + 1, y - top)):
        for column, share_x in ((left, left + 1 - x), (left + 1, x - left)):
            if 0 <= row < height and 0 <= column < width:
                value += share_y * share_x * channels[row, column]
    return value


def search_one_by_one(patch: ImagePatch, point: FloatArray, normal: FloatArray, reach: int) -> list[tuple[float, ...]]:
    """(offset, score, gradient, before, after) of every peak along one normal, the strongest first."""
    values = {}
    for step in range(-reach - FLANK_PX, reach + FLANK_PX + 1):
        x, y = point + step * normal - patch.origin
        values[step] = bilinear(patch.channels, float(x), float(y))
    along = {step: float(value[:2] @ normal) for step, value in values.items()}
    peaks = []
    for step in range(-reach, reach + 1):
        left, here, right = (abs(along[step + k]) for k in (-1, 0, 1))
        if not (here > left and here >= right):
            continue
        squared_cosine = here**2 / (float(values[step][:2] @ values[step][:2]) + 1e-6)
        encoded = (max(float(values[step][2]), 4.0) / 255.0) ** (1.0 - CONFIG.gamma) / CONFIG.gamma
        score = (encoded * here) ** 2 / ((encoded * here) ** 2 + CONFIG.contrast**2) * squared_cosine
        shift = 0.5 * (left - right) / min(left - 2.0 * here + right, -1e-6)
        before, after = float(values[step - FLANK_PX][2]), float(values[step + FLANK_PX][2])
        peaks.append((step + min(max(shift, -0.5), 0.5), score, encoded * along[step], before, after))
    return sorted(peaks, key=lambda peak: -peak[1])[: CONFIG.max_candidates]


@given(seed=st.integers(0, 10_000), reach=st.integers(2, 15))
def test_the_search_agrees_with_its_slow_twin(seed: int, reach: int) -> None:
    rng = np.random.default_rng(seed)
    coarse = rng.integers(0, 255, (12, 16, 3)).astype(np.uint8)
    image = cv2.resize(coarse, (WIDTH, HEIGHT), interpolation=cv2.INTER_CUBIC)
    patch = image_patch(image, (4, 3, 60, 45), CONFIG)
    points = rng.uniform([-2.0, -2.0], [WIDTH + 2.0, HEIGHT + 2.0], (4, 2))
    angles = rng.uniform(0.0, 2.0 * np.pi, 4)
    normals = np.stack([np.cos(angles), np.sin(angles)], 1)
    found = search_along_normals(patch, points, normals, reach, CONFIG)
    for row in range(4):
        slow = search_one_by_one(patch, points[row], normals[row], reach)
        # What scores next to nothing hangs on the last digit.
        slow = [peak for peak in slow if peak[1] > 0.02]
        order = np.argsort(-found.scores[row])
        order = order[found.scores[row, order] > 0.02]
        assert len(order) == len(slow)
        for peak in slow:
            if peak[1] < 0.1:
                continue
            nearest = order[np.abs(found.offsets[row, order] - peak[0]).argmin()]
            assert found.offsets[row, nearest] == pytest.approx(peak[0], abs=1e-3)
            assert found.scores[row, nearest] == pytest.approx(peak[1], abs=1e-3)
            # Read from a table, which in the darkest grey is 1% off between two levels.
            assert found.gradients[row, nearest] == pytest.approx(peak[2], rel=0.015, abs=1e-3)
            assert found.before[row, nearest] == pytest.approx(peak[3], abs=1e-2)
            assert found.after[row, nearest] == pytest.approx(peak[4], abs=1e-2)


# ---- faint pictures ------------------------------------------------------------------------------------------


def darkened(image: ByteImage, share: float) -> ByteImage:
    """With so much of the light."""
    light = share * (image / 255.0) ** ACP.gamma
    return np.round(255.0 * light ** (1.0 / ACP.gamma)).astype(np.uint8)


def chequered(low: float = 60.0, high: float = 180.0) -> ByteImage:
    """Edges enough that a tenth of the pixels lie on some."""
    y, x = np.mgrid[0:HEIGHT, 0:WIDTH]
    grey = np.where((x // 12 + y // 12) % 2, low, high).astype(np.uint8)
    return np.repeat(grey[..., None], 3, 2)


def test_less_is_asked_of_the_edges_of_a_faint_picture() -> None:
    bright, dark = (whole(image, ACP) for image in (chequered(), darkened(chequered(40.0, 60.0), 0.3)))
    assert bright.steepness > ACP.faint_below > dark.steepness
    assert ACP.contrast_in(bright) == ACP.contrast
    share = dark.steepness / ACP.faint_below
    assert ACP.contrast_in(dark) == pytest.approx(ACP.contrast * share**2)
    at, normal = np.array([[23.5, 17.5]]), np.array([[1.0, 0.0]])
    scores = {
        below: search_along_normals(dark, at, normal, 4, replace(ACP, faint_below=below)).scores.max()
        for below in (0.0, ACP.faint_below)
    }
    assert scores[ACP.faint_below] > 1.5 * scores[0.0] > 0.0


def test_something_is_asked_of_a_picture_without_edges() -> None:
    flat = whole(np.full((HEIGHT, WIDTH, 3), 90, np.uint8), ACP)
    assert flat.steepness == pytest.approx(0.0, abs=1e-3)
    assert ACP.contrast_in(flat) == pytest.approx(0.25 * ACP.contrast)
    assert replace(ACP, faint_below=0.0).contrast_in(flat) == ACP.contrast


@given(seed=st.integers(0, 1000), gamma=st.sampled_from([1.0, ACP.gamma]))
def test_steepness_is_a_quantile_of_the_gradients(seed: int, gamma: float) -> None:
    """In grey levels, whatever the light is taken for: its twin takes the gradient of every pixel."""
    rng = np.random.default_rng(seed)
    coarse = rng.integers(30, 225, (12, 16, 3)).astype(np.uint8)
    patch = whole(
        np.asarray(cv2.resize(coarse, (256, 192), interpolation=cv2.INTER_CUBIC)), replace(AS_THEY_ARE, gamma=gamma)
    )
    smooth = np.asarray(patch.channels[..., 2], np.float64)
    by_grey = np.gradient(smooth)
    assert patch.steepness == pytest.approx(np.quantile(np.hypot(*by_grey), 0.9), rel=0.15)


@pytest.mark.parametrize("faint_below", [-1.0, 300.0, float("nan")])
def test_an_impossible_faintness_is_refused(faint_below: float) -> None:
    with pytest.raises(TrackingError, match=r"search\.faint_below = "):
        SearchConfig(faint_below=faint_below)


# ---- soft pictures -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("angle_deg", [0.0, 20.0, 135.0])
@pytest.mark.parametrize("blur_px", [0.0, 1.5, 2.5])
def test_a_step_edge_stays_where_it_is_however_much_it_is_sharpened(angle_deg: float, blur_px: float) -> None:
    normal = np.array([np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))])
    at = np.array([31.3, 23.6])
    patch = whole(half_plane(at, normal, blur_px=blur_px), ACP)
    found = search_along_normals(patch, (at - 2.26 * normal)[None], normal[None], 6, ACP)
    assert best_offset(found) == pytest.approx(2.26, abs=0.12)
    plain = search_along_normals(whole(half_plane(at, normal, blur_px=blur_px)), at[None], normal[None], 6, CONFIG)
    assert found.gradients[0].max() > 1.2 * plain.gradients[0].max()


def test_sharpening_finds_both_edges_where_a_lens_made_one_of_them() -> None:
    """A groove of 4 px behind a blur of 2 px: its edges are found nearer to where they are."""
    left, right = 30.0, 34.0
    first, second = (
        half_plane(np.array([at, 24.0]), np.array([sign, 0.0]), 40.0, 200.0, blur_px=2.0).astype(int)
        for at, sign in ((left, -1.0), (right, 1.0))
    )
    image = np.clip(first + second - 40, 0, 255).astype(np.uint8)
    off = {}
    for config in (CONFIG, ACP):
        patch = image_patch(image, (0, 0, WIDTH, HEIGHT), config, lens_blur_px=2.0)
        found = search_along_normals(patch, np.array([[32.0, 24.0]]), np.array([[1.0, 0.0]]), 8, config)
        best = np.sort(found.offsets[0, np.argsort(-found.scores[0])[:2]])
        off[config] = np.abs(best - [left - 32.0, right - 32.0]).max()
    assert off[ACP] < 0.75 * off[CONFIG]


def test_greys_are_not_sharpened() -> None:
    """What lies beside an edge is asked of them; sharpened they overshoot."""
    image = half_plane(np.array([31.3, 23.6]), np.array([1.0, 0.0]), 20.0, 230.0)
    plain, sharp = whole(image), whole(image, ACP)
    np.testing.assert_array_equal(sharp.channels[..., 2], plain.channels[..., 2])
    assert np.abs(sharp.channels[..., 0]).max() > 1.2 * np.abs(plain.channels[..., 0]).max()


def test_a_camera_that_is_known_need_not_be_asked() -> None:
    """Its blur is what the image itself tells where nobody says."""
    image = half_plane(np.array([31.3, 23.6]), np.array([1.0, 0.0]), blur_px=1.8)
    box = 0, 0, image.shape[1], image.shape[0]
    asked = image_patch(image, box, ACP)
    told = image_patch(image, box, ACP, asked.edge_blur_px)
    np.testing.assert_array_equal(told.channels, asked.channels)
    steepest = [np.abs(image_patch(image, box, ACP, px).channels[..., 0]).max() for px in (0.0, 1.5, 2.5)]
    assert steepest[0] < steepest[1] < steepest[2]


@pytest.mark.parametrize("sharpening", [-0.5, 20.0, float("nan")])
def test_an_impossible_sharpening_is_refused(sharpening: float) -> None:
    with pytest.raises(TrackingError, match=r"search\.sharpening = "):
        SearchConfig(sharpening=sharpening)
