"""Replays read back with rerun's own reader, row by row."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rerun.chunk import Chunk, RrdReader


@dataclass(frozen=True)
class Row:
    """A value of a component and when it was logged; None on timelines that the row is not on, or when static."""

    frame: int | None
    time_s: float | None
    step: int | None
    value: Any


class Recording:
    """What an .rrd file holds, by entity and component ("Scalars:scalars" goes by "scalars")."""

    def __init__(self, chunks: Iterable[Chunk]) -> None:
        self.rows: dict[str, dict[str, list[Row]]] = defaultdict(lambda: defaultdict(list))
        for chunk in chunks:
            batch = chunk.to_record_batch()
            times: dict[str, list[Any]] = {name: [None] * batch.num_rows for name in ("frame", "time", "step")}
            for name in chunk.timeline_names:
                # Durations as whole nanoseconds: as Python values they would need pandas.
                times[name] = batch.column(name).cast("int64").to_pylist()
            for name in batch.schema.names:
                if ":" not in name:
                    continue
                for row, value in enumerate(batch.column(name).to_pylist()):
                    if value is not None:
                        nanoseconds = times["time"][row]
                        time_s = None if nanoseconds is None else 1e-9 * nanoseconds
                        when = (times["frame"][row], time_s, times["step"][row])
                        self.rows[str(chunk.entity_path)][name.split(":")[-1]].append(Row(*when, value))
        for of_entity in self.rows.values():
            for rows in of_entity.values():
                rows.sort(key=lambda row: (row.step is not None, row.step or 0))

    @staticmethod
    def read(path: Path) -> Recording:
        return Recording(RrdReader(path).stream().to_chunks())

    @property
    def entities(self) -> set[str]:
        return set(self.rows)

    def of(self, entity: str, component: str) -> list[Row]:
        """All rows of a component, static ones first."""
        return self.rows[entity][component]

    def on_frames(self, entity: str, component: str) -> list[Row]:
        """Those that are on the timeline `frame`."""
        return [row for row in self.of(entity, component) if row.frame is not None]

    def on_steps_only(self, entity: str, component: str) -> list[Row]:
        """Those that are on the timeline `step` alone."""
        return [row for row in self.of(entity, component) if row.frame is None and row.step is not None]
