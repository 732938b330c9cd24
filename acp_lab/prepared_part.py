"""What the offline phase leaves behind: one folder per part, `part.json` and safetensors, no pickle.

    PARTS_DIR/bracket/part.json                     name, mesh hash, edge break, generators and their reports
                      mesh.safetensors              vertices (mm) and faces
                      edges.safetensors             3D edge samples
                      templates.safetensors         views and what each hides        (generator templates)
                      visibility_0.safetensors ...  one network per view region      (generator learned)
                      control_points_0.safetensors  regressed W per view region      (generator autoencoder)
                      autoencoder_0.safetensors ... decoder and latent regressors    (generator autoencoder)

Files are written whole or not at all; part.json comes last and names what is complete.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from safetensors import SafetensorError
from safetensors.numpy import load_file
from safetensors.numpy import save as serialise

from acp_lab.cad.edges import EdgeSamples
from acp_lab.cad.models_info import Symmetries
from acp_lab.cad.part import Part
from acp_lab.control_points.coplanar_points import mid_section_points
from acp_lab.control_points.view_regions import ALL_REGIONS
from acp_lab.errors import PreparationError
from acp_lab.files import write_whole
from acp_lab.generator.base import RigidGenerator
from acp_lab.generator.painted.config import AutoencoderReport
from acp_lab.generator.painted.image_generator import AutoencoderGenerator, PointSet, RegionAutoencoder
from acp_lab.generator.templates import TemplateGenerator
from acp_lab.generator.visibility import RegionNetwork, VisibilityNetwork
from acp_lab.geometry.arrays import ByteImage

FORMAT_VERSION = 1
# Chosen by measuring on sequences with and without broken edges, see docs/benchmark.md.
DEFAULT_EDGE_BREAK_MM = 0.25


@dataclass(frozen=True)
class RegionReport:
    """Held-out quality of one region's visibility network, as stored in part.json."""

    region: int
    precision: float
    recall: float
    hidden_found: float
    final_loss: float
    train_s: float


