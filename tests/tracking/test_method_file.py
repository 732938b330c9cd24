"""Methods as TOML: round trips, what a file may leave out, and what it may not say."""

from __future__ import annotations

import os
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest

from acp_lab.errors import InputFileError, TrackingError
from acp_lab.imaging.edge_search import SearchConfig
from acp_lab.tracking.camera_motion import CameraMotion
from acp_lab.tracking.confidence import Confidence
from acp_lab.tracking.denoising import Denoising
from acp_lab.tracking.kalman import KalmanPrediction
from acp_lab.tracking.learning.contour_offsets import OffsetConfig
from acp_lab.tracking.learning.encoding import EncodingConfig
from acp_lab.tracking.learning.knowledge import Off, SampleLearning
from acp_lab.tracking.learning.polarity import PolarityConfig
from acp_lab.tracking.learning.region_colours import ColourConfig
from acp_lab.tracking.learning.reliability import ReliabilityConfig
from acp_lab.tracking.learning.rolling_shutter import ShutterConfig
from acp_lab.tracking.method import ACP, ACP_PAPER, DIRECT_6DOF, METHODS, Method
from acp_lab.tracking.method_file import check_writable, read_method, to_toml
from acp_lab.tracking.motions import ControlPointVariables, PoseVariables
from acp_lab.tracking.picture import PictureSearch
from acp_lab.tracking.prediction import ConstantVelocityPrediction, LastPosePrediction
from acp_lab.tracking.priors import ControlPointDamping, MotionPrior, RigidityPrior
from acp_lab.tracking.recovery import Alternatives, SecondTries, WayBack
from acp_lab.tracking.schedule import Level, PixelSchedule, ShareSchedule
from acp_lab.tracking.search import Cloud
from acp_lab.tracking.solvers import Adam, GaussNewton, LevenbergMarquardt
from acp_lab.tracking.sources.painted import PaintedRidges
from acp_lab.tracking.sources.rigid import CadSamples
from acp_lab.tracking.start import TrustedStart
from acp_lab.tracking.states import StateConfig
from acp_lab.tracking.targets.distance_map import DistanceMap, EdgeMapConfig
from acp_lab.tracking.targets.normals import NormalSearch
from acp_lab.tracking.targets.regions import RegionLines
from acp_lab.tracking.tones import ToneMatching
from acp_lab.tracking.turn_check import TurnCheck
from acp_lab.tracking.uncertainty import PoseUncertainty

