"""Where a pose comes from that somebody aligned, and what is said of that when it is saved."""

from __future__ import annotations

from enum import Enum


class Origin(Enum):
    """The value: plain, bold and plain words that follow where the pose was saved."""

    HAND = (", ", "but not snapped", ": that of your hand alone")
    DETECTOR = (", ", "but not snapped", ": as the detector found it")
    SNAP = ("", "", "")
    FAILED_SNAP = (", ", "but snap did not find the part", ": look whether the edges sit")
    READ = (", ", "but not snapped", ": as it was read")
    READ_AS_FOUND = (", as it was read", "", "")

    @property
    def is_found(self) -> bool:
        """Whether the pose was found in the image, see `Tracker.start`."""
        return self in (Origin.DETECTOR, Origin.SNAP, Origin.READ_AS_FOUND)
