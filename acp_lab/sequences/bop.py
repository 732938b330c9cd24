"""Data sets in the BOP layout, and their scenes as sequences.

    models/obj_000001.ply (mm), models/models_info.json
    test/000001/rgb/000000.png|jpg, scene_camera.json, scene_gt.json

Convention: the first frame is the lowest id in rgb/; ids may have gaps. Images are free of distortion, and
the intrinsics may differ from one to the next. The layout does not tell the image size: it is that of the
first image. Sets without colour have gray/ instead of rgb/.
Source of the format: BOP toolkit, docs/bop_datasets_format.md.
"""

from __future__ import annotations

import os
from collections.abc import Collection, Iterable, Iterator
from functools import cached_property
from pathlib import Path

from acp_lab.cad.models_info import PartInfo, read_models_info
from acp_lab.cad.part import Part
from acp_lab.errors import GeometryError, InputFileError, SequenceError
from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.camera import Camera, check_plausible
from acp_lab.input_file import path_of, read_json_object
from acp_lab.sequences.frame import Frame, UnreadableFrame
from acp_lab.sequences.image_file import IMAGE_SUFFIXES, read_first, read_rgb
from acp_lab.sequences.json_file import numbers
from acp_lab.sequences.pixel_coding import PixelCoding
from acp_lab.sequences.protocol import at_most, only_pose
from acp_lab.sequences.scene_truth import SceneTruth, as_id

_CAMERA_MEND = 'it gives per image {"cam_K": [fx, 0, cx, 0, fy, cy, 0, 0, 1]}'
_OTHER_STARTS = "give start poses (track --init results.csv), or have them found (--init auto)"
IMAGE_FOLDERS = ("rgb", "gray")


class BopDataset:
    """A folder in the BOP layout: CAD models and scenes. Files are read when they are asked for."""

    def __init__(self, root: str | Path) -> None:
        """Raises InputFileError when the folder does not exist."""
        self.root = Path(root)
        if self.root.is_file():
            raise InputFileError(
                f"{self.root}: is a file, no data set: a video is tracked with --video FILE and --camera"
            )
        if not self.root.is_dir():
            raise InputFileError(f"{self.root}: no such folder: give a data set in the BOP layout")

    @property
    def name(self) -> str:
        """The name of the folder."""
        return _absolute(self.root).name

    def models(self) -> tuple[int, ...]:
        """Object ids that have a mesh, rising."""
        names = [path.stem for path in (self.root / "models").glob("obj_*.ply")]
        return tuple(sorted(int(name[4:]) for name in names if _is_id(name[4:])))

    def part_path(self, object_id: int) -> Path:
        """The mesh of an object; SequenceError naming the objects that have one when there is none."""
        path = self.root / "models" / f"obj_{object_id:06d}.ply"
        if not path.is_file():
            raise SequenceError(f"{path}: no such model: the data set has {_listed('object', self.models())}")
        return path

    def part_info(self, object_id: int) -> PartInfo:
        """Diameter, box and symmetries of an object; InputFileError or SequenceError when they are not
        told."""
        infos = self._infos
        if object_id not in infos:
            path = self.root / "models" / "models_info.json"
            raise SequenceError(f"{path}: no object {object_id}: it has {_listed('object', tuple(infos))}")
        return infos[object_id]

    def part(self, object_id: int) -> Part:
        """The part of an object, from its mesh and what models_info.json says about it."""
        path = self.part_path(object_id)
        return Part.from_file(path, self.part_info(object_id))

    def scenes(self, split: str = "test") -> tuple[int, ...]:
        """Scene ids of a split, rising; InputFileError when the split does not exist or has none."""
        return tuple(sorted(self._scene_folders(split)))

    def scene_folder(self, scene_id: int, split: str = "test") -> Path:
        """The folder of a scene; SequenceError naming the scenes when there is no such scene."""
        plain = self.root / split / f"{scene_id:06d}"
        if plain.is_dir():  # BOP's own name wins, and among thousands of scenes nobody else need be looked at
            return plain
        folders = self._scene_folders(split)
        if scene_id not in folders:
            raise SequenceError(
                f"{self.root / split}: no scene {scene_id}: it has {_listed('scene', tuple(sorted(folders)))}"
            )
        return folders[scene_id]

    def open_scene(self, scene_id: int, split: str = "test", asked: Collection[int] | None = None) -> BopScene:
        """A scene as a sequence; asked, and errors, as in `BopScene`."""
        return BopScene(self.scene_folder(scene_id, split), asked=asked)

    @cached_property
    def _infos(self) -> dict[int, PartInfo]:
        return read_models_info(self.root / "models" / "models_info.json")

    def _scene_folders(self, split: str) -> dict[int, Path]:
        root = self.root / split
        if not root.is_dir():
            raise InputFileError(
                f"{root}: no such folder: it should hold scenes, such as {root / '000001'}; a plain folder of images "
                "goes with --video DIR and --camera"
            )
        # Sorted, so that of two names for one id (000001 and 1) BOP's own wins.
        folders = {int(path.name): path for path in sorted(root.iterdir(), reverse=True) if _is_scene(path)}
        if not folders:
            raise InputFileError(f"{root}: holds no scene: scenes are folders such as {root / '000001'}")
        return folders


