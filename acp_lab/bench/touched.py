"""What the files of a run look like from outside, so that a run is kept only as long as nobody touched its data.

Names, sizes and times of the last change of images, cameras, truths, models and what is told of them: a folder of
thousands of images is looked through in a moment, as none is read. What escapes it is a file that was changed without
changing its size, and whose time was set back.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from pathlib import Path

from acp_lab.sequences.bop import BopDataset, image_files
from acp_lab.sequences.pixel_coding import FILE_NAME

_SCENE_FILES = ("scene_camera.json", "scene_gt.json", "scene_meta.json")


def scene_look(dataset: BopDataset, scene_id: int, split: str) -> str:
    """Changes with the images, what their pixels mean, cameras, truth and kind of a scene.

    Raises InputFileError or SequenceError where there is no such scene, or it has no images.
    """
    folder = dataset.scene_folder(scene_id, split)
    images = list(image_files(folder).values())
    return _look([*images, images[0].parent / FILE_NAME, *(folder / name for name in _SCENE_FILES)])


def model_look(dataset: BopDataset, object_id: int) -> str:
    """Changes with the mesh of an object and with what models_info.json tells; SequenceError where it has none."""
    return _look([dataset.part_path(object_id), dataset.root / "models" / "models_info.json"])


def _look(paths: Iterable[Path]) -> str:
    seen = hashlib.sha256()
    for path in paths:
        try:
            told = path.stat()
        except OSError:  # one that is not there is told by who reads it
            size_and_time = (-1, -1)
        else:
            size_and_time = (told.st_size, told.st_mtime_ns)
        seen.update(f"{path.name}\0{size_and_time}\0".encode(errors="surrogateescape"))
    return seen.hexdigest()
