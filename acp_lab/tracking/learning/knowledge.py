"""What a method knows of its edge samples: their look, their place beside the CAD's edges, their reliability.

And how far all outlines lie to their bright side, how far the lens blurs edges and motion smears them, how long the
camera takes to read a picture, and how it encodes light. These eight start empty in the first frame; what the profile
of an image edge says of the CAD's was learnt long before, but for what all edges of the part share. Each of the nine
can be switched off.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from acp_lab.compiled import kernel
from acp_lab.control_points.canonical_frame import eye_position
from acp_lab.errors import TrackingError
from acp_lab.generator.base import GeneratedEdges
from acp_lab.geometry.arrays import BoolArray, FloatArray, IntArray, plain
from acp_lab.geometry.camera import Camera
from acp_lab.geometry.in_image import in_image
from acp_lab.imaging.edge_search import Candidates, ImagePatch
from acp_lab.prepared_part import PreparedPart
from acp_lab.tracking.frame_view import Estimate
from acp_lab.tracking.learning.contour_offsets import ContourOffsets, ExpectedOffsets, OffsetConfig
from acp_lab.tracking.learning.edge_memory import EdgeMemory, MemoryConfig
from acp_lab.tracking.learning.edge_profiles import EdgeProfiles, EdgeViews, ProfileConfig, ProfileShifts
from acp_lab.tracking.learning.edge_traits import TraitEvidence
from acp_lab.tracking.learning.encoding import EncodingConfig, LightEncoding
from acp_lab.tracking.learning.lens_blur import LensBlur, LensConfig
from acp_lab.tracking.learning.motion_blur import BlurConfig, MotionBlur
from acp_lab.tracking.learning.novelty import Novelty
from acp_lab.tracking.learning.polarity import EdgePolarity, PolarityConfig
from acp_lab.tracking.learning.reliability import ReliabilityConfig, SampleReliability
from acp_lab.tracking.learning.rolling_shutter import RollingShutter, ShutterConfig


@dataclass(frozen=True)
class Off:
    """Configuration: this part of a method is not there."""

    kind: ClassVar[str] = "off"


@dataclass(frozen=True)
class TargetLearning:
    """Configuration: targets learn what they keep, such as colours; nothing is learnt of edge samples.

    learn_above: share of the running mean quality below which a frame teaches nothing; 0 for every frame.
    """

    kind: ClassVar[str] = "targets"
    learn_above: float = 0.0


@dataclass(frozen=True)
class SampleLearning:
    """Configuration: what is learnt of each edge sample, on methods whose samples are the CAD's.

    Attributes:
        memory: how each edge looked; offsets: where it lies beside the CAD's; reliability: how steadily it was found.
        polarity: how far all outlines are shifted towards their bright side.
        profiles: where the CAD's edge lies beside an image edge, by what that looks like.
        blur: how long the shutter is open, hence how far moving edges are smeared.
        lens: how far edges are blurred that do not move; off, every picture is asked anew.
        shutter: how long the camera takes to read a picture, row by row; off, it reads all at once.
        encoding: how it encodes light as greys; off, or where blur is, as the search takes it to.
        learn_above: share of the running mean quality below which a frame teaches nothing.
        learn_from_px: how far a part must have moved in the image since the last frame that taught; 0 for nowhere.
        trust_from_sigma_px: offsets and reliability weigh the samples from this sigma downwards; at coarser levels
            every sample helps to find the way.
    """

    kind: ClassVar[str] = "samples"
    memory: MemoryConfig | Off = field(default_factory=MemoryConfig)
    offsets: OffsetConfig | Off = field(default_factory=OffsetConfig)
    reliability: ReliabilityConfig | Off = field(default_factory=ReliabilityConfig)
    polarity: PolarityConfig | Off = field(default_factory=PolarityConfig)
    profiles: ProfileConfig | Off = field(default_factory=ProfileConfig)
    blur: BlurConfig | Off = field(default_factory=BlurConfig)
    lens: LensConfig | Off = field(default_factory=LensConfig)
    shutter: ShutterConfig | Off = field(default_factory=ShutterConfig)
    encoding: EncodingConfig | Off = field(default_factory=EncodingConfig)
    learn_above: float = 0.5
    learn_from_px: float = 2.0
    trust_from_sigma_px: float = 2.0

    def __post_init__(self) -> None:
        edges = (self.memory, self.offsets, self.reliability, self.polarity, self.profiles)
        if all(isinstance(part, Off) for part in (*edges, self.blur, self.lens, self.shutter, self.encoding)):
            raise TrackingError('learning: all its parts are off: give learning.kind = "off"')
        if not 0.0 <= self.learn_from_px < float("inf"):
            raise TrackingError(f"learning.learn_from_px = {self.learn_from_px:g}: give px, 0 for every frame")


@dataclass(frozen=True, eq=False)
class Matches:
    """Which image edges a solved frame chose.

    Attributes:
        at: the estimate that they were searched from; points_obj: (n, 3) mm, their 3D samples.
        edges: n edge points of known samples there; normals: (n, 2) unit, theirs.
        candidates: image edges along their normals; best: (n,) column of the chosen ones.
        residuals_px: (n,) from the solved place to the chosen edge, NaN where none was found.
        sure_residuals_px: the same, NaN also where the image edge is faint.
        expected: offsets that were expected, None where they are not learnt.
        off_obj: (n, 3) the sum of the samples' two face normals, off the material.
        patch: the image that was searched; places: (n, 2) px where in it the edge points show.
        shifts: what the profiles of the candidates say, None where nobody asked.
    """

    at: Estimate
    points_obj: FloatArray
    edges: GeneratedEdges
    normals: FloatArray
    candidates: Candidates
    best: np.ndarray
    residuals_px: FloatArray
    sure_residuals_px: FloatArray
    expected: ExpectedOffsets | None
    off_obj: FloatArray
    patch: ImagePatch
    places: FloatArray
    shifts: ProfileShifts | None = None

    @property
    def in_image(self) -> BoolArray:
        """(n,) whether an edge lies in the image: of the others nothing can be found, and that says nothing of them."""
        return in_image(self.places, self.at.view.camera)

    @property
    def gradients(self) -> FloatArray:
        """(n,) grey levels per px of the chosen edges, along the normals."""
        chosen: FloatArray = self.candidates.gradients.reshape(-1).take(self._chosen)
        return chosen

    @property
    def found(self) -> FloatArray:
        """(n, 2) px where the chosen edges are in the picture."""
        offsets: FloatArray = self.candidates.offsets.reshape(-1).take(self._chosen)
        return self.places + offsets[:, None] * self.normals

    @property
    def _chosen(self) -> IntArray:
        """(n,) places of the chosen ones among all candidates, row by row."""
        count, most = self.candidates.scores.shape
        places: IntArray = np.arange(0, count * most, most) + self.best
        return places

    @property
    def outward(self) -> FloatArray:
        """(n,) 1 where the normal of an outline leads off the part, -1 where onto it, 0 for other edges."""
        outward = np.empty(len(self.best))
        directions = self.at.lines(self.points_obj, self.normals).directions
        _outward(directions, plain(self.at.cam_T_obj), self.edges.outline, plain(self.off_obj), outward)
        return outward

    @property
    def to_eye_obj(self) -> FloatArray:
        """(3,) mm from the part's centre to the camera, object frame."""
        return eye_position(self.at.cam_T_obj) - self.at.view.part.box_centre

    @property
    def jacobian(self) -> FloatArray:
        """(n, 6) px along the normals by a pose step."""
        return self.at.lines(self.points_obj, self.normals).jacobian

    @property
    def trait_evidence(self) -> TraitEvidence | None:
        """What the chosen edges say of the part's traits; None where no profiles were read."""
        if self.shifts is None:
            return None
        chosen, residuals_px = self._chosen, self.sure_residuals_px
        if self.expected is not None:
            # Offsets that were measured know the part's traits already: edges are asked as if none had been.
            residuals_px = residuals_px + self.expected.offsets_px
        shifts, depth_mm = self.shifts, float(self.at.centre_cam[2])
        slopes_px = shifts.slopes_px.reshape(-1, shifts.slopes_px.shape[2]).take(chosen, axis=0)
        spreads_px = shifts.spreads_px.reshape(-1).take(chosen)
        return TraitEvidence(residuals_px, slopes_px, spreads_px, self.jacobian, depth_mm, shifts.told_with)