class BopScene:
    """One scene of a data set, as a `Sequence`.

    folder: as it was given; its name is the scene id. frame_ids: the ids of the images, rising.
    image_paths: by image id. ground_truth: what scene_gt.json tells, None without that file.
    Reads everything but the images when it is opened, and of the images the first, for its size.
    Raises InputFileError for files that are missing or malformed, a first image that cannot be read, and
    intrinsics that do not fit the image; SequenceError for a scene without images or with two instances of
    one object that is asked for. A scene without scene_gt.json opens: only asking for its first poses fails.
    """

    def __init__(
        self, folder: str | Path, truth: SceneTruth | None = None, asked: Collection[int] | None = None
    ) -> None:
        """truth: instead of scene_gt.json, as that of one of several instances (`scene_truth.instance_truths`).

        asked: objects whose true poses will be asked for, None for all; see `SceneTruth.from_file`.
        """
        self.folder = Path(folder)
        self.scene_id = _scene_id(self.folder)
        self.image_paths = image_files(self.folder)
        self.frame_ids: tuple[int, ...] = tuple(self.image_paths)
        self.ground_truth = truth
        if truth is None and (self.folder / "scene_gt.json").exists():
            self.ground_truth = SceneTruth.from_file(self.folder / "scene_gt.json", asked)
        first_path = self.image_paths[self.frame_ids[0]]
        first, self._coding = read_first(first_path, PixelCoding.beside(first_path.parent))
        height, width = first.shape[:2]
        self._cameras = _read_cameras(self.folder / "scene_camera.json", self.frame_ids, width, height)

    @property
    def name(self) -> str:
        """Data set, split and scene: "metal_public/test/000001"."""
        return "/".join(_absolute(self.folder).parts[-3:])

    @property
    def dataset(self) -> BopDataset:
        """The data set that the scene stands in, two folders up."""
        return BopDataset(_absolute(self.folder).parent.parent)

    @property
    def split(self) -> str:
        """The folder of scenes that it stands in, such as "test"."""
        return _absolute(self.folder).parent.name

    @property
    def object_ids(self) -> tuple[int, ...]:
        """Ids of the objects of the first frame, rising; empty without truth there."""
        return self.objects_in(self.frame_ids[:1])

    def objects_in(self, frame_ids: Iterable[int]) -> tuple[int, ...]:
        """Ids of the objects that the truth of any of these images names, rising; empty without truth."""
        truth = self.ground_truth
        return () if truth is None else tuple(sorted({i for frame_id in frame_ids for i in truth.in_frame(frame_id)}))

    def camera(self, frame_id: int) -> Camera:
        """The camera of an image; SequenceError when there is no such image."""
        self._check_frame(frame_id)
        return self._cameras[frame_id]

    def frame(self, frame_id: int) -> Frame | UnreadableFrame:
        """Read one image; SequenceError when the scene has no such id."""
        self._check_frame(frame_id)
        camera = self._cameras[frame_id]
        path = self.image_paths[frame_id]
        try:
            image = read_rgb(path, self._coding)
        except InputFileError as error:
            return UnreadableFrame(frame_id, camera, str(error))
        if image.shape[:2] != (camera.height, camera.width):
            return UnreadableFrame(
                frame_id,
                camera,
                f"{path}: image is {image.shape[1]} x {image.shape[0]} px but the first one of the scene is "
                f"{camera.width} x {camera.height}: all images of a scene must have one size",
            )
        return Frame(frame_id, image, camera)

    def frames(self, max_frames: int | None = None) -> Iterator[Frame | UnreadableFrame]:
        """The frames, ids rising, read one at a time; at most max_frames of them."""
        return at_most((self.frame(frame_id) for frame_id in self.frame_ids), max_frames)

    def truth(self, frame_id: int, object_id: int) -> FloatArray | None:
        """The true cam_T_obj (4, 4), mm; None when scene_gt.json does not tell it."""
        return None if self.ground_truth is None else self.ground_truth.pose(frame_id, object_id)

    @property
    def first_poses(self) -> dict[int, FloatArray]:
        """True cam_T_obj (4, 4) by object id in the first frame, never from a later one; SequenceError
        without."""
        path = self.folder / "scene_gt.json"
        if self.ground_truth is None:
            raise SequenceError(f"{path}: no such file, so no true start pose: add it, or {_OTHER_STARTS}")
        poses = self.ground_truth.in_frame(self.frame_ids[0])
        if not poses:
            raise SequenceError(f"{path}: no pose for the first image, {self.frame_ids[0]}: add it, or {_OTHER_STARTS}")
        return poses

    @property
    def first_pose(self) -> FloatArray:
        """The true cam_T_obj (4, 4) of the only object of the first frame; SequenceError for several or
        none."""
        return only_pose(self.name, self.first_poses)

    def _check_frame(self, frame_id: int) -> None:
        if frame_id not in self.image_paths:
            first, last = self.frame_ids[0], self.frame_ids[-1]
            raise SequenceError(
                f"{self.folder}: no image {frame_id}: it has {len(self.frame_ids)}, ids {first} to {last}"
            )


