"""A tracking method as one frozen configuration: which generator, target, loss, direction, solver, prior and W.

`acp-paper` is the paper's path from end to end; the two ablations of its Table III are `acp-paper` with one thing
changed. Any other combination is a configuration too, by `dataclasses.replace` or from a TOML file (`method_file`).
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Literal

from acp_lab.errors import TrackingError
from acp_lab.tracking.losses import LossForm
from acp_lab.tracking.solvers import SolverConfig
from acp_lab.tracking.targets.distance_map import TargetConfig

GeneratorName = Literal["autoencoder", "learned", "templates"]
Variables = Literal["control-points", "pose"]
PointSetName = Literal["regressed", "mid-section"]
EdgePoints = Literal["samples", "ridge", "threshold"]
Direction = Literal["homography", "autograd", "regeneration"]
Prediction = Literal["last", "constant-velocity"]


@dataclass(frozen=True)
class LossConfig:
    """e(I) (paper eq. 6) and its alpha.

    Attributes:
        form: see `losses`; "printed" cannot be minimised and is refused.
        alpha: as a share of the projected diameter; the paper says 0.05 to 0.10.
        schedule: multiples of alpha, one level each, coarse to fine; (1.0,) is the paper's fixed alpha.
    """

    form: LossForm = "geman-mcclure"
    alpha: float = 0.05
    schedule: tuple[float, ...] = (1.0, 0.6, 0.4)


@dataclass(frozen=True)
class MethodConfig:
    """Everything that makes a method, and everything that can be set.

    Attributes:
        name: what results are called.
        generator: t(I) (IV-A); "autoencoder" is the paper's.
        variables: what is optimised; the paper's eight coordinates, or the six of a pose ("w/o CP").
        control_points: W (IV-C); "regressed", or the middle section of the box ("w/o opt").
        direction: how edges are taken to follow I within a level: by the homography of the control points (the paper),
            through the generator (autograd), or by generating anew beside I. A pose moves edges as rigid.
        edges: edge points used at most.
        edge_points: how points are read off a painted edge image; "ridge" and "threshold" are the paper's, "samples"
            lets the image choose among the CAD's edge samples (see `painted_source`).
        edge_level: the least brightness of an edge point.
        target, loss, solver: see there.
        rigid_prior: weight of the wish that I stays a projection of W, per squared px; 0 for none, as in the paper.
        prediction: where a frame starts; "last" is the paper's.
        carry: what goes on to the next frame: "points", I itself as in the paper, lets the two directions drift that no
            rigid motion makes; "pose" is the I of the pose that PnP found.
        learned_weights: let edge points of a rigid generator remember what their image edges looked like and how
            steadily they were found (needs search along normals).
    """

    name: str = "acp-paper"
    generator: GeneratorName = "autoencoder"
    variables: Variables = "control-points"
    control_points: PointSetName = "regressed"
    direction: Direction = "homography"
    edges: int = 600
    edge_points: EdgePoints = "samples"
    edge_level: float = 0.05
    target: TargetConfig = field(default_factory=TargetConfig)
    loss: LossConfig = field(default_factory=LossConfig)
    solver: SolverConfig = field(default_factory=SolverConfig)
    rigid_prior: float = 0.0
    prediction: Prediction = "last"
    carry: Literal["points", "pose"] = "pose"
    learned_weights: bool = False

    def __post_init__(self) -> None:
        if self.loss.form == "printed":
            raise TrackingError(
                "loss form printed: eq. 6 has a pole at D = alpha and no minimum: choose logistic, saturating, "
                "geman-mcclure or tukey"
            )
        checks = (
            ("edges", self.edges >= 20, "20 or more"),
            ("edge_level", 0.0 < self.edge_level < 1.0, "a brightness between 0 and 1"),
            ("loss.alpha", 0.0 < self.loss.alpha <= 1.0, "a share of the diameter, such as 0.07"),
            ("loss.schedule", bool(self.loss.schedule) and min(self.loss.schedule) > 0.0, "one or more above 0"),
            ("solver.steps", self.solver.steps >= 1, "1 or more"),
            ("solver.damping", self.solver.damping >= 0.0, "0 or more"),
            ("solver.rate", self.solver.rate > 0.0, "px above 0"),
            ("rigid_prior", self.rigid_prior >= 0.0, "0 or more"),
            ("target.orientation_bins", 1 <= self.target.orientation_bins <= 32, "1 to 32"),
            ("target.blur_px", 0.0 <= self.target.blur_px <= 20.0, "px from 0 to 20"),
        )
        for key, good, wanted in checks:
            if not good:
                raise TrackingError(f"method {self.name}: {key} is out of range: give {wanted}")
        knows_samples = self.generator != "autoencoder" or self.edge_points == "samples"
        if self.learned_weights and not (knows_samples and self.target.search == "normals"):
            raise TrackingError(
                f'method {self.name}: learned_weights needs target.search = "normals" and edge points '
                'that are samples of the CAD model (generator learned or templates, or edge_points = "samples")'
            )


ACP_PAPER = MethodConfig()
DIRECT_6DOF = replace(ACP_PAPER, name="direct-6dof", variables="pose")
UNOPTIMISED_POINTS = replace(ACP_PAPER, name="unoptimised-points", control_points="mid-section")

METHODS: dict[str, MethodConfig] = {method.name: method for method in (ACP_PAPER, DIRECT_6DOF, UNOPTIMISED_POINTS)}