@dataclass(frozen=True)
class PreparedPart:
    """A part with everything that tracking needs.

    Attributes:
        part: the CAD model.
        edges: its 3D edge samples.
        edge_break_mm: how far the real part's outlines are expected to be broken.
        seed: of all random choices.
        templates: view templates, if prepared.
        networks: visibility networks by region 0..5, if trained.
        reports: one per trained network.
        training: identifies the settings that the networks were trained with.
        regressed_points: the regressed W (4, 3) mm by region 0..5, where they were regressed.
        regression_reports: what the regression did to each, as numbers by name; regression: identifies its settings.
        autoencoders: the paper's edge image generator by region 0..5, if trained.
        autoencoder_reports: one per trained region; autoencoder_training: identifies the settings.
    """

    part: Part
    edges: EdgeSamples
    edge_break_mm: float = DEFAULT_EDGE_BREAK_MM
    seed: int = 0
    templates: TemplateGenerator | None = None
    networks: Mapping[int, RegionNetwork] = field(default_factory=dict)
    reports: tuple[RegionReport, ...] = ()
    training: str = ""
    regressed_points: Mapping[int, np.ndarray] = field(default_factory=dict)
    regression_reports: tuple[Mapping[str, Any], ...] = ()
    regression: str = ""
    autoencoders: Mapping[int, RegionAutoencoder] = field(default_factory=dict)
    autoencoder_reports: tuple[AutoencoderReport, ...] = ()
    autoencoder_training: str = ""

    @property
    def generator_names(self) -> tuple[str, ...]:
        """Generators that are prepared, the best first."""
        made = {"learned": self.networks, "templates": self.templates is not None, "autoencoder": self.autoencoders}
        return tuple(name for name, there in made.items() if there)

    def best_generator(self) -> RigidGenerator:
        """The learned generator, else the templates.

        Raises:
            PreparationError: neither is prepared.
        """
        if self.networks:
            return VisibilityNetwork(self.part, self.edges, self.networks, self.templates)
        if self.templates is None:
            raise PreparationError(
                f"{self.part.name}: no generator is prepared; "
                f"run: acp-lab prepare {self.part.path or 'MESH'} --out PARTS_DIR"
            )
        return self.templates

    def autoencoder(self) -> AutoencoderGenerator:
        """The paper's t(I).

        Raises:
            PreparationError: it is not prepared.
        """
        if not self.autoencoders:
            raise PreparationError(f"{self.part.name}: no auto-encoder is prepared; {self._autoencoder_command()}")
        return AutoencoderGenerator(self.autoencoders, self.part.name)

    def control_points(self, region: int, point_set: PointSet) -> np.ndarray:
        """(4, 3) mm: W of a view region 0..5, as regressed or the box's middle section as it is.

        Raises:
            PreparationError: the region's points are not regressed.
        """
        if point_set == "mid-section":
            return mid_section_points(self.part.box_min, self.part.box_max, ALL_REGIONS[region].axis)
        if region not in self.regressed_points:
            raise PreparationError(
                f"{self.part.name}: the control points of view region {region} are not regressed; "
                f"{self._autoencoder_command()}"
            )
        return self.regressed_points[region]

    def _autoencoder_command(self) -> str:
        return f"run: acp-lab prepare {self.part.path or 'MESH'} --out PARTS_DIR --generator autoencoder"

    def save(self, folder: Path) -> None:
        """Write the whole part; each file atomically, part.json last."""
        folder.mkdir(parents=True, exist_ok=True)
        part, edges = self.part, self.edges
        _retract(folder / "part.json", part.sha256)
        _save(folder / "mesh.safetensors", {"vertices": part.vertices, "faces": part.faces})
        _save(
            folder / "edges.safetensors",
            {
                "points_obj": edges.points_obj,
                "tangents_obj": edges.tangents_obj,
                "normals_obj": edges.normals_obj,
                "crease": edges.crease.astype(np.uint8),
                "convex": edges.convex.astype(np.uint8),
                "spacing_mm": np.array([edges.spacing_mm]),
            },
        )
        if self.templates is not None:
            _save(
                folder / "templates.safetensors",
                {"views_obj": self.templates.views_obj.astype(np.float32), "packed": self.templates.packed},
            )
        for region, network in self.networks.items():
            # float16 halves the folder; the last layer is nearly all of it, and logits near 0 are undecided anyway.
            stored = {**vars(network), "weight3": network.weight3.astype(np.float16)}
            _save(folder / f"visibility_{region}.safetensors", stored)
        for region, points in self.regressed_points.items():
            _save(folder / f"control_points_{region}.safetensors", {"points_obj": points})
        for region, autoencoder in self.autoencoders.items():
            _save(folder / f"autoencoder_{region}.safetensors", autoencoder.arrays())
        write_whole(folder / "part.json", (json.dumps(self._header(), indent=2) + "\n").encode())

    @staticmethod
    def load(folder: str | Path, mesh: str | Path | None = None) -> PreparedPart:
        """Read a prepared part.

        Args:
            mesh: the mesh file that it must have been prepared from, checked by SHA-256.

        Raises:
            PreparationError: missing, incomplete, of another version, or prepared from another mesh.
        """
        folder, mesh = Path(folder), None if mesh is None else Path(mesh)
        path, again = folder / "part.json", f"run: acp-lab prepare {mesh or 'MESH'} --out {folder.parent}"
        header = read_header(folder, again)
        if mesh is not None and header["mesh"]["sha256"] != _sha256(mesh, again):
            raise PreparationError(f"{path}: prepared from another mesh than {mesh}; {again} --no-resume")
        try:
            return _assemble(folder, header, mesh)
        except (
            OSError,
            SafetensorError,
            KeyError,
            TypeError,
            ValueError,
            IndexError,
            AttributeError,
        ) as error:
            reason = str(error).splitlines()[0] if str(error) else type(error).__name__
            raise PreparationError(f"{folder}: the prepared part is damaged ({reason}); {again} --no-resume") from None

    def _header(self) -> dict[str, Any]:
        part = self.part
        header: dict[str, Any] = {
            "format": "acp_lab.part",
            "version": FORMAT_VERSION,
            "name": part.name,
            "mesh": {"file": part.path.name if part.path else None, "sha256": part.sha256},
            "diameter_mm": part.diameter,
            "box_min_mm": part.box_min.tolist(),
            "box_max_mm": part.box_max.tolist(),
            "symmetries": {
                "discrete": part.symmetries.discrete.tolist(),
                "continuous": [[list(axis), list(offset)] for axis, offset in part.symmetries.continuous],
            },
            "edge_break_mm": self.edge_break_mm,
            "edge_samples": len(self.edges),
            "seed": self.seed,
            "generators": {},
        }
        if self.templates is not None:
            header["generators"]["templates"] = {"views": len(self.templates.views_obj)}
        if self.networks:
            header["generators"]["learned"] = {
                "training": self.training,
                "held_out_precision": float(np.mean([report.precision for report in self.reports])),
                "held_out_recall": float(np.mean([report.recall for report in self.reports])),
                "held_out_hidden_found": float(np.mean([report.hidden_found for report in self.reports])),
                "regions": [asdict(report) for report in self.reports],
            }
        if self.autoencoders:
            qualities = [report.generated for report in self.autoencoder_reports]
            header["generators"]["autoencoder"] = {
                "training": self.autoencoder_training,
                "held_out_chamfer_px": {
                    "generated_to_true": float(np.mean([quality.generated_to_true_px for quality in qualities])),
                    "true_to_generated": float(np.mean([quality.true_to_generated_px for quality in qualities])),
                },
                "held_out_f_score": float(np.mean([quality.f_score for quality in qualities])),
                "regions": [asdict(report) for report in self.autoencoder_reports],
            }
        if self.regressed_points:
            header["control_points"] = {
                "regression": self.regression,
                "regions": [dict(report) for report in self.regression_reports],
            }
        return header


