"""Edge finding and edge offsets, on drawn images whose edges are known."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from acp_lab.cad.part import Part
from acp_lab.errors import SequenceError
from acp_lab.geometry.arrays import ByteImage, FloatArray
from acp_lab.imaging.canny import CannyConfig
from acp_lab.sequences.frame import Frame, UnreadableFrame
from acp_lab.studies.edge_break import edge_offsets, offsets_beside_profiles
from acp_lab.studies.edge_finding import RULES, FindingConfig, FindingStudy, detector_counts, finding_study
from acp_lab.studies.true_edges import TrueEdges
from tests.made_parts import bracket, looking_at
from tests.prepared_sample import sample_scene
from tests.tracking.rendered import CAMERA, draw


@dataclass
class Drawn:
    """A scene of drawn images."""

    images: list[ByteImage]
    poses: list[FloatArray]
    name: str = "drawn"

    @property
    def frame_ids(self) -> tuple[int, ...]:
        return tuple(range(len(self.images)))

    def frame(self, frame_id: int) -> Frame | UnreadableFrame:
        return Frame(frame_id, self.images[frame_id], CAMERA)

    def truth(self, frame_id: int, object_id: int) -> FloatArray | None:
        return self.poses[frame_id] if object_id == 1 else None


@pytest.fixture(scope="module")
def part() -> Part:
    return bracket()


@pytest.fixture(scope="module")
def truth(part: Part) -> TrueEdges:
    return TrueEdges(part)


@pytest.fixture(scope="module")
def pose(part: Part) -> FloatArray:
    return looking_at(part, np.array([0.8, 0.6, 1.0]), 330.0, 0.3)


@pytest.fixture(scope="module")
def scene(part: Part, pose: FloatArray) -> Drawn:
    return Drawn([draw([(part, pose)], seed) for seed in range(2)], [pose, pose])


def test_every_rule_is_right_at_the_true_pose_and_falls_behind_off_it(truth: TrueEdges, scene: Drawn) -> None:
    near = finding_study(truth, scene, 1, [1], FindingConfig(0.0, 0.0, trials=1))  # type: ignore[arg-type]
    far = finding_study(truth, scene, 1, [1], FindingConfig(6.0, 6.0, trials=2))  # type: ignore[arg-type]
    assert near.way_px == pytest.approx(0.0, abs=1e-9)
    assert near["nearest edge"] > 0.8
    assert near["among the candidates"] > 0.9
    assert far.way_px > 3.0
    for rule in RULES:
        assert far[rule] < near[rule]
        assert far[rule] <= far["among the candidates"]
    assert far["nearest of its direction"] > far["nearest edge"]
    assert str(far).count("\n") == len(RULES)


def test_studies_repeat_with_their_seed(truth: TrueEdges, scene: Drawn) -> None:
    def study(seed: int) -> FindingStudy:
        return finding_study(truth, scene, 1, [1], FindingConfig(trials=1), seed)  # type: ignore[arg-type]

    assert study(3) == study(3)
    assert study(3) != study(4)


@pytest.mark.parametrize(("frame_id", "object_id", "reason"), [(0, 1, "none before it"), (1, 2, "no truth")])
def test_frames_that_cannot_be_studied(
    truth: TrueEdges, scene: Drawn, frame_id: int, object_id: int, reason: str
) -> None:
    with pytest.raises(SequenceError, match=reason):
        finding_study(truth, scene, object_id, [frame_id])  # type: ignore[arg-type]


def test_a_detector_finds_less_in_a_blurred_image_and_clutter_in_a_scratched_one(
    truth: TrueEdges, scene: Drawn, pose: FloatArray
) -> None:
    own = truth.at(pose, CAMERA)
    sharp = detector_counts(scene.images[0], own, CannyConfig(1.0))
    blurred = detector_counts(scene.images[0], own, CannyConfig(6.0))
    assert sharp.found > 0.8
    assert blurred.found < sharp.found - 0.1
    scratched = scene.images[0].copy()
    middle = own.points.mean(axis=0).astype(int)
    scratched[middle[1] - 30 : middle[1] + 30 : 6, middle[0] - 40 : middle[0] + 40] = 255
    assert detector_counts(scratched, own, CannyConfig(1.0)).clutter > sharp.clutter + 0.1


def test_a_smaller_part_has_its_outlines_inside(truth: TrueEdges, pose: FloatArray, part: Part) -> None:
    inset_mm = 0.4
    exact = Drawn([draw([(part, pose)], 0)], [pose])
    shrunk = Drawn([draw([(bracket(inset_mm=inset_mm), pose)], 0)], [pose])
    on_edge = edge_offsets(truth, exact, 1, [0])  # type: ignore[arg-type]
    inside = edge_offsets(truth, shrunk, 1, [0])  # type: ignore[arg-type]
    assert abs(np.median(on_edge.outline_mm)) < 0.1
    # An edge of two faces that both lie further in moves by up to the square root of 2 of it.
    assert -1.8 * inset_mm < np.median(inside.outline_mm) < -0.8 * inset_mm
    assert str(inside).startswith("outlines: median -")
    with pytest.raises(SequenceError, match="choose others"):
        edge_offsets(truth, exact, 2, [0])  # type: ignore[arg-type]


def test_profiles_tell_where_the_outlines_of_the_sample_belong() -> None:
    """Its edges are broken by 0.25 mm; see `tests/tracking/learning/test_edge_profiles.py` for more."""
    scene = sample_scene()
    truth = TrueEdges(scene.dataset.part(1))
    lies, told = (measure(truth, scene, 1, (5, 25)) for measure in (edge_offsets, offsets_beside_profiles))
    assert np.median(lies.outline_mm) < -0.1
    assert abs(np.median(told.outline_mm)) < 0.5 * abs(np.median(lies.outline_mm))
    assert np.median(np.abs(told.outline_mm)) < 0.7 * np.median(np.abs(lies.outline_mm))
