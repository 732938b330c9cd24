"""`acp-lab detect`: hypotheses of where parts are, in a data set, an image or a video, as results and as a picture."""

from __future__ import annotations

import math
import time
from collections.abc import Iterable, Iterator, Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING

import cv2
import numpy as np

from acp_lab.commands import console, interrupt
from acp_lab.commands.track import PartShelf
from acp_lab.errors import AcpLabError, GeometryError, InputFileError, PreparationError, SequenceError
from acp_lab.files import check_replaces_own
from acp_lab.pasted import quoted
from acp_lab.sequences.frame import Frame, UnreadableFrame
from acp_lab.sequences.results_csv import HEADER_START, run_info_path

if TYPE_CHECKING:
    from acp_lab.geometry.arrays import ByteImage
    from acp_lab.geometry.camera import Camera
    from acp_lab.prepared_part import PreparedPart
    from acp_lab.sequences.bop import BopDataset, BopScene
    from acp_lab.tracking.find import Detection

PICTURE_START = b"\x89PNG"
_TOP = 3
_DRAWN_EACH = 0.5
"""With --each: hypotheses that are less likely would cover the picture."""
_PICTURES = 12
"""Frames that the picture shows at most: the first ones."""
_PICTURE_WIDTH = 640
_ACCEPTED, _OTHERS = (0, 200, 0), ((255, 150, 0), (220, 0, 200))
"""RGB of hypotheses that are accepted, and of others, the best first."""


@dataclass(frozen=True)
class DetectOptions:
    """What to find, and where: the one argument of `acp-lab detect`.

    Attributes:
        source: a data set in the BOP layout, an image, or with `camera` a video or a folder of images.
        camera: of the images, as a file; mesh: the part in them, by default the only one in `parts`.
        scenes: of the data set; empty means all. step: every so manyth frame.
        each: whether several parts alike are looked for, as in a tray, and each counts for itself. top: hypotheses per
            frame and object at most; None for as many as are usual. depth_mm: nearest and farthest.

    Raises:
        AcpLabError: options that contradict each other, or a file that cannot be written.
    """

    source: Path
    parts: Path
    out: Path
    camera: Path | None = None
    mesh: Path | None = None
    split: str = "test"
    scenes: tuple[int, ...] = ()
    step: int = 1
    top: int | None = None
    depth_mm: tuple[float, float] | None = None
    each: bool = False

    def __post_init__(self) -> None:
        if self.depth_mm is not None:
            near, far = self.depth_mm
            if not (math.isfinite(near) and math.isfinite(far) and 0.0 < near <= far):
                raise AcpLabError(f"--depth-mm {near:g} {far:g}: give two distances, 0 < nearest <= farthest")
        if not self.source.exists():
            raise InputFileError(f"{self.source}: no such data set, image or video: check the path")
        if self.is_data_set:
            for name, path in (("camera", self.camera), ("mesh", self.mesh)):
                if path is not None:
                    raise AcpLabError(f"--{name} {path}: only goes with an image, a video or a folder: leave it out")
        elif self.camera is None:
            raise AcpLabError(f"{self.source}: images need their camera: give --camera CAMERA.json")
        elif self.scenes:
            raise SequenceError(f"--scene {self.scenes[0]}: images and videos have no scenes: leave it out")
        if self.picture == self.out:
            raise InputFileError(
                f"{self.out}: --out is the table, and its picture would replace it: name it {self.out.stem}.csv"
            )
        for path, start, kind in ((self.out, HEADER_START, "results"), (self.picture, PICTURE_START, "a picture")):
            if path.is_dir():
                raise InputFileError(f"{path}: is a folder: --out needs a file name")
            if path.resolve() in {p.resolve() for p in (self.source, self.camera, self.mesh) if p is not None}:
                raise InputFileError(f"{path}: --out would overwrite an input: choose another file")
            check_replaces_own(path, start, "--out", kind)
        if self.picture.exists() and not self.out.exists():  # where both are there, an earlier run made them
            raise InputFileError(
                f"{self.picture}: the picture of --out would replace one without results beside it: choose another name"
            )
        run = run_info_path(self.out)
        if run.exists():  # rows of detect have none: it would tell of others
            raise InputFileError(
                f"{self.out}: holds a run of acp-lab track, as {run.name} says: choose another --out, or delete both"
            )
        if self._is_among_images:
            raise InputFileError(
                f"{self.picture}: the picture of --out would be taken for one of the images there: choose another place"
            )

    @property
    def is_data_set(self) -> bool:
        """Whether the source is a data set: a folder of scenes, and not of images alone."""
        return self.source.is_dir() and (self.camera is None or (self.source / self.split).is_dir())

    @property
    def _is_among_images(self) -> bool:
        """Whether --out lies in the folder of images that is looked at, or in that of a scene."""
        from acp_lab.sequences.bop import IMAGE_FOLDERS

        folder = self.out.parent.resolve()
        is_source = not self.is_data_set and folder == self.source.resolve()
        return is_source or (folder.name in IMAGE_FOLDERS and (folder.parent / "scene_camera.json").exists())

    @property
    def picture(self) -> Path:
        """The picture beside the results."""
        return self.out.with_suffix(".png")


