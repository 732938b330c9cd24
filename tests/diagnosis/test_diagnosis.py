"""Each cause is staged, and has to be named: with truth and, where it matters, without."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from acp_lab.cad.models_info import Symmetries
from acp_lab.cad.part import Part
from acp_lab.diagnosis import causes
from acp_lab.diagnosis.causes import Cause, DiagnosisConfig
from acp_lab.diagnosis.diagnosis import Diagnosis, diagnose, first_beside
from acp_lab.diagnosis.frame_evidence import PartObserver, image_motion
from acp_lab.diagnosis.recorded_run import run_from_rows
from acp_lab.errors import SequenceError
from acp_lab.evaluation.evaluation import frame_errors
from acp_lab.geometry.arrays import ByteImage, FloatArray
from acp_lab.geometry.camera import Camera
from acp_lab.geometry.pose import make_pose, so3_exp, transform
from acp_lab.prepared_part import PreparedPart
from acp_lab.sequences.frame import Frame, UnreadableFrame
from acp_lab.tracking.learning.knowledge import Off
from acp_lab.tracking.method import ACP, ACP_EDGES, Method
from acp_lab.tracking.method_file import to_toml
from acp_lab.tracking.prediction import ConstantVelocityPrediction, LastPosePrediction
from acp_lab.tracking.recovery import Alternatives
from acp_lab.tracking.result import TrackState
from acp_lab.tracking.session import TrackRun
from acp_lab.tracking.tracker import Tracker
from tests.made_parts import bracket, extruded, looking_at
from tests.tracking.rendered import CAMERA, GROUND, MadeSequence, add_percent, draw, poses, prepared

FRAMES = 8
TROUBLE = 5  # frames before it are good
SLOW = np.array([0.01, -0.012, 0.008, 0.4, -0.3, 0.5])


@pytest.fixture(scope="module")
def part() -> Part:
    return bracket()


@pytest.fixture(scope="module")
def model(part: Part) -> PreparedPart:
    return prepared(part)


@pytest.fixture(scope="module")
def truth(part: Part) -> list[FloatArray]:
    return poses(part, looking_at(part, np.array([0.8, 0.6, 1.0]), 250.0, 0.3), FRAMES, SLOW)


@pytest.fixture(scope="module")
def images(part: Part, truth: list[FloatArray]) -> list[ByteImage]:
    return [draw([(part, pose)], seed) for seed, pose in enumerate(truth)]


@pytest.fixture(scope="module")
def good(model: PreparedPart, images: list[ByteImage], truth: list[FloatArray]) -> TrackRun:
    return track(model, images, truth)


PLAIN = replace(ACP, magnification=Off())
"""Through a magnifying glass these small parts are not lost so soon."""


def track(
    model: PreparedPart, images: list[ByteImage | None], truth: list[FloatArray], method: Method = ACP
) -> TrackRun:
    return Tracker(model, method).run(MadeSequence(images, {1: truth}), truth[0])


def from_trouble(images: list[ByteImage], change: Callable[[FloatArray], FloatArray]) -> list[ByteImage]:
    """Images whose later ones are changed."""
    changed = [np.clip(np.round(change(image.astype(np.float64))), 0, 255).astype(np.uint8) for image in images]
    return [*images[:TROUBLE], *changed[TROUBLE:]]


def without_truth(run: TrackRun) -> TrackRun:
    assert run.session is not None
    return replace(run, session=replace(run.session, truth=None))


def named(run: TrackRun, frame: int = TROUBLE + 1) -> Diagnosis:
    """The diagnosis, which must say how things stand and what helps."""
    diagnosis = diagnose(run, frame)
    text = str(diagnosis)
    assert f"Frame {frame} " in text
    for finding in diagnosis.findings:
        assert finding.severity >= 1.0
        assert str(finding.cause) in text
        assert finding.advice in text
        assert any(character.isdigit() for character in finding.text)
    return diagnosis


# ---- nothing stands out ----------------------------------------------------------------------------------------


def test_a_good_frame_has_no_cause(good: TrackRun) -> None:
    for run in (good, without_truth(good)):
        diagnosis = named(run)
        assert diagnosis.findings == ()
        assert diagnosis.is_good
        assert "Nothing stands out" in str(diagnosis)
        assert "drifts slowly" in str(diagnosis)
        assert diagnosis.evidence is not None
        assert diagnosis.evidence.found_share > 0.7
        assert f"{100.0 * diagnosis.evidence.found_share:.0f}% of the edges in view" in str(diagnosis)


def test_a_good_frame_is_held_against_the_good_frames_before(good: TrackRun) -> None:
    results = [replace(result, quality=0.5) for result in good.results[1]]
    results[-1] = replace(results[-1], quality=0.43)
    run = replace(good, results={1: tuple(results)})
    assert "0.50 in the good frames before it" in diagnose(run, -1).summary
    assert "14% below the good frames" in diagnose(run, -1).conclusion
    assert "quality is as in the good frames" in diagnose(run, -2).conclusion


def test_without_a_good_frame_before_none_is_spoken_of(good: TrackRun) -> None:
    first = str(diagnose(good, 0))
    assert "no good frame before it" in first
    assert "good frames before" not in first
    assert "% of the edges in view are found" in first
    bad = [replace(result, state=TrackState.WEAK, quality=0.2) for result in good.results[1]]
    assert "no good frame before it" in diagnose(replace(good, results={1: tuple(bad)}), 3).summary
    assert "in the good frames before it" in diagnose(good, 1).summary


def test_edges_that_were_never_found_do_not_count_as_hidden(
    good: TrackRun, images: list[ByteImage], truth: list[FloatArray]
) -> None:
    """In a first frame that counts as good: it said that nothing stands out, and that few edges are found."""
    covered = [image.copy() for image in images]
    for image in covered:
        image[:, : CAMERA.width // 2 + 6] = (230, 150, 40)
    first = diagnose(replace(good, sequence=_ByImageId(list(covered), {1: truth})), 0)
    assert first.evidence is not None
    assert first.evidence.found_share < first.found_limit
    assert first.causes == (Cause.FEW_EDGES,)
    assert not first.hidden.any()
    # Where the frame before shows them they are hidden, which is said.
    later = diagnose(replace(good, sequence=_ByImageId([images[0], *covered[1:]], {1: truth})), 1)
    assert later.evidence is not None
    assert later.evidence.found_share < later.found_limit
    assert later.causes == ()
    assert re.search(r"% of the edges in view are found in the image, [456]\d% are hidden\.", later.conclusion)
    assert "few" not in later.conclusion


# ---- what the image does ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("known", [True, False])
def test_few_edges(model: PreparedPart, images: list[ByteImage], truth: list[FloatArray], known: bool) -> None:
    faint = from_trouble(images, lambda image: 100.0 + 0.06 * (image - 100.0))
    run = track(model, faint, truth)
    diagnosis = named(run if known else without_truth(run))
    assert diagnosis.causes[0] is Cause.FEW_EDGES
    assert "targets.search.contrast" in diagnosis.findings[0].advice
    # At first a sudden change of light is undone.
    assert TROUBLE <= diagnosis.onset <= TROUBLE + 1


@pytest.mark.parametrize("known", [True, False])
@pytest.mark.parametrize("patterned", [True, False])
def test_occlusion(
    model: PreparedPart, images: list[ByteImage], truth: list[FloatArray], known: bool, patterned: bool
) -> None:
    def cover(image: FloatArray) -> FloatArray:
        covered = image.copy()
        low, high = 0, CAMERA.width // 2 - 2
        covered[:, low:high] = (230.0, 150.0, 40.0)
        if patterned:
            covered[:, low:high:6] = (250.0, 190.0, 80.0)
        return covered

    run = track(model, from_trouble(images, cover), truth)
    diagnosis = named(run if known else without_truth(run))
    assert Cause.OCCLUSION in diagnosis.causes
    # Where the hiding was seen is where it is.
    assert diagnosis.evidence is not None
    hidden = diagnosis.evidence.points[diagnosis.hidden]
    assert (hidden[:, 0] < CAMERA.width // 2 + 4).mean() > 0.9


def test_clutter(model: PreparedPart, images: list[ByteImage], truth: list[FloatArray]) -> None:
    rng = np.random.default_rng(3)
    cells = rng.uniform(0.0, 255.0, (CAMERA.height // 3 + 1, CAMERA.width // 3 + 1))
    pattern = np.kron(cells, np.ones((3, 3)))[: CAMERA.height, : CAMERA.width]
    cluttered = images[:TROUBLE]
    for image in images[TROUBLE:]:
        ground = np.abs(image[..., 0].astype(np.float64) - GROUND) < 12.0
        changed = image.copy()
        changed[ground] = pattern[ground, None].astype(np.uint8)
        cluttered.append(changed)
    # So small a part is searched within few px, where there is room for few other edges.
    diagnosis = diagnose(track(model, cluttered, truth, PLAIN), TROUBLE + 1, config=DiagnosisConfig(rivals=0.5))
    assert Cause.CLUTTER in diagnosis.causes
    (finding,) = [finding for finding in diagnosis.findings if finding.cause is Cause.CLUTTER]
    assert "reach_px" in finding.advice


def test_changed_appearance(model: PreparedPart, images: list[ByteImage], truth: list[FloatArray]) -> None:
    run = track(model, from_trouble(images, lambda image: 255.0 - image), truth, PLAIN)
    assert Cause.APPEARANCE in named(run, TROUBLE).causes


def test_a_pose_beside_the_part_says_nothing_of_its_look(good: TrackRun) -> None:
    """Truth is known, and the image shows the part as ever: what fell is the quality of another place."""
    beside = good.results[1][TROUBLE].cam_T_obj.copy()
    beside[:3, 3] += (40.0, 0.0, 0.0)
    bad = replace(good.results[1][TROUBLE], cam_T_obj=beside, state=TrackState.WEAK, quality=0.05)
    run = replace(good, results={1: (*good.results[1][:TROUBLE], bad)})
    assert Cause.APPEARANCE not in diagnose(run, -1).causes


def test_an_unreadable_image(model: PreparedPart, images: list[ByteImage], truth: list[FloatArray]) -> None:
    torn: list[ByteImage | None] = list(images)
    torn[TROUBLE] = None
    diagnosis = diagnose(track(model, torn, truth), TROUBLE)
    assert diagnosis.causes[0] is Cause.UNREADABLE
    assert "the file is empty" in str(diagnosis)
    assert diagnosis.image is None


def test_the_reason_of_an_unreadable_image_is_that_of_its_file(
    part: Part, model: PreparedPart, images: list[ByteImage], truth: list[FloatArray]
) -> None:
    """A run from a results file knows nothing of it, and says other things of the frame."""
    torn: list[ByteImage | None] = list(images)
    torn[TROUBLE] = None
    run = track(model, torn, truth)
    assert run.sequence is not None
    again = run_from_rows(run.rows, run.sequence, {1: part}, "acp")
    (finding,) = [one for one in diagnose(again, TROUBLE).findings if one.cause is Cause.UNREADABLE]
    assert finding.text == f"{2 * TROUBLE:06d}.png: the file is empty"


def test_a_lost_part_is_judged_by_the_image_that_is_measured(
    model: PreparedPart, images: list[ByteImage], truth: list[FloatArray]
) -> None:
    """Without truth that is the first of the bad stretch; the quality of a later image says nothing of its look."""
    fading = list(images)
    for number, share in zip(range(TROUBLE - 1, FRAMES), (0.85, 0.5, 0.03, 0.0), strict=True):
        faint = 100.0 + share * (images[number].astype(np.float64) - 100.0)
        fading[number] = np.round(faint).astype(np.uint8)
    run = without_truth(track(model, fading, truth))
    lost = [replace(result, state=TrackState.LOST, quality=0.01) for result in run.results[1][TROUBLE + 1 :]]
    weak = replace(run.results[1][TROUBLE], state=TrackState.WEAK, quality=0.4)
    diagnosis = diagnose(replace(run, results={1: (*run.results[1][:TROUBLE], weak, *lost)}), -1)
    assert diagnosis.measured_frame == diagnosis.onset == TROUBLE
    found = {finding.cause: finding.severity for finding in diagnosis.findings}
    assert found.get(Cause.APPEARANCE, 1.0) < 3.0


# ---- what the part does ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("known", [True, False])
def test_motion_beyond_the_search(part: Part, model: PreparedPart, truth: list[FloatArray], known: bool) -> None:
    jumped = [pose.copy() for pose in truth]
    for pose in jumped[TROUBLE:]:
        pose[:3, 3] += (48.0, 9.0, 0.0)  # about 63 px
    images = [draw([(part, pose)], seed) for seed, pose in enumerate(jumped)]
    # A cloud would find it.
    method = replace(ACP, recovery=Alternatives(cloud_below=0.0))
    run = Tracker(model, method).run(MadeSequence(images, {1: jumped}), jumped[0])
    diagnosis = named(run if known else without_truth(run), TROUBLE)
    assert Cause.FAST_MOTION in diagnosis.causes
    (finding,) = [finding for finding in diagnosis.findings if finding.cause is Cause.FAST_MOTION]
    assert finding.measured == pytest.approx(63.0, abs=6.0)
    assert re.search("reach_px of at least [56]", finding.advice)


@pytest.mark.parametrize("known", [True, False])
def test_motion_is_measured_from_the_trackers_own_prediction(part: Part, model: PreparedPart, known: bool) -> None:
    """A steady motion surprises a tracker that expects rest, and one of constant velocity not at all."""
    step = np.array([0.0, 0.0, 0.0, 5.0, 3.0, 0.0])
    truth = poses(part, looking_at(part, np.array([0.8, 0.6, 1.0]), 250.0, 0.3), TROUBLE + 1, step)
    images = [draw([(part, pose)], seed) for seed, pose in enumerate(truth)]
    centres = [CAMERA.project(transform(pose, part.box_centre)[None])[0] for pose in truth]
    step_px = np.linalg.norm(centres[-1] - centres[-2])
    # A limit of 2 px, whatever the reach.
    config = DiagnosisConfig(recovery_px=2.0 - PartObserver(part).reach_px(CAMERA, truth[-1]))
    found = {}
    for prediction in (LastPosePrediction(), ConstantVelocityPrediction()):
        tracker = Tracker(model, replace(ACP_EDGES, prediction=prediction))
        run = tracker.run(MadeSequence(images, {1: truth}), truth[0])
        assert add_percent(part, run.results[1][-1].cam_T_obj, truth[-1]) < 2.0
        # Of a good frame nobody asks how the part moved.
        weak = replace(run.results[1][-1], quality=0.2, state=TrackState.WEAK)
        weakened = replace(run, results={1: (*run.results[1][:-1], weak)})
        diagnosis = diagnose(weakened if known else without_truth(weakened), -1, config=config)
        found[prediction.kind] = [f.measured for f in diagnosis.findings if f.cause is Cause.FAST_MOTION]
    assert found["last-pose"] == [pytest.approx(step_px, abs=1.0)]
    assert found["constant-velocity"] == []


@pytest.mark.parametrize("known", [True, False])
def test_a_prediction_from_a_lost_pose_says_nothing_of_motion(good: TrackRun, known: bool) -> None:
    """A tracker that lost the part by a board before it is far from it, however slowly the part moves."""
    results = list(good.results[1])
    for number in range(TROUBLE, FRAMES):
        off = results[number].cam_T_obj.copy()
        off[:3, 3] += (60.0 + 8.0 * (number % 2), 0.0, 0.0)
        results[number] = replace(results[number], state=TrackState.LOST, quality=0.02, cam_T_obj=off)
        if number > TROUBLE:
            results[number] = replace(results[number], predicted=results[number - 1].cam_T_obj)
    run = replace(good, results={1: tuple(results)})
    assert Cause.FAST_MOTION not in diagnose(run if known else without_truth(run), -1).causes


def test_partly_outside(part: Part, model: PreparedPart, truth: list[FloatArray]) -> None:
    leaving = [pose.copy() for pose in truth]
    for number, pose in enumerate(leaving):
        pose[0, 3] += 9.5 * number
    images = [draw([(part, pose)], seed) for seed, pose in enumerate(leaving)]
    diagnosis = named(track(model, images, leaving), FRAMES - 1)
    assert Cause.OUTSIDE_IMAGE in diagnosis.causes
    outside = next(finding.measured for finding in diagnosis.findings if finding.cause is Cause.OUTSIDE_IMAGE)
    pixels = CAMERA.project(transform(leaving[-1], part.vertices))
    assert outside == pytest.approx(float((pixels[:, 0] > CAMERA.width - 1).mean()), abs=0.3)


def test_the_border_of_a_region(good: TrackRun, part: Part) -> None:
    """Staged in the run itself: a method that hangs on its control points would show it in its quality."""
    on_border = looking_at(part, np.array([1.0, 0.2, 1.0]) * part.box_size, 250.0)
    swapping = [
        replace(result, region=number % 2 * 4, quality=0.2, state=TrackState.WEAK, cam_T_obj=on_border)
        for number, result in enumerate(good.results[1][TROUBLE:])
    ]
    run = replace(good, results={1: (*good.results[1][:TROUBLE], *swapping)})
    diagnosis = named(run)
    (finding,) = [finding for finding in diagnosis.findings if finding.cause is Cause.REGION_BORDER]
    assert "--regions all" in finding.advice


def test_near_degenerate_control_points(good: TrackRun) -> None:
    flat = np.array([[60.0, 80.0], [140.0, 82.0], [141.0, 86.0], [61.0, 84.0]])
    squeezed = [replace(result, control_points=flat) for result in good.results[1]]
    diagnosis = named(replace(good, results={1: tuple(squeezed)}))
    assert diagnosis.causes == (Cause.DEGENERATE_POINTS,)
    assert diagnosis.findings[0].measured < 0.06


@pytest.mark.parametrize("factor", [0.85, 1.2])
def test_wrong_focal_length(
    model: PreparedPart, images: list[ByteImage], truth: list[FloatArray], factor: float
) -> None:
    wrong = Camera(CAMERA.width, CAMERA.height, factor * CAMERA.fx, factor * CAMERA.fy, CAMERA.cx, CAMERA.cy)

    class WrongCamera(MadeSequence):
        def frames(self, max_frames: int | None = None):  # type: ignore[no-untyped-def]
            for frame in super().frames(max_frames):
                yield replace(frame, camera=wrong)

    run = Tracker(model).run(WrongCamera(images, {1: truth}), truth[0])
    diagnosis = named(without_truth(run))
    assert diagnosis.causes[0] is Cause.UNIT_OR_CAMERA
    assert f"factor of {factor:.1f}" in diagnosis.findings[0].text
    assert "fx" in diagnosis.findings[0].advice


def test_a_part_in_another_unit(good: TrackRun) -> None:
    """As with a start pose in tenths of millimetres: the part looks tiny."""
    far = truth_far = good.starts[1].copy()
    far[:3, 3] *= 10.0
    run = replace(good, starts={1: truth_far})
    diagnosis = named(run)
    assert diagnosis.causes[0] is Cause.UNIT_OR_CAMERA


@pytest.mark.parametrize("known", [True, False])
def test_a_start_beside_the_part(
    model: PreparedPart, images: list[ByteImage], truth: list[FloatArray], known: bool
) -> None:
    """It was told as an occlusion, with settings that make nothing better."""
    beside = truth[0] @ make_pose(so3_exp(np.array([0.0, 1.2, 0.6])), np.array([12.0, 8.0, 0.0]))
    run = Tracker(model, ACP_EDGES).run(MadeSequence(images, {1: truth}), beside)
    never = tuple(replace(r, state=TrackState.WEAK, quality=min(r.quality, 0.2)) for r in run.results[1])
    run = replace(run, results={1: never})
    diagnosis = diagnose(run if known else without_truth(run), 3)
    assert diagnosis.causes[0] is Cause.WRONG_START
    assert "--init auto" in diagnosis.findings[0].advice
    assert "learn_above" not in str(diagnosis)
    # Where the truth says that the start was right, it is not blamed.
    fair = replace(run, starts={1: truth[0]})
    assert (Cause.WRONG_START in diagnose(fair if known else without_truth(fair), 3).causes) is not known


# ---- the error that is told --------------------------------------------------------------------------------------


def test_the_error_told_is_that_of_the_evaluation(good: TrackRun, part: Part, truth: list[FloatArray]) -> None:
    off = truth[3].copy()
    off[:3, 3] += (0.0, 3.0, -4.0)
    results = [*good.results[1][:3], replace(good.results[1][3], cam_T_obj=off), *good.results[1][4:]]
    run = replace(good, results={1: tuple(results)})
    row = next(row for row in run.rows if row.im_id == results[3].frame_id)
    errors = frame_errors(part, {row.im_id: truth[3]}, {row.im_id: row})
    diagnosis = diagnose(run, 3)
    assert diagnosis.add_percent == pytest.approx(100.0 * errors.distance[0], rel=1e-9)
    assert diagnosis.add_percent == pytest.approx(100.0 * 5.0 / part.diameter)
    assert f", ADD {100.0 * 5.0 / part.diameter:.1f}% of the diameter" in diagnosis.summary


def test_a_pose_that_is_poorly_fixed_is_said_to_be(good: TrackRun) -> None:
    results = list(good.results[1])
    results[3] = replace(results[3], exactness=0.62)
    results[4] = replace(results[4], exactness=0.96)
    run = replace(good, results={1: tuple(results)})
    assert "What is seen fixes its pose poorly: exactness 0.62." in diagnose(run, 3).summary
    assert "exactness" not in diagnose(run, 4).summary


@pytest.mark.parametrize("known", [True, False])
def test_a_pose_beside_the_part_is_named_whatever_its_quality(good: TrackRun, part: Part, known: bool) -> None:
    """It was said that nothing stands out, with the edges found, which are those of the true pose."""
    results = list(good.results[1])
    for number in range(3, FRAMES):
        off = results[number].cam_T_obj.copy()
        off[:3, 3] += (0.3 * part.diameter, 0.0, 0.0)
        results[number] = replace(results[number], cam_T_obj=off, predicted=off)
    run = replace(good, results={1: tuple(results)})
    run = run if known else without_truth(run)
    assert first_beside(run, 1) == (3 if known else None)
    assert diagnose(run, 2).is_good
    diagnosis = diagnose(run, 5)
    assert diagnosis.is_beside == known
    if known:
        assert diagnosis.findings == ()
        assert not diagnosis.is_good
        assert diagnosis.add_percent == pytest.approx(30.0, abs=2.0)
        assert diagnosis.conclusion.startswith("The tracked pose is beside the part. It is off by")
        assert f"{diagnosis.add_percent:.1f}% of the diameter (ADD)" in diagnosis.conclusion
        assert "The quality does not show it." in diagnosis.conclusion
        assert "found in the image at the true pose" in diagnosis.conclusion
        weak = replace(results[5], state=TrackState.WEAK)
        words = diagnose(replace(run, results={1: (*results[:5], weak, *results[6:])}), 5).conclusion
        assert "quality does not" not in words
    assert ("Nothing stands out" in str(diagnosis)) is (not known and diagnosis.is_good)


def test_a_part_turned_by_its_symmetry_is_right() -> None:
    """A three-sided prism, whose box has its centre beside the axis of symmetry."""
    angles = np.radians([0.0, 120.0, 240.0])
    vertices, faces = extruded(25.0 * np.column_stack([np.cos(angles), np.sin(angles)]), 20.0)
    turns = np.array([make_pose(so3_exp(np.array([0.0, 0.0, angle])), np.zeros(3)) for angle in angles[1:]])
    prism = Part.from_mesh(vertices, faces, "prism", Symmetries(turns))
    truth = poses(prism, looking_at(prism, np.array([0.8, 0.6, 1.0]), 200.0, 0.3), FRAMES, SLOW)
    images = [draw([(prism, pose)], seed) for seed, pose in enumerate(truth)]
    run = Tracker(prepared(prism)).run(MadeSequence(images, {1: truth}), truth[0] @ turns[0])
    assert add_percent(prism, run.results[1][-1].cam_T_obj, truth[-1]) > 30.0, "the test's own point is gone"
    diagnosis = diagnose(run, TROUBLE)
    assert diagnosis.metric == "ADD-S"
    assert diagnosis.add_percent < 1.5
    assert diagnosis.is_good
    assert "ADD-S" in diagnosis.summary
    # With a low quality the motion is looked at too: the part was where it was expected.
    weak = [replace(result, quality=0.2, state=TrackState.WEAK) for result in run.results[1][TROUBLE:]]
    weakened = replace(run, results={1: (*run.results[1][:TROUBLE], *weak)})
    assert Cause.FAST_MOTION not in diagnose(weakened, TROUBLE, config=DiagnosisConfig(recovery_px=0.0)).causes


def test_the_settings_that_advice_names_exist() -> None:
    """What helps is said in options of the command line; those of --config are keys of a method's file."""
    text = " ".join(Path(causes.__file__).read_text(encoding="utf-8").split())
    method = tomllib.loads(to_toml(ACP))
    named = set(re.findall(r"\b((?:targets|states|learning|schedule|sight)(?:\.[a-z_]+)+)", text))
    assert {"targets.search.contrast", "sight.reach", "learning.memory.rate"} <= named
    for key in named:
        value = method
        for word in key.split("."):
            value = value[0] if isinstance(value, list) else value
            assert word in value, key
            value = value[word]
    assert "reach_px" in method["schedule"]["levels"][0]
    assert not re.search(r"\b[A-Z][A-Za-z]*(?:Config|Learning|Schedule|Tries)\.", text.partition("class Finding")[2])


