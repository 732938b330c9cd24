"""Videos whose frames come at times of one's own choice, as those of phones do, or lie at known places in the file."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from pathlib import Path

import av
import numpy as np

from tests.sequences.tiny_dataset import HEIGHT, WIDTH

_MILLISECOND = Fraction(1, 1000)


def timed_video(path: Path, times_ms: Sequence[int], images: Sequence[np.ndarray] = ()) -> Path:
    """Write images, (h, w, 3) RGB, or noise of the tiny data set's size; the header of a cut MP4 file can be read."""
    if not images:
        images = np.random.default_rng(0).integers(0, 256, (len(times_ms), HEIGHT, WIDTH, 3), dtype=np.uint8)
    options = {"movflags": "+faststart"} if path.suffix == ".mp4" else {}
    with av.open(str(path), "w", options=options) as film:
        stream = film.add_stream("mpeg4", rate=30)
        stream.height, stream.width = images[0].shape[:2]
        stream.pix_fmt, stream.time_base, stream.codec_context.time_base = "yuv420p", _MILLISECOND, _MILLISECOND
        for image, time_ms in zip(images, times_ms, strict=True):
            frame = av.VideoFrame.from_ndarray(image, format="rgb24")
            frame.pts, frame.time_base = time_ms, _MILLISECOND
            film.mux(stream.encode(frame))
        film.mux(stream.encode(None))
    return path


def coded_video(path: Path, codec: str, count: int) -> tuple[Path, list[tuple[int, int]]]:
    """Write noise of the tiny data set's size; the file, and place and number of bytes of each frame, in order."""
    images = np.random.default_rng(0).integers(0, 256, (count, HEIGHT, WIDTH, 3), dtype=np.uint8)
    with av.open(str(path), "w") as film:
        stream = film.add_stream(codec, rate=30)
        stream.height, stream.width = HEIGHT, WIDTH
        stream.pix_fmt = "yuvj420p" if codec == "mjpeg" else "yuv420p"
        for image in images:
            film.mux(stream.encode(av.VideoFrame.from_ndarray(image, format="rgb24")))
        film.mux(stream.encode(None))
    with av.open(str(path)) as film:
        return path, [(packet.pos, packet.size) for packet in film.demux(video=0) if packet.pos is not None]