@dataclass(frozen=True, eq=False)
class DetectJob:
    """The frames of one scene, how many they are, and the parts to look for by object id."""

    scene_id: int
    frames: Iterable[Frame | UnreadableFrame]
    count: int
    models: Mapping[int, PreparedPart]


def detect_parts(options: DetectOptions) -> None:
    """Find the parts, write results and picture, and print one line per object and scene."""
    from acp_lab.detection.config import DetectionConfig
    from acp_lab.files import write_whole
    from acp_lab.sequences.results_csv import ResultRow, ResultsWriter
    from acp_lab.tracking.find import MOST_EACH, Finder

    jobs = _scene_jobs(options) if options.is_data_set else [_own_job(options)]
    config = None if options.depth_mm is None else DetectionConfig(depth_mm=options.depth_mm)
    finders = {
        model.part.name: Finder(model, config)
        for model in {m.part.name: m for j in jobs for m in j.models.values()}.values()
    }
    top = options.top or (MOST_EACH if options.each else _TOP)
    tiles = list[np.ndarray]()
    writer: ResultsWriter | None = None
    with ExitStack() as at_the_end, console.Progress() as progress:
        for job in jobs:
            found = dict.fromkeys(job.models, 0)
            frames = 0
            for number, frame in enumerate(job.frames):
                interrupt.check()
                progress(f"scene {job.scene_id}", number, job.count)
                if isinstance(frame, UnreadableFrame):
                    progress.close()
                    console.warn(f"image {frame.index}: {frame.reason}: left out")
                    continue
                frames += 1
                drawn: list[tuple[PreparedPart, tuple[Detection, ...]]] = []
                rows = list[ResultRow]()
                for object_id, model in job.models.items():
                    begin = time.perf_counter()
                    finder = finders[model.part.name]
                    detections = finder.find_each(frame, top) if options.each else finder.find(frame, top)
                    time_s = time.perf_counter() - begin
                    rows += [
                        ResultRow(job.scene_id, frame.index, object_id, one.score, one.cam_T_obj, time_s)
                        for one in detections
                    ]
                    accepted = sum(one.is_accepted for one in detections)
                    found[object_id] += accepted if options.each else min(accepted, 1)
                    drawn.append((model, _likely(detections) if options.each else detections))
                if writer is None:  # older results stay until there are others
                    writer = at_the_end.enter_context(ResultsWriter(options.out))
                for row in rows:
                    writer.append(row)
                if len(tiles) < _PICTURES:
                    tiles.append(_tile(frame, drawn, f"scene {job.scene_id}, image {frame.index}"))
            progress.close()
            for object_id, count in found.items():
                name = job.models[object_id].part.name
                what = f"{count} found in {frames} frames" if options.each else f"found in {count} of {frames} frames"
                print(f"scene {job.scene_id}, object {object_id} ({name}): {what}")
    if writer is None:
        raise SequenceError(f"{options.source}: none of its images can be read: check them")
    print(f"{options.out}: written")
    if tiles:
        write_whole(options.picture, _mosaic(tiles), "the picture")
        print(f"{options.picture}: written")


def _likely(detections: tuple[Detection, ...]) -> tuple[Detection, ...]:
    """Those that are not unlikely, or else the best."""
    return tuple(one for one in detections if one.score >= _DRAWN_EACH) or detections[:1]


def _scene_jobs(options: DetectOptions) -> list[DetectJob]:
    from acp_lab.sequences.bop import BopDataset

    dataset, shelf = BopDataset(options.source), PartShelf(options.parts)
    ids = dict.fromkeys(options.scenes or dataset.scenes(options.split))
    jobs = []
    for scene_id in ids:
        scene = dataset.open_scene(scene_id, options.split, asked=())  # of the truth, ids alone
        models = {
            object_id: shelf.part(dataset.part_path(object_id)) for object_id in _objects(dataset, scene, options)
        }
        count = len(scene.frame_ids[:: options.step])
        jobs.append(DetectJob(scene_id, _every(scene, options.step), count, models))
    return jobs


def _objects(dataset: BopDataset, scene: BopScene, options: DetectOptions) -> list[int]:
    """The ids that a scene's truth names, no more of it; without truth those whose part is prepared."""
    from acp_lab.prepared_part import check_holds_parts

    if named := scene.objects_in(scene.frame_ids):
        return list(named)
    prepared = [i for i in dataset.models() if (options.parts / dataset.part_path(i).stem / "part.json").is_file()]
    if not prepared:
        check_holds_parts(options.parts)
        raise PreparationError(
            f"{options.parts}: holds none of the parts of {options.source}; "
            f"run: acp-lab prepare {quoted(options.source / 'models')}/*.ply --out {quoted(options.parts)}"
        )
    return prepared


