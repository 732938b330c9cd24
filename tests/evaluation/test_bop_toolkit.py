"""Our errors against those that the BOP toolkit computed of the same poses, stored with how they were made."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from acp_lab.evaluation.metrics import add_mm, adds_mm, pose_error
from acp_lab.sample import sample_dataset
from acp_lab.sequences.bop import BopDataset
from tests.prepared_sample import sample_scene

STORED = json.loads((Path(__file__).parent / "bop_toolkit_values.json").read_text(encoding="utf-8"))


@pytest.mark.parametrize("frame", STORED["frames"], ids=lambda frame: f"image {frame['image']}")
def test_errors_are_those_of_the_bop_toolkit(frame: dict) -> None:  # type: ignore[type-arg]
    part, truth = BopDataset(sample_dataset()).part(1), sample_scene().truth(frame["image"], 1)
    assert truth is not None
    estimate = np.vstack([np.reshape(frame["pose"], (3, 4)), [0.0, 0.0, 0.0, 1.0]])
    error = pose_error(estimate, truth)
    close = {"rel": 1e-9, "abs": 1e-9}
    assert add_mm(part.vertices, estimate, truth) == pytest.approx(frame["add_mm"], **close)
    assert adds_mm(part.vertices, estimate, truth) == pytest.approx(frame["adi_mm"], **close)
    assert error.translation_mm == pytest.approx(frame["te_mm"], **close)
    # Its arc cosine of a trace: the smallest angles have few digits.
    assert error.rotation_deg == pytest.approx(frame["re_deg"], rel=1e-7, abs=2e-6)
