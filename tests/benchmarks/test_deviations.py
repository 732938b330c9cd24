"""The path from literal to `acp-paper`: each step changes one part of the method, and the last one ends there."""

from __future__ import annotations

import itertools
from dataclasses import fields, replace

import numpy as np

from acp_lab.prepared_part import PreparedPart, Trained
from acp_lab.sequences.altered import AlteredSequence
from acp_lab.tracking.method import METHODS
from benchmarks.deviations import (
    CAUSES,
    DecodedScene,
    Run,
    errors_along,
    floor,
    mean_rows,
    of_painted_regions,
    steps,
)
from tests.prepared_sample import sample_model, sample_scene


def test_each_step_changes_one_part() -> None:
    named = steps()
    path = list(named.values())[:7]
    assert path[0] == METHODS["acp-paper-literal"]
    assert path[-1] == METHODS["acp-paper"]
    parts = [item.name for item in fields(path[0]) if item.name not in ("name", "summary")]
    changed = [
        {name for name in parts if getattr(before, name) != getattr(after, name)}
        for before, after in itertools.pairwise(path)
    ]
    assert changed == [{"variables"}, {"source"}, {"targets"}, {"schedule"}, {"variables"}, {"variables"}]


def test_what_is_taken_away_is_one_deviation_of_the_whole_path() -> None:
    named = steps()
    paper, literal = METHODS["acp-paper"], METHODS["acp-paper-literal"]
    for step, part in (
        ("without residual homography", "variables"),
        ("without frame at the pose", "source"),
        ("without orientation bins", "targets"),
        ("without annealed alpha", "schedule"),
    ):
        assert named[step] == replace(paper, **{part: getattr(literal, part)}), step
        assert named[step] != paper
    # Without the lengths on the part it is the step before; without the rigid direction, which they need, that before.
    assert named["+ rigid direction"] == replace(paper, variables=replace(paper.variables, lengths="image"))
    by_homography = replace(paper.variables, direction="homography", lengths="image")
    assert named["+ annealed alpha"] == replace(paper, variables=by_homography)
    assert set(CAUSES) <= set(named)
    for edges in ("true images", "exact edges"):
        by_homography, rigid = named[edges], named[f"{edges}, rigid direction"]
        assert replace(rigid, variables=by_homography.variables) == by_homography
        assert rigid.variables == paper.variables


def test_rows_are_means_over_sequences() -> None:
    runs = [
        Run(name, "literal", {"@2": share, "@5": share, "@10": 1.0}, ms)
        for name, share, ms in (("a", 0.2, 30.0), ("b", 0.4, 40.0))
    ]
    row = mean_rows(runs)["literal"]
    np.testing.assert_allclose([row["@2"], row["@5"], row["@10"], row["ms"]], [0.3, 0.3, 1.0, 35.0])


def test_exact_edges_are_those_of_the_painted_regions() -> None:
    model = sample_model()
    networks = Trained({region: f"network {region}" for region in range(6)}, dict.fromkeys(range(6), "report"))
    painted = Trained({4: "painter"}, {4: "report"})
    values = {item.name: getattr(model, item.name) for item in fields(model)}
    found = of_painted_regions(PreparedPart(**values | {"networks": networks, "autoencoders": painted}))
    assert found.networks.regions == (4,)
    assert found.templates is None


def test_true_images_are_read_to_a_fraction_of_a_pixel() -> None:
    found = floor(DecodedScene(sample_scene()), sample_model(), views=5)
    assert 0.0 < found["there_px"] < 0.25
    assert 0.0 < found["back_px"] < 0.3
    assert found["f_score"] > 0.97
    assert found["bias_percent"] < 0.4


def test_a_method_along_a_sequence_in_both_orders_and_from_a_start_that_is_off() -> None:
    scene, model = sample_scene(), sample_model()
    short = DecodedScene(AlteredSequence(scene, frame_ids=scene.frame_ids[:4]))
    method = METHODS["acp-edges"]
    for backwards in (False, True):
        errors, ms = errors_along(short, model, method, backwards=backwards)
        assert errors.shape == (3,)
        assert errors.max() < 0.02
        assert ms > 0.0
    off = errors_along(short, model, method, (4.0, 4.0))[0]
    assert not np.array_equal(off, errors_along(short, model, method)[0])
