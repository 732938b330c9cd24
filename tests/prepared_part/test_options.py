"""What can be asked of the offline phase, and that part.json keeps it."""

from __future__ import annotations

import json
from dataclasses import asdict
from typing import Any

import pytest

from acp_lab.errors import PreparationError
from acp_lab.prepared_part import PrepareOptions


@pytest.mark.parametrize(
    ("wish", "message"),
    [
        ({"generator": "best"}, r"--generator best: choose one of templates, learned, both, autoencoder"),
        ({"regions": (0, 6)}, r"--regions \(0, 6\): choose from 0 to 5, or all"),
        ({"regions": ()}, r"--regions \(\): choose from 0 to 5, or all"),
        ({"edge_break_mm": -0.1}, r"--edge-break -0\.1: give millimetres"),
        ({"edge_break_mm": float("nan")}, r"--edge-break nan: give millimetres"),
        ({"painting_frame": "middle"}, r"--painting-frame middle: choose pose or prediction"),
        ({"painting_px": 100}, r"--painting-px 100: give a multiple of 16 from 64 to 512"),
        ({"painting_px": 1024}, r"--painting-px 1024: give a multiple of 16"),
        ({"device": "tpu"}, r"--device tpu: choose auto, cpu or cuda"),
        ({"seed": -1}, r"--seed -1: give 0 or more"),
    ],
    ids=str,
)
def test_bad_wishes_are_refused(wish: dict[str, Any], message: str) -> None:
    with pytest.raises(PreparationError, match=message):
        PrepareOptions(**wish)


@pytest.mark.parametrize(
    ("wish", "words"),
    [
        ({}, ""),
        ({"generator": "learned", "regions": (3, 0), "seed": 5}, "--generator learned --regions 0,3 --seed 5"),
        ({"edge_break_mm": 0.3, "fast": True, "resume": False}, "--edge-break 0.3 --fast"),
        (
            {"edge_source": "normals", "painting_frame": "prediction", "painting_px": 128, "device": "cuda"},
            "--edges normals --painting-frame prediction --painting-px 128",
        ),
    ],
    ids=str,
)
def test_options_as_words_of_the_command_line(wish: dict[str, Any], words: str) -> None:
    assert PrepareOptions(**wish).command_words == words


def test_regions_are_wanted_once_each_in_ascending_order() -> None:
    assert PrepareOptions(regions=(4, 0, 4)).wanted_regions == (0, 4)
    assert PrepareOptions(regions=(4, 0, 4)) == PrepareOptions(regions=(0, 4))
    assert PrepareOptions().wanted_regions == (0, 1, 2, 3, 4, 5)


@pytest.mark.parametrize(
    "options",
    [PrepareOptions(), PrepareOptions("autoencoder", True, (5, 2), 0.4, "normals", 7, False, "prediction", "cpu")],
    ids=["default", "all set"],
)
def test_json_and_back(options: PrepareOptions) -> None:
    assert PrepareOptions.from_json(json.loads(json.dumps(asdict(options)))) == options


def test_options_that_came_later_have_their_defaults() -> None:
    assert PrepareOptions.from_json({"generator": "templates"}) == PrepareOptions("templates")
    with pytest.raises(TypeError):
        PrepareOptions.from_json({"generator": "templates", "colour": "red"})
