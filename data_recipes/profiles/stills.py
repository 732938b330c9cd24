"""Single pictures of random and known parts, sharp and with broken edges, from far apart views.

Each scene has a part, a material, a room and a bench of its own, and six views of it: a network that shall hold for
parts that nobody has seen needs many scenes, not many frames. Sequences would show the same edges again and again.
"""

from __future__ import annotations

import zipfile
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from acp_lab.errors import InputFileError
from acp_lab.files import replacing
from acp_lab.geometry.arrays import ByteImage, FloatArray
from acp_lab.geometry.camera import Camera
from acp_lab.geometry.pose_step import pose_step_between
from data_recipes.metal.cad_parts import CadPart, make_part
from data_recipes.metal.plan import Kind, SceneConfig
from data_recipes.metal.random_parts import random_part
from data_recipes.metal.render import LONG_PASSES, PASSES, Passes, Renderer
from data_recipes.metal.scene import make_scene
from data_recipes.metal.sensor import make_sensor

VIEWS = 6
KNOWN_PARTS = (
    "slot_block", "l_bracket", "u_clevis", "flange_hub", "valve_body", "finned_cover", "lever_arm", "v_block",
    "keyed_shaft", "t_slot_plate", "bearing_ring", "corner_bracket", "heat_sink", "cam_disc",
)  # fmt: skip
"""Those of the recipe that benchmarks do not check changes on (`benchmarks.robustness.CHECKING`)."""
_KNOWN_SHARE = 0.35
_KINDS: tuple[Kind, ...] = ("regular", "reflection", "rotation", "occlusion", "fast", "fast", "regular")
_BREAKS_MM = (0.0, 0.0, 0.15, 0.25, 0.3, 0.4, 0.4, 0.5)
# The views lie far apart, but are exposed as if the part moved as fast as its kind does.
_BLUR_DEG: dict[Kind, float] = {"regular": 1.3, "reflection": 1.3, "rotation": 2.4, "occlusion": 1.3, "fast": 3.3}
_EXPOSURES = (0.1, 0.25)
SMEARED = 200_000
"""Scenes from this number on move fast before a shutter that is open for long."""
_LONG_EXPOSURES = (0.3, 1.3)
_WIDTH, _HEIGHT = 448, 384
_JPEG_QUALITY = 91


@dataclass(frozen=True)
class _StillConfig(SceneConfig):
    """A scene of a camera with a focal length of its own, px."""

    focal_px: float = 900.0

    @property
    def camera(self) -> Camera:
        return Camera(
            self.width, self.height, self.focal_px, self.focal_px, (self.width - 1) / 2, (self.height - 1) / 2
        )


@dataclass(frozen=True, eq=False)
class Stills:
    """The views of one scene.

    Attributes:
        part: as it was drawn, sharp. edge_break_mm: of the one in the pictures.
        camera: of all views.
        images: (h, w, 3) uint8 RGB each; cam_T_obj: (n, 4, 4) their true poses, in the middle of the exposure.
        motions: (n, 6) pose steps (rad, mm) about the middle of the part's box, over the exposure.
        visible: (n,) share of the part that nothing hides.
    """

    part: CadPart
    edge_break_mm: float
    camera: Camera
    images: list[ByteImage]
    cam_T_obj: FloatArray
    motions: FloatArray
    visible: FloatArray


@dataclass(frozen=True, eq=False)
class StillPlan:
    """What a scene shows. exposure_frames: of the step between two views; passes: that a view is rendered in."""

    part: CadPart
    config: SceneConfig
    exposure_frames: float
    passes: Passes