def read_header(folder: Path, mend: str) -> dict[str, Any]:
    """part.json of a folder; PreparationError with the `mend` when there is none or it is not one of ours."""
    path = folder / "part.json"
    try:
        header = json.loads(path.read_text(encoding="utf-8"))
        known = header["format"] == "acp_lab.part"
        version = header["version"]
        header["mesh"]["sha256"]
    except FileNotFoundError:
        raise PreparationError(f"{folder}: this part is not prepared; {mend}") from None
    except (OSError, ValueError, KeyError, TypeError):
        raise PreparationError(f"{path}: cannot be read as a prepared part; {mend} --no-resume") from None
    if not known or version != FORMAT_VERSION:
        raise PreparationError(
            f"{path}: has format version {version}, this program reads version {FORMAT_VERSION}; {mend} --no-resume"
        )
    return dict(header)


def write_picture(path: Path, picture: ByteImage) -> None:
    """A grey picture (h, w) uint8 as PNG, whole or not at all."""
    _, content = cv2.imencode(".png", picture)
    write_whole(path, content.tobytes())


def _retract(path: Path, sha256: str) -> None:
    """Take back a part.json of another mesh: until it is written anew, the files beside it are of both."""
    try:
        known = json.loads(path.read_text(encoding="utf-8"))["mesh"]["sha256"]
    except (OSError, ValueError, KeyError, TypeError):
        known = None
    if known != sha256:
        path.unlink(missing_ok=True)


def _save(path: Path, arrays: Mapping[str, np.ndarray]) -> None:
    # Not save_file: it makes files that only their owner may read, and parts are shared.
    write_whole(path, serialise({key: np.ascontiguousarray(value) for key, value in arrays.items()}))


def _assemble(folder: Path, header: Mapping[str, Any], mesh_path: Path | None) -> PreparedPart:
    mesh, samples = load_file(folder / "mesh.safetensors"), load_file(folder / "edges.safetensors")
    symmetries = header["symmetries"]
    part = Part(
        name=header["name"],
        path=mesh_path,
        sha256=header["mesh"]["sha256"],
        vertices=mesh["vertices"],
        faces=mesh["faces"],
        diameter=float(header["diameter_mm"]),
        box_min=np.array(header["box_min_mm"]),
        box_max=np.array(header["box_max_mm"]),
        symmetries=Symmetries(
            np.array(symmetries["discrete"]).reshape(-1, 4, 4),
            tuple((tuple(axis), tuple(offset)) for axis, offset in symmetries["continuous"]),
        ),
    )
    edges = EdgeSamples(
        samples["points_obj"],
        samples["tangents_obj"],
        samples["normals_obj"],
        samples["crease"].astype(bool),
        samples["convex"].astype(bool),
        float(samples["spacing_mm"][0]),
    )
    generators = header["generators"]
    templates = None
    if "templates" in generators:
        stored = load_file(folder / "templates.safetensors")
        if stored["packed"].shape != (len(stored["views_obj"]), (len(edges) + 7) // 8):
            raise ValueError(f"templates of shape {stored['packed'].shape} for {len(edges)} edge samples")
        templates = TemplateGenerator(edges, part.box_centre, stored["views_obj"], stored["packed"])
    reports = tuple(RegionReport(**report) for report in generators.get("learned", {}).get("regions", ()))
    networks = {report.region: load_network(folder, report.region) for report in reports}
    for region, network in networks.items():
        if len(network.rows) and network.rows.max() >= len(edges):
            raise ValueError(f"the network of region {region} knows more edge samples than there are")
    # Parts prepared before there was an auto-encoder have neither of these two keys.
    painted, regression = generators.get("autoencoder", {}), header.get("control_points", {})
    painted_reports = tuple(AutoencoderReport.from_json(report) for report in painted.get("regions", ()))
    regression_reports = tuple(regression.get("regions", ()))
    return PreparedPart(
        part,
        edges,
        float(header["edge_break_mm"]),
        int(header["seed"]),
        templates,
        networks,
        reports,
        generators.get("learned", {}).get("training", ""),
        {report["region"]: _load_points(folder, report["region"]) for report in regression_reports},
        regression_reports,
        regression.get("regression", ""),
        {report.region: load_autoencoder(folder, report.region) for report in painted_reports},
        painted_reports,
        painted.get("training", ""),
    )


def load_network(folder: Path, region: int) -> RegionNetwork:
    """The visibility network of one region 0..5."""
    stored = load_file(folder / f"visibility_{region}.safetensors")
    return RegionNetwork(**{**stored, "weight3": stored["weight3"].astype(np.float32)})


def load_autoencoder(folder: Path, region: int) -> RegionAutoencoder:
    """The edge image generator of one region 0..5."""
    return RegionAutoencoder.from_arrays(load_file(folder / f"autoencoder_{region}.safetensors"))


def _load_points(folder: Path, region: int) -> np.ndarray:
    points: np.ndarray = load_file(folder / f"control_points_{region}.safetensors")["points_obj"]
    if points.shape != (4, 3):
        raise ValueError(f"control points of shape {points.shape}")
    return points


def _sha256(path: Path, mend: str) -> str:
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError as error:
        raise PreparationError(f"{path}: the mesh cannot be read ({error.strerror}); {mend}") from None
