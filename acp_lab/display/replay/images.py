"""The images of a replay, encoded beside the tracking thread.

JPEG encoding takes longer than anything else in a replay, and OpenCV does it without holding up Python, so a
second thread does it. An image that came from a JPEG file of reasonable size is handed on as it is.

Ctrl-C may come at any line, also inside `queue.Queue` and `threading.Event`, which are Python: a lock that stays taken
there, or somebody who is not woken, is waited for for ever. `queue.SimpleQueue` is C, where no key gets in.
"""

from __future__ import annotations

import queue
import threading
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import cv2

from acp_lab.display.replay.clock import Moment
from acp_lab.display.replay.columns import frames_together, time_columns
from acp_lab.geometry.arrays import ByteImage
from acp_lab.sequences.image_header import is_turned

if TYPE_CHECKING:
    from rerun import RecordingStream

JPEG_QUALITY = 85
LOWEST_QUALITY = 45
MOST_BYTES_PER_PIXEL = 0.18
"""100 images of 640 x 512 px then stay below 6 MB, but for the noisiest."""
MOST_WAITING = 8
"""Images; a tracker that is faster than the encoder waits for it, rather than fill the memory."""
WAIT_S = 0.001
"""Between two looks whether there is room again."""
MOST_BYTES_TOGETHER = 4_000_000
"""Of encoded images that are sent together; see `columns.frames_together`."""


@dataclass(frozen=True, eq=False)
class _Job:
    moment: Moment
    entity: str
    content: bytes | ByteImage
    opacity: float | None


class ImageWriter:
    """Logs images, (h, w, 3) uint8 RGB, to a recording from a thread of its own.

    sent_bytes: of the images that were handed to the recording.
    """

    def __init__(self, recording: RecordingStream) -> None:
        self.sent_bytes = 0
        self._encoded_bytes = self._encoded = self._taken = 0
        self._recording = recording
        self._jobs = queue.SimpleQueue[_Job | queue.SimpleQueue[None] | None]()
        self._gathered: dict[tuple[str, float | None], list[tuple[Moment, bytes]]] = {}
        self._failure: Exception | None = None
        self._thread = threading.Thread(target=self._work, name="replay images", daemon=True)
        self._thread.start()

    def put(
        self, moment: Moment, entity: str, image: ByteImage, source: Path | None = None, opacity: float | None = None
    ) -> None:
        """Log an image at a moment, soon. source: the file that it was decoded from, where there is one.

        The array may be written anew at once: another image of the sequence may come in it.
        """
        if self._failure is None:
            content = _small_jpeg(source, image) or image.copy()
            self._taken += 1
            while self._jobs.qsize() >= MOST_WAITING:
                time.sleep(WAIT_S)
            self._jobs.put(_Job(moment, entity, content, opacity))

    @property
    def expected_bytes(self) -> float:
        """Of all images so far; those that wait are taken to be like the others."""
        return self._encoded_bytes * self._taken / max(1, self._encoded)

    def flush(self) -> None:
        """Hand everything to the recording."""
        done = queue.SimpleQueue[None]()
        self._jobs.put(done)
        done.get()

    def close(self) -> None:
        """Wait until everything is logged; raises what went wrong in the thread."""
        self._jobs.put(None)
        self._thread.join()
        if self._failure is not None:
            raise self._failure

    def _work(self) -> None:
        is_open = True
        while is_open:
            job = self._jobs.get()
            is_open = job is not None
            try:
                if self._failure is not None:
                    continue  # keep taking jobs, so that nobody waits for room
                if isinstance(job, _Job):
                    self._gather(job)
                else:
                    self._send()
            except Exception as error:
                self._failure = error
            finally:
                if isinstance(job, queue.SimpleQueue):
                    job.put(None)

    def _gather(self, job: _Job) -> None:
        jpeg = job.content if isinstance(job.content, bytes) else encode_jpeg(job.content)
        self._encoded_bytes += len(jpeg)
        self._encoded += 1
        gathered = self._gathered.setdefault((job.entity, job.opacity), [])
        gathered.append((job.moment, jpeg))
        is_much = self._encoded_bytes - self.sent_bytes > MOST_BYTES_TOGETHER
        if is_much or len(gathered) >= frames_together(job.moment.frame):
            self._send()

    def _send(self) -> None:
        import rerun as rr

        self.sent_bytes = self._encoded_bytes
        for (entity, opacity), gathered in self._gathered.items():
            moments, jpegs = zip(*gathered, strict=True)
            columns = rr.EncodedImage.columns(
                blob=jpegs,
                media_type=["image/jpeg"] * len(jpegs),
                opacity=None if opacity is None else [opacity] * len(jpegs),
            )
            self._recording.send_columns(entity, time_columns(moments), columns)
        self._gathered.clear()


def encode_jpeg(image: ByteImage) -> bytes:
    """An image (h, w, 3) RGB as JPEG, of lower quality where it would exceed `MOST_BYTES_PER_PIXEL`."""
    bgr = cv2.cvtColor(image, cv2.COLOR_RGB2BGR)
    most = MOST_BYTES_PER_PIXEL * image.shape[0] * image.shape[1]
    quality = JPEG_QUALITY
    while True:
        _, jpeg = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, quality])
        if len(jpeg) <= most or quality <= LOWEST_QUALITY:
            return jpeg.tobytes()
        quality -= 10


def _small_jpeg(source: Path | None, image: ByteImage) -> bytes | None:
    """The bytes of a JPEG file that is small enough and shown as it is stored; None for any other file."""
    if source is None or source.suffix.lower() not in (".jpg", ".jpeg"):
        return None
    try:
        if source.stat().st_size > MOST_BYTES_PER_PIXEL * image.shape[0] * image.shape[1]:
            return None
        content = source.read_bytes()
    except OSError:  # gone by now; the decoded image is still here
        return None
    return None if is_turned(content) else content  # viewers would turn it below overlays that are not
