"""Files as a reader of notebook 10 would bring them, made from the sample: a mesh, pictures of a board, a video.

They are as awkward as real ones: the mesh is an STL file in metres, and the video was taken through a lens that
distorts. The camera that took them is known here, so that a calibration can be held against it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from fractions import Fraction
from pathlib import Path

import cv2
import numpy as np

from acp_lab.course.made_boards import board_views, camera_rays
from acp_lab.course.workshop import sample_part, sample_scene
from acp_lab.files import replacing, write_whole
from acp_lab.geometry.camera import Camera
from acp_lab.sequences.calibration import Chessboard
from acp_lab.sequences.frame import Frame

BOARD = Chessboard(9, 6, 25.0)
LENS = (-0.16, 0.09, 0.0006, -0.0004, 0.0)
"""k1, k2, p1, p2, k3: 10 px near the corners of the picture."""
BOARD_COUNT = 14
_FPS = 30
_CRF = "16"  # H.264's constant quality: a good camera's


@dataclass(frozen=True)
class StandIns:
    """Paths: mesh, an STL file in metres; boards, a folder of PNG files; video, an MP4 file. camera: that took them."""

    mesh: Path
    boards: Path
    video: Path
    camera: Camera


def stand_ins(folder: str | Path) -> StandIns:
    """Make the files in a folder; those that are there already are taken as they are.

    Raises InputFileError when the a file cannot be written.
    """
    folder = Path(folder)
    made = StandIns(folder / "bracket.stl", folder / "boards", folder / "clip.mp4", stand_in_camera())
    if not made.mesh.exists():
        _write_mesh(made.mesh)
    names = [made.boards / f"board_{number:02d}.png" for number in range(BOARD_COUNT)]
    if not all(name.exists() for name in names):
        for name, image in zip(names, board_views(BOARD, made.camera, BOARD_COUNT), strict=True):
            write_whole(name, cv2.imencode(".png", image)[1].tobytes())
    if not made.video.exists():
        _write_video(made.video, made.camera)
    return made


def stand_in_camera() -> Camera:
    """The camera that took boards and video: the sample's, behind a lens."""
    return replace(sample_scene().camera(0), dist=LENS)


def _write_mesh(path: Path) -> None:
    import trimesh

    part = sample_part()
    mesh = trimesh.Trimesh(0.001 * part.vertices, part.faces, process=False)
    write_whole(path, trimesh.exchange.stl.export_stl(mesh))


def _write_video(path: Path, camera: Camera) -> None:
    """The sample's frames as the lens would have shown them."""
    import av

    rays = camera_rays(camera)[..., :2]
    seen_at = (rays * (camera.fx, camera.fy) + (camera.cx, camera.cy)).astype(np.float32)
    with replacing(path, "the video") as part, av.open(str(part), "w", format="mp4") as film:
        stream = film.add_stream("libx264", rate=Fraction(_FPS), options={"crf": _CRF, "preset": "veryfast"})
        stream.width, stream.height, stream.pix_fmt = camera.width, camera.height, "yuv420p"
        for frame in sample_scene().frames():
            if isinstance(frame, Frame):
                bent = cv2.remap(
                    frame.image, seen_at[..., 0], seen_at[..., 1], cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE
                )
                film.mux(stream.encode(av.VideoFrame.from_ndarray(np.asarray(bent, np.uint8), format="rgb24")))
        film.mux(stream.encode(None))
