"""Profiles of image edges: what is read of them, what the network makes of it, and that the shipped one is worth it."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
import torch

from acp_lab.cad.edges import facing, sample_edges, visible_samples
from acp_lab.cad.raycast import make_caster
from acp_lab.control_points.canonical_frame import eye_position
from acp_lab.errors import TrackingError
from acp_lab.generator.base import GeneratedEdges, VisibleSamples, project_samples
from acp_lab.geometry.arrays import Float32Array, FloatArray
from acp_lab.geometry.camera import Camera
from acp_lab.geometry.pose import transform
from acp_lab.imaging.edge_search import (
    AS_THEY_ARE,
    Candidates,
    ImagePatch,
    SearchConfig,
    image_patch,
    search_along_normals,
)
from acp_lab.sequences.frame import Frame
from acp_lab.tracking.learning.edge_profiles import (
    FEATURES,
    EdgeProfiles,
    EdgeViews,
    ProfileConfig,
    ProfileNetwork,
    Profiles,
    ProfileShifts,
    describe,
    shipped_network,
)
from tests.made_parts import bracket, looking_at
from tests.prepared_sample import sample_model, sample_scene
from tests.tracking.rendered import CAMERA, draw

LEAST, ANY_PX = 0.02, 1e6
PART = bracket()
EDGES = sample_edges(PART)
POSE = looking_at(PART, np.array([0.8, 0.6, 1.0]), 330.0, 0.3)


def network(hidden: int = 8, seed: int = 0, traits: int = 2) -> ProfileNetwork:
    rng = np.random.default_rng(seed)
    sizes = (FEATURES, hidden, hidden, 2 + traits)
    weights = tuple(rng.normal(0, 0.3, pair).astype(np.float32) for pair in pairwise(sizes))
    biases = tuple(rng.normal(0, 0.1, size).astype(np.float32) for size in sizes[1:])
    mean, scale = rng.normal(0, 0.2, FEATURES), rng.uniform(0.5, 2.0, FEATURES)
    return ProfileNetwork(weights, biases, mean.astype(np.float32), scale.astype(np.float32))


def seen_at(pose: FloatArray, camera: Camera = CAMERA) -> tuple[GeneratedEdges, EdgeViews]:
    eye_obj = eye_position(pose)
    ids = np.flatnonzero(visible_samples(EDGES, make_caster(PART), eye_obj, 0.002 * PART.diameter))[:150]
    outline = facing(EDGES, eye_obj).outline[ids]
    edges = project_samples(EDGES, VisibleSamples(ids, outline, np.ones(len(ids))), pose, camera)
    return edges, EdgeViews(EDGES, ids, outline, pose, camera.fx, 1.0)


def searched(image: np.ndarray, edges: GeneratedEdges, normals: FloatArray) -> tuple[ImagePatch, Candidates]:
    patch = image_patch(image, (0, 0, image.shape[1], image.shape[0]), AS_THEY_ARE)
    return patch, search_along_normals(patch, edges.points, normals, 6, SearchConfig())


@pytest.fixture(scope="module")
def image() -> np.ndarray:
    return np.asarray(draw([(PART, POSE)], 3))


# ---- what is read --------------------------------------------------------------------------------------------


def bilinear(channels: np.ndarray, x: float, y: float) -> np.ndarray:
    """(3,) of (h, w, 3), 0 outside."""
    found = np.zeros(3)
    for row in (int(np.floor(y)), int(np.floor(y)) + 1):
        for column in (int(np.floor(x)), int(np.floor(x)) + 1):
            if 0 <= row < channels.shape[0] and 0 <= column < channels.shape[1]:
                found += (1 - abs(x - column)) * (1 - abs(y - row)) * channels[row, column]
    return found


def plain_features(
    patch: ImagePatch, point: FloatArray, normal: FloatArray, offset: float, score: float, views: EdgeViews, i: int,
    smear_px: float = 0.0,
) -> tuple[float, FloatArray]:  # fmt: skip
    """Side and features of one candidate, in words of geometry."""
    turn, sample = views.cam_T_obj[:3, :3], views.ids[i]
    point_cam = transform(views.cam_T_obj, views.edges.points_obj[sample][None])[0]
    eye = -point_cam / np.linalg.norm(point_cam)
    across = np.array([*normal, 0.0])
    across = across - (across @ eye) * eye
    across /= np.linalg.norm(across)
    axes = np.stack([across, eye, np.cross(eye, across)])
    first, second = sorted(views.edges.normals_obj[sample] @ turn.T, key=lambda face: -float(face @ eye))
    towards = (first + second) @ across if views.outline[i] else (second - first) @ across
    side = -1.0 if towards < 0 else 1.0
    half = int(smear_px / 2)
    places = [point - patch.origin + (offset + side * k) * normal for k in range(-5 - half, 6 + half)]
    read = np.array([bilinear(patch.channels.astype(np.float64), *place) for place in places])
    slopes = np.array([read[k : k + 2 * half + 1, :2].mean(0) for k in range(11)])
    along = side * slopes @ normal
    beside = slopes @ np.array([-normal[1], normal[0]])
    light = np.log((np.clip(read[:, 2], 0, 255) / 255) ** patch.gamma + 0.02)[[2, -3, 0, -1]]
    peak, sign = abs(along[5]) + 1e-3, -1.0 if along[5] < 0 else 1.0
    turned = np.array([side, 1.0, side])
    features = [
        *np.clip(sign * along / peak, -3, 3),
        *np.minimum(np.abs(beside[1::2]) / peak, 2),
        np.log(peak), sign, *light,
        np.log(views.focal_px / point_cam[2]), score,
        *(turned * (axes @ first)), *(turned * (axes @ second)),
        views.outline[i], views.edges.crease[sample], views.edges.convex[sample], first @ second, *(side * normal),
        np.log(1.0 + smear_px),
    ]  # fmt: skip
    return side, np.array(features, np.float64)


@pytest.mark.parametrize("smeared", [False, True])
def test_features_are_those_of_the_plain_twin(image: np.ndarray, smeared: bool) -> None:
    edges, views = seen_at(POSE)
    patch, candidates = searched(image, edges, edges.normals)
    blur_px = np.linspace(0.0, 9.0, len(edges)) if smeared else np.zeros(len(edges))
    found = describe(
        patch, edges.points, edges.normals, candidates, views, ANY_PX, LEAST, blur_px if smeared else None
    )  # fmt: skip
    assert len(found.rows) == (candidates.scores > LEAST).sum() > 100
    assert found.features.shape == (len(found.rows), FEATURES)
    for k in range(0, len(found.rows), 7):
        i, m = found.rows[k], found.columns[k]
        side, features = plain_features(
            patch, edges.points[i], edges.normals[i], candidates.offsets[i, m], candidates.scores[i, m], views, int(i),
            float(blur_px[i]),
        )
        assert found.sides[i] == side
        # The gradients are single precision, and are divided by the edge's own; light is read from a table.
        np.testing.assert_allclose(found.features[k], features, atol=3e-3)


def by_place(edges: GeneratedEdges, normals: FloatArray, candidates: Candidates, found: Profiles) -> Float32Array:
    """Features in the order of the places of their candidates."""
    places = edges.points[found.rows] + candidates.offsets[found.rows, found.columns, None] * normals[found.rows]
    return np.asarray(found.features[np.lexsort((*np.round(places, 4).T, found.rows))])


def test_which_way_the_normal_points_changes_nothing(image: np.ndarray) -> None:
    edges, views = seen_at(POSE)
    both = []
    for normals in (edges.normals, -edges.normals):
        patch, candidates = searched(image, edges, normals)
        # Six candidates at most: where there are more, equal scores may fall either way.
        found = describe(patch, edges.points, normals, candidates, views, ANY_PX, 0.3)
        both.append(by_place(edges, normals, candidates, found))
    assert len(both[0]) > 100
    np.testing.assert_allclose(*both, atol=1e-3)


def test_a_mirrored_picture_reads_alike(image: np.ndarray) -> None:
    edges, views = seen_at(POSE)
    width = image.shape[1]
    mirror = np.array([-1.0, 1.0])
    mirrored = GeneratedEdges(
        np.array([width - 1.0, 0.0]) + mirror * edges.points, mirror * edges.tangents, edges.weights, edges.sample_ids,
        edges.outline,
    )  # fmt: skip
    flip = np.diag([-1.0, 1.0, 1.0, 1.0])
    # The mirrored part, in an object frame that is mirrored, too.
    turned = replace(EDGES, points_obj=EDGES.points_obj @ flip[:3, :3], normals_obj=EDGES.normals_obj @ flip[:3, :3])
    other = replace(views, edges=turned, cam_T_obj=flip @ POSE @ flip)
    found = []
    for picture, points, normals, seen in (
        (image, edges, edges.normals, views),
        (np.ascontiguousarray(image[:, ::-1]), mirrored, mirror * edges.normals, other),
    ):
        patch, candidates = searched(picture, points, normals)
        profiles = describe(patch, points.points, normals, candidates, seen, ANY_PX, 0.3)
        features = profiles.features[np.lexsort((candidates.offsets[profiles.rows, profiles.columns], profiles.rows))]
        found.append(np.array(features))
    assert len(found[0]) > 100
    # Along the edge there is no side, so what lies along it changes its sign in a mirror; and so does x in the image.
    along, x = [FEATURES - 13 + 2, FEATURES - 13 + 5], FEATURES - 3
    found[1][:, along] *= -1.0
    found[1][:, x] *= -1.0
    np.testing.assert_allclose(*found, atol=2e-3)


# ---- what the network makes of it ----------------------------------------------------------------------------


def test_far_candidates_are_left_out(image: np.ndarray) -> None:
    edges, views = seen_at(POSE)
    patch, candidates = searched(image, edges, edges.normals)
    near = describe(patch, edges.points, edges.normals, candidates, views, 1.0, LEAST)
    fits = candidates.scores * np.exp(-0.5 * candidates.offsets**2)
    np.testing.assert_array_equal(np.stack([near.rows, near.columns]), np.nonzero(fits > LEAST))
    assert 100 < len(near.rows) < (candidates.scores > LEAST).sum()


def test_the_network_is_that_of_torch() -> None:
    made = network()
    layers = []
    for weight, bias in zip(made.weights, made.biases, strict=True):
        layer = torch.nn.Linear(*weight.shape)
        layer.weight.data, layer.bias.data = torch.from_numpy(weight.T.copy()), torch.from_numpy(bias)
        layers += [layer, torch.nn.ReLU()]
    features = np.random.default_rng(1).normal(0, 3, (50, FEATURES)).astype(np.float32)
    inputs = torch.from_numpy((features - made.mean) * made.scale).clamp(-6, 6)
    with torch.no_grad():
        expected = torch.nn.Sequential(*layers[:-1])(inputs)
        expected[:, 1].clamp_(-4, 2)
    np.testing.assert_allclose(made(features), expected, rtol=1e-4, atol=1e-5)


def test_the_network_works_on_the_thread_that_asks(monkeypatch: pytest.MonkeyPatch) -> None:
    """OpenBLAS makes work for several threads of more than 64 ** 3 multiplications, and waits for the slowest."""
    asked, multiply = list[int](), np.matmul

    def counted(left: Float32Array, right: Float32Array, out: Float32Array) -> Float32Array:
        asked.append(len(left) * right.size)
        return multiply(left, right, out=out)

    features = np.random.default_rng(0).normal(size=(700, FEATURES)).astype(np.float32)
    whole = shipped_network()(features)
    monkeypatch.setattr(np, "matmul", counted)
    np.testing.assert_allclose(shipped_network()(features), whole)
    assert len(asked) > 2
    assert max(asked) <= 64**3
    one_by_one = np.concatenate([shipped_network()(row[None]) for row in features[::50]])
    np.testing.assert_allclose(one_by_one, whole[::50], atol=1e-4)


@pytest.mark.parametrize("value", [0.0, 1e30, -1e30])
def test_the_shipped_network_answers_whatever_it_is_shown(value: float) -> None:
    found = shipped_network()(np.full((3, FEATURES), value, np.float32))
    assert found.shape == (3, 2 + shipped_network().traits)
    assert np.isfinite(found).all()


def test_shifts_are_along_the_normals_and_limited(image: np.ndarray) -> None:
    edges, views = seen_at(POSE)
    patch, candidates = searched(image, edges, edges.normals)
    made = network()
    found = EdgeProfiles(ProfileConfig(largest_px=0.4, spread_share=0.5), made).read(
        patch, edges.points, edges.normals, candidates, views, ANY_PX, LEAST
    )
    profiles = describe(patch, edges.points, edges.normals, candidates, views, ANY_PX, LEAST)
    answers, at = made(profiles.features), (profiles.rows, profiles.columns)
    assert len(profiles.rows) % 4  # they are asked in fours
    shifts = np.clip(answers[:, 0], -0.4, 0.4) * profiles.sides[profiles.rows]
    np.testing.assert_allclose(found.shifts_px[at], shifts, rtol=1e-4, atol=1e-5)
    np.testing.assert_allclose(found.spreads_px[at], 0.5 * np.exp(answers[:, 1]), rtol=1e-4)
    unasked = np.ones_like(candidates.scores, bool)
    unasked[at] = False
    assert unasked.any()
    assert not found.shifts_px[unasked].any()
    assert not found.spreads_px[unasked].any()


def test_shifts_follow_the_traits(image: np.ndarray) -> None:
    edges, views = seen_at(POSE)
    patch, candidates = searched(image, edges, edges.normals)
    profiles = EdgeProfiles(ProfileConfig(largest_px=100.0), network())

    def shifts(traits: list[float]) -> ProfileShifts:
        profiles.traits.values = np.array(traits)
        return profiles.read(patch, edges.points, edges.normals, candidates, views, ANY_PX, LEAST)

    usual, other = shifts([0.0, 0.0]), shifts([0.3, -0.5])
    assert usual.slopes_px.shape == (*candidates.scores.shape, 2)
    assert np.abs(usual.slopes_px).max() > 0.1
    np.testing.assert_allclose(
        other.shifts_px, usual.shifts_px + usual.slopes_px @ np.array([0.3, -0.5]), rtol=1e-4, atol=1e-5
    )  # fmt: skip
    np.testing.assert_array_equal(other.spreads_px, usual.spreads_px)
    described = usual.spreads_px > 0.0
    assert not usual.slopes_px[~described].any()


def test_the_spread_of_a_sample_is_that_of_its_nearest_good_candidate(image: np.ndarray) -> None:
    edges, views = seen_at(POSE)
    patch, candidates = searched(image, edges, edges.normals)
    found = EdgeProfiles(ProfileConfig(), network()).read(
        patch, edges.points, edges.normals, candidates, views, ANY_PX, LEAST
    )  # fmt: skip
    offsets = candidates.offsets + found.shifts_px
    spread = found.spread_of_best(candidates.scores, offsets, 2.0)
    for i in range(0, len(edges), 10):
        fits = candidates.scores[i] * np.exp(-0.5 * (offsets[i] / 2.0) ** 2)
        assert spread[i] == found.spreads_px[i, int(fits.argmax())]


def test_nothing_is_asked_where_nothing_is_seen() -> None:
    edges, views = seen_at(POSE)
    patch, candidates = searched(np.zeros((CAMERA.height, CAMERA.width, 3), np.uint8), edges, edges.normals)
    found = EdgeProfiles(ProfileConfig()).read(patch, edges.points, edges.normals, candidates, views, ANY_PX, LEAST)
    assert not found.shifts_px.any()


# ---- what the shipped network is worth -----------------------------------------------------------------------


def test_edges_of_the_sample_lie_nearer_to_the_cads() -> None:
    """Its edges are broken by 0.25 mm. The training saw other pictures of its part, with sharp and broken edges."""
    scene, model = sample_scene(), sample_model()
    edges, caster, part = model.edges, make_caster(model.part), model.part
    before, after, outlines = [], [], []
    for index in (5, 20, 35):
        frame = next(each for each in scene.frames() if each.index == index)
        pose = scene.truth(index, 1)
        assert isinstance(frame, Frame)
        assert pose is not None
        eye_obj = eye_position(pose)
        ids = np.flatnonzero(visible_samples(edges, caster, eye_obj, 0.002 * part.diameter))[:600]
        seen = VisibleSamples(ids, facing(edges, eye_obj).outline[ids], np.ones(len(ids)))
        points = project_samples(edges, seen, pose, frame.camera)
        patch, candidates = searched(frame.image, points, points.normals)
        views = EdgeViews(edges, ids, points.outline, pose, frame.camera.fx, 1.0)
        shifts = EdgeProfiles(ProfileConfig()).read(
            patch, points.points, points.normals, candidates, views, ANY_PX, LEAST
        ).shifts_px  # fmt: skip
        best = (candidates.scores * np.exp(-0.5 * candidates.offsets**2)).argmax(1)
        rows = np.arange(len(ids))
        found = candidates.scores[rows, best] > 0.1
        profiles = describe(patch, points.points, points.normals, candidates, views, ANY_PX, LEAST)
        offsets = candidates.offsets[rows, best] * profiles.sides
        before.append(offsets[found])
        after.append((offsets + shifts[rows, best] * profiles.sides)[found])
        outlines.append(points.outline[found])
    lies, told, outline = map(np.concatenate, (before, after, outlines))
    # Half the way of all outlines that lie inside, and two thirds of the scatter.
    assert np.median(lies[outline]) < -0.15
    assert abs(np.median(told[outline])) < 0.5 * abs(np.median(lies[outline]))
    assert np.median(np.abs(told)) < 0.7 * np.median(np.abs(lies))


# ---- settings ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("setting", [
        {"largest_px": 0.0}, {"spread_share": -1.0}, {"break_share": 11.0}, {"evidence_share": 1.5},
        {"trait_memory": 1.0}, {"outline_mm": float("nan")}, {"usual_break_mm": -0.1}, {"trait_shift_mm": 0.0},
    ], ids=str)
def test_settings_are_checked(setting: dict[str, float]) -> None:
    with pytest.raises(TrackingError, match=r"learning\.profiles\."):
        ProfileConfig(**setting)


def test_the_usual_edge_break_is_what_profiles_tell() -> None:
    config = ProfileConfig()
    assert config.expected_mm(0.25) == config.outline_mm
    assert config.expected_mm(0.4) < config.outline_mm < config.expected_mm(0.0)
