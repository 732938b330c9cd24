"""part.json: what a prepared part is, what it was prepared with, which generators it has and how good they are."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from acp_lab.cad.models_info import Symmetries
from acp_lab.errors import InputFileError, PreparationError
from acp_lab.geometry.arrays import FloatArray
from acp_lab.input_file import read_bytes, read_json_object
from acp_lab.prepared_part.integrity import changes, checksum

if TYPE_CHECKING:
    from acp_lab.prepared_part.model import PreparedPart

FORMAT_VERSION = 2
UNSEALED_VERSION = 1
"""Of parts without checksums; `prepare` adds them, nothing else reads such parts."""


_LONGEST_NAME = 249
"""Bytes: file systems take 255, and the folder's lock has six more than the folder."""


def part_folder(parts: Path, name: str, mesh: Path | None = None) -> Path:
    """Where a part of that name is stored among `parts`; PreparationError for a name that would be elsewhere.

    mesh: the file that the part is named after, if it is of one, to begin the message with.
    """
    shown = str(mesh)
    where = "" if mesh is None else f"{shown if shown.isprintable() else repr(shown)}: "
    if not name or name.startswith(".") or not name.isprintable() or Path(name).name != name or "\\" in name:
        told = f"a part cannot be named {name!r}, which is no plain folder name"
        raise PreparationError(f"{where}{told}: rename its mesh file")
    if len(os.fsencode(name)) > _LONGEST_NAME:
        told = f"a part is named after its file, and {len(os.fsencode(name))} bytes are too many for a folder's name"
        raise PreparationError(f"{where}{told} ({_LONGEST_NAME} at most): rename its mesh file")
    return parts / name


def header_of(model: PreparedPart) -> dict[str, Any]:
    """The values of part.json."""
    part = model.part
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
        "near_turns": model.near_turns.tolist(),
        "edge_break_mm": model.edge_break_mm,
        "edge_samples": len(model.edges),
        "views": 0 if model.views is None else len(model.views),
        "seed": model.seed,
        "options": {generator: asdict(options) for generator, options in model.options.items()},
        "generators": _generators(model),
        "cpu_s": {stage: round(value, 3) for stage, value in model.cpu_s.items()},
    }
    if model.regressed_points:
        header["control_points"] = {
            "regression": model.regressed_points.settings,
            "regions": [dict(report) for report in model.regressed_points.reports.values()],
        }
    return header


def _generators(model: PreparedPart) -> dict[str, Any]:
    generators: dict[str, Any] = {}
    if model.templates is not None:
        generators["templates"] = {"views": len(model.templates.views_obj)}
    if model.networks:
        reports = list(model.networks.reports.values())
        generators["learned"] = {
            "training": model.networks.settings,
            "held_out_precision": _mean(report.precision for report in reports),
            "held_out_recall": _mean(report.recall for report in reports),
            "held_out_hidden_found": _mean(report.hidden_found for report in reports),
            "regions": [asdict(report) for report in reports],
        }
    if model.autoencoders:
        painted = list(model.autoencoders.reports.values())
        generators["autoencoder"] = {
            "training": model.autoencoders.settings,
            "held_out_chamfer_px": {
                "generated_to_true": _mean(report.generated.generated_to_true_px for report in painted),
                "true_to_generated": _mean(report.generated.true_to_generated_px for report in painted),
            },
            "held_out_f_score": _mean(report.generated.f_score for report in painted),
            "pose_bias_percent": _mean_known(report.bias_percent for report in painted),
            "regions": [asdict(report) for report in painted],
        }
    return generators


def read_header(folder: Path, fix: str) -> dict[str, Any]:
    """part.json of a folder; PreparationError, ending in `fix`, when there is none or it is no prepared part.

    It may be of a part without checksums; its own is not checked.
    """
    path = folder / "part.json"
    if not path.exists():
        check_holds_parts(folder.parent)
        if any(folder.glob("*/part.json")):
            names = ", ".join(sorted(str(below.parent) for below in folder.glob("*/part.json")))
            raise PreparationError(f"{folder}: is no part, it holds some: name one of them: {names}")
        raise PreparationError(f"{folder}: this part is not prepared; {fix}")
    if not os.access(path, os.R_OK):
        raise PreparationError(f"{path}: cannot be read: check its permissions")
    try:
        header = read_json_object(path, fix)
        known = header["format"] == "acp_lab.part"
        version = header["version"]
        header["mesh"]["sha256"]
    except (InputFileError, KeyError, TypeError):
        raise PreparationError(f"{path}: cannot be read as a prepared part; {fix} --no-resume") from None
    if not known or version not in (UNSEALED_VERSION, FORMAT_VERSION):
        raise PreparationError(
            f"{path}: has format version {str(version)[:20]}, this program reads version {FORMAT_VERSION}; "
            f"{fix} --no-resume"
        )
    return header


def check_holds_parts(parts: Path) -> None:
    """PreparationError for a folder that is a part itself where the folder of parts is wanted."""
    if (parts / "part.json").exists():
        raise PreparationError(f"{parts}: is a prepared part itself: --parts is the folder above, {parts.parent}")


def symmetries_of(header: Mapping[str, Any]) -> Symmetries:
    """The part's symmetries."""
    stored = header["symmetries"]
    return Symmetries(
        np.array(stored["discrete"]).reshape(-1, 4, 4),
        tuple((tuple(axis), tuple(offset)) for axis, offset in stored["continuous"]),
    )


def near_turns_of(header: Mapping[str, Any]) -> FloatArray:
    """(k, 4, 4), see `cad.near_turns`."""
    return np.array(header.get("near_turns", ()), np.float64).reshape(-1, 4, 4)


def withdraw_header(folder: Path, sha256: str, contents: Mapping[str, bytes]) -> None:
    """Remove the part.json of another mesh, or of files that are about to change: until it is written anew, it and
    the files beside it do not belong together. contents: of the files to write, by name.
    """
    try:
        known = read_header(folder, "")
    except PreparationError:
        known = {}
    if not known or known["mesh"]["sha256"] != sha256 or changes(known, contents):
        (folder / "part.json").unlink(missing_ok=True)


def sha256_of(mesh: Path, fix: str) -> str:
    """The hash of a mesh file; PreparationError, ending in `fix`, when it cannot be read."""
    try:
        return checksum(read_bytes(mesh))
    except InputFileError as error:
        reason = str(error).removeprefix(f"{mesh}: ")
        raise PreparationError(f"{mesh}: the mesh cannot be read ({reason}); {fix}") from None


def _mean_known(values: Iterable[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return _mean(known) if known else None


def _mean(values: Iterable[float]) -> float:
    return float(np.mean(list(values)))
