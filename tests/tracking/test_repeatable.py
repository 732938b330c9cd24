"""Two processes give the same poses to the bit."""

from __future__ import annotations

import hashlib
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from acp_lab.tracking.method import ACP_PAPER_SAMPLES
from acp_lab.tracking.tracker import Tracker
from tests.made_parts import box, looking_at
from tests.tracking.lit_part import lit_part
from tests.tracking.rendered import MadeSequence, draw, poses, prepared

ROOT = Path(__file__).resolve().parents[2]


def digest(padding: int) -> str:
    """SHA-256 of the poses and control points of `acp-paper` on made frames, its painted images all lit.

    The right half of the part is covered from the second frame on: edge points that are far from every image edge, at
    the right end of the crop, show how cv2 rounds there, which depends on where the distance map lies in memory.

    padding: bytes that are allocated first, so that what follows lies elsewhere in memory.
    """
    kept = [np.empty(padding + 16 * k, np.uint8) for k in range(20)]
    part = box((60.0, 40.0, 4.0))
    truth = poses(part, looking_at(part, np.array([0.4, 0.3, 1.0]), 260.0, 0.3), 6)
    images = [draw([(part, pose)], seed) for seed, pose in enumerate(truth)]
    for image in images[1:]:
        image[:, 95:] = 60
    sequence = MadeSequence(list(images), {1: truth})
    model = lit_part(prepared(part), (4,))
    found = hashlib.sha256()
    for method in (replace(ACP_PAPER_SAMPLES, margin_px=margin_px) for margin_px in (40.0, 10.0, 1.0)):
        for result in Tracker(model, method).run(sequence, sequence.first_pose).results[1]:
            found.update(result.cam_T_obj.tobytes())
            found.update(result.control_points.tobytes())
            found.update(np.float64(result.loss).tobytes())
    assert len(kept) == 20
    return found.hexdigest()


@pytest.mark.slow
def test_two_processes_give_the_same_poses_to_the_bit() -> None:
    command = "from tests.tracking.test_repeatable import digest; print(digest({}))"
    found = {
        subprocess.run(
            [sys.executable, "-c", command.format(padding)], cwd=ROOT, capture_output=True, text=True, check=True
        ).stdout.strip()
        for padding in (1, 40, 1000)
    }
    assert len(found) == 1
    assert len(found.pop()) == 64
