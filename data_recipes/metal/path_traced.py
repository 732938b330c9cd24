"""The same scenes through a path tracer (Mitsuba 3): pictures closer to reality, at many times the cost.

Part, bench, lamps, room, motion and truth are those of `scene`; only the light is followed further: any number of
bounces between the things on the bench, glossy reflections of everything in everything, and soft shadows of every
panel of the room. Tool marks are bump textures here. There is no depth of field and no denoiser: noise falls with the
square root of the samples per pixel.
Convention: world frame, mm; images are linear RGB. Mitsuba's pixel centres lie at half pixels, and its camera looks
along z with x to the left and y up: both are corrected in `_sensor` alone.
"""

from __future__ import annotations

import os
from typing import Any

import numpy as np
from scipy.ndimage import gaussian_filter

from acp_lab.errors import InputFileError
from data_recipes.metal.bodies import Placed
from data_recipes.metal.environment import Environment, Patch
from data_recipes.metal.render import PASSES, Picture
from data_recipes.metal.render_pass import nearest_hits
from data_recipes.metal.scene import Moment, Scene
from data_recipes.metal.surfaces import Material
from data_recipes.metal.table import HALF_MM

_MAX_BOUNCES = 8
_BRIGHTEST = 20.0
"""Single samples brighter than that are cut: a pixel that caught a lamp in a scratch outshines its neighbours."""
_UV_PER_MM = 1.0 / 40.0
_TEXTURE = 512


def path_tracer(scene: Scene, spp: int) -> PathTracer:
    """A renderer of the scene with spp samples per pixel; InputFileError when Mitsuba is not installed."""
    try:
        import mitsuba as mi
    except ImportError:
        raise InputFileError("--path-traced needs Mitsuba: pip install -e '.[path-traced]'") from None
    mi.set_variant(_fastest_variant())
    return PathTracer(mi, scene, spp)


def _fastest_variant() -> str:
    """Of Mitsuba's variants that can run here."""
    import drjit

    if drjit.has_backend(drjit.JitBackend.CUDA):
        return "cuda_ad_rgb"
    # The vectorised variant is faster, but an LLVM that is too old for it ends the process: only where one is named.
    return "llvm_ad_rgb" if os.environ.get("DRJIT_LIBLLVM_PATH") else "scalar_rgb"


