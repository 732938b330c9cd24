"""A scene: the tracked part, what holds or hides it, the bench with its clutter, the room, and all motions.

Five kinds. `regular`: the part lies on the bench, the camera moves. `reflection`: the part is held and turned while
lamp and operator move. `rotation`: the part turns about one axis. `occlusion`: another part passes in front.
`fast`: like regular or held, at up to 5 degrees per frame.
Convention: the truth is `cam_T_part` at whole times; every other pose is derived from it, so they cannot disagree.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from acp_lab.geometry.camera import Camera
from acp_lab.geometry.pose import inverse, make_pose, transform
from data_recipes.metal import arrange, surfaces
from data_recipes.metal.bodies import Body, Placed
from data_recipes.metal.cad_parts import CadPart
from data_recipes.metal.edge_break import break_edges
from data_recipes.metal.environment import Environment, make_environment
from data_recipes.metal.motion import (
    PosePath,
    look_from,
    orbit_rotations,
    shake,
    smooth_numbers,
    speed_profile,
    tumble_rotations,
    walk,
    wander,
)
from data_recipes.metal.plan import Kind, SceneConfig
from data_recipes.metal.table import TABLE_KINDS, Table, make_table

ROT_DEG: dict[Kind, float] = {"regular": 1.6, "reflection": 1.5, "rotation": 2.8, "occlusion": 1.5, "fast": 3.8}
TRANS_MM: dict[Kind, float] = {"regular": 2.5, "reflection": 2.5, "rotation": 1.5, "occlusion": 2.0, "fast": 4.5}
_NEAR_MM, _FAR_MM = 355.0, 500.0
_ROT_LIMIT = {"fast": 5.0}


@dataclass(frozen=True, eq=False)
class Moment:
    """The scene at one time: bodies with poses (the tracked part first), the camera pose and the room."""

    world_T_cam: np.ndarray
    part: Placed
    others: tuple[Placed, ...]
    bench: Placed
    environment: Environment

    @property
    def moving(self) -> tuple[Placed, ...]:
        """Everything but the bench."""
        return (self.part, *self.others)

    @property
    def bodies(self) -> tuple[Placed, ...]:
        """Everything, the tracked part first."""
        return (self.part, *self.others, self.bench)


@dataclass(frozen=True, eq=False)
class Scene:
    """Bodies, materials, room and paths of one sequence."""

    config: SceneConfig
    camera: Camera
    truth: PosePath
    shake: PosePath | None  # now_T_steady of a camera in a hand
    held: bool
    anchor: np.ndarray  # world_T_part when the part lies, world_T_cam when it is held
    part: Body
    bench: Body
    look_alikes: tuple[np.ndarray, ...]  # world_T_item of each, part of the bench
    handle: Body | None
    occluder: Body | None
    occluder_path: PosePath | None
    materials: surfaces.Materials
    names: tuple[str, ...]
    table: Table
    room: Environment
    lights: np.ndarray | None  # (frames, 4): shift of the lamp in mm and its gain
    exposure_frames: float

    def cam_T_part(self, frame: int) -> np.ndarray:
        """The truth of a frame, (4, 4): the pose when the row of the part's middle is read."""
        if self.config.readout == 0.0:
            return np.asarray(self.truth.poses[frame])
        pose = self.truth.poses[frame]
        middle_obj = 0.5 * (self.part.vertices.min(0) + self.part.vertices.max(0))
        for _ in range(4):  # while its row is sought the part moves on
            row = self.camera.project(transform(pose, middle_obj[None]))[0, 1]
            pose = self.truth.at(self.read_at(frame, float(row)))
        return np.asarray(pose)

    def read_at(self, frame: int, row: float) -> float:
        """The time, in frames, at which a row of a frame is read; that of its middle row at the whole time."""
        middle = 0.5 * (self.config.height - 1)
        return frame + self.config.readout * (row - middle) / self.config.height

    def at(self, time: float) -> Moment:
        """Everything in its place at a time in frames."""
        cam_T_part = self.truth.at(time)
        if self.held:
            world_T_cam = self.anchor if self.shake is None else self.anchor @ inverse(self.shake.at(time))
            world_T_part = world_T_cam @ cam_T_part
        else:
            world_T_part = self.anchor
            world_T_cam = world_T_part @ inverse(cam_T_part)
        others = []
        if self.handle is not None:
            others.append(Placed(self.handle, world_T_part))
        if self.occluder is not None and self.occluder_path is not None:
            others.append(Placed(self.occluder, world_T_cam @ self.occluder_path.at(time)))
        room = self.room
        if self.lights is not None:
            frame = int(np.clip(round(time), 0, len(self.lights) - 1))
            shift, gain = self.lights[frame, :3], float(self.lights[frame, 3])
            room = room.moved(len(room.patches) - 2, shift, gain).moved(len(room.patches) - 1, -2.0 * shift, 1.0)
        return Moment(world_T_cam, Placed(self.part, world_T_part), tuple(others), Placed(self.bench, np.eye(4)), room)


