"""Sequences that are changed on the way."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from acp_lab.errors import SequenceError
from acp_lab.sample import sample_dataset
from acp_lab.sequences import open_sequence
from acp_lab.sequences.altered import AlteredSequence
from acp_lab.sequences.bop import BopScene
from acp_lab.sequences.frame import Frame, UnreadableFrame
from acp_lab.sequences.images import ImageFolder


@pytest.fixture(scope="module")
def scene() -> BopScene:
    return open_sequence(sample_dataset())


def darker(frame: Frame) -> Frame:
    return replace(frame, image=frame.image // 2)


def test_kept_frames_come_in_order_with_their_truth(scene: BopScene) -> None:
    altered = AlteredSequence(scene, frame_ids=(9, 0, 3), name="three")
    for _ in range(2):  # each call starts anew
        assert [frame.index for frame in altered.frames()] == [0, 3, 9]
    assert [frame.index for frame in altered.frames(2)] == [0, 3]
    assert altered.frame_ids == (0, 3, 9)
    assert altered.name == "three"
    assert (altered.scene_id, altered.object_ids) == (scene.scene_id, scene.object_ids)
    np.testing.assert_array_equal(altered.first_pose, scene.first_pose)
    np.testing.assert_array_equal(altered.first_poses[1], scene.first_pose)
    np.testing.assert_array_equal(altered.truth(9, 1), scene.truth(9, 1))


def test_frames_are_changed_and_the_source_is_not(scene: BopScene) -> None:
    (changed,) = AlteredSequence(scene, darker).frames(1)
    original = scene.frame(0)
    assert isinstance(changed, Frame)
    assert isinstance(original, Frame)
    np.testing.assert_array_equal(changed.image, original.image // 2)
    assert len(AlteredSequence(scene, darker).frame_ids) == len(scene.frame_ids)


def test_a_change_may_spoil_a_frame_and_spoilt_ones_pass_through(scene: BopScene) -> None:
    def torn(frame: Frame) -> Frame | UnreadableFrame:
        return UnreadableFrame(frame.index, frame.camera, "torn") if frame.index == 1 else frame

    twice = AlteredSequence(AlteredSequence(scene, torn), darker)
    kinds = [type(frame) for frame in twice.frames(3)]
    assert kinds == [Frame, UnreadableFrame, Frame]


def test_all_frames_of_a_sequence_that_announces_none_are_kept(scene: BopScene, tmp_path: Path) -> None:
    """Such as a video without an index, or a live camera."""
    first = scene.frame(0)
    assert isinstance(first, Frame)
    assert cv2.imwrite(str(tmp_path / "0.png"), first.image)
    folder = ImageFolder(tmp_path, scene.camera(0))
    folder.frame_ids = ()
    assert [frame.index for frame in AlteredSequence(folder, darker).frames()] == [0]


def test_bad_frame_ids(scene: BopScene) -> None:
    with pytest.raises(SequenceError, match="has no frame 99"):
        AlteredSequence(scene, frame_ids=(0, 99))
    for left_out in ((1, 2), ()):
        with pytest.raises(SequenceError, match="first frame is left out"):
            AlteredSequence(scene, frame_ids=left_out)
