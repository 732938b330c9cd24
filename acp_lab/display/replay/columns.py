"""Rows for a recording, gathered for a few frames and sent together.

A single `log` costs the tracking thread 60 to 400 microseconds, whatever it says, and a frame has some twenty
entities. Sent as columns of ten frames they cost a quarter of that. A run that is killed loses those frames.

For each message that was sent, rerun keeps an entry of its file's index in memory, so a long run sends more frames
together: a tenth of those that it has, up to a hundred.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from acp_lab.display.replay.clock import Moment

if TYPE_CHECKING:
    import pyarrow as pa
    from rerun import RecordingStream, TimeColumn

FEWEST_TOGETHER, MOST_TOGETHER = 10, 100


def frames_together(frames: int) -> int:
    """How many frames to send together in a run that has had so many; a run that is killed loses no more of them."""
    return min(max(FEWEST_TOGETHER, frames // 10), MOST_TOGETHER)


@dataclass
class _Rows:
    """Rows of one entity and archetype: when, how many instances each has, and their fields."""

    moments: list[Moment] = field(default_factory=list)
    lengths: list[int] = field(default_factory=list)
    values: dict[str, list[Any]] = field(default_factory=dict)


class ColumnBuffer:
    """Logs below `root` ("" or a name that ends in a slash), at the moment of the last `at`.

    sent: frames whose rows were handed to the recording.
    """

    def __init__(self, recording: RecordingStream, root: str = "") -> None:
        self.root = root
        self._recording = recording
        self._rows: dict[tuple[str, type], _Rows] = {}
        self._moment = Moment(0, 0.0, 0)
        self.sent = self._waiting = 0

    def at(self, moment: Moment) -> None:
        """What is logged from now on happens at this moment."""
        self._moment = moment
        moment.set_on(self._recording)

    def style(self, entity: str, *what: Any) -> None:
        """Log what holds for ever and on every timeline, such as colours; the entity "" is the root itself."""
        self._recording.log((self.root + entity).rstrip("/") or "/", *what, static=True)

    def now(self, entity: str, *what: Any) -> None:
        """Log something rare, at once."""
        self._recording.log(self.root + entity, *what)

    def row(self, entity: str, archetype: type, **fields: Any) -> None:
        """Log a row, soon.

        archetype: of rerun, such as rr.Points2D. fields: per component, a sequence with one value per instance;
        all of one length. Without instances the row says that there is nothing any more.
        """
        rows = self._rows.setdefault((entity, archetype), _Rows())
        rows.moments.append(self._moment)
        rows.lengths.append(len(next(iter(fields.values()))))
        for name, values in fields.items():
            rows.values.setdefault(name, []).append(values)

    def end_frame(self) -> None:
        """Send everything after every few frames."""
        self._waiting += 1
        if self._waiting >= frames_together(self._moment.frame):
            self.flush()

    def flush(self) -> None:
        """Send what was gathered."""
        when: dict[tuple[Moment, ...], list[TimeColumn]] = {}
        for (entity, archetype), rows in self._rows.items():
            moments = tuple(rows.moments)
            if moments not in when:  # nearly all entities have a row in every frame
                when[moments] = time_columns(moments)
            joined = {name: _joined(values) for name, values in rows.values.items()}
            columns = archetype.columns(**joined).partition(rows.lengths)  # type: ignore[attr-defined]
            self._recording.send_columns(self.root + entity, when[moments], columns)
        self._rows.clear()
        self.sent += self._waiting
        self._waiting = 0

    def on_steps(self, entity: str, steps: range, columns: Any) -> None:
        """Log columns of a frame's iterations on the timeline `step` alone: on `frame` only the result counts."""
        import rerun as rr

        self._recording.send_columns(self.root + entity, [rr.TimeColumn("step", sequence=steps)], columns)


def time_columns(moments: tuple[Moment, ...]) -> list[TimeColumn]:
    """The moments on all three timelines."""
    import rerun as rr

    return [
        rr.TimeColumn("frame", sequence=[moment.frame for moment in moments]),
        rr.TimeColumn("time", duration=[moment.time_s for moment in moments]),
        rr.TimeColumn("step", sequence=[moment.step for moment in moments]),
    ]


def _joined(values: list[Any]) -> Any:
    """The instances of all rows, one after the other."""
    if not isinstance(values[0], np.ndarray):
        return [value for of_row in values for value in of_row]
    joined = np.concatenate(values)
    return _strips(joined) if joined.ndim == 3 and joined.shape[1:] == (2, 2) else joined


def _strips(strips: np.ndarray) -> pa.Array:
    """Strokes (n, 2, 2) as rerun stores them; its own way there is a loop over all of them."""
    import pyarrow as pa
    import rerun as rr

    wanted = rr.components.LineStrip2DBatch([]).as_arrow_array().type
    points = pa.FixedSizeListArray.from_arrays(pa.array(strips.reshape(-1)), type=wanted.value_type)
    return pa.ListArray.from_arrays(np.arange(0, 2 * len(strips) + 1, 2, dtype=np.int32), points, type=wanted)