def _every(scene: BopScene, step: int) -> Iterator[Frame | UnreadableFrame]:
    for frame_id in scene.frame_ids[::step]:
        yield scene.frame(frame_id)


def _own_job(options: DetectOptions) -> DetectJob:
    """One's own image, or every so manyth one of a video or a folder."""
    from acp_lab.geometry.camera import Camera
    from acp_lab.sequences.image_file import IMAGE_SUFFIXES
    from acp_lab.sequences.images import open_images

    assert options.camera is not None
    camera = Camera.from_json(options.camera)
    if options.source.is_file() and options.source.suffix.lower() in IMAGE_SUFFIXES:
        return DetectJob(1, [_image(options.source, camera)], 1, {1: _own_part(options)})
    images = open_images(options.source, camera)
    some = islice(images.frames(), 0, None, options.step)
    return DetectJob(1, some, len(images.frame_ids[:: options.step]), {1: _own_part(options)})


def _image(path: Path, camera: Camera) -> Frame:
    from acp_lab.geometry.camera import Undistorter
    from acp_lab.sequences.image_file import read_rgb
    from acp_lab.sequences.pixel_coding import PixelCoding

    try:
        image = Undistorter(camera)(read_rgb(path, PixelCoding.beside(path.parent)))
    except GeometryError as error:
        raise InputFileError(f"{path}: {error}") from None
    return Frame(0, image, camera.pinhole())


def _own_part(options: DetectOptions) -> PreparedPart:
    """That of the mesh, or the only one there."""
    from acp_lab.prepared_part import PreparedPart, check_holds_parts

    if options.mesh is not None:
        return PartShelf(options.parts).part(options.mesh)
    folders = sorted(path.parent for path in options.parts.glob("*/part.json"))
    if not folders:
        check_holds_parts(options.parts)
        raise PreparationError(
            f"{options.parts}: holds no prepared part; run: acp-lab prepare MESH --out {quoted(options.parts)}"
        )
    if len(folders) != 1:
        names = ", ".join(folder.name for folder in folders)
        raise AcpLabError(f"{options.parts}: holds {names}: say with --mesh which part the images show")
    return PreparedPart.load(folders[0])


def _tile(frame: Frame, drawn: list[tuple[PreparedPart, tuple[Detection, ...]]], title: str) -> ByteImage:
    """(h, w, 3): the frame with the edges of all hypotheses, the best one on top, and their scores."""
    scale = _PICTURE_WIDTH / frame.image.shape[1]
    size = (_PICTURE_WIDTH, max(1, round(frame.image.shape[0] * scale)))
    picture = frame.image.copy()
    words = [title]
    for model, detections in drawn:
        for rank in reversed(range(len(detections))):
            one = detections[rank]
            _draw(picture, frame, model, one, _ACCEPTED if one.is_accepted else _OTHERS[min(rank, len(_OTHERS) - 1)])
        scores = ", ".join(f"{one.score:.2f}" for one in detections) or "not found"
        words.append(f"{model.part.name}: {scores}")
    picture = cv2.resize(picture, size, interpolation=cv2.INTER_AREA).astype(np.uint8, copy=False)
    for line, text in enumerate(words):
        font, at = cv2.FONT_HERSHEY_SIMPLEX, (8, 20 + 20 * line)
        (width, height), below = cv2.getTextSize(text, font, 0.5, 1)
        # On a plate: wider strokes set letters further apart, so that an outline would not fit its text.
        cv2.rectangle(picture, (at[0] - 2, at[1] - height - 2), (at[0] + width + 2, at[1] + below), (0, 0, 0), -1)
        cv2.putText(picture, text, at, font, 0.5, (255, 255, 255), 1, cv2.LINE_AA)
    return picture


def _draw(picture: ByteImage, frame: Frame, model: PreparedPart, one: Detection, colour: tuple[int, int, int]) -> None:
    from acp_lab.control_points.canonical_frame import eye_position
    from acp_lab.control_points.view_regions import choose_region
    from acp_lab.generator.base import project_samples

    generator, part = model.best_generator(), model.part
    region = choose_region(eye_position(one.cam_T_obj) - part.box_centre, 0.5 * part.box_size)
    visible = generator.visible(one.cam_T_obj, region, len(generator.edges))
    edges = project_samples(generator.edges, visible, one.cam_T_obj, frame.camera)
    picture[edges.image(frame.camera.width, frame.camera.height) > 0] = colour


def _mosaic(tiles: list[np.ndarray]) -> bytes:
    """PNG bytes of tiles side by side, at most four in a row."""
    columns = min(4, len(tiles))
    high = max(tile.shape[0] for tile in tiles)
    padded = [cv2.copyMakeBorder(tile, 0, high - tile.shape[0], 0, 0, cv2.BORDER_CONSTANT) for tile in tiles]
    while len(padded) % columns:
        padded.append(np.zeros_like(padded[0]))
    rows = [np.hstack(padded[i : i + columns]) for i in range(0, len(padded), columns)]
    return cv2.imencode(".png", np.vstack(rows)[..., ::-1])[1].tobytes()