def make_scene(part: CadPart, config: SceneConfig) -> Scene:
    """Set the stage for one sequence; the same part and config give the same scene."""
    camera = config.camera
    rng = np.random.default_rng([config.seed, 2])
    held, rest = _stance(rng, part, config)
    truth = plan_truth(part, config, held, rest)
    anchor = _place_camera(rng, truth, part) if held else arrange.on_table(rest, part.vertices, (0.0, 0.0))

    rng = np.random.default_rng([config.seed, 4])
    vertices, faces = break_edges(part.vertices, part.faces, config.edge_break_mm)
    material = _part_material(rng, part, config)
    stock = arrange.Stock([material, surfaces.metal("dark steel", "turned"), surfaces.metal("steel", "turned")])
    count = int(rng.integers(9, 14)) if config.clutter is None else config.clutter
    free = 0.0 if held else 0.62 * part.diameter
    body = Body(part.name, vertices, faces, np.zeros(len(faces), np.int64))
    lying = arrange.look_alikes(
        np.random.default_rng([config.seed, 11]), (vertices, faces), rest, config.look_alikes, alone=held
    )
    bench = arrange.bench(rng, stock, count, free, avoid=part.name, break_mm=0.3, lying=lying)
    handle = arrange.handle(part, truth.poses, config.kind == "rotation", material_index=1) if held else None
    occluder, path = None, None
    if config.kind == "occlusion":
        occluder = arrange.occluder(rng, stock, part, body if config.look_alikes else None)
        path = _passing(rng, truth, part, config)
    rng = np.random.default_rng([config.seed, 5])
    kind = config.table or TABLE_KINDS[int(rng.integers(len(TABLE_KINDS)))]
    table = make_table(rng, kind, camera.fx / 450.0)
    room = make_environment(np.random.default_rng([config.seed, 6]))
    materials = surfaces.Materials(tuple(stock.materials), surfaces.make_noise(np.random.default_rng([config.seed, 7])))
    lights = _lights(np.random.default_rng([config.seed, 8]), config.frames) if config.kind == "reflection" else None
    exposure = float(np.random.default_rng([config.seed, 9]).uniform(0.10, 0.25))
    return Scene(
        config, camera, truth, _shake(config), held, anchor, body, bench,
        tuple(item.world_T_item for item in lying), handle, occluder, path, materials,
        tuple(m.name for m in stock.materials), table, room, lights, exposure,
    )  # fmt: skip


def _part_material(rng: np.random.Generator, part: CadPart, config: SceneConfig) -> surfaces.Material:
    usual: dict[int, tuple[surfaces.Finish, ...]] = {
        1: ("milled", "brushed"), 2: ("milled", "brushed"), 3: ("turned", "milled"), 4: ("cast", "milled"),
    }  # fmt: skip
    finish = config.finish or usual[part.group][int(rng.integers(2))]
    choice: tuple[str, ...] = ("steel", "aluminium", "aluminium", "brass")
    name = config.metal or choice[int(rng.integers(2 if finish == "cast" else 4))]
    # Shinier for reflections, but a casting stays rough.
    roughness = 0.6 if config.kind == "reflection" and finish != "cast" else rng.uniform(0.7, 1.3)
    return surfaces.metal(name, finish, max(roughness, 0.9) if finish == "cast" else roughness)


def _stance(rng: np.random.Generator, part: CadPart, config: SceneConfig) -> tuple[bool, np.ndarray]:
    """Whether the part is held (else it lies and the camera moves), and world_R_part (3, 3) in which it would lie."""
    held = config.kind in ("reflection", "rotation") or (config.kind != "regular" and rng.random() < 0.5)
    return held, arrange.resting_rotation(rng, part.vertices, part.faces, pick=config.rest)


def scene_truth(part: CadPart, config: SceneConfig) -> PosePath:
    """The truth of `make_scene(part, config)` without the scene: cam_T_part per frame."""
    held, rest = _stance(np.random.default_rng([config.seed, 2]), part, config)
    return plan_truth(part, config, held, rest)


