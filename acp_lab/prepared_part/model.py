"""A part with everything that tracking needs, and its folder on disk."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from safetensors import SafetensorError
from safetensors.numpy import save as serialise

from acp_lab.cad.edges import EdgeSamples
from acp_lab.cad.part import Part
from acp_lab.control_points.coplanar_points import mid_section_points
from acp_lab.control_points.view_regions import ALL_REGIONS
from acp_lab.detection.view_templates import Views
from acp_lab.errors import AcpLabError, PreparationError
from acp_lab.files import staged
from acp_lab.generator.base import RigidGenerator
from acp_lab.generator.device import Device
from acp_lab.generator.painted.config import AutoencoderReport
from acp_lab.generator.painted.image_generator import AutoencoderGenerator, PointSet, RegionAutoencoder
from acp_lab.generator.templates import TemplateGenerator
from acp_lab.generator.visibility import RegionNetwork, VisibilityNetwork
from acp_lab.geometry.arrays import FloatArray
from acp_lab.input_file import path_of
from acp_lab.pasted import quoted
from acp_lab.prepared_part import arrays
from acp_lab.prepared_part.header import (
    UNSEALED_VERSION,
    header_of,
    near_turns_of,
    read_header,
    sha256_of,
    withdraw_header,
)
from acp_lab.prepared_part.integrity import SUFFIX, check_sealed, header_bytes
from acp_lab.prepared_part.options import PrepareOptions
from acp_lab.prepared_part.trained import RegionReport, RegressionValues, Trained

DEFAULT_EDGE_BREAK_MM = 0.25
"""Of a part of usual size, see `cad.part.USUAL_DIAMETERS`; `prepare` takes it in proportion for others.

