"""Ways to draw the edge image of a view, for the comparison of their speed: each makes a function View -> (h, w)."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import torch

from acp_lab.cad.edges import EdgeSamples
from acp_lab.cad.part import Part
from acp_lab.cad.raycast import RayCaster, normal_map
from acp_lab.control_points.canonical_frame import CANONICAL_SIZE, CanonicalFrame
from acp_lab.control_points.coplanar_points import mid_section_points
from acp_lab.control_points.motion_pairs import draw_samples, visible_rows
from acp_lab.control_points.view_regions import ALL_REGIONS
from acp_lab.generator.base import RigidGenerator
from acp_lab.generator.painted.autoencoder import Decoder
from acp_lab.generator.painted.config import AutoencoderConfig
from acp_lab.generator.painted.image_generator import AutoencoderGenerator, RegionAutoencoder
from acp_lab.generator.painted.latent_regressor import LatentRegressor
from acp_lab.generator.visibility import RegionNetwork, VisibilityNetwork
from acp_lab.geometry.camera import Camera

SEED = 0
# Steps of the 8-bit normals between neighbouring pixels; a crease of 25 degrees makes about 55.
CANNY_LOW, CANNY_HIGH = 60.0, 150.0


@dataclass(frozen=True)
class View:
    """One view: its region 0..5 and canonical frame, which also is a camera."""

    region: int
    frame: CanonicalFrame


@dataclass(frozen=True)
class MeshUnderTest:
    """One mesh, what is made of it once, and the seconds that took."""

    part: Part
    caster: RayCaster
    edges: EdgeSamples
    tree_s: float
    edges_s: float


Draw = Callable[[View], np.ndarray]


def autoencoder(part: Part) -> Draw:
    """t(I) of the paper, eq. 5: control points -> latent -> decoder, of the usual widths for 128 px, untrained."""
    shape = AutoencoderConfig().painting(CANONICAL_SIZE).shape
    torch.manual_seed(SEED)
    regressor = LatentRegressor(shape)
    points_obj = [mid_section_points(part.box_min, part.box_max, region.axis) for region in ALL_REGIONS]
    stored = {
        region.index: RegionAutoencoder.of_networks(
            shape,
            Decoder(shape),
            {"regressed": regressor, "mid-section": regressor},
            {"regressed": points_obj[region.index], "mid-section": points_obj[region.index]},
        )
        for region in ALL_REGIONS
    }
    generator = AutoencoderGenerator(stored, part.name)
    for region in stored:  # networks are built when a region is first used
        generator.edge_image(np.zeros((4, 2)), region)

    def draw(view: View) -> np.ndarray:
        return generator.edge_image(view.frame.project(points_obj[view.region]), view.region)

    return draw


def edge_samples(mesh: MeshUnderTest) -> Draw:
    """The mesh's own edges, hidden ones found by one ray each, drawn as strokes."""

    def draw(view: View) -> np.ndarray:
        pose = view.frame.canonical_T_obj
        camera = Camera.from_matrix(view.frame.matrix, view.frame.size, view.frame.size)
        return draw_samples(mesh.edges, visible_rows(mesh.part, mesh.edges, mesh.caster, pose), camera, pose)

    return draw


def stored_visibility(generator: RigidGenerator) -> Draw:
    """The same edges, with a generator in place of the rays."""

    def draw(view: View) -> np.ndarray:
        pose = view.frame.canonical_T_obj
        camera = Camera.from_matrix(view.frame.matrix, view.frame.size, view.frame.size)
        rows = generator.visible(pose, view.region, len(generator.edges)).ids
        return draw_samples(generator.edges, rows, camera, pose)

    return draw


def untrained_network(mesh: MeshUnderTest) -> RigidGenerator:
    """A visibility network of the size that training makes, with random weights, that calls everything visible."""
    rng = np.random.default_rng(SEED)
    hidden, samples = 128, len(mesh.edges)

    def weights(*shape: int) -> np.ndarray:
        return rng.normal(0.0, 0.05, shape).astype(np.float32)

    network = RegionNetwork(
        weights(hidden, 8),
        weights(hidden),
        weights(hidden, hidden),
        weights(hidden),
        weights(samples, hidden),
        np.full(samples, 100.0, np.float32),
        np.arange(samples, dtype=np.int32),
    )
    return VisibilityNetwork(mesh.part, mesh.edges, dict.fromkeys(range(6), network), None)


def ray_cast_normals(mesh: MeshUnderTest) -> Draw:
    """A normal per pixel by rays (Embree), then Canny, without any graphics library."""

    def draw(view: View) -> np.ndarray:
        camera = Camera.from_matrix(view.frame.matrix, view.frame.size, view.frame.size)
        return canny_of_normals(normal_map(mesh.part, mesh.caster, camera, view.frame.canonical_T_obj))

    return draw


def make_renderer(size: int) -> Any:
    """pyrender's renderer, one for all meshes (a second one breaks the first); None where OpenGL does not work."""
    try:
        import pyrender

        return pyrender.OffscreenRenderer(size, size)
    except Exception as error:  # whatever EGL and its drivers come up with
        print(f"OpenGL does not work here, its column is left out: {error}", file=sys.stderr)
        return None


def rendered_normals(mesh: MeshUnderTest, renderer: Any) -> Draw:
    """Normals as colours through OpenGL (pyrender), then Canny: the way of the authors."""
    import pyrender

    corners = mesh.part.vertices[mesh.part.faces].reshape(-1, 3)
    colours = np.repeat(0.5 * (mesh.part.face_normals + 1.0), 3, axis=0)
    primitive = pyrender.Primitive(
        positions=corners.astype(np.float32), color_0=np.column_stack([colours, np.ones(len(colours))])
    )
    scene = pyrender.Scene(bg_color=(0.0, 0.0, 0.0, 1.0), ambient_light=(1.0, 1.0, 1.0))
    node = scene.add(pyrender.Mesh([primitive]))
    camera_node = scene.add(pyrender.IntrinsicsCamera(1.0, 1.0, 0.0, 0.0), pose=np.eye(4))
    gl_T_cv = np.diag([1.0, -1.0, -1.0, 1.0])

    def draw(view: View) -> np.ndarray:
        pose = view.frame.canonical_T_obj
        depth = float(np.linalg.norm(pose[:3, :3] @ mesh.part.box_centre + pose[:3, 3]))
        middle = 0.5 * view.frame.size  # OpenGL's pixel centres lie at +0.5
        camera_node.camera = pyrender.IntrinsicsCamera(
            view.frame.focal_px,
            view.frame.focal_px,
            middle,
            middle,
            znear=depth - 1.05 * mesh.part.radius,
            zfar=depth + 1.05 * mesh.part.radius,
        )
        scene.set_pose(node, gl_T_cv @ pose)
        image, _ = renderer.render(scene, pyrender.RenderFlags.FLAT | pyrender.RenderFlags.SKIP_CULL_FACES)
        return canny_of_colours(image)

    return draw


def canny_of_normals(normals: np.ndarray) -> np.ndarray:
    """Edges (h, w) bool of a map of unit normals (h, w, 3), 0 where no part is."""
    colours = np.round(127.5 * (normals + 1.0)).astype(np.uint8)
    colours[~normals.any(2)] = 0
    return canny_of_colours(colours)


def canny_of_colours(image: np.ndarray) -> np.ndarray:
    """Edges (h, w) bool of an image (h, w, 3) uint8, whichever channel shows them best."""
    return cv2.Canny(np.ascontiguousarray(image), CANNY_LOW, CANNY_HIGH, L2gradient=True) > 0
