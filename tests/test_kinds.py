"""What a beginner hands over in place of the object that is wanted is told in one line, with the call that makes it."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import acp_lab as acp
from acp_lab.display.pictures import draw_edges
from acp_lab.display.widgets import LossLandscape, ManipulationExplorer, PoseAligner, TrackPlayer
from acp_lab.errors import AcpLabError
from acp_lab.generator.base import VisibleSamples
from acp_lab.geometry.camera import Undistorter
from acp_lab.geometry.pose import make_pose
from acp_lab.sequences.frame import Frame
from acp_lab.tracking.part_size import for_size
from acp_lab.tracking.priors import MotionPrior
from acp_lab.tracking.session import track_sequence
from tests.prepared_sample import sample_model, sample_scene

BENT = acp.Camera(640, 480, 600, 600, 320, 240, (0.1, 0.0, 0.0, 0.0, 0.0))

WRONG: dict[str, tuple[Any, str]] = {
    "Tracker": (lambda: acp.Tracker("parts/bracket"), "model is a str 'parts/bracket', .*acp.PreparedPart.load"),  # type: ignore[arg-type]
    "prepare": (lambda: acp.prepare(Path("bracket.ply")), r"part is a \w+Path 'bracket.ply', no Part: .*from_file"),  # type: ignore[arg-type]
    "start": (
        lambda: acp.Tracker(sample_model()).start(sample_scene().frame(0).image, np.eye(4)),  # type: ignore[union-attr]
        r"frame is a ndarray, no Frame: .*scene.frame\(0\)",
    ),
    "run": (
        lambda: acp.Tracker(sample_model()).run(sample_scene(), start="POSE.json"),  # type: ignore[arg-type]
        r"the start pose: no pose .*read_pose\('POSE.json'\)",
    ),
    "run of a path": (
        lambda: acp.Tracker(sample_model()).run("data/test/000001", start=np.eye(4)),  # type: ignore[arg-type]
        "data/test/000001: is a path, no sequence: give acp.open_sequence",
    ),
    "one tracker for two parts": (
        lambda: track_sequence(
            dict.fromkeys((1, 2), acp.Tracker(sample_model())), sample_scene(), dict.fromkeys((1, 2), np.eye(4))
        ),
        "one tracker for several objects: make one for each",
    ),
    "starts": (
        lambda: track_sequence({1: acp.Tracker(sample_model())}, sample_scene(), [np.eye(4)]),  # type: ignore[arg-type]
        "starts is a list, no Mapping: give a dictionary by object id",
    ),
    "live": (lambda: acp.live(sample_model(), None), "camera is a NoneType, no Camera"),  # type: ignore[arg-type]
    "live from a file": (
        lambda: acp.live(sample_model(), sample_scene().camera(0), start="POSE.json"),  # type: ignore[arg-type]
        r"start = 'POSE.json': give 'find', or a pose, such as acp.read_pose\('POSE.json'\)",
    ),
    "live from no pose": (
        lambda: acp.live(sample_model(), sample_scene().camera(0), start=[[1, 2], [3]]),  # type: ignore[arg-type]
        "start: no pose of shape",
    ),
    "live of no camera": (
        lambda: acp.live(sample_model(), sample_scene().camera(0), -1),
        "camera -1: there are none of that number",
    ),
    "detect": (
        lambda: acp.detect(sample_model(), sample_scene().frame(0).image),  # type: ignore[union-attr]
        "frame is a ndarray, no Frame",
    ),
    "detect of a path": (
        lambda: acp.detect("parts/bracket", sample_scene().frame(0)),  # type: ignore[arg-type]
        "model is a str 'parts/bracket', no PreparedPart",
    ),
    "prepare as it is called": (lambda: acp.prepare(sample_model().part, "fast"), "options is a str 'fast'"),  # type: ignore[arg-type]
    "track": (lambda: _started().track(sample_scene().frame(1).image), r"frame is a ndarray, no Frame"),  # type: ignore[union-attr]
    "show": (lambda: acp.show("run.rrd"), "run is a str 'run.rrd', no TrackRun: .*acp-lab replay"),  # type: ignore[arg-type]
    "explain": (lambda: acp.explain("results.csv", 0), "run is a str 'results.csv', no TrackRun"),  # type: ignore[arg-type]
    "TrackPlayer": (lambda: TrackPlayer("results.csv"), "run is a str 'results.csv', no TrackRun"),  # type: ignore[arg-type]
    "PoseAligner": (
        lambda: PoseAligner(sample_model(), sample_scene().frame(0).image),  # type: ignore[union-attr]
        "frame is a ndarray, no Frame",
    ),
    "LossLandscape": (
        lambda: LossLandscape(sample_model(), sample_scene().frame(0).image, np.eye(4)),  # type: ignore[union-attr]
        "frame is a ndarray, no Frame",
    ),
    "ManipulationExplorer": (
        lambda: ManipulationExplorer(sample_model(), sample_scene().camera(0), sample_scene().first_pose[:3]),
        r"the reference pose: no pose of shape \(4, 4\)",
    ),
    "ManipulationExplorer of a part around the camera": (
        lambda: ManipulationExplorer(sample_model(), sample_scene().camera(0), np.eye(4)),
        "inside",
    ),
    "Replay": (lambda: acp.Replay("run.rrd", iterations="some"), "iterations = 'some': give one of off, failures, all"),  # type: ignore[arg-type]
    "Replay without room": (lambda: acp.Replay("run.rrd", most_mb=0.0), "most_mb = 0.0: give megabytes"),
    "Replay of room in words": (lambda: acp.Replay("run.rrd", most_mb="5"), "most_mb = '5': give megabytes"),
    "Replay of sessions in words": (lambda: acp.Replay("run.rrd", sessions="2"), "sessions = '2': give a whole number"),
    "Replay without sessions": (lambda: acp.Replay("run.rrd", 0), "sessions = 0: give a whole number, 1 or more"),
    "Replay of less than no frames": (lambda: acp.Replay("run.rrd", frames=-3), "frames = -3: give a whole number, 0"),
    "snap": (
        lambda: acp.snap(sample_model(), sample_scene().frame(0).image, np.eye(4)),
        "frame is a ndarray, no Frame",
    ),  # type: ignore[union-attr]
    "look": (lambda: _started().look(sample_scene().frame(1).image, np.eye(4)), "frame is a ndarray, no Frame"),  # type: ignore[union-attr]
    "open_sequence of nothing": (lambda: acp.open_sequence(None), "None: is no path of a scene"),  # type: ignore[arg-type]
    "read_pose of nothing": (lambda: acp.read_pose(None), "None: is no path of a pose file: .*POSE.json"),  # type: ignore[arg-type]
    "Camera.from_json of nothing": (lambda: acp.Camera.from_json(None), "None: is no path of a camera file"),  # type: ignore[arg-type]
    "Camera.from_json of values": (lambda: acp.Camera.from_json({"width": 640}), "{'width': 640}: is no path"),  # type: ignore[arg-type]
    "PreparedPart.load of nothing": (lambda: acp.PreparedPart.load(None), "None: is no path of a prepared part"),  # type: ignore[arg-type]
    "PreparedPart.load and a part": (lambda: acp.PreparedPart.load("a", 3), "3: is no path of a mesh file"),  # type: ignore[arg-type]
    "Replay of nothing": (lambda: acp.Replay(None), "None: is no path of a replay"),  # type: ignore[arg-type]
    "ResultsFile of nothing": (lambda: acp.ResultsFile(None), "None: is no path of a results file"),  # type: ignore[arg-type]
    "prepare into a number": (
        lambda: acp.prepare(sample_model().part, out=3),  # type: ignore[arg-type]
        "3: is no path of a folder of prepared parts",
    ),
    "snap of nothing": (lambda: acp.snap(None, _first(), np.eye(4)), "model is a NoneType, no PreparedPart"),  # type: ignore[arg-type]
    "PoseAligner of nothing": (lambda: PoseAligner(None, _first()), "model is a NoneType, no PreparedPart"),  # type: ignore[arg-type]
    "detect with a number": (
        lambda: acp.detect(sample_model(), _first(), 3, 5),  # type: ignore[arg-type]
        "config is a int, no DetectionConfig",
    ),
    "a matrix in words": (lambda: acp.Camera.from_matrix("abc", 640, 480), "matrix 'abc': give 3 x 3 numbers"),  # type: ignore[arg-type]
    "a view in words": (lambda: acp.Camera.from_field_of_view(640, 480, "60"), "hfov_deg='60': give degrees"),  # type: ignore[arg-type]
    "a crop between pixels": (lambda: BENT.pinhole().cropped(0.5, 0, 9, 9), "crop at 0.5, 0: give whole px"),  # type: ignore[arg-type]
    "start found in words": (lambda: _begun("yes"), "found is a str 'yes', no bool: give True or False"),
    "start found in numbers": (lambda: _begun(np.array([1, 0])), "found is a ndarray, no bool"),
    "detect none": (lambda: acp.detect(sample_model(), _first(), top=0), "top = 0: give how many"),
    "Tracker with a class": (lambda: acp.Tracker(sample_model(), acp.Method), "method is a type, no Method: .*'acp'"),  # type: ignore[arg-type]
    "Tracker with nothing": (lambda: acp.Tracker(sample_model(), None), "method is a NoneType"),  # type: ignore[arg-type]
    "predicted before start": (lambda: acp.Tracker(sample_model()).predicted, "predicted was asked before start"),
    "last before start": (lambda: acp.Tracker(sample_model()).last, "last was asked before start"),
    "run of images": (lambda: _run([_first().image]), r"a list is no sequence: give acp.open_images\(images, camera\)"),
    "run of another object": (lambda: _run(sample_scene(), object_id=7), "does not show object 7, but 1"),
    "run of half a frame": (lambda: _run(sample_scene(), max_frames=2.5), "max_frames = 2.5: give a whole number"),
    "one observer": (
        lambda: _run(sample_scene(), observers=acp.Replay("a.rrd")),
        r"observers is a Replay, no Iterable",
    ),
    "a word for observers": (lambda: _run(sample_scene(), observers="a.rrd"), "observers: a str is none"),
    "a sequence of images": (lambda: _run(_Bare()), "frame is a ndarray, no Frame"),
    "Method without a tuple": (lambda: replace(acp.METHODS["acp"], priors=MotionPrior()), "priors: give a tuple"),  # type: ignore[arg-type]
    "Method with a word": (lambda: replace(acp.METHODS["acp"], prediction="kalman"), "prediction = 'kalman': give its"),  # type: ignore[arg-type]
    "Method with nothing": (lambda: replace(acp.METHODS["acp"], recovery=None), "recovery = None: .*Off"),  # type: ignore[arg-type]
    "Part.from_file and a unit": (
        lambda: acp.Part.from_file("b.ply", "m"),
        "info is a str 'm', no PartInfo: .*unit='m'",
    ),  # type: ignore[arg-type]
    "Part.from_mesh of fractions": (lambda: _made(faces=np.eye(3)), "faces are float64: give whole numbers"),
    "Part.from_mesh of words": (lambda: _made(vertices=[["a", 1, 2]]), "are no arrays"),
    "Part.from_mesh without a name": (lambda: _made(name=None), "part None: its name is a NoneType"),
    "evaluate the wrong way round": (
        lambda: acp.evaluate(sample_scene(), _Bare()),
        "no truth to score .*after the run",
    ),  # type: ignore[arg-type]
    "evaluate of poses": (lambda: acp.evaluate(np.zeros((3, 4, 4)), sample_scene()), "a row of results is a ndarray"),  # type: ignore[arg-type]
    "evaluate of nothing": (lambda: acp.evaluate(None, sample_scene()), "results is a NoneType"),  # type: ignore[arg-type]
    "Frame with a matrix": (
        lambda: Frame(0, _first().image, np.eye(3)),
        "camera is a ndarray, no Camera: .*from_matrix",
    ),  # type: ignore[arg-type]
    "Frame without a number": (lambda: Frame("a", _first().image, _first().camera), "its index is no whole number"),  # type: ignore[arg-type]
    "Frame at noon": (lambda: Frame(0, _first().image, _first().camera, "12:00"), "its time_s is a str"),  # type: ignore[arg-type]
    "Frame of 16 bits": (lambda: Frame(0, np.zeros((4, 4, 3), np.uint16), _first().camera), "image >> 8"),
    "Frame of shares": (lambda: Frame(0, np.zeros((4, 4, 3)), _first().camera), r"np.uint8\(255.0 \* image\)"),
    "Frame of RGBA": (lambda: Frame(0, np.zeros((4, 4, 4), np.uint8), _first().camera), "of RGBA image"),
    "Camera of fractions": (lambda: acp.Camera(640.5, 480, 600, 600, 320, 240), "640.5 x 480: give whole px"),  # type: ignore[arg-type]
    "Camera without a focal length": (lambda: acp.Camera(640, 480, None, 600, 320, 240), "fx is None: give a number"),  # type: ignore[arg-type]
    "Camera with a word": (lambda: acp.Camera(640, 480, 600, 600, 320, 240, "none"), "distortion .*give five finite"),  # type: ignore[arg-type]
    "make_pose of a vector": (lambda: make_pose(np.ones(3), np.ones(3)), r"give \(3, 3\) and \(3,\)"),
    "Undistorter of 16 bits": (lambda: Undistorter(BENT)(np.zeros((480, 640, 3), np.uint16)), "uint8, 0 to 255"),
    "Undistorter of shares": (lambda: Undistorter(BENT.pinhole())(np.zeros((480, 640, 3))), "image is float64"),  # type: ignore[arg-type]
    "open_images of images of shares": (
        lambda: next(acp.open_images([np.zeros((4, 4, 3))], _first().camera).frames()),  # type: ignore[list-item]
        "images: image 0 is float64",
    ),
    "open_images of a number": (lambda: acp.open_images(2.5, _first().camera), "source is a float"),  # type: ignore[arg-type]
    "open_images": (lambda: acp.open_images("frames", "CAMERA.json"), r"camera is a str .*Camera.from_json"),  # type: ignore[arg-type]
}


class _Bare:
    """Stands for a sequence that somebody wrote: it gives images instead of frames."""

    name, scene_id, frame_ids, object_ids = "bare", 1, (0,), (1,)
    first_poses: dict[int, Any] = {}  # noqa: RUF012

    def frames(self, max_frames: int | None = None) -> Any:
        return iter([_first().image])

    def truth(self, frame_id: int, object_id: int) -> None:
        return None


def _first() -> Frame:
    frame = sample_scene().frame(0)
    assert isinstance(frame, Frame)
    return frame


def _run(sequence: Any, **options: Any) -> Any:
    return acp.Tracker(sample_model()).run(sequence, sample_scene().first_pose, **options)


def _made(**changed: Any) -> acp.Part:
    return acp.Part.from_mesh(**{"vertices": np.eye(3), "faces": [[0, 1, 2]], "name": "made", **changed})


def _begun(found: Any) -> None:
    acp.Tracker(sample_model()).start(_first(), sample_scene().first_pose, found)


def _started() -> acp.Tracker:
    frame, tracker = sample_scene().frame(0), acp.Tracker(sample_model())
    assert isinstance(frame, Frame)
    tracker.start(frame, sample_scene().first_pose)
    return tracker


@pytest.mark.parametrize(("call", "told"), WRONG.values(), ids=WRONG.keys())
def test_another_kind_of_object_is_one_line(call: Any, told: str) -> None:
    with pytest.raises(AcpLabError, match=told) as caught:
        call()
    assert "\n" not in str(caught.value)


def test_what_a_tracker_tells_may_be_changed() -> None:
    """As to metres, for a robot: the tracker goes on from its own."""
    changed, left = _started(), _started()
    for number in range(1, 4):
        for told in (changed.last, changed.predicted, *changed.control_points_obj):
            told /= 1000.0
        frame = sample_scene().frame(number)
        ours, theirs = changed.track(frame), left.track(frame)
        np.testing.assert_array_equal(ours.cam_T_obj, theirs.cam_T_obj)
        np.testing.assert_array_equal(ours.control_points, theirs.control_points)


def test_a_run_keeps_its_own_start() -> None:
    start = sample_scene().first_pose.copy()
    run = acp.Tracker(sample_model()).run(sample_scene(), start, max_frames=1)
    start[:] = 0.0
    np.testing.assert_array_equal(run.starts[1], sample_scene().first_pose)


@pytest.mark.parametrize("as_what", [list, np.stack, iter], ids=["list", "array", "generator"])
def test_images_in_memory_are_a_sequence(as_what: Any) -> None:
    frames = [frame for frame in sample_scene().frames(3) if isinstance(frame, Frame)]
    images = acp.open_images(as_what([frame.image for frame in frames]), frames[0].camera)
    run = acp.Tracker(sample_model()).run(images, sample_scene().first_pose)
    of_scene = acp.Tracker(sample_model()).run(sample_scene(), sample_scene().first_pose, max_frames=3)
    assert len(run.results[1]) == 3
    for one, other in zip(run.results[1], of_scene.results[1], strict=True):
        np.testing.assert_allclose(one.cam_T_obj, other.cam_T_obj, atol=1e-6)


def test_a_result_is_one_line_and_equals_itself() -> None:
    result = _started().track(sample_scene().frame(1))
    assert result != deepcopy(result)
    assert result in {result}
    for shown in (repr(result), repr(sample_model()), repr(sample_model().part)):
        assert len(shown) < 250
    assert "frame 1, tracking, quality" in repr(result)


def test_a_loaded_part_is_read_only() -> None:
    part = sample_model().part
    assert not any(values.flags.writeable for values in (part.vertices, part.faces))


def test_one_pixel_has_one_ray_and_one_point_one_pixel() -> None:
    camera = BENT.pinhole()
    ray = camera.rays(np.array([100.0, 200.0]))
    np.testing.assert_allclose(ray, camera.rays(np.array([[100.0, 200.0]]))[0])
    np.testing.assert_allclose(camera.project(400.0 * ray), [100.0, 200.0])


def test_sizes_and_lenses_as_numpy_and_opencv_give_them(tmp_path: Path) -> None:
    height, width = np.zeros((480, 640)).shape
    bent = acp.Camera(np.int64(width), np.int64(height), 600, 600, 320, 240, np.full((5, 1), 0.1))  # type: ignore[arg-type]
    bent.to_json(tmp_path / "camera.json")
    assert acp.Camera.from_json(tmp_path / "camera.json") == bent


def test_a_generator_may_give_any_arrays() -> None:
    shown = VisibleSamples(np.arange(8, dtype=np.int32)[::2], np.zeros(8, bool)[::2], np.ones(4, np.float32))
    assert (shown.ids.dtype, shown.weights.dtype) == (np.int64, np.float64)
    assert shown.outline.flags.c_contiguous


def test_settings_of_ones_own_without_mm_stay_the_very_object() -> None:
    @dataclass(frozen=True)
    class Mine:
        kind: str = "mine"
        counted: int = field(default=0, init=False)

    method = replace(acp.METHODS["acp"], priors=(MotionPrior(), Mine()))
    assert for_size(method, 3.0).priors[1] is method.priors[1]


def test_a_frame_in_which_nothing_shows_draws_nothing() -> None:
    draw_edges(None, None)  # type: ignore[arg-type]
