"""Errors that a user can fix.

Every message is one line that names the file or value at fault and says what to do about it;
the command line prints it after `error:` and exits with status 2.
"""

from __future__ import annotations

from pathlib import Path


class AcpLabError(Exception):
    """Base of all errors raised on purpose by this package."""


class InputFileError(AcpLabError):
    """A file is missing, empty, malformed or contradicts another one."""


class ParameterError(AcpLabError):
    """A setting that is beyond what makes sense."""


class GeometryError(AcpLabError):
    """Numbers that are no camera, pose or quad: singular, folded, not a rotation."""


class PartError(AcpLabError):
    """A CAD model that cannot be used: no faces, no edges, a suspicious unit."""


class PreparationError(AcpLabError):
    """A prepared part is missing, incomplete or belongs to another mesh."""


class PaintingFrameError(PreparationError):
    """A part's auto-encoder paints in another frame than a method needs: training it anew would lose it."""


class SequenceError(AcpLabError):
    """A sequence lacks what was asked of it: scene, object, truth, frames."""


class TrackingError(AcpLabError):
    """A tracker was asked for something it cannot do."""


def check_kind(value: object, kind: type, name: str, fix: str) -> None:
    """ParameterError, ending in `fix`, for an argument of another kind, such as the path of a file for what it holds.

    name: of the argument; fix: the call that makes the right object.
    """
    if not isinstance(value, kind):
        shown = f" {str(value)[:80]!r}" if isinstance(value, str | Path) else ""
        raise ParameterError(f"{name} is a {type(value).__name__}{shown}, no {kind.__name__}: give {fix}")
