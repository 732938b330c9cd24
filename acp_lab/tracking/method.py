"""A tracking method: a frozen sum of parts, each with its own settings.

    source      which edges t(I) generates                     sources/
    variables   what is varied, and how edges follow it        motions
    targets     what the frame compares them with              targets/
    schedule    coarse to fine                                 schedule
    priors      what is believed beside the image              priors
    solver      how e is minimised                             solvers
    tones       what sudden changes and bands of light do      tones, bands
    denoising   what is done about noise                       denoising
    prediction  where the next frame starts                    prediction
    camera      what a camera that shakes does to that         camera_motion
    sight       how a first glance corrects that               picture
    magnification  how small and large parts are seen          magnification
    start       what the first frame does with a given pose    start
    recovery    what happens when a frame fits badly           recovery
    way_back    who looks for a part that is lost              way_back
    turns       by which tooth a part is turned                turn_check, turned
    learning    what is learnt of each edge sample             learning/
    confidence  how likely the part is there                   confidence
    uncertainty how exact its pose is then                     uncertainty

`acp-paper` is the paper's path with six deviations that can be switched one by one: `variables.residual`,
`source.frame`, `edge_map.orientation_bins`, `schedule.shares`, `variables.direction` and `variables.lengths`;
`acp-paper-literal` is without them, but not without what else docs/paper-ledger.md lists. The two ablations of Table
III are `acp-paper` with one part changed. `acp-paper-samples` reads no positions off the painted image: it gates the
CAD's own edge samples. Any other sum of parts is a method too, by `dataclasses.replace` or from a TOML file
(`method_file`). Parts that do not fit together are refused; a setting that another part makes idle is not, such as
`learning.offsets.break_share` beside profiles, or `camera` without a Kalman filter. Settings in mm are for CAD parts of
60 to 160 mm, and taken in proportion for others
(`part_size`).
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace
from typing import Literal

from acp_lab.control_points.coplanar_points import mid_section_points
from acp_lab.control_points.view_regions import ALL_REGIONS
from acp_lab.errors import TrackingError
from acp_lab.geometry.arrays import FloatArray
from acp_lab.imaging.edge_search import AS_THEY_ARE
from acp_lab.prepared_part import PreparedPart
from acp_lab.tracking.camera_motion import CameraMotion
from acp_lab.tracking.choices import check_choices
from acp_lab.tracking.confidence import EDGES_ALONE, Confidence
from acp_lab.tracking.denoising import Denoising
from acp_lab.tracking.kalman import KalmanPrediction
from acp_lab.tracking.learning.contour_offsets import OffsetConfig
from acp_lab.tracking.learning.knowledge import Off, SampleLearning, TargetLearning
from acp_lab.tracking.magnification import Magnification
from acp_lab.tracking.motions import ControlPointVariables, PoseVariables
from acp_lab.tracking.picture import PictureSearch
from acp_lab.tracking.prediction import ConstantVelocityPrediction, LastPosePrediction
from acp_lab.tracking.priors import ControlPointDamping, MotionPrior, RigidityPrior, TikhonovPrior
from acp_lab.tracking.recovery import Alternatives, SecondTries, WayBack
from acp_lab.tracking.schedule import Level, PixelSchedule, ShareSchedule
from acp_lab.tracking.solvers import GaussNewton, Solver
from acp_lab.tracking.sources import EdgeSource
from acp_lab.tracking.sources.painted import PaintedRidges, PaintedSamples
from acp_lab.tracking.sources.rigid import CadSamples
from acp_lab.tracking.start import TrustedStart
from acp_lab.tracking.states import StateConfig
from acp_lab.tracking.targets.contour_regions import ContourRegions
from acp_lab.tracking.targets.distance_map import DistanceMap, EdgeMapConfig
from acp_lab.tracking.targets.edge_confidence import EdgeConfidence
from acp_lab.tracking.targets.normals import NormalSearch
from acp_lab.tracking.targets.regions import RegionLines
from acp_lab.tracking.tones import ToneMatching
from acp_lab.tracking.turn_check import TurnCheck
from acp_lab.tracking.uncertainty import PoseUncertainty

Source = CadSamples | PaintedSamples | PaintedRidges
Variables = ControlPointVariables | PoseVariables
TargetConfig = DistanceMap | NormalSearch | RegionLines | ContourRegions | EdgeConfidence
Schedule = PixelSchedule | ShareSchedule
PriorConfig = ControlPointDamping | RigidityPrior | MotionPrior | TikhonovPrior
PredictionConfig = ConstantVelocityPrediction | LastPosePrediction | KalmanPrediction


@dataclass(frozen=True)
class Method:
    """Everything that makes a method, and everything that can be set; the defaults are those of `acp`.

    Attributes:
        name: what results are called; summary: one line for lists.
        control_points: W (IV-C): "regressed", or the middle section of the box ("w/o opt" in paper Table III).
        margin_px: image kept around the part.
        states: when a part counts as tracking, weak or lost.
        The others: see the module's head.
    """

    name: str = "acp"
    summary: str = ""
    control_points: Literal["regressed", "mid-section"] = "mid-section"
    margin_px: float = 32.0
    source: Source = field(default_factory=CadSamples)
    variables: Variables = field(default_factory=lambda: PoseVariables(linearise="level"))
    targets: tuple[TargetConfig, ...] = (NormalSearch(), RegionLines())
    schedule: Schedule = field(default_factory=PixelSchedule)
    priors: tuple[PriorConfig, ...] = (ControlPointDamping(), MotionPrior())
    solver: Solver = field(default_factory=lambda: GaussNewton(steps=3, damping=0.0, last_px=0.03))
    tones: ToneMatching | Off = field(default_factory=ToneMatching)
    denoising: Denoising | Off = field(default_factory=Denoising)
    prediction: PredictionConfig = field(default_factory=KalmanPrediction)
    camera: CameraMotion | Off = field(default_factory=CameraMotion)
    sight: PictureSearch | Off = field(default_factory=PictureSearch)
    magnification: Magnification | Off = field(default_factory=Magnification)
    start: TrustedStart | Off = field(default_factory=TrustedStart)
    recovery: SecondTries | Alternatives | Off = field(default_factory=Alternatives)
    way_back: WayBack | Off = field(default_factory=WayBack)
    turns: TurnCheck | Off = field(default_factory=TurnCheck)
    learning: SampleLearning | TargetLearning | Off = field(default_factory=SampleLearning)
    confidence: Confidence | Off = field(default_factory=Confidence)
    uncertainty: PoseUncertainty | Off = field(default_factory=PoseUncertainty)
    states: StateConfig = field(default_factory=StateConfig)

    def __post_init__(self) -> None:
        self._check_kinds()
        searches = any(target.searches for target in self.targets)
        judges_matches = any(isinstance(target, NormalSearch) for target in self.targets[:1])
        learns_samples = isinstance(self.learning, SampleLearning)
        sees_contours = any(isinstance(target, ContourRegions | EdgeConfidence) for target in self.targets)
        learners = [f'"{target.kind}"' for target in self.targets if target.learns]
        binds_levels = any(isinstance(target, NormalSearch) and target.bind == "level" for target in self.targets)
        sees_regions = any(isinstance(target, RegionLines) for target in self.targets)
        varies_points = isinstance(self.variables, ControlPointVariables)
        checks = (
            (bool(self.targets), "targets: is empty: give one or more"),
            (
                not isinstance(next(iter(self.targets), None), RegionLines),
                'targets: regions say nothing of the inside: put edges first, such as "normals"',
            ),
            (0.0 <= self.margin_px <= 1000.0, f"margin_px = {self.margin_px:g}: give px from 0 to 1000"),
            (
                searches or not isinstance(self.schedule, PixelSchedule),
                'schedule.kind = "pixels": a distance map has no reach_px: give "share-of-diameter", '
                'or a target that searches along "normals"',
            ),
            (
                varies_points or not any(isinstance(prior, RigidityPrior) for prior in self.priors),
                'priors.kind = "rigidity": a pose is rigid anyway: leave it out, or vary "control-points"',
            ),
            (
                not learns_samples or (judges_matches and self.source.knows_samples),
                'learning: needs a first target that searches along "normals" and a source of CAD samples '
                '("cad-samples" or "painted-samples")',
            ),
            (
                not sees_regions or learns_samples,
                'targets.kind = "regions": its colours are learnt with the samples: give learning.kind = "samples"',
            ),
            (
                not (self._regenerates and (self._residual or self._paints_at_pose)),
                "variables.direction: generates anew beside a free I, which a residual homography and a source with "
                'frame = "pose" do not: give direction = "homography"',
            ),
            (
                not self._follows_neighbour or self._residual,
                'variables.direction = "rigid": moves on from the rigid neighbour of I, where edges must be generated: '
                'give residual = "homography"',
            ),
            (
                self.variables.lengths == "image" or self._knows_cad_edges,
                'variables.lengths = "part": only a rigid direction or a pose knows the CAD edge of a painted point: '
                'give direction = "rigid", or lengths = "image"',
            ),
            (
                not learners or not isinstance(self.learning, Off),
                f"targets.kind = {', '.join(learners)}: what it keeps of frames, as colours, must be learnt: "
                'give learning.kind = "targets"',
            ),
            (
                not sees_contours or self.source.knows_samples,
                'targets.kind = "contour-regions", "edge-confidence": needs outlines: give source.kind = "cad-samples"',
            ),
            (
                not isinstance(self.learning, TargetLearning) or bool(learners),
                'learning.kind = "targets": no target of this method learns by itself: give learning.kind = "off"',
            ),
            (
                not (self._regenerates and binds_levels),
                'targets.bind = "level": follows the edges of a level, but variables.direction generates others at '
                'every step: give bind = "step", or direction = "homography"',
            ),
            (
                not (self._regenerates and sees_contours),
                "variables.direction: generates other edges at every step, but colours follow those of a level: give "
                'direction = "homography"',
            ),
            (
                isinstance(self.confidence, Off) or judges_matches,
                'confidence: needs a first target that searches along "normals"',
            ),
            (
                isinstance(self.uncertainty, Off) or self.prediction.weighs_images,
                'uncertainty: needs the information of each frame, which is kept with prediction.kind = "kalman"',
            ),
            (
                isinstance(self.sight, Off) or self.prediction.weighs_images,
                'sight: needs a prediction that knows how sure it is: give prediction.kind = "kalman", '
                'or sight.kind = "off"',
            ),
            (
                self.prediction.weighs_images or not any(isinstance(prior, MotionPrior) for prior in self.priors),
                'priors.kind = "motion": needs a prediction that knows how sure it is: give prediction.kind = '
                '"kalman", or leave it out',
            ),
            (
                not (self._learns_offsets and self.source.inset_outlines),
                "source.inset_outlines and learning.offsets would both move outlines: switch one of them off",
            ),
        )
        for good, problem in checks:
            if not good:
                raise TrackingError(f"method {self.name}: {problem}")

    def _check_kinds(self) -> None:
        for name in ("targets", "priors"):
            if not isinstance(getattr(self, name), tuple):
                raise TrackingError(f"method {self.name}: {name}: give a tuple of settings, such as (NormalSearch(),)")
        for field_ in fields(self):
            value = getattr(self, field_.name)
            if field_.name in ("name", "summary", "control_points", "margin_px", "states"):
                continue
            for one in value if isinstance(value, tuple) else (value,):
                if not hasattr(one, "kind"):
                    raise TrackingError(
                        f"method {self.name}: {field_.name} = {one!r:.40}: give its settings, such as those of "
                        "acp.METHODS['acp'], or Off()"
                    )
        try:
            check_choices(self)
        except TrackingError as error:
            raise TrackingError(f"method {self.name}: {error}") from None

    @property
    def _regenerates(self) -> bool:
        return isinstance(self.variables, ControlPointVariables) and self.variables.direction in (
            "autograd",
            "differences",
        )

    @property
    def _residual(self) -> bool:
        return isinstance(self.variables, ControlPointVariables) and self.variables.residual == "homography"

    @property
    def _follows_neighbour(self) -> bool:
        return isinstance(self.variables, ControlPointVariables) and self.variables.direction == "rigid"

    @property
    def _knows_cad_edges(self) -> bool:
        return self._follows_neighbour or isinstance(self.variables, PoseVariables) or self.source.knows_samples

    @property
    def _paints_at_pose(self) -> bool:
        return isinstance(self.source, PaintedRidges) and self.source.frame == "pose"

    @property
    def _learns_offsets(self) -> bool:
        return isinstance(self.learning, SampleLearning) and not isinstance(self.learning.offsets, Off)

    def open_source(self, model: PreparedPart) -> EdgeSource:
        """t(I) of a part; PreparationError when the generator is not prepared."""
        return self.variables.around(self.source.open(model, self.control_points))

    def control_points_of(self, model: PreparedPart, regions: tuple[int, ...]) -> tuple[FloatArray, ...]:
        """(4, 3) mm per view region 0..5: W; those of regions beyond `regions` are the box's middle section.

        Raises PreparationError where W is not regressed.
        """
        part = model.part
        return tuple(
            model.control_points(region.index, self.control_points)
            if region.index in regions
            else mid_section_points(part.box_min, part.box_max, region.axis)
            for region in ALL_REGIONS
        )


AGREEMENT_STATES = StateConfig(weak_below=0.27, tracking_above=0.30, lost_below=0.20, found_above=0.27, proof=1)
"""Of methods whose quality is an agreement, not a probability."""
ACP = Method(summary="the best tracker here: CAD edges along normals, colours across the outline, a motion prior")
ACP_EDGES = replace(
    ACP,
    name="acp-edges",
    summary="edges alone, searched along normals, by what acp had before regions, profiles and priors",
    targets=(NormalSearch(AS_THEY_ARE, plain_share=0.0, sharing=Off()),),
    priors=(ControlPointDamping(),),
    solver=GaussNewton(steps=3, damping=0.0),
    prediction=ConstantVelocityPrediction(),
    denoising=Off(),
    camera=Off(),
    sight=Off(),
    start=TrustedStart(agreement_alone=float("inf"), bias_in_breaks=0.0, both_ways=False),
    recovery=SecondTries(),
    turns=Off(),
    learning=SampleLearning(
        offsets=OffsetConfig(view_deg=0.0, follow_rate=0.0),
        polarity=Off(),
        profiles=Off(),
        blur=Off(),
        lens=Off(),
        shutter=Off(),
        encoding=Off(),
        learn_above=0.7,
        learn_from_px=0.0,
    ),
    confidence=EDGES_ALONE,
    uncertainty=Off(),
)
ACP_PAPER = Method(
    name="acp-paper",
    summary="the paper's path: ridges of the painted edge image, eight free coordinates, a distance map",
    control_points="regressed",
    margin_px=40.0,
    source=PaintedRidges(frame="pose"),
    variables=ControlPointVariables("rigid", carry="points", residual="homography", lengths="part"),
    targets=(DistanceMap(edge_map=EdgeMapConfig(orientation_bins=8)),),
    # Of some two thousand ridges of a picture, evenly thinned.
    schedule=ShareSchedule(alpha=0.05, shares=(1.0, 0.5, 0.28), samples=1500),
    priors=(),
    solver=GaussNewton(),
    tones=Off(),
    denoising=Off(),
    prediction=LastPosePrediction(),
    camera=Off(),
    sight=Off(),
    magnification=Off(),
    start=Off(),
    recovery=Off(),
    way_back=Off(),
    turns=Off(),
    learning=Off(),
    confidence=Off(),
    uncertainty=Off(),
    states=AGREEMENT_STATES,
)
ACP_PAPER_LITERAL = replace(
    ACP_PAPER,
    name="acp-paper-literal",
    summary="acp-paper without its six deviations D1 to D6; what else differs: docs/paper-ledger.md",
    source=PaintedRidges(frame="prediction"),
    variables=ControlPointVariables(carry="points"),
    targets=(DistanceMap(),),
    schedule=ShareSchedule(alpha=0.05, shares=(1.0,), samples=1500),
)
ACP_PAPER_SAMPLES = replace(
    ACP_PAPER,
    name="acp-paper-samples",
    summary="a mixture: the painted edge image only chooses among the CAD's edge samples",
    source=PaintedSamples(),
    variables=ControlPointVariables(),
    targets=(DistanceMap(),),
    schedule=ShareSchedule(alpha=0.05, shares=(1.0, 0.6, 0.4)),
)
DIRECT_6DOF = replace(
    ACP_PAPER,
    name="direct-6dof",
    summary="acp-paper without control points: a pose is varied",
    variables=PoseVariables(lengths="part"),
)
UNOPTIMISED_POINTS = replace(
    ACP_PAPER,
    name="unoptimised-points",
    summary="acp-paper without optimised control points: those of the box's middle section",
    control_points="mid-section",
)

REGION = Method(
    name="region",
    summary="colours across the outline alone: the sparse region tracker RBGT/SRT3D, read from its papers",
    margin_px=80.0,
    source=CadSamples("templates", outlines_only=True),
    variables=PoseVariables(linearise="level"),
    targets=(ContourRegions(),),
    # Lines of 6, 4, 2, 2, 1 and 1 px per segment.
    schedule=PixelSchedule(
        (Level(57, 15.0), Level(38, 5.0), Level(19, 3.5), Level(19, 3.5), Level(10, 1.5), Level(10, 1.5))
    ),
    priors=(TikhonovPrior(),),
    solver=GaussNewton(steps=2, damping=0.0),
    tones=Off(),
    denoising=Off(),
    prediction=LastPosePrediction(),
    camera=Off(),
    sight=Off(),
    magnification=Off(),
    start=Off(),
    recovery=Off(),
    way_back=Off(),
    turns=Off(),
    learning=TargetLearning(),
    confidence=Off(),
    uncertainty=Off(),
    states=AGREEMENT_STATES,
)

SLET = replace(
    REGION,
    name="slet",
    summary="image edges across the outline, each as sure as its colours and its distance make it (SLET)",
    targets=(EdgeConfidence(),),
    schedule=PixelSchedule(
        (Level(24, 12.0, 200), Level(16, 6.0, 200), Level(10, 3.0, 200), Level(8, 2.0, 200), Level(6, 1.5, 200))
    ),
)
REGION_POINTS = replace(
    REGION,
    name="region-points",
    summary="the paper's future work: control points optimised on regions, eight coordinates by homography",
    variables=ControlPointVariables(),
    priors=(TikhonovPrior(), RigidityPrior(0.05)),
)

METHODS: dict[str, Method] = {
    method.name: method
    for method in (
        ACP,
        ACP_EDGES,
        REGION,
        REGION_POINTS,
        SLET,
        ACP_PAPER,
        ACP_PAPER_LITERAL,
        ACP_PAPER_SAMPLES,
        DIRECT_6DOF,
        UNOPTIMISED_POINTS,
    )
}


def method_named(name: str) -> Method:
    """One of `METHODS`; TrackingError for a name that is no method."""
    if name not in METHODS:
        raise TrackingError(
            f"--method {name}: no such method: there are {', '.join(METHODS)}; --config FILE takes any other"
        )
    return METHODS[name]