# ---- the measurements --------------------------------------------------------------------------------------------


def test_image_motion_is_that_of_the_image(images: list[ByteImage]) -> None:
    moved = np.roll(images[0], (7, -11), axis=(0, 1))
    frames = Frame(0, images[0], CAMERA), Frame(1, moved, CAMERA)
    points = np.array([[70.0, 50.0], [130.0, 50.0], [130.0, 110.0], [70.0, 110.0]])
    motion = image_motion(*frames, points, np.zeros(2), 30.0)
    np.testing.assert_allclose(motion, [-11.0, 7.0])
    # What was expected is taken where nothing speaks against it.
    expected = np.array([-10.6, 7.3])
    np.testing.assert_array_equal(image_motion(*frames, points, expected, 30.0), expected)


def test_nothing_matches_noise(images: list[ByteImage]) -> None:
    noise = np.random.default_rng(0).integers(0, 255, images[0].shape, dtype=np.uint8)
    points = np.array([[70.0, 50.0], [130.0, 50.0], [130.0, 110.0], [70.0, 110.0]])
    frames = Frame(0, images[0], CAMERA), Frame(1, noise, CAMERA)
    assert image_motion(*frames, points, np.zeros(2), 30.0) is None


def test_a_part_behind_the_camera_shows_nothing(part: Part, images: list[ByteImage]) -> None:
    behind = make_pose(np.eye(3), np.array([0.0, 0.0, -300.0]))
    evidence = PartObserver(part).measure(images[0], CAMERA, behind)
    assert evidence.found_share == 0.0
    assert evidence.outside == 1.0


