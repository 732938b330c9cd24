"""Methods as TOML: round trips, what a file may leave out, and what it may not say."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from acp_lab.errors import InputFileError, TrackingError
from acp_lab.tracking.method import ACP_PAPER, DIRECT_6DOF, METHODS, UNOPTIMISED_POINTS, LossConfig, MethodConfig
from acp_lab.tracking.method_file import read_method, to_toml
from acp_lab.tracking.solvers import SolverConfig
from acp_lab.tracking.targets.distance_map import TargetConfig

UNLIKE = MethodConfig(
    name="other",
    generator="templates",
    direction="autograd",
    edges=123,
    target=TargetConfig("normals", 1.5, "bilateral", "median", 4),
    loss=LossConfig("tukey", 0.05, (1.0,)),
    solver=SolverConfig("adam", 30, 0.1, 0.2),
    rigid_prior=0.5,
    prediction="constant-velocity",
    carry="pose",
    learned_weights=True,
)


@pytest.mark.parametrize("config", [*METHODS.values(), UNLIKE], ids=lambda config: config.name)
def test_a_method_comes_back_from_its_file(config: MethodConfig, tmp_path: Path) -> None:
    path = tmp_path / "method.toml"
    path.write_text(to_toml(config))
    assert read_method(path) == config


def test_what_a_file_leaves_out_is_as_in_the_paper(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text("[loss]\nalpha = 0.05\n")
    assert read_method(path) == replace(ACP_PAPER, name="mine", loss=replace(ACP_PAPER.loss, alpha=0.05))
    path.write_text('base = "direct-6dof"\nedges = 200\n')
    assert read_method(path) == replace(DIRECT_6DOF, name="mine", edges=200)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("alpha = 0.1", ("alpha", "no such setting", "loss")),
        ("[loss]\nalpha = 'small'", ("loss.alpha", "small", "a number")),
        ("[loss]\nalpha = 0", ("alpha", "out of range")),
        ("[loss]\nschedule = 1.0", ("loss.schedule", "list")),
        ("[loss]\nschedule = []", ("schedule",)),
        ("[loss]\nform = 'printed'", ("printed", "pole", "geman-mcclure")),
        ("loss = 3", ("loss", "table")),
        ("edges = 1.5", ("edges", "whole number")),
        ("edges = true", ("edges", "whole number")),
        ("variables = 'eight'", ("variables", "eight", "control-points")),
        ("base = 'best'", ("base", "best", "acp-paper")),
        ("learned_weights = true", ("learned_weights", "normals")),
        ("[solver]\nname = 'newton'", ("solver.name", "gauss-newton")),
        ("= 3", ("TOML",)),
    ],
)
def test_what_makes_no_sense_is_named(text: str, words: tuple[str, ...], tmp_path: Path) -> None:
    path = tmp_path / "method.toml"
    path.write_text(text)
    with pytest.raises(InputFileError) as caught:
        read_method(path)
    message = str(caught.value)
    assert "\n" not in message
    for word in (str(path), *words):
        assert word in message


def test_a_file_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(InputFileError, match="cannot be read"):
        read_method(tmp_path / "none.toml")


def test_the_printed_loss_is_refused_in_code_too() -> None:
    with pytest.raises(TrackingError, match="pole"):
        MethodConfig(loss=LossConfig(form="printed"))


def test_ablations_change_one_thing() -> None:
    for ablation, change in (
        (DIRECT_6DOF, {"variables": "pose"}),
        (UNOPTIMISED_POINTS, {"control_points": "mid-section"}),
    ):
        assert ablation == replace(ACP_PAPER, name=ablation.name, **change)
