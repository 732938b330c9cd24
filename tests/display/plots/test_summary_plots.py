"""The summary picture."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from acp_lab.display.plots.summary import SummaryPicture
from acp_lab.errors import InputFileError
from tests.display.made_run import play


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
