"""Camera: projection, its inverse, its file, and undistortion."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from acp_lab.errors import GeometryError, InputFileError
from acp_lab.geometry import Camera, Undistorter
from acp_lab.geometry.camera import _undistortion_maps

GOOD: dict[str, Any] = {
    "width": 640,
    "height": 512,
    "fx": 600.0,
    "fy": 620,
    "cx": 319.5,
    "cy": 250.25,
    "dist": [-0.25, 0.08, 0.001, -0.0005, -0.01],
}


def test_the_axis_meets_the_principal_point(camera: Camera) -> None:
    assert camera.project(np.array([[0.0, 0.0, 700.0]])) == pytest.approx(np.array([[319.5, 250.25]]))


def test_project_is_the_textbook_formula(camera: Camera, rng: np.random.Generator) -> None:
    points = rng.uniform([-100, -100, 200], [100, 100, 900], (50, 3))
    homogeneous = points @ camera.matrix.T
    np.testing.assert_allclose(camera.project(points), homogeneous[:, :2] / homogeneous[:, 2:], atol=1e-11)
    expected, _ = cv2.projectPoints(points, np.zeros(3), np.zeros(3), camera.matrix, None)
    np.testing.assert_allclose(camera.project(points), expected[:, 0], atol=1e-9)


def test_rays_undo_project(camera: Camera, rng: np.random.Generator) -> None:
    pixels = rng.uniform(-50, 700, (40, 2))
    depth = rng.uniform(100, 1000, (40, 1))
    rays = camera.rays(pixels)
    assert (rays[:, 2] == 1.0).all()
    np.testing.assert_allclose(camera.project(rays * depth), pixels, atol=1e-10)


def test_points_behind_the_camera_have_no_image(camera: Camera) -> None:
    points = np.array([[10.0, 5.0, 400.0], [10.0, 5.0, -400.0], [10.0, 5.0, 0.0], [0.0, 0.0, np.nan]])
    pixels = camera.project(points)
    assert np.isfinite(pixels[0]).all()
    assert np.isnan(pixels[1:]).all()


def test_no_points_is_no_error(camera: Camera) -> None:
    assert camera.project(np.empty((0, 3))).shape == (0, 2)
    assert camera.rays(np.empty((0, 2))).shape == (0, 3)


def test_project_leaves_its_input_alone(camera: Camera) -> None:
    points = np.array([[1.0, 2.0, 3.0], [1.0, 2.0, -3.0]])
    before = points.copy()
    camera.project(points)
    np.testing.assert_array_equal(points, before)


def test_matrix_round_trip_and_its_guard(camera: Camera) -> None:
    assert Camera.from_matrix(camera.matrix, 640, 512) == camera
    with pytest.raises(ValueError, match="read-only"):
        camera.matrix[0, 0] = 1.0


@pytest.mark.parametrize(
    "matrix",
    [
        np.eye(4),
        np.array([[600.0, 3.0, 320.0], [0, 600.0, 240.0], [0, 0, 1.0]]),
        np.array([[600.0, 0.0, 320.0], [0, 600.0, 240.0], [0, 0, 2.0]]),
        np.array([[600.0, np.nan, 320.0], [0, 600.0, 240.0], [0, 0, 1.0]]),
        np.array([[600.0, 0.0, 0.0], [0, 600.0, 0.0], [320.0, 240.0, 1.0]]),
    ],
)
def test_matrices_that_are_no_camera_are_refused(matrix: np.ndarray) -> None:
    with pytest.raises(GeometryError, match="camera matrix"):
        Camera.from_matrix(matrix, 640, 480)


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"width": 0}, "size"),
        ({"height": -3}, "size"),
        ({"fx": 0.0}, "focal"),
        ({"fy": float("inf")}, "focal"),
        ({"fx": float("nan")}, "focal"),
        ({"cx": float("nan")}, "principal"),
        ({"dist": (0.1, 0.2)}, "distortion"),
        ({"dist": (0.1, 0.2, 0.0, 0.0, float("nan"))}, "distortion"),
    ],
)
def test_numbers_that_are_no_camera_are_refused(change: dict[str, Any], word: str) -> None:
    with pytest.raises(GeometryError, match=word):
        Camera(**{**GOOD, **change})


def test_cameras_are_values(camera: Camera) -> None:
    _ = camera.matrix  # a cached matrix must not count in comparisons
    twin = Camera(640, 512, 600.0, 620.0, 319.5, 250.25)
    assert twin == camera
    assert hash(twin) == hash(camera)
    assert hash(Camera(**GOOD)) == hash(Camera(**{**GOOD, "dist": tuple(GOOD["dist"])}))


def test_whole_numbers_are_a_camera_like_any_other() -> None:
    """Compiled loops take float64 alone."""
    camera = Camera(640, 480, 600, 600, 320, 240)
    assert camera == Camera(640, 480, 600.0, 600.0, 320.0, 240.0)
    assert camera.numbers.dtype == np.float64
    assert Camera(640, 480, *np.float32([600, 600, 320, 240])).numbers.dtype == np.float64


def test_a_crop_moves_pixels_by_its_corner(camera: Camera, rng: np.random.Generator) -> None:
    points = rng.uniform([-100, -100, 200], [100, 100, 900], (20, 3))
    crop = camera.cropped(37, 21, 200, 100)
    assert (crop.width, crop.height) == (200, 100)
    np.testing.assert_allclose(crop.project(points), camera.project(points) - (37, 21), atol=1e-10)


def test_halved_keeps_what_is_seen_where(camera: Camera) -> None:
    """A point between the middle of four pixels falls on the middle of the one that they become."""
    half = camera.halved()
    assert (half.width, half.height) == (camera.width // 2, camera.height // 2)
    rays = camera.rays(np.array([[0.5, 0.5], [200.5, 101.5]]))
    assert half.project(rays) == pytest.approx(np.array([[0.0, 0.0], [100.0, 50.5]]))


def test_shrunk_keeps_what_is_seen_where(camera: Camera) -> None:
    """The middle pixel of nine falls on the middle of the one that they become."""
    small = camera.shrunk(3)
    assert (small.width, small.height) == (camera.width // 3, camera.height // 3)
    rays = camera.rays(np.array([[1.0, 1.0], [301.0, 151.0]]))
    assert small.project(rays) == pytest.approx(np.array([[0.0, 0.0], [100.0, 50.0]]))


def test_a_distorted_camera_is_not_cropped(distorted_camera: Camera) -> None:
    with pytest.raises(GeometryError, match="undistort"):
        distorted_camera.cropped(0, 0, 10, 10)


# --- CAMERA.json ------------------------------------------------------------------------------------------


def test_json_round_trip(tmp_path: Path, distorted_camera: Camera) -> None:
    path = tmp_path / "CAMERA.json"
    distorted_camera.to_json(path)
    assert Camera.from_json(path) == distorted_camera
    assert set(json.loads(path.read_text())) == set(GOOD)
    assert [p.name for p in tmp_path.iterdir()] == ["CAMERA.json"], "a temporary file was left behind"


def test_json_of_the_contract(tmp_path: Path) -> None:
    path = tmp_path / "CAMERA.json"
    path.write_text(json.dumps({**GOOD, "width": 640.0, "note": "further keys do not matter"}))
    camera = Camera.from_json(str(path))
    assert (camera.width, camera.height, camera.fy, camera.dist[0]) == (640, 512, 620.0, -0.25)
    assert isinstance(camera.width, int)


@pytest.mark.parametrize("hfov_deg", [5.0, 60.0, 120.0])
def test_a_field_of_view_is_seen_from_border_to_border(tmp_path: Path, hfov_deg: float) -> None:
    path = tmp_path / "CAMERA.json"
    path.write_text(json.dumps({"width": 640, "height": 480, "hfov_deg": hfov_deg}))
    camera = Camera.from_json(path)
    # Pixel 0 is the centre of the first pixel: the border is half a pixel before it.
    left, right = camera.rays(np.array([[-0.5, 239.5], [639.5, 239.5]]))
    assert np.degrees(np.arctan(right[0]) - np.arctan(left[0])) == pytest.approx(hfov_deg)
    assert left[0] == pytest.approx(-right[0])
    assert left[1] == right[1] == 0.0
    assert camera.fx == camera.fy
    assert not camera.is_distorted
    # Written, it is the usual file.
    camera.to_json(path)
    assert Camera.from_json(path) == camera


def without(key: str) -> str:
    return json.dumps({k: v for k, v in GOOD.items() if k != key})


def changed(**values: Any) -> str:
    return json.dumps({**GOOD, **values})


@pytest.mark.parametrize(
    ("text", "word"),
    [
        ("", "is empty"),
        ("   ", "is empty"),
        ("{", "not valid JSON"),
        ("[" * 100_000, "not valid JSON"),
        ("[1, 2]", "no JSON object"),
        ("null", "no JSON object"),
        ("3", "no JSON object"),
        ("{}", "width, height, fx, fy, cx, cy, dist"),
        (without("fx"), "lacks fx"),
        (without("dist"), '"dist": \\[0, 0, 0, 0, 0\\]'),
        (changed(fx="600"), "fx is '600'"),
        (changed(fx=None), "fx is None"),
        (changed(fx=True), "fx is True"),
        (changed(fx=[600]), "fx is"),
        (changed(fx=0), "above 0"),
        (changed(fy=-600), "above 0"),
        (changed(cx=float("nan")), "cx is nan"),
        (changed(cy=float("inf")), "cy is inf"),
        (changed(cx=10**400), "cx is"),
        (changed(width=0), "at least 1"),
        (changed(height=-5), "at least 1"),
        (changed(width=640.5), "whole pixels"),
        (changed(dist=0), "dist is 0: give five numbers"),
        (changed(dist=[0, 0, 0, 0]), r"dist is \[0, 0, 0, 0\]: give five"),
        (changed(dist=[0] * 8), "dist is .*: give five"),
        (changed(dist=[0, 0, "x", 0, 0]), r"dist\[2\]"),
        (changed(dist=[0, 0, 0, 0, float("nan")]), r"dist\[4\]"),
        (changed(fx="x" * 10_000 + "\n"), "fx is"),
        (changed(fx=1e-300), "fx is 1e-300 px"),
        (changed(fy=1e9), r"fy is 1e\+09 px"),
        (changed(fx=20), "fx is 20 px"),
        (changed(fx=700_000), "fx is 700000 px"),
        (changed(cx=-1e6), r"cx is -1e\+06 px"),
        (changed(dist=[0, 0, 0, 0, -1e8]), r"dist holds -1e\+08"),
        ('{"width": 640, "height": 480, "hfov_deg": 0}', "between 0 and 180"),
        ('{"width": 640, "height": 480, "hfov_deg": 180}', "between 0 and 180"),
        ('{"width": 640, "height": 480, "hfov_deg": 179.9}', "fx is"),
        ('{"width": 640, "height": 480, "hfov_deg": "60"}', "hfov_deg is '60'"),
        ('{"width": 640, "hfov_deg": 60}', 'lacks height.*"hfov_deg": 60'),
        (changed(hfov_deg=60), "keep one of the two"),
    ],
)
def test_malformed_camera_files_are_one_line(tmp_path: Path, text: str, word: str) -> None:
    path = tmp_path / "CAMERA.json"
    path.write_text(text)
    with pytest.raises(InputFileError, match=word) as caught:
        Camera.from_json(path)
    message = str(caught.value)
    assert message.startswith(str(path))
    assert "\n" not in message
    assert len(message) < 400


def test_camera_files_that_cannot_be_read(tmp_path: Path) -> None:
    with pytest.raises(InputFileError, match="no such camera file"):
        Camera.from_json(tmp_path / "absent.json")
    with pytest.raises(InputFileError, match="cannot be read"):
        Camera.from_json(tmp_path)
    (tmp_path / "binary.json").write_bytes(b"\xff\xfe\x00\x81")
    with pytest.raises(InputFileError, match="UTF-8"):
        Camera.from_json(tmp_path / "binary.json")


def test_a_camera_that_cannot_be_written(tmp_path: Path, camera: Camera) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(InputFileError, match=r"CAMERA\.json: .*cannot be written"):
        camera.to_json(tmp_path / "file" / "CAMERA.json")


# --- undistortion -----------------------------------------------------------------------------------------


def test_undistortion_without_distortion_is_the_identity(camera: Camera) -> None:
    image = np.zeros((512, 640, 3), np.uint8)
    assert Undistorter(camera)(image) is image
    assert camera.pinhole() is camera


@pytest.mark.parametrize("channels", [(), (3,)])
def test_undistortion_puts_spots_where_the_pinhole_projects(
    distorted_camera: Camera, channels: tuple[int, ...]
) -> None:
    """Draw Gaussian spots where the lens shows points, and find them where the pinhole camera shows them."""
    points = np.array([[x, y, 600.0] for x in (-220.0, -100.0, 0.0, 230.0) for y in (-180.0, 0.0, 170.0)])
    seen, _ = cv2.projectPoints(
        points, np.zeros(3), np.zeros(3), distorted_camera.matrix, np.array(distorted_camera.dist)
    )
    y, x = np.mgrid[:512, :640]
    image = np.zeros((512, 640), np.uint8)
    for u, v in seen[:, 0]:
        image = np.maximum(image, (255 * np.exp(-((x - u) ** 2 + (y - v) ** 2) / 18.0)).astype(np.uint8))
    if channels:
        image = np.repeat(image[..., None], 3, axis=2)
    result = Undistorter(distorted_camera)(image)
    assert result.shape == image.shape
    assert result.dtype == np.uint8
    grey = (result if not channels else result[..., 0]).astype(float)

    expected = distorted_camera.pinhole().project(points)
    # The lens moves spots by several pixels: without undistortion this test fails.
    assert np.abs(expected - seen[:, 0]).max() > 5.0
    for u, v in expected:
        window = np.hypot(x - u, y - v) < 12.0
        weight = grey * window
        centre = np.array([(x * weight).sum(), (y * weight).sum()]) / weight.sum()
        assert np.hypot(*(centre - (u, v))) < 0.15


def test_what_the_lens_never_saw_is_black() -> None:
    """Beyond r = 0.82 a formula of k1 = -0.5 leads back towards the middle, and would show the image once more."""
    camera = Camera(641, 513, 300.0, 300.0, 320.0, 256.0, (-0.5, 0.0, 0.0, 0.0, 0.0))
    with pytest.warns(UserWarning, match="folds the image"):
        result = Undistorter(camera)(np.full((513, 641), 200, np.uint8))
    y, x = np.mgrid[:513, :641]
    radius = np.hypot(x - 320.0, y - 256.0) / 300.0
    fold = np.sqrt(1.0 / 1.5)
    assert (result[radius > fold + 0.002] == 0).all()
    assert (result[radius < fold - 0.002] == 200).all()
    # A lens that never folds, or does so outside the image, shows all of it.
    for k1 in (0.1, -0.2):
        seen = Undistorter(Camera(641, 513, 600.0, 600.0, 320.0, 256.0, (k1, 0.0, 0.0, 0.0, 0.0)))
        tables = cv2.initUndistortRectifyMap(
            seen.camera.matrix, np.array(seen.camera.dist), np.eye(3), seen.camera.matrix, (641, 513), cv2.CV_16SC2
        )
        for made, plain in zip(_undistortion_maps(seen.camera), tables, strict=True):
            np.testing.assert_array_equal(made, plain)


def test_a_lens_that_folds_the_image_is_told_and_one_that_does_so_outside_is_not(
    distorted_camera: Camera, recwarn: pytest.WarningsRecorder
) -> None:
    for camera in (distorted_camera, Camera(641, 513, 600.0, 600.0, 320.0, 256.0, (-0.5, 0.0, 0.0, 0.0, 0.0))):
        Undistorter(camera)  # farther out than its corners it folds, as those of many lenses do
    assert [str(one.message) for one in recwarn] == []
    with pytest.warns(UserWarning, match=r"-0.5, 0, 0, 0, 0: folds the image, from 245 px round its middle on"):
        Undistorter(Camera(641, 513, 300.0, 300.0, 320.0, 256.0, (-0.5, 0.0, 0.0, 0.0, 0.0)))


def test_undistortion_tables_are_made_once(distorted_camera: Camera) -> None:
    _undistortion_maps.cache_clear()
    for _ in range(3):
        Undistorter(Camera(**{**GOOD}))(np.zeros((512, 640), np.uint8))
    assert _undistortion_maps.cache_info().misses == 1


def test_an_image_of_another_size_is_refused(distorted_camera: Camera, camera: Camera) -> None:
    for one in (distorted_camera, camera):
        with pytest.raises(GeometryError, match="100 x 50 px but its camera is 640 x 512"):
            Undistorter(one)(np.zeros((50, 100, 3), np.uint8))