# In these every setting differs from what `acp` and `acp-paper` have.
RIDGES = Method(
    name="painted points",
    summary='with "quotes", and an é',
    control_points="regressed",
    margin_px=12.5,
    source=PaintedRidges("threshold", 0.2, "prediction"),
    variables=ControlPointVariables("autograd", "points"),
    targets=(DistanceMap("tukey", EdgeMapConfig(1.5, "bilateral", "median", 4), 0.25),),
    schedule=ShareSchedule(0.03, (1.0,), 123),
    priors=(RigidityPrior(0.5), ControlPointDamping(0.01)),
    solver=Adam(30, 0.1),
    prediction=ConstantVelocityPrediction(-1.0),
    sight=Off(),
    uncertainty=Off(),
    start=Off(),
    recovery=SecondTries(0.7, 9.0, 3.0, 2),
    learning=Off(),
    confidence=Off(),
    states=StateConfig(0.3, 0.4, 0.1, 0.2, 5, 3),
)
NORMALS = Method(
    name="both",
    source=CadSamples("templates"),
    variables=PoseVariables("step"),
    targets=(NormalSearch(SearchConfig(2.0, 4, 9.0, 2.2, 3.0, 0.5), "step", 0.3, 0.1, 0.4, 2.0), DistanceMap()),
    schedule=PixelSchedule((Level(9, 3.0), Level(6, 1.5, 77, 0.5))),
    priors=(),
    solver=LevenbergMarquardt(7, 0.5),
    prediction=LastPosePrediction(),
    sight=Off(),
    uncertainty=Off(),
    start=TrustedStart(0.8, 0.9, 1.0, 0.1, 3.0, 2, 0.6, 0.4, both_ways=False),
    learning=SampleLearning(
        memory=Off(),
        offsets=OffsetConfig(0.4, known_spread=0.5, inner_limits=(0.2, 0.9)),
        reliability=ReliabilityConfig(scatter_px=0.6),
        polarity=PolarityConfig(0.2, 0.4, 5.0, 0.1, 2.0),
        shutter=ShutterConfig(0.4, 0.6, 3.0, 0.02, 0.01, 1.5, 0.1, 4.0, 2.5),
        encoding=EncodingConfig(2.5, 1.5, 90.0, 50, 1.3),
        learn_above=0.5,
        learn_from_px=3.0,
        trust_from_sigma_px=1.0,
    ),
)
FUSED = Method(
    name="fused",
    targets=(
        NormalSearch(),
        RegionLines(
            50, 15.0, ColourConfig(0.1, 9, 1e-4, 0.9), 3.0, 0.5, 1.5, (0.1, 0.2), 0.5, 1.0, 0.3, 2.0, 1.5, 3.0, 0.4
        ),
    ),
    priors=(MotionPrior(0.5), ControlPointDamping()),
    prediction=KalmanPrediction(1.0, 2.0, 0.1, 5.0, 0.15, 1.5, 2.5, 3.0, 2.0, 0.3),
    camera=CameraMotion(0.1, 5.0, 0.5),
    sight=PictureSearch(20, 0.5, 0.7, 0.4, 0.2, 3.0, 3.0, 5.0),
    start=TrustedStart(agreement_alone=0.65),
    recovery=Alternatives(
        0.65, 0.1, 0.2, 0.01, 5.0, 0.4, Cloud(4.0, 0.2, 50, 5, 3), 0.7, Cloud(9.0, 0.3, 99, 7, 1), 0.3, 0.2
    ),
    way_back=WayBack(1e4, 9, 2e4, 3, 0.7, 0.3, 0.8, 12, 90),
    turns=TurnCheck(-0.3, 0.3, 0.6, 0.3, 2.0, 3.0, 5.0, 0.5, 2.0),
    confidence=Confidence(-2.0, 3.0, 4.0, 5.0, 0.9),
    tones=ToneMatching(9.0, 0.4, 0.3, 0.7, 0.03, 0.5),
    denoising=Denoising(2.0, 8.0, 1.5, 7, 3),
    uncertainty=PoseUncertainty(1.0, 0.2, 0.3, 0.4),
)
EVERY = [*METHODS.values(), RIDGES, NORMALS, FUSED, replace(NORMALS, solver=GaussNewton(9, 0.1), learning=Off())]


def test_no_part_that_is_written_out_here_is_at_its_default() -> None:
    region, rest = FUSED.targets[1], (FUSED.prediction, FUSED.recovery, FUSED.sight, FUSED.way_back, FUSED.confidence)
    rest = (*rest, FUSED.tones, FUSED.denoising, FUSED.uncertainty, FUSED.camera, FUSED.turns)
    for part in (region, region.colours, *rest):  # type: ignore[union-attr]
        for item in fields(part):
            assert getattr(part, item.name) != getattr(type(part)(), item.name), item.name


@pytest.mark.parametrize("method", EVERY, ids=lambda method: method.name)
@pytest.mark.parametrize("base", METHODS)
def test_a_method_comes_back_from_its_file_whatever_its_base(method: Method, base: str, tmp_path: Path) -> None:
    path = tmp_path / "method.toml"
    path.write_text(f'base = "{base}"\n{to_toml(method)}', encoding="utf-8")
    assert read_method(path) == method


