"""What options of the command line can be set to. Light: `acp-lab --help` imports it."""

from __future__ import annotations

from enum import StrEnum


class Unit(StrEnum):
    """The unit of a mesh file's numbers."""

    MM = "mm"
    CM = "cm"
    M = "m"
    INCH = "inch"


class EdgeSource(StrEnum):
    """Where `prepare --generator autoencoder` takes true edges from."""

    ANALYTIC = "analytic"
    NORMALS = "normals"


class PaintingFrame(StrEnum):
    """Where the auto-encoder's canonical frame stands: at the pose that it paints, or at a frame's predicted one."""

    POSE = "pose"
    PREDICTION = "prediction"


class Device(StrEnum):
    """Where the auto-encoder is trained."""

    AUTO = "auto"
    CPU = "cpu"
    CUDA = "cuda"


class Generator(StrEnum):
    """What `prepare` makes of t(I)."""

    TEMPLATES = "templates"
    LEARNED = "learned"
    BOTH = "both"
    AUTOENCODER = "autoencoder"


class Iterations(StrEnum):
    """Of which frames a replay shows each iteration: none, those that went badly, every one."""

    OFF = "off"
    FAILURES = "failures"
    ALL = "all"