Chosen by measuring on sequences with and without broken edges, see docs/benchmark-parts.md.
"""


@dataclass(frozen=True, eq=False, repr=False)
class PreparedPart:
    """A part with everything that tracking needs.

    Attributes:
        part: the CAD model.
        edges: its 3D edge samples.
        edge_break_mm: how far the real part's outlines are expected to be broken.
        seed: of all random choices.
        templates: view templates, if prepared.
        views: what shows from all around, for finding the part; None in parts prepared before there was a detector.
        near_turns: (k, 4, 4) after which most of the part looks the same, see `cad.near_turns`; none in parts prepared
            before they were looked for.
        networks: the visibility networks that were trained.
        regressed_points: the regressed W (4, 3) mm of each region.
        autoencoders: the paper's edge image generators that were trained.
        options: what it was prepared with, the latest for each generator that was asked for.
        cpu_s: CPU seconds of all threads that each stage of preparation took, by its name; stages of parts prepared
            by earlier versions are missing.
        folder: where it was loaded from; None for a part that is only in memory.
    """

    part: Part
    edges: EdgeSamples
    edge_break_mm: float = DEFAULT_EDGE_BREAK_MM
    seed: int = 0
    templates: TemplateGenerator | None = None
    views: Views | None = None
    near_turns: FloatArray = field(default_factory=lambda: np.zeros((0, 4, 4)))
    networks: Trained[RegionNetwork, RegionReport] = field(default_factory=Trained)
    regressed_points: Trained[FloatArray, RegressionValues] = field(default_factory=Trained)
    autoencoders: Trained[RegionAutoencoder, AutoencoderReport] = field(default_factory=Trained)
    options: Mapping[str, PrepareOptions] = field(default_factory=dict)
    cpu_s: Mapping[str, float] = field(default_factory=dict)
    folder: Path | None = field(default=None, compare=False)

    def __repr__(self) -> str:
        generators = ", ".join(self.generator_names) or "none"
        return f"PreparedPart({self.part!r}, generators: {generators}, {len(self.edges)} edge samples)"

    def took(self, stage: str, cpu_s: float) -> PreparedPart:
        """The same, some CPU seconds of a stage later."""
        return replace(self, cpu_s={**self.cpu_s, stage: self.cpu_s.get(stage, 0.0) + cpu_s})

    @property
    def generator_names(self) -> tuple[str, ...]:
        """Generators that are prepared, the best first."""
        return tuple(name for name, regions in self.regions_by_generator.items() if regions)

    @property
    def regions_by_generator(self) -> dict[str, tuple[int, ...]]:
        """The view regions 0..5 that each generator was prepared for, the best generator first; () for none.

        Templates know all regions. In a region that it was not trained for, the visibility network ("learned") falls
        back to the templates, if there are any; the auto-encoder raises PreparationError.
        """
        return {
            "learned": self.networks.regions,
            "templates": () if self.templates is None else self.templates.regions,
            "autoencoder": self.autoencoders.regions,
        }

    @property
    def lacks(self) -> str:
        """What was asked for and is not there, as after an interrupted `prepare`, in words; empty for a whole part."""
        return " and ".join(
            f"{what} of view regions {', '.join(map(str, sorted(regions)))}" for what, regions in self._lacking.items()
        )

    @property
    def mend_command(self) -> str:
        """What to run so that it lacks nothing.

        Auto-encoders are asked for as they were: for other settings, those that are there would be trained anew.
        """
        commands = [] if set(self._lacking) == {"auto-encoders"} else [self.prepare_command]
        if "auto-encoders" in self._lacking:
            commands.append(f"{self.prepare_command} {self.options['autoencoder'].command_words}")
        return " && ".join([commands[0], *(command.removeprefix("run: ") for command in commands[1:])])

    @property
    def _lacking(self) -> dict[str, set[int]]:
        """The view regions that lack what was asked for, by what it is."""
        lacking: dict[str, set[int]] = {}
        for options in self.options.values():
            trained, what = self.networks.regions, "visibility networks"
            if options.generator == "autoencoder":
                trained, what = self.autoencoders.regions, "auto-encoders"
            elif options.generator == "templates" or options.seed != self.seed:  # networks of another seed are replaced
                continue
            lacking.setdefault(what, set()).update(set(options.wanted_regions).difference(trained))
        return {what: regions for what, regions in lacking.items() if regions}

    def best_generator(self) -> RigidGenerator:
        """The learned generator, else the templates.

        Raises:
            PreparationError: neither is prepared.
        """
        if self.networks:
            return VisibilityNetwork(self.part, self.edges, self.networks, self.templates)
        if self.templates is None:
            raise PreparationError(f"{self.part.name}: no generator is prepared; {self.prepare_command}")
        return self.templates

    def autoencoder(self, device: Device = "cpu") -> AutoencoderGenerator:
        """The paper's t(I), painting on a device.

        Raises:
            PreparationError: it is not prepared.
        """
        if not self.autoencoders:
            raise PreparationError(
                f"{self.part.name}: no auto-encoder is prepared; {self.prepare_command} --generator autoencoder"
            )
        return AutoencoderGenerator(self.autoencoders, self.part.name, device)

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
                f"{self.prepare_command} --generator autoencoder"
            )
        return self.regressed_points[region]

    @property
    def prepare_command(self) -> str:
        """What to run for whatever it lacks, up to the options."""
        return _prepare_command(self.part.path, None if self.folder is None else self.folder.parent)

    def save(self, folder: Path) -> None:
        """Write the part: only files whose content differs from what is there, part.json last.

        A part that is there stays as it is until all of it has been written beside it.

        Raises:
            InputFileError: a file cannot be written.
        """
        # Not save_file: it makes files that only their owner may read, and parts are shared.
        contents = {
            name + SUFFIX: serialise({key: np.ascontiguousarray(value) for key, value in values.items()})
            for name, values in arrays.arrays_by_file(self).items()
        }
        files = {"part.json": header_bytes(header_of(self), contents), **contents}
        with staged({folder / name: content for name, content in files.items()}):
            withdraw_header(folder, self.part.sha256, contents)

    @classmethod
    def load(cls, folder: str | Path, mesh: str | Path | None = None) -> PreparedPart:
        """Read a prepared part.

        Args:
            mesh: the mesh file that it must have been prepared from, checked by SHA-256.

        Raises:
            PreparationError: missing, incomplete, changed, of another version, or prepared from another mesh.
        """
        folder = path_of(folder, "a prepared part", "parts/bracket")
        mesh = None if mesh is None else path_of(mesh, "a mesh file", "bracket.ply")
        again = _prepare_command(mesh, folder.parent)
        header = read_header(folder, again)
        if mesh is not None and header["mesh"]["sha256"] != sha256_of(mesh, again):
            raise PreparationError(
                f"{folder / 'part.json'}: prepared from another mesh than {mesh}; {again} --no-resume (which replaces "
                "it), or keep both: prepare into another folder, and give that as --parts"
            )
        if header["version"] == UNSEALED_VERSION:
            raise PreparationError(
                f"{folder / 'part.json'}: is of an earlier version, without checksums; {again} (it adds them)"
            )
        try:
            check_sealed(header)
            part, edges = arrays.load_part(folder, header, mesh), arrays.load_edges(folder, header)
            return cls(
                part,
                edges,
                edge_break_mm=float(header["edge_break_mm"]),
                seed=int(header["seed"]),
                templates=arrays.load_templates(folder, header, part, edges),
                views=arrays.load_views(folder, header, part, edges),
                near_turns=near_turns_of(header),
                networks=arrays.load_networks(folder, header, edges),
                regressed_points=arrays.load_regressed_points(folder, header),
                autoencoders=arrays.load_autoencoders(folder, header),
                # Parts prepared by earlier versions lack this key.
                options={
                    generator: PrepareOptions.from_json(values)
                    for generator, values in header.get("options", {}).items()
                },
                cpu_s={stage: float(value) for stage, value in header.get("cpu_s", {}).items()},
                folder=folder,
            )
        except PermissionError as error:
            raise PreparationError(f"{error.filename or folder}: cannot be read: check its permissions") from None
        except (
            OSError,
            SafetensorError,
            AcpLabError,
            KeyError,
            TypeError,
            ValueError,
            IndexError,
            AttributeError,
        ) as error:
            reason = str(error).splitlines()[0] if str(error) else type(error).__name__
            raise PreparationError(f"{folder}: the prepared part is damaged ({reason}); {again} --no-resume") from None


def _prepare_command(mesh: Path | None, parts: Path | None) -> str:
    return f"run: acp-lab prepare {quoted(mesh or 'MESH')} --out {quoted(parts or 'PARTS_DIR')}"
