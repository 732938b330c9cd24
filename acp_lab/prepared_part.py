"""What the offline phase leaves behind: one folder per part, `part.json` and safetensors, no pickle.

    PARTS_DIR/bracket/part.json                     name, mesh hash, edge break, generators and their reports
                      mesh.safetensors              vertices (mm) and faces
                      edges.safetensors             3D edge samples
                      templates.safetensors         views and what each hides        (generator templates)
                      visibility_0.safetensors ...  one network per view region      (generator learned)

Files are written whole or not at all; part.json comes last and names what is complete.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from safetensors import SafetensorError
from safetensors.numpy import load_file
from safetensors.numpy import save as serialise

from acp_lab.cad.edges import EdgeSamples
from acp_lab.cad.models_info import Symmetries
from acp_lab.cad.part import Part
from acp_lab.errors import PreparationError
from acp_lab.generator.base import RigidGenerator
from acp_lab.generator.templates import TemplateGenerator
from acp_lab.generator.visibility import RegionNetwork, VisibilityNetwork

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
    """

    part: Part
    edges: EdgeSamples
    edge_break_mm: float = DEFAULT_EDGE_BREAK_MM
    seed: int = 0
    templates: TemplateGenerator | None = None
    networks: Mapping[int, RegionNetwork] = field(default_factory=dict)
    reports: tuple[RegionReport, ...] = ()
    training: str = ""

    @property
    def generator_names(self) -> tuple[str, ...]:
        """Generators that are prepared, the best first."""
        names = ("learned",) if self.networks else ()
        return (*names, "templates") if self.templates is not None else names

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
        _write(folder / "part.json", (json.dumps(self._header(), indent=2) + "\n").encode())

    @staticmethod
    def load(folder: Path, mesh: Path | None = None) -> PreparedPart:
        """Read a prepared part.

        Args:
            mesh: the mesh file that it must have been prepared from, checked by SHA-256.

        Raises:
            PreparationError: missing, incomplete, of another version, or prepared from another mesh.
        """
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
    _write(path, serialise({key: np.ascontiguousarray(value) for key, value in arrays.items()}))


def _write(path: Path, content: bytes) -> None:
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    temporary.write_bytes(content)
    os.replace(temporary, path)


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
    return PreparedPart(
        part,
        edges,
        float(header["edge_break_mm"]),
        int(header["seed"]),
        templates,
        networks,
        reports,
        generators.get("learned", {}).get("training", ""),
    )


def load_network(folder: Path, region: int) -> RegionNetwork:
    """The visibility network of one region 0..5."""
    stored = load_file(folder / f"visibility_{region}.safetensors")
    return RegionNetwork(**{**stored, "weight3": stored["weight3"].astype(np.float32)})


def _sha256(path: Path, mend: str) -> str:
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError as error:
        raise PreparationError(f"{path}: the mesh cannot be read ({error.strerror}); {mend}") from None
