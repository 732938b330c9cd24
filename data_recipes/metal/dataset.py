"""Renders planned sequences into a data set in the BOP layout."""

from __future__ import annotations

import json
import time
from collections.abc import Sequence
from dataclasses import asdict
from functools import lru_cache
from itertools import pairwise
from pathlib import Path
from typing import Protocol

import numpy as np

from acp_lab.bench.workers import each
from acp_lab.geometry.pose import rotation_angle_deg
from data_recipes.bop_writer import (
    Model,
    new_dataset,
    pose_entry,
    visibility,
    write_image,
    write_json,
    write_models,
    write_scene,
)
from data_recipes.command import note
from data_recipes.metal.cad_parts import CadPart
from data_recipes.metal.look_alikes import look_alikes_in
from data_recipes.metal.path_traced import path_tracer
from data_recipes.metal.plan import Plan, SceneConfig
from data_recipes.metal.random_parts import part_named
from data_recipes.metal.render import Picture, Renderer, RowByRowRenderer
from data_recipes.metal.scene import Scene, make_scene
from data_recipes.metal.sensor import make_sensor

FPS = 30.0
LOOK_ALIKES = "scene_look_alikes.json"
"""Beside scene_gt.json, which has the tracked part alone."""


def render_dataset(
    out: Path,
    plans: Sequence[Plan],
    suffix: str,
    force: bool = False,
    spp: int | None = None,
    workers: int = 1,
    scheduler: str | None = None,
) -> None:
    """Render all planned sequences into the BOP data set `out`.

    suffix: ".jpg" or ".png". spp: samples per pixel of a path tracer; None for our own renderer. workers, scheduler:
    who renders, see `workers.each`; what is rendered does not depend on it. Raises InputFileError when `out` exists
    and force is not set, and when there is no path tracer; ParameterError where no scheduler answers.
    """
    names = list(dict.fromkeys(plan.part for plan in plans))
    with new_dataset(out, force) as root:
        models = {number: bop_model(_part(name)) for number, name in enumerate(names, start=1)}
        write_models(root, models)
        asked = {}
        for number, plan in enumerate(plans, start=1):
            told = {"number": number, "object_id": names.index(plan.part) + 1, "suffix": suffix, "spp": spp}
            asked[f"scene {number}"] = json.dumps({"root": str(root.resolve()), **told, **asdict(plan)})
        for name, seconds in each(render_scene, asked, workers=workers, scheduler=scheduler):
            plan = plans[int(name.split()[1]) - 1]
            per_frame_s = float(seconds) / plan.config.frames
            note(f"{name}: {plan.part}, {plan.config.kind}, {per_frame_s:.1f} s per frame")


def render_scene(text: str) -> str:
    """Render the sequence of a JSON text into its data set; the seconds that it took. What a worker is asked for."""
    start, told = time.perf_counter(), json.loads(text)
    number, object_id, spp = told["number"], told["object_id"], told["spp"]
    folder, part = Path(told["root"]) / "test" / f"{number:06d}", _part(told["part"])
    (folder / "rgb").mkdir(parents=True, exist_ok=True)  # it may be there of a worker that died
    scene = make_scene(part, SceneConfig(**told["config"]))
    own = RowByRowRenderer if scene.config.readout else Renderer
    renderer = own(scene) if spp is None else path_tracer(scene, spp)
    _render_scene(folder, scene, renderer, object_id, told["suffix"])
    write_json(folder / "scene_meta.json", _meta(scene, number, object_id, part))
    return str(time.perf_counter() - start)


@lru_cache(maxsize=8)
def _part(name: str) -> CadPart:
    return part_named(name)


def bop_model(part: CadPart) -> Model:
    """What the data set keeps of a part: mesh, diameter, group, name and symmetries."""
    extra = {"group": part.group, "name": part.name, **part.symmetries}
    return Model(part.vertices, part.faces, part.diameter, extra)


class FrameRenderer(Protocol):
    """What turns a scene into pictures."""

    def frame(self, index: int) -> Picture:
        """Render one frame."""


def _render_scene(folder: Path, scene: Scene, renderer: FrameRenderer, object_id: int, suffix: str) -> None:
    sensor, seen = None, dict[int, dict[str, object]]()
    for frame in range(scene.config.frames):
        picture = renderer.frame(frame)
        if sensor is None:
            sensor = make_sensor(np.random.default_rng([scene.config.seed, 20]), picture.image, picture.part_seen)
        noise = np.random.default_rng([scene.config.seed, 21, frame])
        write_image(folder / "rgb" / f"{frame:06d}{suffix}", sensor.expose(picture.image, noise))
        seen[frame] = visibility(picture.part_alone, picture.part_seen)
    poses = {frame: scene.cam_T_part(frame) for frame in seen}
    write_scene(folder, dict.fromkeys(seen, scene.camera.matrix), object_id, poses, seen)
    if scene.look_alikes:
        write_json(folder / LOOK_ALIKES, {str(k): _others(scene, k, object_id) for k in range(scene.config.frames)})


def _others(scene: Scene, frame: int, object_id: int) -> list[dict[str, object]]:
    """The parts like the tracked one in a frame, as BOP's scene_gt.json has poses, and what share of each is seen."""
    found = look_alikes_in(scene, frame)
    return [{**pose_entry(one.cam_T_obj, object_id), "visib_fract": round(one.visible, 4)} for one in found]


def _meta(scene: Scene, scene_id: int, object_id: int, part: CadPart) -> dict[str, object]:
    config = scene.config
    return {
        "scene_id": scene_id,
        "obj_id": object_id,
        "part": part.name,
        "group": part.group,
        "kind": config.kind,
        "seed": config.seed,
        "edge_break_mm": config.edge_break_mm,
        "material": scene.names[0],
        "table": scene.table.kind,
        "moving": "part" if scene.held else "camera",
        "look_alikes": config.look_alikes,
        "shake_deg": config.shake_deg,
        "readout": config.readout,
        "light_moves": scene.lights is not None,
        "frames": config.frames,
        "fps": FPS,
        "width": config.width,
        "height": config.height,
        "exposure_frames": round(scene.exposure_frames, 4),
        "motion": motion_statistics(scene.truth.poses),
    }


def motion_statistics(cam_T_obj: np.ndarray) -> dict[str, object]:
    """Rotation (deg) and translation (mm) per frame, and the range of distances (mm), of poses (n, 4, 4)."""
    pairs = list(pairwise(cam_T_obj))
    turn = np.array([rotation_angle_deg(a[:3, :3], b[:3, :3]) for a, b in pairs] or [0.0])
    step = np.array([float(np.linalg.norm(b[:3, 3] - a[:3, 3])) for a, b in pairs] or [0.0])
    return {
        "rot_deg_mean": round(float(turn.mean()), 3),
        "rot_deg_max": round(float(turn.max()), 3),
        "trans_mm_mean": round(float(step.mean()), 3),
        "trans_mm_max": round(float(step.max()), 3),
        "dist_mm": [round(float(cam_T_obj[:, 2, 3].min()), 1), round(float(cam_T_obj[:, 2, 3].max()), 1)],
    }
