"""Pictures of how a part is found."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from matplotlib.figure import Figure

from acp_lab.detection.evidence import WEIGHTS, Evidence
from acp_lab.display.plots.finding import (
    FEATURE_NAMES,
    direction_colours,
    draw_contrast,
    draw_edge_directions,
    draw_evidence,
    draw_scores,
    draw_template,
    draw_turns,
)
from acp_lab.studies.finding import SpreadScores, TemplateView

EVIDENCE = Evidence(0.8, 0.5, 0.4, 0.6, 0.7, 5.0, 120.0)
SEEN = TemplateView(
    np.full((40, 50, 3), 90, np.uint8),
    np.array([25.0, 20.0]),
    np.array([[-5, 3], [6, -2]]),
    np.array([0, 4]),
    3.0,
)


def test_directions_go_round_in_half_a_turn() -> None:
    colours = direction_colours(np.arange(8), 8)
    steps = np.linalg.norm(np.diff(np.vstack([colours, colours[:1]]), axis=0), axis=1)
    assert steps.min() > 0.1
    assert steps[-1] < 1.8 * np.median(steps), "the last direction is next to the first"


def test_edges_are_drawn_where_they_are() -> None:
    edges = np.zeros((8, 30, 40), np.uint8)
    edges[3, 10, 12] = 1
    axes = Figure().subplots()
    draw_edge_directions(axes, edges)
    picture = np.asarray(axes.images[0].get_array())
    np.testing.assert_allclose(picture[10, 12], direction_colours(np.array([3]), 8)[0])
    assert (picture[0, 39] == 1.0).all()
    assert len(axes.collections[0].get_segments()) == 8


def test_contrast_template_scores_and_turns_say_what_they_show() -> None:
    figure = Figure()
    contrast, template, scores, turns = figure.subplots(1, 4)
    draw_contrast(contrast, SEEN.image, np.array([[5.0, 6.0], [20.0, 9.0], [8.0, 8.0]]), np.array([4.0, -3.0, 9.0]))
    assert [text.get_text() for text in contrast.get_legend().get_texts()] == ["part brighter: 67%", "part darker: 33%"]
    draw_template(template, SEEN, 8)
    middles = np.array([segment.mean(0) for segment in template.collections[0].get_segments()])
    np.testing.assert_allclose(middles, [[20.0, 23.0], [31.0, 18.0]])
    draw_scores(scores, SpreadScores(4.0, np.zeros((40, 50)), 0.4, 0.2, 9), SEEN)
    assert scores.get_title() == "edges reach 4 px"
    draw_turns(turns, np.array([-1.0, 0.0, 1.0]), {"any": np.full(3, 0.5), "own": np.full(3, 0.2)})
    assert [line.get_label() for line in turns.lines] == ["any", "own"]
    figure.canvas.draw()


def test_bars_of_evidence_add_up_to_the_log_odds() -> None:
    axes = Figure().subplots()
    draw_evidence(axes, {"one": EVIDENCE, "other": replace(EVIDENCE, outline=0.1)})
    widths = np.array([bar.get_width() for bar in axes.patches]).reshape(2, len(WEIGHTS))
    np.testing.assert_allclose(widths.sum(1)[0], EVIDENCE.log_odds)
    assert len(FEATURE_NAMES) == len(WEIGHTS)
    assert f"log-odds {EVIDENCE.log_odds:.1f}" in axes.get_legend().get_texts()[0].get_text()
