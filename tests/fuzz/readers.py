"""Every reader of files from outside, with a small good file to begin with: bad ones must be refused, in one line."""

from __future__ import annotations

import json
import os
import tempfile
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import trimesh

from acp_lab.cad.models_info import read_models_info
from acp_lab.cad.part import Part
from acp_lab.commands.methods import chosen_method
from acp_lab.display.replay.file import check_replay
from acp_lab.errors import AcpLabError
from acp_lab.geometry.camera import Camera
from acp_lab.prepared_part import PreparedPart
from acp_lab.sequences.image_file import image_damage, read_rgb
from acp_lab.sequences.json_file import read_pose
from acp_lab.sequences.pixel_coding import PixelCoding
from acp_lab.sequences.results_csv import HEADER, read_results, rows_with_ends
from acp_lab.sequences.scene_truth import SceneTruth
from acp_lab.tracking.method import METHODS
from acp_lab.tracking.method_file import to_toml

_BOX = trimesh.creation.box((40.0, 30.0, 20.0))
_POSE = {"cam_R_m2c": [1, 0, 0, 0, 1, 0, 0, 0, 1], "cam_t_m2c": [0, 0, 400.5]}
_IMAGE = np.arange(24 * 32 * 3, dtype=np.uint8).reshape(24, 32, 3)
_SIZE = {"width": 640, "height": 480}
_OBJ = b"# b\nv 0 0 0\nv 9 0 0\nv 0 9 0\nv 0 0 9\nf 1/1 2/2 3/3\nf 1 2 4\n"
_UNTURNED = "1 0 0 0 1 0 0 0 1"
_ROWS = f"{','.join(HEADER)}\n1,2,3,0.5,{_UNTURNED},10 20 500,0.01\n1,3,3,1,{_UNTURNED},1e1 2 5,-1\n".encode()


@dataclass(frozen=True)
class Reader:
    """name: of the file; read: what is done with it; seeds: good contents."""

    name: str
    read: Callable[[Path], object]
    seeds: tuple[bytes, ...]


def _mesh(kind: str, **how: object) -> bytes:
    content = _BOX.export(file_type=kind, **how)
    return content.encode() if isinstance(content, str) else bytes(content)


def _json(values: object) -> bytes:
    return json.dumps(values).encode()


def _encoded(suffix: str) -> bytes:
    return bytes(cv2.imencode(suffix, _IMAGE)[1].tobytes())


def _image(path: Path) -> None:
    read_rgb(path)
    image_damage(path)


def _results(path: Path) -> None:
    rows_with_ends(path)
    read_results(path)


def _method(path: Path) -> None:
    chosen_method("acp", path)


READERS = (
    Reader("part.ply", Part.from_file, (_mesh("ply"), _mesh("ply", encoding="ascii"))),
    Reader(
        "part.obj", Part.from_file, (_mesh("obj"), b"# b\nv 0 0 0\nv 9 0 0\nv 0 9 0\nv 0 0 9\nf 1/1 2/2 3/3\nf 1 2 4\n")
    ),
    Reader("part.stl", Part.from_file, (_mesh("stl"), _mesh("stl_ascii"))),
    Reader(
        "models_info.json",
        read_models_info,
        (
            _json(
                {
                    "1": {
                        "diameter": 53.9,
                        **dict.fromkeys(("min_x", "min_y", "min_z"), -20.0),
                        **dict.fromkeys(("size_x", "size_y", "size_z"), 40),
                        "symmetries_discrete": [[1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]],
                        "symmetries_continuous": [{"axis": [0, 0, 1], "offset": [0, 0, 0]}],
                    }
                }
            ),
        ),
    ),
    Reader(
        "CAMERA.json",
        Camera.from_json,
        (
            _json(
                {"width": 640, "height": 480, "fx": 600, "fy": 600.5, "cx": 320, "cy": 240, "dist": [0.1, 0, 0, 0, 0]}
            ),
            _json({"width": 640, "height": 480, "hfov_deg": 50}),
        ),
    ),
    Reader("POSE.json", read_pose, (_json(_POSE),)),
    Reader("scene_gt.json", SceneTruth.from_file, (_json({"0": [{**_POSE, "obj_id": 1}], "7": []}),)),
    Reader("pixels.json", lambda path: PixelCoding.beside(path.parent), (_json({"bits": 12, "bayer": "rggb"}), b"{}")),
    Reader(
        "results.csv",
        _results,
        (
            (
                ",".join(HEADER)
                + "\n1,2,3,0.5,1 0 0 0 1 0 0 0 1,10 20 500,0.01\n1,3,3,1,1 0 0 0 1 0 0 0 1,1e1 2 5,-1\n"
            ).encode(),
        ),
    ),
    Reader("mine.toml", _method, tuple(to_toml(METHODS[name]).encode() for name in ("acp", "acp-paper"))),
    Reader("part.json", lambda path: PreparedPart.load(path.parent), (b'{"format": "acp_lab.part", "version": 2}',)),
    Reader("image.png", _image, (_encoded(".png"),)),
    Reader("image.jpg", _image, (_encoded(".jpg"),)),
    Reader("run.rrd", check_replay, (b"RRF2" + bytes(8) + bytes(16), b"RRF2" + bytes(40))),
)
BY_NAME = {reader.name: reader for reader in READERS}


def try_content(reader: Reader, content: bytes) -> None:
    """Read a file of that content; raises whatever is no error of ours, AssertionError for one of several lines."""
    with tempfile.TemporaryDirectory(prefix="fuzz_", dir=_memory()) as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        path = Path(folder) / reader.name
        path.write_bytes(content)
        try:
            reader.read(path)
        except AcpLabError as error:
            message = str(error)
            assert "\n" not in message.strip(), message
            assert len(message) < 2000, message[:200]


def _memory() -> str | None:
    return "/dev/shm" if os.path.isdir("/dev/shm") else None