def plan_truth(part: CadPart, config: SceneConfig, held: bool, rest: np.ndarray) -> PosePath:
    """cam_T_part per frame: tumbling when held, else lying as `rest` (3, 3) says, under an orbiting camera."""
    rng, camera, frames = np.random.default_rng([config.seed, 3]), config.camera, config.frames
    mean_rot = ROT_DEG[config.kind] if config.rot_deg is None else config.rot_deg
    mean_mm = TRANS_MM[config.kind] if config.trans_mm is None else config.trans_mm
    steps = speed_profile(rng, frames, mean_rot, max(_ROT_LIMIT.get(config.kind, 3.0), 1.3 * mean_rot))
    total = float(steps.sum()) + 1.0
    if held:
        path = tumble_rotations(rng, total, config.kind == "rotation")
    else:
        path = orbit_rotations(rng, total) @ rest
    rotations = walk(path, steps)
    # Offsets for which the whole bounding sphere stays inside the image even at the nearest distance.
    radius = float(np.linalg.norm(part.vertices, axis=1).max()) * 1.06
    half = np.array([camera.width / camera.fx, camera.height / camera.fy]) / 2 * _NEAR_MM - radius
    half = np.clip(half, 4.0, [55.0, 40.0])
    shift = wander(rng, frames, mean_mm, np.array([*-half, _NEAR_MM]), np.array([*half, _FAR_MM]))
    poses = np.stack([make_pose(r, t) for r, t in zip(rotations, shift, strict=True)])
    hand = _shake(config)
    return PosePath(poses if hand is None else hand.poses @ poses)


def _shake(config: SceneConfig) -> PosePath | None:
    rng = np.random.default_rng([config.seed, 10])
    return shake(rng, config.frames, config.shake_deg) if config.shake_deg else None


def _place_camera(rng: np.random.Generator, truth: PosePath, part: CadPart) -> np.ndarray:
    """world_T_cam of a camera above the bench, far enough from it that the held part never touches it."""
    cam_R_world = look_from(rng.uniform(0, 2 * np.pi), np.deg2rad(rng.uniform(42, 62)))
    radius = float(np.linalg.norm(part.vertices, axis=1).max())
    lowest = float((truth.poses[:, :3, 3] @ cam_R_world[:, 2]).min())
    height = max(radius + 10.0 - lowest, -cam_R_world[2, 2] * 600.0)
    world_R_cam = cam_R_world.T
    axis = world_R_cam[:, 2]
    return make_pose(world_R_cam, axis * height / axis[2])


def _passing(rng: np.random.Generator, truth: PosePath, part: CadPart, config: SceneConfig) -> PosePath:
    """cam_T_occluder: crosses the view of the part from one side to the other, and hides up to half of it."""
    frames = config.frames
    radius = float(np.linalg.norm(part.vertices, axis=1).max())
    angle = rng.uniform(-0.5, 0.5) + (np.pi if rng.random() < 0.5 else 0.0)
    way = np.array([np.cos(angle), np.sin(angle)])
    aside = np.array([-way[1], way[0]]) * rng.choice([-1.0, 1.0]) * radius * rng.uniform(0.35, 0.55)
    if config.look_alikes:  # as large as the part: it hides half of it from farther aside
        aside *= 2.2
    s = np.linspace(-1, 1, max(frames, 2))[:frames]
    sway = smooth_numbers(rng, 4, 3, frames)
    turns = tumble_rotations(rng, 60.0, False)
    rotations = walk(turns, np.full(max(frames - 1, 0), 0.8 if frames < 60 else 40.0 / frames))
    poses = []
    for k in range(frames):
        centre = truth.poses[k, :3, 3]
        depth = centre[2] - radius - 45.0 - 8.0 * sway[k, 2]
        beside = (1.9 * radius * s[k] * way + aside + 6.0 * sway[k, :2]) * depth / centre[2]
        poses.append(make_pose(rotations[k], np.array([*(centre[:2] * depth / centre[2] + beside), depth])))
    return PosePath(np.stack(poses))


def _lights(rng: np.random.Generator, frames: int) -> np.ndarray:
    """Lamp shift (mm) and gain per frame: a hand-held lamp that swings and flickers slowly."""
    wave = smooth_numbers(rng, max(4, frames // 9), 4, frames)
    return np.column_stack([wave[:, :3] * np.array([260.0, 260.0, 120.0]), np.exp(0.35 * wave[:, 3])])


def part_pixels(scene: Scene, frame: int, points_obj: np.ndarray) -> np.ndarray:
    """Where points (n, 3) of the part appear in a frame's image: (n, 2) px."""
    return scene.camera.project(transform(scene.cam_T_part(frame), points_obj))