class SampleKnowledge:
    """What is known of one tracked part, see the module's head; each is None where it is off.

    edges: the part's 3D edge samples. is_magnified: whether pictures are drawn with more pixels than the camera has.
    """

    def __init__(self, config: SampleLearning | TargetLearning | Off, model: PreparedPart) -> None:
        edges = model.edges
        self.config = config
        self.edges = edges
        self.memory: EdgeMemory | None = None
        self.offsets: ContourOffsets | None = None
        self.reliability: SampleReliability | None = None
        self.polarity: EdgePolarity | None = None
        self.profiles: EdgeProfiles | None = None
        self.blur: MotionBlur | None = None
        self.lens: LensBlur | None = None
        self.shutter: RollingShutter | None = None
        self.encoding: LightEncoding | None = None
        self.is_magnified = False
        self._novelty: Novelty | None = None
        if not isinstance(config, SampleLearning):
            return
        if config.learn_from_px > 0.0:
            self._novelty = Novelty(model.part, config.learn_from_px)
        if isinstance(config.memory, MemoryConfig):
            self.memory = EdgeMemory(len(edges), config.memory)
        if isinstance(config.offsets, OffsetConfig):
            source = config.profiles if isinstance(config.profiles, ProfileConfig) else config.offsets
            prior_mm = source.expected_mm(model.edge_break_mm)
            self.offsets = ContourOffsets(edges, model.part.diameter, prior_mm, config.offsets)
        if isinstance(config.reliability, ReliabilityConfig):
            self.reliability = SampleReliability(len(edges), config.reliability)
        if isinstance(config.polarity, PolarityConfig):
            self.polarity = EdgePolarity(config.polarity)
        if isinstance(config.profiles, ProfileConfig):
            self.profiles = EdgeProfiles(config.profiles)
        if isinstance(config.blur, BlurConfig):
            self.blur = MotionBlur(config.blur)
        if isinstance(config.lens, LensConfig):
            self.lens = LensBlur(config.lens)
        if isinstance(config.shutter, ShutterConfig):
            self.shutter = RollingShutter(config.shutter)
        if isinstance(config.encoding, EncodingConfig) and self.blur is not None:
            self.encoding = LightEncoding(config.encoding)

    def agreement(self, sample_ids: np.ndarray, candidates: Candidates, scores: FloatArray) -> FloatArray:
        """(n, m) scores, less for candidates that contradict what their sample looked like."""
        return scores if self.memory is None else scores * self.memory.factors(sample_ids, candidates)

    def blur_px(self, edges: GeneratedEdges, normals: FloatArray, at: Estimate) -> FloatArray | None:
        """(n,) px over which motion smears the edges of samples along their normals; None where nobody knows."""
        motion = at.view.motion
        if self.blur is None or self.blur.share == 0.0 or motion is None:
            return None
        points_obj = self.edges.points_obj.take(edges.sample_ids, axis=0)
        return self.blur.smear_px(at.lines(points_obj, normals).jacobian @ motion)

    @property
    def lens_blur_px(self) -> float | None:
        """How far the camera blurs edges that do not move; None where nobody knows."""
        return None if self.lens is None else self.lens.blur_px

    @property
    def gamma(self) -> float | None:
        """Light is the grey level to this power, see `LightEncoding`; None for what the search takes it to be."""
        return None if self.encoding is None else self.encoding.gamma

    @property
    def readout(self) -> FloatArray | None:
        """(2,) how long the camera reads a picture, see `RollingShutter`; None where all at once, or nobody knows."""
        return None if self.shutter is None else self.shutter.readout

    def read_profiles(
        self, patch: ImagePatch, places: FloatArray, edges: GeneratedEdges, normals: FloatArray, candidates: Candidates,
        at: Estimate, sigma_px: float, least: float, blur_px: FloatArray | None = None,
    ) -> ProfileShifts | None:  # fmt: skip
        """Where the CAD's edges lie beside candidates with a score above `least`; None where nobody asks.

        places: (n, 2) px where in it the edge points show; blur_px: (n,) theirs, see `blur_px`.
        """
        if self.profiles is None or not self._is_fine(sigma_px):
            return None
        views = EdgeViews(
            self.edges, edges.sample_ids, edges.outline, at.cam_T_obj, at.view.camera.fx, at.view.part.times_usual
        )
        return self.profiles.read(patch, places, normals, candidates, views, sigma_px, least, blur_px)

    def expect(
        self, edges: GeneratedEdges, normals: FloatArray, at: Estimate, scatter_px: FloatArray | None = None
    ) -> ExpectedOffsets | None:
        """Where the image edges of samples lie beside the CAD's, with the estimate's pose.

        scatter_px: (n,) of an edge about where it belongs, nothing being known of its offset; where it is told.
        """
        if self.offsets is None:
            return None
        directions = at.lines(self.edges.points_obj.take(edges.sample_ids, axis=0), normals).directions
        directions_obj = directions @ at.cam_T_obj[:3, :3]
        return self.offsets.expect(edges.sample_ids, edges.outline, directions_obj, scatter_px)

    def _is_fine(self, sigma_px: float) -> bool:
        return isinstance(self.config, SampleLearning) and sigma_px <= self.config.trust_from_sigma_px

    @property
    def shift_px(self) -> float:
        """By how much outlines lie to the bright side of where they belong."""
        return 0.0 if self.polarity is None else self.polarity.shift_px

    def trust(self, edges: GeneratedEdges, expected: ExpectedOffsets | None, sigma_px: float) -> FloatArray | None:
        """(n,) weights in (0, 1] at a level of that sigma; None where all samples count alike."""
        if not self._is_fine(sigma_px):
            return None
        if self.reliability is None:
            return None if expected is None else expected.weights
        steady = self.reliability.weights(edges.sample_ids, edges.outline)
        return steady if expected is None else expected.weights * steady

    @property
    def has_traits(self) -> bool:
        """Whether it is learnt what the part's edges have in common."""
        return self.profiles is not None and self.profiles.traits.are_learnt

    def learn_traits(self, matches: Matches, afresh: bool = False) -> FloatArray:
        """Take in what a solved frame says of what the part's edges have in common; afresh: and nothing before it.

        Returns (n,) px along the normals by which the chosen edges are told to lie elsewhere than when they were.
        """
        evidence = matches.trait_evidence
        if self.profiles is None or evidence is None:
            return np.zeros(len(matches.best))
        traits = self.profiles.traits
        before = traits.values
        if afresh:
            traits.forget()
        traits.learn(evidence)
        if self.offsets is not None:
            self.offsets.move(traits.values - before)
        moved: FloatArray = evidence.slopes_px @ (traits.values - evidence.told_with)
        return moved

    def measure_offsets(self, matches: Matches) -> None:
        """Take in the offsets that a trusted pose shows, and before them what edges and outlines have in common."""
        moved_px = self.learn_traits(matches, afresh=True)
        if self.offsets is None or matches.expected is None:
            return
        ids, outline = matches.edges.sample_ids, matches.edges.outline
        residuals_px = matches.sure_residuals_px + moved_px
        if self.polarity is not None:
            shift_px = self.polarity.measure(
                matches.gradients, matches.outward, residuals_px, matches.jacobian, rate=1.0
            )
            residuals_px = residuals_px - shift_px * np.sign(matches.gradients) * outline
        evidence = matches.trait_evidence
        slopes_px = None if evidence is None else evidence.slopes_px
        self.offsets.see_from(matches.to_eye_obj)
        self.offsets.learn(ids, outline, matches.expected, residuals_px, slopes_px)

    def forget_offsets(self) -> None:
        """As before any was measured: where edges lie, and how far all outlines are shifted."""
        if self.offsets is not None:
            self.offsets.forget()
        if self.polarity is not None:
            self.polarity.forget()

    @property
    def learns(self) -> bool:
        """Whether frames teach anything at all."""
        return not isinstance(self.config, Off)

    def trusts(self, quality: float, mean_quality: float) -> bool:
        """Whether a frame of that quality may teach, and be looked back to; each may where nothing is learnt."""
        if isinstance(self.config, Off):
            return True
        least = self.config.learn_above * mean_quality
        return quality >= least if isinstance(self.config, TargetLearning) else quality > least

    def is_new(self, camera: Camera, cam_T_obj: FloatArray, quality: float) -> bool:
        """Whether a frame that may teach shows what the last one that taught did not, see `Novelty`.

        Asked once of a frame. Of its camera, its pose (4, 4) and its quality.
        """
        return self._novelty is None or self._novelty.is_new(camera, cam_T_obj, quality)

    def learn(self, matches: Matches) -> None:
        """Take in a solved frame."""
        ids, outline, residuals_px = matches.edges.sample_ids, matches.edges.outline, matches.residuals_px
        if self.memory is not None:
            self.memory.learn(ids, matches.candidates, matches.best, residuals_px)
        if self.offsets is not None:
            self.offsets.see_from(matches.to_eye_obj)
        self.learn_traits(matches)
        if self.offsets is not None:
            self.offsets.observe_scatter(ids, outline, residuals_px, matches.jacobian)
            if matches.expected is not None:
                self.offsets.follow(ids, outline, matches.expected, matches.sure_residuals_px)
        if self.reliability is not None:
            inside = matches.in_image
            self.reliability.learn(ids[inside], outline[inside], residuals_px[inside])
        if self.polarity is not None:
            rate = self.polarity.config.rate
            sure_px = matches.sure_residuals_px
            self.polarity.measure(matches.gradients, matches.outward, sure_px, matches.jacobian, rate)
        motion = matches.at.view.motion
        if self.blur is not None and motion is not None:
            self.blur.learn(matches.patch, matches.places, matches.normals, matches.jacobian @ motion)
        if matches.at.motion is not None:
            motion_px = matches.jacobian @ matches.at.motion
            # Between the pixels of a magnified picture light is not what it was.
            if self.encoding is not None and not self.is_magnified:
                self._learn_encoding(self.encoding, matches, motion_px)
            if self.shutter is not None:
                self._learn_shutter(self.shutter, matches, motion_px)
        if self.lens is not None:
            self.lens.learn(matches.patch)

    def _learn_encoding(self, encoding: LightEncoding, matches: Matches, motion_px: FloatArray) -> None:
        smear_px = None if self.blur is None else self.blur.smear_px(motion_px)
        if smear_px is not None:
            found = np.flatnonzero(np.isfinite(matches.sure_residuals_px))
            lens_px = self.lens_blur_px or 0.0
            encoding.learn(matches.patch, matches.found[found], matches.normals[found], smear_px[found], lens_px)

    def _learn_shutter(self, shutter: RollingShutter, matches: Matches, motion_px: FloatArray) -> None:
        if not shutter.is_told_by(motion_px):
            return
        at = matches.at
        camera, expected = at.view.camera, at.view.readout
        size_px = np.array([camera.width, camera.height], float)
        late = (matches.edges.points - camera.project(at.centre_cam[None])) / size_px
        shutter.learn(
            np.zeros(2) if expected is None else expected, size_px, late, matches.normals, motion_px,
            matches.sure_residuals_px, matches.gradients, matches.outward, matches.jacobian,
        )  # fmt: skip


@kernel("void(f8[:, ::1], f8[:, ::1], b1[::1], f8[:, ::1], f8[::1])")
def _outward(
    directions: FloatArray, pose: FloatArray, outline: BoolArray, off_obj: FloatArray, outward: FloatArray
) -> None:
    """Fill outward (n,), see `Matches.outward`: directions (n, 3) in camera axes, off_obj (n, 3) in the object's."""
    for n in range(len(outline)):
        outward[n] = 0.0
        if outline[n]:
            side = 0.0
            for k in range(3):
                for j in range(3):
                    side += directions[n, j] * pose[j, k] * off_obj[n, k]
            outward[n] = np.sign(side)