# ---- results and images ----------------------------------------------------------------------------------------


class _ByImageId(MadeSequence):
    """A data set, which reads any image by its id."""

    def frame(self, frame_id: int) -> Frame | UnreadableFrame:
        return next(frame for frame in self.frames() if frame.index == frame_id)


@pytest.mark.parametrize("kind", [MadeSequence, _ByImageId])
def test_results_that_begin_late_or_have_gaps_are_held_against_their_own_images(
    good: TrackRun, images: list[ByteImage], truth: list[FloatArray], kind: type[MadeSequence]
) -> None:
    results = tuple(good.results[1][number] for number in (2, 3, 5, 6))
    run = replace(good, results={1: results}, sequence=kind(list(images), {1: truth}))
    for number, image in enumerate((2, 3, 5, 6)):
        diagnosis = diagnose(run, number)
        assert diagnosis.frame_id == 2 * image
        np.testing.assert_array_equal(diagnosis.image, images[image])


def test_without_a_good_frame_before_there_is_nothing_to_compare_with(
    good: TrackRun, images: list[ByteImage], truth: list[FloatArray]
) -> None:
    """The last image of the sequence, of all, was taken for it."""
    bad = [replace(result, state=TrackState.WEAK, quality=0.2) for result in good.results[1]]
    dark = np.full_like(images[0], 40)
    covered = [dark.copy() for _ in images]
    for image, shown in zip(covered, images, strict=True):
        image[:, CAMERA.width // 2 :] = shown[:, CAMERA.width // 2 :]
    covered[-1] = images[-1]
    run = replace(good, results={1: tuple(bad)}, sequence=_ByImageId(list(covered), {1: truth}))
    without_last = replace(run, sequence=_ByImageId(list(covered[:-1]), {1: truth}))
    first, again = diagnose(run, 0), diagnose(without_last, 0)
    assert first.findings == again.findings
    np.testing.assert_array_equal(first.hidden, again.hidden)


# ---- bad input -------------------------------------------------------------------------------------------------


def test_bad_input(good: TrackRun) -> None:
    with pytest.raises(SequenceError, match="no frame 8"):
        diagnose(good, FRAMES)
    with pytest.raises(SequenceError, match="object 3"):
        diagnose(good, 0, object_id=3)
    with pytest.raises(SequenceError, match="does not know its parts"):
        diagnose(replace(good, session=None), 0)


def test_frames_count_from_the_end_too(good: TrackRun) -> None:
    assert diagnose(good, -1).frame == FRAMES - 1


def test_without_images_the_run_alone_speaks(good: TrackRun) -> None:
    diagnosis = diagnose(replace(good, sequence=None), 3)
    assert diagnosis.evidence is None
    assert diagnosis.findings == ()
