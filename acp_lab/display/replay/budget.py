"""How large a replay may become: images are dropped before data, and data before the limit is passed.

Images are most of a replay. They stop when, after one more, the file would not have room for the data of all frames to
come; where nobody knows yet how many come, or how much their data take, when half the room is taken.
"""

from __future__ import annotations

from dataclasses import dataclass

from acp_lab.display.replay.columns import frames_together

USED_AT_MOST = 0.95
"""Share of the limit that is filled: the index at the file's end takes the rest."""
_UNKNOWN_SHARE = 0.5
_SLACK = 1.1
"""Frames to come may hold more edges than those before."""


@dataclass
class SizeBudget:
    """most_bytes: of the file. images_end, data_end: the frame of the replay in which images, and all else, stop."""

    most_bytes: float = float("inf")
    images_end: int | None = None
    data_end: int | None = None
    _fixed_bytes: float | None = None

    def spend(self, frame: int, sent: int, data_bytes: float, image_bytes: float, frames_left: int | None) -> None:
        """Take in what the file holds before `frame`.

        Args:
            sent: frames whose data are among the data_bytes; those of the others wait to be sent together.
            image_bytes: of all images so far, sent or not.
            frames_left: to come, None where nobody knows.
        """
        if self._fixed_bytes is None:
            self._fixed_bytes = data_bytes  # meshes and colours, once
        per_frame = (data_bytes - self._fixed_bytes) / sent if sent else 0.0
        free = USED_AT_MOST * self.most_bytes - data_bytes - image_bytes - per_frame * (frame - sent)
        left = frames_together(frame) if frames_left is None else frames_left
        is_known = frames_left is not None and sent > 0
        needed = _SLACK * per_frame * left if is_known else _UNKNOWN_SHARE * self.most_bytes
        if self.images_end is None and free - image_bytes / max(frame, 1) < needed:
            self.images_end = frame
        if self.data_end is None and free < per_frame * min(frames_together(frame), left):
            self.data_end = frame

    @property
    def told(self) -> str:
        """One line: what the replay lacks; empty where nothing."""
        limit = f"to stay below {self.most_bytes / 1e6:g} MB"
        if self.data_end is not None:
            return f"ends before frame {self.data_end}, its images before frame {self.images_end}, {limit}"
        if self.images_end is not None:
            return f"has no images from frame {self.images_end} on, {limit}"
        return ""