def plan_stills(number: int) -> StillPlan:
    """Of scene `number`, 0 or more."""
    rng = np.random.default_rng([number, 99])
    is_known = rng.random() < _KNOWN_SHARE
    part = make_part(KNOWN_PARTS[rng.integers(len(KNOWN_PARTS))]) if is_known else random_part(number)
    kind, break_mm = _KINDS[rng.integers(len(_KINDS))], _BREAKS_MM[rng.integers(len(_BREAKS_MM))]
    is_smeared = number >= SMEARED
    kind = "fast" if is_smeared else kind
    turn_deg = float(rng.uniform(9, 14))
    config = _StillConfig(
        kind, VIEWS, _WIDTH, _HEIGHT, 100_000 + number, break_mm, rot_deg=turn_deg, trans_mm=20.0,
        clutter=int(rng.integers(1, 5)), focal_px=float(rng.uniform(680, 1000)),
    )  # fmt: skip
    share = float(rng.uniform(*(_LONG_EXPOSURES if is_smeared else _EXPOSURES)))
    return StillPlan(part, config, share * _BLUR_DEG[kind] / turn_deg, LONG_PASSES if is_smeared else PASSES)


def render_stills(number: int) -> Stills:
    """The views of scene `number`, 0 or more; the same number gives the same truth."""
    plan = plan_stills(number)
    scene = replace(make_scene(plan.part, plan.config), exposure_frames=plan.exposure_frames)
    renderer, sensor, images, visible = Renderer(scene, plan.passes), None, list[ByteImage](), list[float]()
    for view in range(VIEWS):
        picture = renderer.frame(view)
        if sensor is None:
            sensor = make_sensor(np.random.default_rng([number, 20]), picture.image, picture.part_seen)
        images.append(sensor.expose(picture.image, np.random.default_rng([number, 21, view])))
        visible.append(float(picture.part_seen.sum() / max(picture.part_alone.sum(), 1)))
    poses = np.stack([scene.cam_T_part(view) for view in range(VIEWS)])
    half, vertices = 0.5 * scene.exposure_frames, plan.part.vertices
    centre_obj = 0.5 * (vertices.min(0) + vertices.max(0))
    motions = np.stack(
        [pose_step_between(scene.truth.at(k - half), scene.truth.at(k + half), centre_obj) for k in range(VIEWS)]
    )
    return Stills(plan.part, plan.config.edge_break_mm, plan.config.camera, images, poses, motions, np.array(visible))


def write_stills(path: Path, stills: Stills) -> None:
    """Keep the views of a scene in one file, whole or not at all."""
    camera, part = stills.camera, stills.part
    arrays: dict[str, Any] = {
        "vertices": part.vertices, "faces": part.faces, "poses": stills.cam_T_obj,
        "motions": stills.motions, "visible": stills.visible,
        "camera": np.array([camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy]),
        "edge_break_mm": np.array(stills.edge_break_mm), "name": np.array(part.name), "group": np.array(part.group),
    }  # fmt: skip
    arrays |= {f"image_{view}": _jpeg(image) for view, image in enumerate(stills.images)}
    with replacing(path, "the views") as temporary, temporary.open("wb") as file:
        np.savez(file, **arrays)


def read_stills(path: Path) -> Stills:
    """What `write_stills` wrote. Raises InputFileError for any other file."""
    try:
        with np.load(path, allow_pickle=False) as arrays:
            width, height, *numbers = arrays["camera"].tolist()
            part = CadPart(str(arrays["name"]), int(arrays["group"]), arrays["vertices"], arrays["faces"])
            images = [_decoded(arrays[f"image_{view}"]) for view in range(VIEWS)]
            return Stills(
                part, float(arrays["edge_break_mm"]), Camera(int(width), int(height), *numbers), images,
                arrays["poses"], arrays["motions"], arrays["visible"],
            )  # fmt: skip
    except (OSError, EOFError, ValueError, KeyError, zipfile.BadZipFile) as error:
        raise InputFileError(f"{path}: holds no views of a scene ({error}): remove it, it is rendered anew") from None


def _jpeg(image: ByteImage) -> np.ndarray:
    done, encoded = cv2.imencode(
        ".jpg", cv2.cvtColor(image, cv2.COLOR_RGB2BGR), [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY]
    )
    if not done:
        raise InputFileError("OpenCV cannot write JPEG here: install opencv-python-headless anew")
    return encoded.ravel()


def _decoded(encoded: np.ndarray) -> ByteImage:
    image = cv2.imdecode(encoded, cv2.IMREAD_COLOR_RGB)
    if image is None:
        raise ValueError("a picture is damaged")
    return np.asarray(image, np.uint8)
