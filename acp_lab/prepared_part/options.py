"""What the offline phase is asked for: the argument of `prepare`, which part.json records."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, get_args

from acp_lab.control_points.view_regions import REGION_COUNT
from acp_lab.errors import PreparationError
from acp_lab.generator.device import Device
from acp_lab.generator.painted.edge_images import PaintingFrame, Source

GENERATORS = ("templates", "learned", "both", "autoencoder")
LARGEST_EDGE_BREAK_MM = 1e3
# The decoder's coarsest cells are 16 px wide; the authors' code paints 512 px.
PAINTING_PX = range(64, 513, 16)


@dataclass(frozen=True)
class PrepareOptions:
    """What to prepare of a part, and how.

    Attributes:
        generator: "templates" (seconds), "learned" (minutes), "both", or "autoencoder", the paper's own, with its
            regressed control points (minutes per region). What the folder holds of other generators is kept.
        fast: less training, for lessons and tests.
        regions: view regions 0..5 to train, stored in ascending order; None for all. Others fall back to the
            templates; the auto-encoder has none to fall back to.
        edge_break_mm: how far the real part's edges are broken; None for what the folder holds, else 0.25 for
            parts of usual size, `cad.part.USUAL_DIAMETERS`, and in proportion for others.
        edge_source: what the auto-encoder learns to paint: the mesh's "analytic" edges, or rendered "normals"
            through Canny, as the paper's authors did; those know no broken edges.
        seed: of all random choices, 0 or more.
        resume: keep what the folder holds; False replaces it.
        painting_frame: where the canonical frame stands that the auto-encoder paints in: at the "pose" itself
            (`acp-paper`), or at the "prediction" for a frame (`acp-paper-literal`), see `edge_images.EdgeImageConfig`.
        device: of the auto-encoder's training: "cpu", "cuda" (a GPU), or "auto", a GPU where there is one.
        painting_px: side of what the auto-encoder paints, a multiple of 16; None for 192, or 128 with `fast`. Small
            features need many: 192 px keep lines apart that flow into one on 128, for a quarter more time of training.

    Raises:
        PreparationError: a value that none of these allows, named as the command line's option.
    """

    generator: str = "both"
    fast: bool = False
    regions: tuple[int, ...] | None = None
    edge_break_mm: float | None = None
    edge_source: Source = "analytic"
    seed: int = 0
    resume: bool = True
    painting_frame: PaintingFrame = "pose"
    device: Device = "auto"
    painting_px: int | None = None

    def __post_init__(self) -> None:
        if self.generator not in GENERATORS:
            raise PreparationError(f"--generator {self.generator}: choose one of {', '.join(GENERATORS)}")
        if self.regions is not None:
            if not self.regions or not set(self.regions) <= set(range(REGION_COUNT)):
                raise PreparationError(f"--regions {self.regions}: choose from 0 to {REGION_COUNT - 1}, or all")
            object.__setattr__(self, "regions", tuple(sorted(set(self.regions))))
        if self.edge_break_mm is not None and not 0.0 <= self.edge_break_mm < LARGEST_EDGE_BREAK_MM:
            raise PreparationError(f"--edge-break {self.edge_break_mm:g}: give millimetres, such as 0.3")
        if self.painting_frame not in get_args(PaintingFrame):
            raise PreparationError(f"--painting-frame {self.painting_frame}: choose pose or prediction")
        if self.painting_px is not None and self.painting_px not in PAINTING_PX:
            least, most = PAINTING_PX[0], PAINTING_PX[-1]
            raise PreparationError(
                f"--painting-px {self.painting_px}: give a multiple of {PAINTING_PX.step} from {least} to {most}"
            )
        if self.device not in get_args(Device):
            raise PreparationError(f"--device {self.device}: choose auto, cpu or cuda")
        if self.seed < 0:
            raise PreparationError(f"--seed {self.seed}: give 0 or more")

    @property
    def wanted_regions(self) -> tuple[int, ...]:
        """The view regions to train, ascending."""
        return tuple(range(REGION_COUNT)) if self.regions is None else self.regions

    @property
    def command_words(self) -> str:
        """The options of `acp-lab prepare` that ask for the same, but for the device, which depends on the machine."""
        regions = None if self.regions is None else ",".join(map(str, self.regions))
        values = {
            "--generator": (self.generator, "both"),
            "--regions": (regions, None),
            "--edge-break": (self.edge_break_mm, None),
            "--edges": (self.edge_source, "analytic"),
            "--painting-frame": (self.painting_frame, "pose"),
            "--painting-px": (self.painting_px, None),
            "--seed": (self.seed, 0),
        }
        words = [f"{option} {value}" for option, (value, default) in values.items() if value != default]
        return " ".join([*words, "--fast"] if self.fast else words)

    @classmethod
    def from_json(cls, values: Mapping[str, Any]) -> PrepareOptions:
        """The inverse of dataclasses.asdict; raises TypeError or PreparationError for anything else."""
        regions = values.get("regions")
        return cls(**{**values, "regions": None if regions is None else tuple(regions)})