class PathTracer:
    """Renders frames of one scene; what never moves is loaded into Mitsuba once."""

    def __init__(self, mi: Any, scene: Scene, spp: int) -> None:
        self._mi, self._scene, self._spp = mi, scene, spp
        rng = np.random.default_rng([scene.config.seed, 30])
        self._bsdfs = [self._bsdf(material, rng) for material in scene.materials.materials]
        self._still = {"table": self._table(), **self._body(scene.at(0.0).bench)}

    def frame(self, index: int) -> Picture:
        """Render one frame: four moments of the exposure, as the ray caster does."""
        camera = self._scene.camera
        total = np.zeros((camera.height, camera.width, 3), np.float32)
        for k, (_, _, when) in enumerate(PASSES):
            moment = self._scene.at(index + when * self._scene.exposure_frames)
            scene = self._mi.load_dict(self._described(moment))
            seed = self._scene.config.seed * 100003 + 4 * index + k
            image = self._mi.render(scene, spp=max(1, self._spp // len(PASSES)), seed=seed % 2**31)
            total += np.minimum(np.array(image, np.float32)[..., :3], _BRIGHTEST) / len(PASSES)
        moment = self._scene.at(float(index))
        u, v = np.meshgrid(np.arange(camera.width, dtype=float), np.arange(camera.height, dtype=float))
        rays = camera.rays(np.stack([u.ravel(), v.ravel()], 1)) @ moment.world_T_cam[:3, :3].T
        hits = nearest_hits(moment, rays, camera)
        shape = (camera.height, camera.width)
        return Picture(total, hits.alone.reshape(shape), (hits.owner == 0).reshape(shape))

    def _described(self, moment: Moment) -> dict[str, Any]:
        described: dict[str, Any] = {
            "type": "scene",
            "integrator": {"type": "path", "max_depth": _MAX_BOUNCES},
            "sensor": self._sensor(moment.world_T_cam),
            **self._still,
            **self._room(moment.environment),
        }
        for placed in moment.moving:
            described |= self._body(placed)
        return described

    def _sensor(self, world_T_cam: np.ndarray) -> dict[str, Any]:
        camera, mi = self._scene.camera, self._mi
        to_world = world_T_cam @ np.diag([-1.0, -1.0, 1.0, 1.0])
        return {
            "type": "perspective",
            "fov_axis": "x",
            "fov": float(np.degrees(2 * np.arctan(camera.width / (2 * camera.fx)))),
            # From the principal point to the film's middle.
            "principal_point_offset_x": 0.5 - (camera.cx + 0.5) / camera.width,
            "principal_point_offset_y": 0.5 - (camera.cy + 0.5) / camera.height,
            "near_clip": 10.0,
            "far_clip": 10000.0,
            "to_world": mi.ScalarTransform4f(to_world.tolist()),
            "film": {
                "type": "hdrfilm", "width": camera.width, "height": camera.height, "pixel_format": "rgb",
                "rfilter": {"type": "box"},
            },
            "sampler": {"type": "independent"},
        }  # fmt: skip

    def _body(self, placed: Placed) -> dict[str, Any]:
        """A mesh per material of a body, at its place in the world."""
        body, pose = placed.body, placed.world_T_body
        meshes = {}
        for index in np.unique(body.material):
            rows = np.flatnonzero(body.material == index)
            corners = body.vertices[body.faces[rows]]
            frame = np.eye(3)[None] if body.lay_frame is None else body.lay_frame[rows]
            uv = _box_uv(np.einsum("fij,fkj->fki", frame, corners), np.einsum("fij,fj->fi", frame, body.normals[rows]))
            points = corners.reshape(-1, 3) @ pose[:3, :3].T + pose[:3, 3]
            normals = body.corners[rows].reshape(-1, 3) @ pose[:3, :3].T
            name = f"{body.name}_{index}"
            meshes[name] = self._mesh(name, points, normals, uv.reshape(-1, 2), self._bsdfs[index])
        return meshes

    def _mesh(self, name: str, points: np.ndarray, normals: np.ndarray, uv: np.ndarray, bsdf: Any) -> Any:
        """Three corners (3n, 3) per triangle, with normals (3n, 3) and texture coordinates (3n, 2)."""
        mi = self._mi
        properties = mi.Properties()
        properties["mesh_bsdf"] = bsdf
        mesh = mi.Mesh(
            name, len(points), len(points) // 3, props=properties, has_vertex_normals=True, has_vertex_texcoords=True
        )
        values = mi.traverse(mesh)
        for key, array in (("vertex_positions", points), ("vertex_normals", normals), ("vertex_texcoords", uv)):
            values[key] = np.ascontiguousarray(array, np.float32).ravel()
        values["faces"] = np.arange(len(points), dtype=np.uint32)
        values.update()
        return mesh

    def _bsdf(self, material: Material, rng: np.random.Generator) -> Any:
        if sum(material.diffuse) > 0.0:
            return self._mi.load_dict({
                "type": "roughplastic", "distribution": "ggx", "alpha": material.rough,
                "diffuse_reflectance": _rgb(material.diffuse),
            })  # fmt: skip
        # The lobe of mirrored rays is twice as wide as the slopes of the micro-facets, GGX's alpha root two of their
        # deviation.
        along, across = 0.7 * material.rough, 0.7 * float(np.hypot(material.rough, material.streak))
        metal = {
            "type": "roughconductor", "material": "none", "distribution": "ggx", "alpha_u": max(along, 0.02),
            "alpha_v": max(across, 0.02), "specular_reflectance": _rgb(material.mirror),
        }  # fmt: skip
        dull = {"type": "diffuse", "reflectance": _rgb(material.mirror)}
        blend = {"type": "blendbsdf", "weight": 0.5 * material.wide, "metal": metal, "dull": dull}
        bump = {"type": "bumpmap", "scale": material.marks, "bsdf": blend}
        return self._mi.load_dict({**bump, "arbitrary": self._bitmap(_marks(material, rng)[..., None])})

    def _table(self) -> Any:
        table = self._scene.table
        edge = HALF_MM + table.texel_mm / 2
        corners = np.array([[-edge, -edge], [edge, -edge], [edge, edge], [-edge, edge]])[[0, 1, 2, 0, 2, 3]]
        points = np.column_stack([corners, np.zeros(6)])
        uv = (corners + edge) / (2 * edge)
        top = {
            "type": "roughplastic", "distribution": "ggx", "alpha": 0.3, "nonlinear": True,
            "diffuse_reflectance": self._bitmap(table.texture), "specular_reflectance": table.gloss,
        }  # fmt: skip
        return self._mesh("table", points, np.tile([0.0, 0.0, 1.0], (6, 1)), uv, self._mi.load_dict(top))

    def _room(self, room: Environment) -> dict[str, Any]:
        mi = self._mi
        # Mitsuba's panoramas have y up; ours z up, with its middle column towards +x.
        upright = np.array([[0, 0, 1, 0], [1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 0, 1.0]])
        walls = {
            "type": "envmap", "bitmap": mi.Bitmap(np.ascontiguousarray(room.panorama[0][:, ::-1], np.float32)),
            "to_world": mi.ScalarTransform4f(upright.tolist()),
            "sampling_weight": float(np.pi * room.ambient().mean()),
        }  # fmt: skip
        return {"walls": walls, **{f"patch{k}": self._panel(patch) for k, patch in enumerate(room.patches)}}

    def _panel(self, patch: Patch) -> dict[str, Any]:
        # Lamps are tried as often as they light the table.
        square = float(patch.centre @ patch.centre)
        facing = max(float(-patch.centre @ patch.normal), 0.0) * max(float(patch.centre[2]), 0.0) / square
        weight = patch.area * float(patch.radiance.mean()) * facing / square + 1e-3
        to_world = np.eye(4)
        to_world[:3] = np.column_stack([patch.half_u, patch.half_v, patch.normal, patch.centre])
        return {
            "type": "rectangle",
            "to_world": self._mi.ScalarTransform4f(to_world.tolist()),
            "bsdf": {"type": "diffuse", "reflectance": 0.0},
            "light": {"type": "area", "radiance": _rgb(patch.radiance), "sampling_weight": weight},
        }

    def _bitmap(self, values: np.ndarray) -> dict[str, Any]:
        """A texture (h, w, channels) of plain numbers whose row 0 is at v = 0."""
        flipped = np.ascontiguousarray(values[::-1], np.float32)
        return {"type": "bitmap", "bitmap": self._mi.Bitmap(flipped), "raw": True, "wrap_mode": "repeat"}


def _box_uv(corners: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Texture coordinates (n, 3, 2) of face corners (n, 3, 3), mm: seen along the axis that the face looks to most."""
    main = np.abs(normals).argmax(1)
    u = np.where(main[:, None] == 0, corners[..., 1], corners[..., 0])
    v = np.where(main[:, None] == 2, corners[..., 1], corners[..., 2])
    return np.asarray(np.stack([u, v], axis=-1) * _UV_PER_MM)


def _marks(material: Material, rng: np.random.Generator) -> np.ndarray:
    """Heights (size, size), mm, of what tools left, at a slope of 1: lines along u, on castings grain."""
    white = rng.standard_normal((_TEXTURE, _TEXTURE))
    # About as wide as a pixel: finer marks would be noise, and are in the roughness.
    spread = (4.0, 4.0) if material.finish in ("cast", "plain") else (4.0, 80.0)
    heights = gaussian_filter(white, spread, mode="wrap")
    return np.asarray(heights / np.gradient(heights, axis=0).std() / (_UV_PER_MM * _TEXTURE))


def _rgb(colour: Any) -> dict[str, Any]:
    return {"type": "rgb", "value": [float(value) for value in colour]}
