"""A replay as a film that every browser plays: the frames with what was tracked drawn over them (H.264, MP4).

Below the image stand, per object, its state, the quality, ADD(-S) where truth is known, and the curve of the quality
over the whole film with a mark for now. Two replays run beside each other.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass
from difflib import SequenceMatcher
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING

import cv2
import numpy as np
from numpy.typing import NDArray

from acp_lab.display.colours import to_bytes
from acp_lab.display.replay.curves import STATE_COLOURS
from acp_lab.display.replay.file import ReplayContent
from acp_lab.display.replay.frames import ShownFrame, ShownObject, fps_of, shown_frames
from acp_lab.display.replay.log import BRIGHT_COLOURS
from acp_lab.errors import AcpLabError, InputFileError
from acp_lab.files import replacing
from acp_lab.geometry.arrays import ByteImage
from acp_lab.tracking.result import TrackState

if TYPE_CHECKING:
    from PIL import ImageDraw

Progress = Callable[[str, int, int], None]

PANEL_WIDTH = 1024
"""Smaller images are enlarged to about this, so that lines and words are smooth."""
ROW_HEIGHT = 52
FONT_SIZE = 22
WORDS_AT = 150
LEAST_CURVE = 90
CRF = 21  # H.264's constant quality: 18 is visually lossless, 23 is libx264's own choice
BACKGROUND = (24, 26, 31)
TEXT = (232, 232, 232)
FAINT = (120, 124, 132)
_MADE_BY = "acp-lab replay"
_SHIFT = 4  # fractional bits of cv2's coordinates


@dataclass(frozen=True)
class _Panel:
    """One replay in the film: its frames, the names of its objects, and the size that all its pictures have."""

    frames: list[ShownFrame]
    names: tuple[str, ...]
    title: str
    width: int
    height: int


@dataclass(frozen=True)
class _Place:
    """Where an image of (h, w) px is in a panel's picture, which another scene's images may not fill."""

    scale: float
    left: int
    top: int

    @classmethod
    def of(cls, image: ByteImage, panel: _Panel) -> _Place:
        """In the middle, as large as it fits."""
        height, width = image.shape[:2]
        scale = min(panel.width / width, panel.height / height)
        return cls(scale, round(panel.width - scale * width) // 2, round(panel.height - scale * height) // 2)


def write_film(contents: Sequence[ReplayContent], path: Path, progress: Progress | None = None) -> int:
    """Write one or two replays as an MP4 file, whole or not at all; the number of frames.

    Raises AcpLabError without PyAV, InputFileError for a replay without images, for a place that cannot be written and
    for one that holds a video which is no such film.
    """
    try:
        import av
    except ImportError:
        raise AcpLabError(f"{path}: films need PyAV: pip install av") from None
    _check_replaces_film(path)
    panels = [_panel(content, "AB"[order] if len(contents) > 1 else "") for order, content in enumerate(contents)]
    numbers = in_step([[(frame.scene, frame.image_id) for frame in panel.frames] for panel in panels])
    options = {"movflags": "+faststart"}
    with replacing(path, "the film") as part, av.open(str(part), "w", format="mp4", options=options) as film:
        film.metadata["comment"] = _MADE_BY
        rate = Fraction(fps_of(panels[0].frames)).limit_denominator(1000)
        stream = film.add_stream("libx264", rate=rate, options={"crf": str(CRF), "preset": "veryfast"})
        stream.pix_fmt = "yuv420p"
        for done, of_panels in enumerate(numbers, 1):
            picture = _even(_joined([_drawn(panel, number) for panel, number in zip(panels, of_panels, strict=True)]))
            if done == 1:
                stream.height, stream.width = picture.shape[:2]
            film.mux(stream.encode(av.VideoFrame.from_ndarray(picture, format="rgb24")))
            if progress is not None:
                progress("film", done, len(numbers))
        film.mux(stream.encode(None))
    return len(numbers)


def in_step(images: Sequence[Sequence[Hashable]]) -> list[tuple[int, ...]]:
    """Which frame of each of one or two films is shown when; images: what each of their frames shows, such as ids.

    The same images stand beside each other; where one film lacks some, as that of a run which went on behind another
    does, it waits: in its last frame before, or in its first.
    """
    first, *others = images
    if not others:
        return [(number,) for number in range(len(first))]
    (second,) = others
    shown: list[tuple[int, ...]] = []
    for _, begin_1, end_1, begin_2, end_2 in SequenceMatcher(None, first, second, autojunk=False).get_opcodes():
        for step in range(max(end_1 - begin_1, end_2 - begin_2)):
            shown.append((max(min(begin_1 + step, end_1 - 1), 0), max(min(begin_2 + step, end_2 - 1), 0)))
    return shown


def _check_replaces_film(path: Path) -> None:
    """Refuse to replace a video that was not made here, such as the one that was tracked."""
    import av

    if not path.is_file() or not path.stat().st_size:
        return
    try:
        with av.open(str(path)) as video:
            comment = video.metadata.get("comment", "")
    except av.FFmpegError:
        comment = ""
    if comment != _MADE_BY:
        raise InputFileError(f"{path}: the film would replace a file that is not one of a replay: choose another name")


def _panel(content: ReplayContent, title: str) -> _Panel:
    frames = shown_frames(content)
    first = next((frame.jpeg for frame in frames if frame.jpeg is not None), None)
    if first is None:
        raise InputFileError(f"{content.file.path}: holds no image: no film can be made of it")
    height, width = _decode(first).shape[:2]
    scale = max(1.0, round(2 * PANEL_WIDTH / width) / 2)
    return _Panel(frames, content.objects, title, round(scale * width), round(scale * height))


def _drawn(panel: _Panel, number: int) -> ByteImage:
    """Frame `number` of a panel, with its captions below."""
    frame = panel.frames[number]
    picture, place = _ground(panel, number)
    for order, name in enumerate(panel.names):
        if name in frame.objects:
            _draw_object(picture, frame.objects[name], BRIGHT_COLOURS[order % len(BRIGHT_COLOURS)], place)
    return np.vstack([picture, _captions(panel, number)])


def _ground(panel: _Panel, number: int) -> tuple[ByteImage, _Place]:
    """The image of a frame; of one that could not be read the image before it, darker; plain where none was kept."""
    frame = panel.frames[number]
    jpeg = next(f.jpeg for f in [*reversed(panel.frames[: number + 1]), *panel.frames] if f.jpeg is not None)
    image = _decode(jpeg)
    place = _Place.of(image, panel)
    picture = np.full((panel.height, panel.width, 3), BACKGROUND, np.uint8)
    if not frame.is_left_out:
        size = (round(place.scale * image.shape[1]), round(place.scale * image.shape[0]))
        large = cv2.resize(image, size, interpolation=cv2.INTER_CUBIC)
        shown = large if frame.jpeg is not None else large // 3
        picture[place.top : place.top + size[1], place.left : place.left + size[0]] = shown
    return picture, place


def _draw_object(picture: ByteImage, shown: ShownObject, colour: tuple[float, ...], place: _Place) -> None:
    strokes = _fixed(shown.strokes, place)
    rgb = shown.colours.tolist()
    # A dark rim keeps light strokes legible on bright metal.
    cv2.polylines(picture, list(strokes), False, (20, 20, 20), 4, cv2.LINE_AA, _SHIFT)
    for stroke, of_stroke in zip(strokes, rgb, strict=True):
        cv2.polylines(picture, [stroke], False, of_stroke, 2, cv2.LINE_AA, _SHIFT)
    if shown.quad is not None and np.isfinite(shown.quad).all() and np.abs(shown.quad).max() < 1e5:
        own = to_bytes(colour).tolist()
        quad = _fixed(shown.quad[None], place)[0]
        cv2.polylines(picture, [quad], True, own, 1, cv2.LINE_AA, _SHIFT)
        for corner in quad:
            cv2.circle(picture, corner.tolist(), 5 << _SHIFT, own, -1, cv2.LINE_AA, _SHIFT)


def _captions(panel: _Panel, number: int) -> ByteImage:
    """One row per object: state, words, curve."""
    from PIL import Image, ImageDraw, ImageFont

    canvas = Image.new("RGB", (panel.width, ROW_HEIGHT * len(panel.names)), BACKGROUND)
    draw, font = ImageDraw.Draw(canvas), ImageFont.load_default(FONT_SIZE)
    frame = panel.frames[number]
    for row, name in enumerate(panel.names):
        shown = frame.objects.get(name, ShownObject())
        top, middle = row * ROW_HEIGHT, row * ROW_HEIGHT + ROW_HEIGHT // 2
        state = next((state for state in TrackState if state == shown.state), None)
        chip = to_bytes(STATE_COLOURS[state]).tolist() if state else list(FAINT)
        draw.rounded_rectangle((12, top + 10, 132, top + ROW_HEIGHT - 10), 6, fill=tuple(chip))
        draw.text((72, middle), shown.state or "-", (255, 255, 255), font, anchor="mm")
        missing = ": not in the replay" if frame.is_left_out else ": unreadable" if frame.jpeg is None else ""
        words = [f"image {frame.image_id}{missing}"]
        if len(panel.names) > 1:
            words.insert(0, name)
        if panel.title:
            words.insert(0, panel.title)
        if math.isfinite(shown.quality):
            words.append(f"quality {shown.quality:.2f}")
        if math.isfinite(shown.add_percent):
            words.append(f"ADD(-S) {shown.add_percent:.1f} %")
        said = "     ".join(words)
        draw.text((WORDS_AT, middle), said, TEXT, font, anchor="lm")
        left = max(0.68 * panel.width, WORDS_AT + draw.textlength(said, font) + 20.0)
        if panel.width - left > LEAST_CURVE:
            _draw_curve(draw, panel, name, number, round(left), top)
    return np.asarray(canvas)


def _draw_curve(draw: ImageDraw.ImageDraw, panel: _Panel, name: str, number: int, left: int, top: int) -> None:
    """The quality over the whole film, from 0 at the bottom to 1 at the top, from `left` to the right border."""
    values = [frame.objects[name].quality if name in frame.objects else math.nan for frame in panel.frames]
    right = panel.width - 14
    low, high = top + ROW_HEIGHT - 9, top + 9
    across = np.linspace(left, right, max(len(values), 2))
    draw.line((left, low, right, low), FAINT)
    points = [(x, low + (high - low) * v) for x, v in zip(across, values, strict=False) if math.isfinite(v)]
    if len(points) > 1:
        draw.line(points, FAINT, 2)
        draw.line(points[: max(2, sum(math.isfinite(v) for v in values[: number + 1]))], TEXT, 2)
    draw.line((across[number], high, across[number], low), TEXT)


def _fixed(points: NDArray[np.float32], place: _Place) -> NDArray[np.int32]:
    """Points (n, k, 2) in rerun's pixels of an image as cv2's fixed-point coordinates on the panel's picture."""
    clipped = np.clip(points.astype(np.float64) * place.scale + (place.left - 0.5, place.top - 0.5), -1e4, 1e4)
    return np.round(clipped * (1 << _SHIFT)).astype(np.int32)


def _decode(jpeg: bytes) -> ByteImage:
    as_stored = cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION  # as what is drawn over it
    bgr = np.asarray(cv2.imdecode(np.frombuffer(jpeg, np.uint8), as_stored), np.uint8)
    return np.asarray(cv2.cvtColor(bgr, cv2.COLOR_BGR2RGB), np.uint8)


def _joined(pictures: Sequence[ByteImage]) -> ByteImage:
    """Pictures beside each other, the lower ones filled up."""
    height = max(picture.shape[0] for picture in pictures)
    filled = []
    for picture in pictures:
        rest = np.full((height - picture.shape[0], picture.shape[1], 3), BACKGROUND, np.uint8)
        filled.append(np.vstack([picture, rest]))
    return np.hstack(filled)


def _even(picture: ByteImage) -> ByteImage:
    """Cut to even sides, which yuv420p needs."""
    return np.ascontiguousarray(picture[: picture.shape[0] // 2 * 2, : picture.shape[1] // 2 * 2])
