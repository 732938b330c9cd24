"""A run's poses in a results.csv, row by row while it goes on: `observers=[acp.ResultsFile("results.csv")]`.

In the BOP format of `sequences.results_csv`, which `acp-lab eval` and the tools of that field read.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from acp_lab.input_file import path_of
from acp_lab.sequences.frame import Frame, UnreadableFrame
from acp_lab.sequences.results_csv import KeptRows, ResultRow, ResultsWriter, check_results_place
from acp_lab.tracking.observer import SessionInfo
from acp_lab.tracking.result import TrackResult


class ResultsFile:
    """Observer that writes a row per frame and object as soon as it is known; a run that is cut off leaves its rows.

    path: the CSV file. It is replaced when the first frame has been tracked, not before: a start pose may turn out
    to be wrong. run_info: for `results.run.json` beside it, any mapping that JSON can hold; None leaves no such file.
    kept: rows of an older run's file that stay before the new ones (`results_csv.rows_with_ends`).
    Raises InputFileError when the file cannot be written, holds something else, or another program is writing it.
    """

    def __init__(
        self, path: str | Path, run_info: Mapping[str, Any] | None = None, kept: KeptRows | None = None
    ) -> None:
        self.path = path_of(path, "a results file", "results.csv")
        check_results_place(self.path)  # before a frame is tracked for it
        self._run_info, self._kept = run_info, kept
        self._writer: ResultsWriter | None = None
        self._scene_id = 0

    def on_start(self, session: SessionInfo) -> None:
        """Take down whose results they are."""
        self._scene_id = session.scene_id

    def on_frame(self, frame: Frame | UnreadableFrame, results: Mapping[int, TrackResult]) -> None:
        """Write the frame's rows; the first one opens the file."""
        if self._writer is None:
            self._writer = ResultsWriter(self.path, self._run_info, self._kept)
        for object_id, result in sorted(results.items()):
            pose, time_s = result.cam_T_obj, result.timings.total_s
            self._writer.append(ResultRow(self._scene_id, result.frame_id, object_id, result.quality, pose, time_s))

    def on_end(self) -> None:
        """Close the file."""
        if self._writer is not None:
            self._writer.close()
            self._writer = None
