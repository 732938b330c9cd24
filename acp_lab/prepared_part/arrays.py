"""The safetensors files of a prepared part: what stands in which, and the way back."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from acp_lab.cad.edges import EdgeSamples
from acp_lab.cad.part import Part
from acp_lab.detection.view_templates import SEARCH_SAMPLES, Views, views_of
from acp_lab.generator.painted.config import AutoencoderReport
from acp_lab.generator.painted.image_generator import RegionAutoencoder
from acp_lab.generator.templates import TemplateGenerator
from acp_lab.generator.visibility import RegionNetwork
from acp_lab.geometry.arrays import FloatArray
from acp_lab.prepared_part.header import symmetries_of
from acp_lab.prepared_part.integrity import read_arrays
from acp_lab.prepared_part.trained import RegionReport, RegressionValues, Trained

if TYPE_CHECKING:
    from acp_lab.prepared_part.model import PreparedPart

T = TypeVar("T")
R = TypeVar("R")


def arrays_by_file(model: PreparedPart) -> dict[str, Mapping[str, np.ndarray]]:
    """The arrays of each file, by the file's name without suffix."""
    part, edges = model.part, model.edges
    files: dict[str, Mapping[str, np.ndarray]] = {
        "mesh": {"vertices": part.vertices, "faces": part.faces},
        "edges": {
            "points_obj": edges.points_obj,
            "tangents_obj": edges.tangents_obj,
            "normals_obj": edges.normals_obj,
            "crease": edges.crease.astype(np.uint8),
            "convex": edges.convex.astype(np.uint8),
            "spacing_mm": np.array([edges.spacing_mm]),
        },
    }
    if model.templates is not None:
        templates = model.templates
        files["templates"] = {"views_obj": templates.views_obj.astype(np.float32), "packed": templates.packed}
    if model.views is not None:
        views = model.views
        files["views"] = {
            "directions_obj": views.directions_obj,
            "samples": views.samples.astype(np.int32),
            "counts": views.counts,
            "lengths": views.lengths,
        }
    for region, network in model.networks.items():
        # float16 halves the folder; the last layer is nearly all of it, and logits near 0 are undecided anyway.
        files[f"visibility_{region}"] = {**vars(network), "weight3": network.weight3.astype(np.float16)}
    for region, points in model.regressed_points.items():
        files[f"control_points_{region}"] = {"points_obj": points}
    for region, autoencoder in model.autoencoders.items():
        files[f"autoencoder_{region}"] = autoencoder.arrays()
    return files


def load_part(folder: Path, header: Mapping[str, Any], mesh_path: Path | None) -> Part:
    """The CAD model; `mesh_path`: the file that it was prepared from, if known."""
    mesh = read_arrays(folder, header, "mesh")
    for values in mesh.values():
        values.flags.writeable = False
    return Part(
        name=header["name"],
        path=mesh_path,
        sha256=header["mesh"]["sha256"],
        vertices=mesh["vertices"],
        faces=mesh["faces"],
        diameter=float(header["diameter_mm"]),
        box_min=np.array(header["box_min_mm"]),
        box_max=np.array(header["box_max_mm"]),
        symmetries=symmetries_of(header),
    )


def load_edges(folder: Path, header: Mapping[str, Any]) -> EdgeSamples:
    """The 3D edge samples."""
    samples = read_arrays(folder, header, "edges")
    return EdgeSamples(
        samples["points_obj"],
        samples["tangents_obj"],
        samples["normals_obj"],
        samples["crease"].astype(bool),
        samples["convex"].astype(bool),
        float(samples["spacing_mm"][0]),
    )


def load_templates(folder: Path, header: Mapping[str, Any], part: Part, edges: EdgeSamples) -> TemplateGenerator | None:
    """The view templates, if there are any."""
    if "templates" not in header["generators"]:
        return None
    stored = read_arrays(folder, header, "templates")
    if stored["packed"].shape != (len(stored["views_obj"]), (len(edges) + 7) // 8):
        raise ValueError(f"templates of shape {stored['packed'].shape} for {len(edges)} edge samples")
    return TemplateGenerator(edges, part.box_centre, stored["views_obj"], stored["packed"])


def load_views(folder: Path, header: Mapping[str, Any], part: Part, edges: EdgeSamples) -> Views | None:
    """The views that the detector searches; None where there are none."""
    if not header.get("views"):
        return None
    stored = read_arrays(folder, header, "views")
    samples = stored["samples"].astype(np.int64)
    count, counts, lengths = len(samples), stored["counts"], stored["lengths"]
    if samples.shape != (count, SEARCH_SAMPLES) or stored["directions_obj"].shape != (count, 3) or not count:
        raise ValueError(f"views of shape {samples.shape}")
    if not (samples.min() >= 0 and samples.max() < len(edges)):
        raise ValueError(f"views of edge samples that are not among the {len(edges)}")
    if counts.shape != (count,) or not (counts.min() >= 1 and counts.max() <= SEARCH_SAMPLES):
        raise ValueError("views with impossible counts of samples")
    if lengths.shape != (count,) or not lengths.min() > 0.0:
        raise ValueError("views with impossible lengths")
    return views_of(part, edges, stored["directions_obj"], samples, stored["counts"], stored["lengths"])


def load_networks(folder: Path, header: Mapping[str, Any], edges: EdgeSamples) -> Trained[RegionNetwork, RegionReport]:
    """The visibility networks."""

    def network(region: int) -> RegionNetwork:
        stored = read_arrays(folder, header, f"visibility_{region}")
        network = RegionNetwork(**{**stored, "weight3": stored["weight3"].astype(np.float32)})
        if len(network.rows) and network.rows.max() >= len(edges):
            raise ValueError(f"the network of region {region} knows more edge samples than there are")
        return network

    learned = header["generators"].get("learned", {})
    return _trained(learned, "training", lambda report: RegionReport(**report), network)


def load_regressed_points(folder: Path, header: Mapping[str, Any]) -> Trained[FloatArray, RegressionValues]:
    """The regressed control points W, (4, 3) mm each."""

    def points(region: int) -> FloatArray:
        points: FloatArray = read_arrays(folder, header, f"control_points_{region}")["points_obj"]
        if points.shape != (4, 3):
            raise ValueError(f"control points of shape {points.shape}")
        return points

    # Parts prepared before there was an auto-encoder lack this key, and its own.
    return _trained(header.get("control_points", {}), "regression", dict, points)


def load_autoencoders(folder: Path, header: Mapping[str, Any]) -> Trained[RegionAutoencoder, AutoencoderReport]:
    """The paper's edge image generators."""

    def autoencoder(region: int) -> RegionAutoencoder:
        return RegionAutoencoder.from_arrays(read_arrays(folder, header, f"autoencoder_{region}"))

    painted = header["generators"].get("autoencoder", {})
    return _trained(painted, "training", AutoencoderReport.from_json, autoencoder)


def _trained(
    stored: Mapping[str, Any],
    settings: str,
    report_of: Callable[[Mapping[str, Any]], R],
    load: Callable[[int], T],
) -> Trained[T, R]:
    """What part.json lists under "regions", each loaded; `settings` is the key of the settings beside it."""
    reports = {report["region"]: report_of(report) for report in stored.get("regions", ())}
    return Trained({region: load(region) for region in reports}, reports, stored.get(settings, ""))
