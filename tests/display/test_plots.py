"""The summary picture, and the colours in it."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from acp_lab.display.accuracy import AddPercent
from acp_lab.display.colours import GREY, SKY, VERMILLION, residual_colours, to_bytes
from acp_lab.display.plots.summary import SummaryPicture
from acp_lab.errors import InputFileError
from tests.display.made_run import box, play, true_pose


def test_residuals_run_from_sky_blue_to_vermillion() -> None:
    colours = residual_colours(np.array([0.0, 3.0, -3.0, 50.0, np.inf, np.nan]))
    np.testing.assert_allclose(colours[0], SKY)
    for row in colours[1:5]:
        np.testing.assert_allclose(row, VERMILLION)
    np.testing.assert_allclose(colours[5], GREY)
    assert residual_colours(np.zeros(0)).shape == (0, 3)


def test_colours_as_bytes() -> None:
    assert to_bytes((0.0, 0.5, 1.0)).tolist() == [0, 128, 255]


def test_add_in_percent_of_the_diameter() -> None:
    part = box()
    moved = true_pose(0)
    moved[0, 3] += 0.02 * part.diameter
    error = AddPercent(part)
    assert error(moved, true_pose(0)) == pytest.approx(2.0)
    assert np.isnan(error(moved, None))


@pytest.mark.parametrize(("object_ids", "with_truth"), [((1,), True), ((1, 2), False)])
def test_the_picture_is_written(tmp_path: Path, object_ids: tuple[int, ...], with_truth: bool) -> None:
    path = tmp_path / "new" / "summary.png"
    # The frame that cannot be read is asked for too: it is left out.
    play([SummaryPicture(path, [0, 3, 4])], object_ids, with_truth)
    image = cv2.imread(str(path))
    assert image is not None
    assert min(image.shape[:2]) > 300
    # Something was drawn: not one colour only.
    assert len(np.unique(image.reshape(-1, 3), axis=0)) > 50
    assert [file.name for file in path.parent.iterdir()] == ["summary.png"]


def test_a_place_that_cannot_be_written(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(InputFileError, match=r"summary\.png.*cannot be written"):
        play([SummaryPicture(tmp_path / "file" / "summary.png", [0])])