def open_sequence(path: str | Path) -> BopScene:
    """Open a scene folder (…/test/000001), or a data set that holds a single scene in test/.

    Raises InputFileError when there is neither, SequenceError when the data set has several scenes.

    Example:
        >>> from acp_lab.sample import sample_dataset
        >>> scene = open_sequence(sample_dataset())
        >>> len(scene.frame_ids), scene.frame(0).image.shape, scene.first_pose.shape
        (40, (512, 640, 3), (4, 4))
    """
    path = path_of(path, "a scene", "data/test/000001")
    if path.is_file():
        raise InputFileError(f"{path}: a file needs its camera: use open_images(path, Camera.from_json('CAMERA.json'))")
    if not path.is_dir():
        raise InputFileError(f"{path}: no such folder: give a scene folder such as dataset/test/000001")
    if any((path / inside).exists() for inside in ("scene_camera.json", "scene_gt.json", *IMAGE_FOLDERS)):
        return BopScene(path)
    if not (path / "test").is_dir():
        raise InputFileError(
            f"{path}: neither a scene (rgb/ and scene_camera.json) nor a data set (test/000001): "
            "give a scene folder; a plain folder of images opens with ImageFolder(path, camera)"
        )
    dataset = BopDataset(path)
    scenes = dataset.scenes()
    if len(scenes) > 1:
        first = dataset.scene_folder(scenes[0])
        raise SequenceError(f"{path}: has {_listed('scene', scenes)}: open one, as {first}")
    return dataset.open_scene(scenes[0])


def image_files(folder: Path) -> dict[int, Path]:
    """The images of a scene folder by image id, ids rising: rgb/, or gray/ when there is no rgb/.

    Raises InputFileError without such a folder or for two files of one id, SequenceError when it is empty.
    """
    if not folder.is_dir():
        raise InputFileError(f"{folder}: no such folder: give a scene folder such as dataset/test/000001")
    found = [folder / name for name in IMAGE_FOLDERS if (folder / name).is_dir()]
    if not found:
        raise InputFileError(f"{folder / 'rgb'}: no such folder: it holds the images, 000000.png or .jpg")
    paths: dict[int, Path] = {}
    for path in sorted(found[0].iterdir()):
        if path.suffix.lower() not in IMAGE_SUFFIXES or not _is_id(path.stem):
            continue
        other = paths.setdefault(int(path.stem), path)
        if other != path:
            raise InputFileError(f"{path}: image {int(path.stem)} has another file, {other.name}: remove one")
    if not paths:
        raise SequenceError(f"{found[0]}: holds no images: name them by their ids, 000000.png or .jpg")
    return dict(sorted(paths.items()))


def _read_cameras(path: Path, frame_ids: tuple[int, ...], width: int, height: int) -> dict[int, Camera]:
    content = read_json_object(path, _CAMERA_MEND)
    entries = {as_id(key, f"{path}: the image id"): entry for key, entry in content.items()}
    cameras = {}
    for frame_id in frame_ids:
        where = f"{path}: image {frame_id}"
        entry = entries.get(frame_id)
        if not isinstance(entry, dict) or "cam_K" not in entry:
            raise InputFileError(f"{where} has no cam_K: {_CAMERA_MEND}")
        matrix = numbers(entry["cam_K"], 9, f"{where}: cam_K").reshape(3, 3)
        try:
            camera = Camera.from_matrix(matrix, width, height)
        except GeometryError as error:
            raise InputFileError(f"{where}: {error}") from None
        check_plausible(camera, where)
        # The cheapest proof that the intrinsics belong to images of another size, crop or orientation.
        if not (0 <= camera.cx <= width - 1 and 0 <= camera.cy <= height - 1):
            raise InputFileError(
                f"{where}: intrinsics do not fit the image: principal point ({camera.cx:g}, {camera.cy:g}) "
                f"lies outside {width} x {height} px: give cam_K for this image size"
            )
        cameras[frame_id] = camera
    return cameras


def _absolute(path: Path) -> Path:
    # Not resolve(): a link keeps the name that it has in the data set.
    return Path(os.path.abspath(path))


def _scene_id(folder: Path) -> int:
    name = _absolute(folder).name
    if not _is_id(name):
        raise InputFileError(f"{folder}: a scene folder is named by its id: rename it as 000001")
    return int(name)


def _is_scene(path: Path) -> bool:
    return _is_id(path.name) and path.is_dir()


def _is_id(text: str) -> bool:
    return text.isascii() and text.isdigit()


def _listed(what: str, ids: tuple[int, ...]) -> str:
    if not ids:
        return f"no {what}"
    shown = ", ".join(str(i) for i in sorted(ids)[:12]) + (", …" if len(ids) > 12 else "")
    return f"{what}{'s' if len(ids) > 1 else ''} {shown}"