def test_what_a_file_leaves_out_is_as_in_its_base(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text("[schedule]\nalpha = 0.05\n")
    mine = replace(ACP_PAPER, name="mine", summary="")
    assert read_method(path) == replace(mine, schedule=replace(ACP_PAPER.schedule, alpha=0.05))
    path.write_text('base = "direct-6dof"\n[schedule]\nsamples = 200\n')
    mine = replace(DIRECT_6DOF, name="mine", summary="")
    assert read_method(path) == replace(mine, schedule=replace(DIRECT_6DOF.schedule, samples=200))
    path.write_text('base = "acp"\nname = "bold"\n[learning.memory]\nkind = "off"\n')
    assert isinstance(ACP.learning, SampleLearning)
    assert read_method(path) == replace(
        ACP, name="bold", summary="", learning=replace(ACP.learning, memory=Off())
    )


def test_words_of_the_base_are_not_those_of_another_method(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    for text, summary in (
        ('base = "acp"\n', ACP.summary),
        ('base = "acp"\nname = "bold"\n', ""),
        ('base = "acp"\nmargin_px = 40\n', ""),
        ('base = "acp"\nmargin_px = 40\nsummary = "wider"\n', "wider"),
    ):
        path.write_text(text)
        assert read_method(path).summary == summary


def test_what_toml_cannot_tell_is_one_line() -> None:
    @dataclass(frozen=True)
    class Mine(GaussNewton):
        kind: ClassVar[str] = "mine"

    class Unlike(GaussNewton):
        """Of the same kind: it would be read as another class."""

    for method in EVERY:
        check_writable(method)
    @dataclass(frozen=True)
    class Measured(GaussNewton):
        values: np.ndarray = field(default_factory=lambda: np.zeros(3))

    for solver, why in (
        (Mine(), r"solver\.kind = 'mine': give one of"),
        (Unlike(), "it would read back as another one"),
        (Measured(), "ndarray"),
    ):
        with pytest.raises(TrackingError, match=rf"^method bold: cannot be written as TOML \(.*{why}.*: use ") as told:
            check_writable(replace(ACP, name="bold", solver=solver))
        assert len(str(told.value)) < 400


def test_another_kind_starts_from_its_own_defaults_and_the_same_from_the_bases(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text('base = "acp"\n[solver]\nkind = "adam"\nrate = 0.2\n')
    assert read_method(path).solver == Adam(rate=0.2)
    path.write_text('base = "acp"\n[solver]\ndamping = 0.5\n')
    assert read_method(path).solver == replace(ACP.solver, damping=0.5)
    path.write_text('base = "acp"\n[[schedule.levels]]\nreach_px = 9\nsigma_px = 2\n')
    assert read_method(path).schedule == PixelSchedule((Level(9, 2.0),))
    path.write_text('[[targets]]\nkind = "normals"\n[[targets]]\nkind = "distance-map"\nprecision = 2\n')
    assert read_method(path).targets == (NormalSearch(), DistanceMap(precision=2.0))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        # What is none of ours.
        ("alpha = 0.1", ("alpha", "no such setting", "schedule")),
        ("kind = 'acp'", ("kind", "no such setting")),
        ("[states]\nkind = 'fine'", ("states.kind", "no such setting", "patience")),
        ("base = 'acp'\n[learning]\nprofiles = 3", ("learning.profiles = 3", "give a table [learning.profiles]")),
        ("base = 'acp'\n[learning.profiles]\nkind = 'off'\nspread_share = 1.0", ("spread_share", "has none: remove")),
        ("[schedule]\nlevels = 3", ("schedule.levels", "no such setting", "alpha, shares, samples")),
        ("base = 'best'", ("base", "best", "acp-paper")),
        ("base = ['acp']", ("base", "acp-paper")),
        # Kinds.
        ("[solver]\nkind = 'newton'", ("solver.kind = 'newton'", "gauss-newton, levenberg-marquardt, adam")),
        ("[solver]\nkind = 3", ("solver.kind = 3", "gauss-newton")),
        ("[prediction]\nkind = 'off'", ("prediction.kind", "constant-velocity, last-pose")),
        ("[[targets]]\nprecision = 2.0", ("targets.kind", "distance-map, normals")),
        ("[[targets]]\nkind = ['normals']", ("targets.kind", "distance-map, normals")),
        # Values of another type.
        ("[schedule]\nalpha = 'small'", ("schedule.alpha", "small", "a number")),
        ("[schedule]\nalpha = true", ("schedule.alpha", "True", "a number")),
        ("[schedule]\nsamples = 1.5", ("schedule.samples", "whole number")),
        ("[schedule]\nsamples = true", ("schedule.samples", "whole number")),
        ("base = 'acp-paper-samples'\n[source]\ninset_outlines = 1", ("source.inset_outlines", "true or false")),
        ("name = 3", ("name", "a text")),
        ("[variables]\ndirection = 'eight'", ("variables.direction", "eight", "homography, rigid, autograd, diff")),
        ("[schedule]\nshares = 1.0", ("schedule.shares", "list")),
        ("[schedule]\nshares = [1.0, 'a']", ("schedule.shares", "'a'", "a number")),
        ("base = 'acp'\n[learning.offsets]\ninner_limits = [1, 2, 3]", ("inner_limits", "2 numbers")),
        ("[schedule]\nalpha = " + 400 * "9", ("schedule.alpha", "400 digits", "give another")),
        ("[schedule]\nsamples = " + 400 * "9", ("schedule.samples", "400 digits", "give another")),
        # Tables, lists and their nesting.
        ("schedule = 3", ("schedule", "table [schedule]")),
        ("[[schedule]]\nalpha = 0.1", ("schedule", "table [schedule]")),
        ("targets = 3", ("targets", "a list")),
        ("[targets]\nkind = 'normals'", ("targets", "a list")),
        ("priors = [1]", ("priors", "table [priors]")),
        ("[[targets]]\nkind = 'distance-map'\nedge_map = 3", ("targets.edge_map", "table [targets.edge_map]")),
        ("base = 'acp'\n[[schedule.levels]]\nsigma_px = 2.0", ("schedule.levels.reach_px", "is missing")),
        ("schedule.alpha.beta.gamma.delta = 1", ("schedule.alpha", "a number")),
        ("targets = " + 200 * "[" + 200 * "]", ("targets", "table")),
        ("name = " + 300 * "[" + 300 * "]", ("name", "a text")),
        ("name = " + 5000 * "[" + 5000 * "]", ("nested too deeply",)),
        # Sums that are none, and values out of range.
        ("targets = []", ("targets", "empty")),
        ("[schedule]\nalpha = 0", ("schedule.alpha = 0", "share of the diameter")),
        ("[schedule]\nalpha = nan", ("schedule.alpha = nan", "share of the diameter")),
        ("[schedule]\nshares = []", ("schedule.shares",)),
        ("[schedule]\nkind = 'pixels'", ("schedule.kind", "distance map", "share-of-diameter")),
        ("[solver]\nsteps = 1000000000", ("solver.steps = 1000000000", "1 to 1000")),
        ("[[targets]]\nkind = 'distance-map'\nloss = 'printed'", ("printed", "pole", "geman-mcclure")),
        ("[learning]\nkind = 'samples'", ("learning", "normals")),
        ("margin_px = inf", ("margin_px = inf", "0 to 1000")),
        ("= 3", ("TOML",)),
        ("name = 'a'\nname = 'b'", ("TOML",)),
    ],
)
def test_what_makes_no_sense_is_named_on_one_line(text: str, words: tuple[str, ...], tmp_path: Path) -> None:
    path = tmp_path / "method.toml"
    path.write_text(text)
    with pytest.raises(InputFileError) as caught:
        read_method(path)
    message = str(caught.value)
    assert "\n" not in message
    assert len(message) < 400
    for word in (str(path), *words):
        assert word in message


def test_a_file_that_is_not_there_or_no_text(tmp_path: Path) -> None:
    with pytest.raises(InputFileError, match="no such method file: check --config"):
        read_method(tmp_path / "none.toml")
    with pytest.raises(InputFileError, match="cannot be read"):
        read_method(tmp_path)
    (tmp_path / "noise.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputFileError, match=r"noise\.toml: no text in UTF-8: save it as UTF-8"):
        read_method(tmp_path / "noise.toml")


def test_a_byte_order_mark_is_read_over(tmp_path: Path) -> None:
    path = tmp_path / "windows.toml"
    path.write_text('base = "acp"\nmargin_px = 12.5\n', encoding="utf-8-sig")
    assert read_method(path) == replace(ACP, name="windows", summary="", margin_px=12.5)
    path.write_text('base = "acp"\n', encoding="utf-16")
    with pytest.raises(InputFileError, match=r"windows\.toml: no text in UTF-8: save it as UTF-8"):
        read_method(path)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no pipes in folders")
def test_a_pipe_is_refused_without_waiting_for_it(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.toml")
    with pytest.raises(InputFileError, match="is a pipe, a device or a socket, not a file: check --config"):
        read_method(tmp_path / "pipe.toml")
