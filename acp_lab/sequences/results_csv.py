"""Results in the BOP format: one line per frame and object, which every tool of that field reads.

    scene_id,im_id,obj_id,score,R,t,time

Convention: R is nine numbers row by row, t three in mm, both separated by spaces, together cam_T_obj; score
is the quality in [0, 1]; time is wall seconds from the decoded frame to the pose, negative when unknown.
Source of the format: BOP challenge, "Format of results". Numbers are written so that they read back exactly.
"""

from __future__ import annotations

import csv
from collections.abc import Collection, Iterable, Mapping, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from io import SEEK_END, FileIO
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np

from acp_lab.errors import GeometryError, InputFileError, SequenceError, TrackingError
from acp_lab.files import check_replaces_own, remove_leftovers, staged
from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.pose import check_rotation, make_pose
from acp_lab.input_file import LARGEST_NUMBER, check_regular, read_bytes
from acp_lab.locks import only_writer
from acp_lab.sequences.json_file import json_bytes, shown, write_json

HEADER = ("scene_id", "im_id", "obj_id", "score", "R", "t", "time")
HEADER_START = b"scene_id,im_id,"
"""What every results file begins with."""


@dataclass(frozen=True, eq=False)
class ResultRow:
    """The pose of one object in one image: cam_T_obj (4, 4) mm, score in [0, 1], time_s < 0 when unknown."""

    scene_id: int
    im_id: int
    obj_id: int
    score: float
    cam_T_obj: FloatArray
    time_s: float = -1.0

    @property
    def key(self) -> tuple[int, int, int]:
        """(scene_id, im_id, obj_id): one row each."""
        return self.scene_id, self.im_id, self.obj_id


@dataclass(frozen=True)
class KeptRows:
    """What stays of an older results file: its first `end` bytes, of `length` when that was decided."""

    end: int
    length: int


def check_results_place(path: Path, writer: str = "the results") -> None:
    """InputFileError where a results file, or its `results.run.json`, would replace what is none; writer: who asks."""
    check_replaces_own(path, HEADER_START, writer, "results")
    check_replaces_own(run_info_path(path), b"{", writer, "run information")


class ResultsWriter:
    """Writes a results file row by row, so that an interrupted run leaves what it had.

    `with ResultsWriter("results.csv", run_info) as results: results.append(row)`. Both files are replaced
    when the writer is made: the CSV by its header alone, or by the rows that are `kept`, to go on behind them;
    `results.run.json` beside it by run_info (any mapping that JSON can hold: configuration, versions, machine).
    Where there is no room for the latter, the old results stay. Folders on the way are made. Until it is closed, no
    other writer may have the file.

    Raises InputFileError when a file cannot be written, holds something else, another program is writing it, or has
    written it since it was decided what is kept.
    """

    def __init__(
        self, path: str | Path, run_info: Mapping[str, Any] | None = None, kept: KeptRows | None = None
    ) -> None:
        self.path = Path(path)
        check_results_place(self.path)
        with ExitStack() as on_failure:
            on_failure.enter_context(only_writer(self.path, "these results"))
            remove_leftovers(run_info_path(self.path))
            told = {} if run_info is None else {run_info_path(self.path): json_bytes(run_info)}
            with staged(told):
                self._file = self._open(kept)
                on_failure.callback(self._file.close)
                if kept is None:
                    self._write(",".join(HEADER))
            if run_info is None:
                # Of an older run; it would describe rows that are gone.
                with suppress(FileNotFoundError):
                    run_info_path(self.path).unlink()
            self._at_the_end = on_failure.pop_all()

    def _open(self, kept: KeptRows | None) -> FileIO:
        try:
            file = FileIO(self.path, "w" if kept is None else "r+")
            if kept is not None and file.seek(0, SEEK_END) != kept.length:
                file.close()
                raise InputFileError(f"{self.path}: another run has written it in the meantime: look, and start again")
            self._whole_bytes = file.seek(0 if kept is None else kept.end)
            file.truncate()
        except OSError as error:
            raise self._failure(error) from None
        return file

    def append(self, row: ResultRow) -> None:
        """Write one row and hand it to the operating system; TrackingError for numbers that are no result."""
        numbers = (row.score, row.time_s, *row.cam_T_obj[:3].ravel())
        if not all(abs(number) <= LARGEST_NUMBER for number in numbers) or not 0.0 <= row.score <= 1.0:
            raise TrackingError(
                f"scene {row.scene_id}, image {row.im_id}, object {row.obj_id}: score {row.score} must be in "
                f"[0, 1], pose and time finite and within {LARGEST_NUMBER:g}: report this"
            )
        rotation = " ".join(repr(float(value)) for value in row.cam_T_obj[:3, :3].ravel())
        translation = " ".join(repr(float(value)) for value in row.cam_T_obj[:3, 3])
        score, time_s = repr(float(row.score)), repr(float(row.time_s))
        self._write(f"{row.scene_id},{row.im_id},{row.obj_id},{score},{rotation},{translation},{time_s}")

    def write_run_info(self, run_info: Mapping[str, Any]) -> None:
        """Replace `results.run.json`, whole or not at all; for what is known only at the end."""
        write_json(run_info_path(self.path), run_info)

    def close(self) -> None:
        """Close the file and let others write it; a second call does nothing."""
        self._at_the_end.close()

    def __enter__(self) -> ResultsWriter:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _write(self, line: str) -> None:
        left = memoryview(line.encode() + b"\n")
        try:
            while left:
                left = left[self._file.write(left) :]
            self._whole_bytes = self._file.tell()
        except OSError as error:
            with suppress(OSError):
                self._file.truncate(self._whole_bytes)  # no half line, where the disk was full
            raise self._failure(error) from None

    def _failure(self, error: OSError) -> InputFileError:
        return InputFileError(f"{self.path}: cannot be written ({error.strerror}): choose another place")


def run_info_path(results_path: Path) -> Path:
    """`results.run.json` of `results.csv`: where the configuration of a run stands.

    Of names with another suffix, or none, the whole is kept: `run.v1` and `run.v2` are two runs.
    """
    kept = results_path.stem if results_path.suffix.lower() == ".csv" else results_path.name
    return results_path.with_name(f"{kept}.run.json")


def read_results(path: str | Path) -> tuple[ResultRow, ...]:
    """Read a results file; rotations come back orthonormal.

    Raises InputFileError, one line naming file, line, value and fix, for a file that is missing or malformed
    and for a second row of the same scene, image and object.
    """
    rows: list[ResultRow] = []
    first_line: dict[tuple[int, int, int], int] = {}
    for line, row in _read_lines(Path(path)):
        if row.key in first_line:
            raise InputFileError(
                f"{path}: line {line}: scene {row.scene_id}, image {row.im_id}, object {row.obj_id} stands in line "
                f"{first_line[row.key]} already: keep one row"
            )
        first_line[row.key] = line
        rows.append(row)
    return tuple(rows)


def _read_lines(path: Path) -> list[tuple[int, ResultRow]]:
    """All rows with the numbers of their lines."""
    try:
        check_regular(path, "give a results CSV file")
        with path.open(encoding="utf-8-sig", newline="") as file:
            return _read_rows(path, file)
    except FileNotFoundError:
        raise InputFileError(f"{path}: no such results file: check the path, or run acp-lab track") from None
    except OSError as error:
        raise InputFileError(f"{path}: cannot be read ({error.strerror}): give a results CSV file") from None
    except (UnicodeDecodeError, csv.Error) as error:
        reason = str(error).splitlines()[0]
        raise InputFileError(f"{path}: no CSV text ({reason}): give {','.join(HEADER)}") from None


def rows_with_ends(path: Path) -> tuple[tuple[ResultRow, int], ...]:
    """The rows of a file that `ResultsWriter` wrote, perhaps cut off, each with the bytes of the file up to its end.

    A last line without its end is left out. Raises InputFileError as `read_results`.
    """
    content = read_bytes(path, "check the path, or run acp-lab track", "results file")
    content = content[: content.rfind(b"\n") + 1]
    rows: list[tuple[ResultRow, int]] = []
    end = 0
    for number, line in enumerate(content.splitlines(keepends=True), 1):
        end += len(line)
        text = line.decode("utf-8", errors="replace").strip()
        if number > 1:
            if line.strip(b"\r\n"):  # else an empty line, as in `read_results`
                rows.append((_row(next(csv.reader([text]), []), f"{path}: line {number}"), end))
        elif text != ",".join(HEADER):
            raise InputFileError(f"{path}: line 1 is {shown(text)}: it must be {','.join(HEADER)}")
    return tuple(rows)


def start_poses(path: str | Path, scene_id: int, frame_id: int) -> dict[int, FloatArray]:
    """cam_T_obj (4, 4) by object id that a results file (POSES.csv) tells for one image; see `start_rows`."""
    return {object_id: row.cam_T_obj for object_id, row in start_rows(path, scene_id, frame_id).items()}


def start_rows(path: str | Path, scene_id: int, frame_id: int) -> dict[int, ResultRow]:
    """By object id, rising, the row that a results file (POSES.csv) has for one image.

    A detector writes several poses of one object, such as `acp-lab detect` does; the one with the highest score counts,
    of equals the first. Raises InputFileError for a file that is missing or malformed, SequenceError when the image is
    not in the file.
    """
    rows = [row for _, row in _read_lines(Path(path)) if (row.scene_id, row.im_id) == (scene_id, frame_id)]
    if not rows:
        raise SequenceError(
            f"{path}: no row for scene {scene_id}, image {frame_id}: add the start poses of its objects"
        )
    best: dict[int, ResultRow] = {}
    for row in rows:
        if row.obj_id not in best or row.score > best[row.obj_id].score:
            best[row.obj_id] = row
    return dict(sorted(best.items()))


@dataclass(frozen=True)
class FirstStart:
    """frame_id: the earliest image with start poses. later: the objects that have some in later images only."""

    frame_id: int
    later: tuple[int, ...] = ()


def first_start(
    path: str | Path, scene_id: int, frame_ids: Sequence[int], objects: Collection[int] = ()
) -> FirstStart:
    """The earliest of a scene's images for which a results file (POSES.csv) tells start poses.

    objects: whose, empty for all. Raises InputFileError for a file that is missing or malformed, SequenceError when it
    tells none.
    """
    shown = set(frame_ids)
    told = {
        (row.im_id, row.obj_id)
        for _, row in _read_lines(Path(path))
        if row.scene_id == scene_id and row.im_id in shown and (not objects or row.obj_id in objects)
    }
    if not told:
        whose = f" and object {', '.join(map(str, objects))}" if objects else ""
        raise SequenceError(
            f"{path}: no row for an image of scene {scene_id}{whose}, the first image of which is {frame_ids[0]}: add "
            "the start poses of its objects"
        )
    first, _ = min(told)
    in_first = {object_id for frame_id, object_id in told if frame_id == first}
    return FirstStart(first, tuple(sorted({object_id for _, object_id in told} - in_first)))


def _read_rows(path: Path, lines: Iterable[str]) -> list[tuple[int, ResultRow]]:
    reader = csv.reader(lines)
    header = next(reader, None)
    if header is None:
        raise InputFileError(f"{path}: the file is empty: its first line must be {','.join(HEADER)}")
    if tuple(name.strip() for name in header) != HEADER:
        raise InputFileError(f"{path}: line 1 is {shown(','.join(header))}: it must be {','.join(HEADER)}")
    return [
        (reader.line_num, _row(fields, f"{path}: line {reader.line_num}"))
        for fields in reader
        if fields  # an empty line, as some editors leave at the end
    ]


def _row(fields: list[str], where: str) -> ResultRow:
    if len(fields) != len(HEADER):
        raise InputFileError(
            f"{where} has {len(fields)} fields, not {len(HEADER)}: write {','.join(HEADER)}, or remove it"
        )
    ids = [_id(text, f"{where}: {name}") for name, text in zip(HEADER[:3], fields[:3], strict=True)]
    score = float(_numbers(fields[3], 1, f"{where}: score")[0])
    matrix = _numbers(fields[4], 9, f"{where}: R").reshape(3, 3)
    translation = _numbers(fields[5], 3, f"{where}: t")
    time_s = float(_numbers(fields[6], 1, f"{where}: time")[0])
    try:
        rotation = check_rotation(matrix, f"{where}: R")
    except GeometryError as error:
        raise InputFileError(str(error)) from None
    return ResultRow(ids[0], ids[1], ids[2], score, make_pose(rotation, translation), time_s)


def _id(text: str, where: str) -> int:
    text = text.strip()
    if not (text.isascii() and text.isdigit() and len(text) < 19):
        raise InputFileError(f"{where} is {shown(text)}: give a whole number from 0")
    return int(text)


def _numbers(text: str, count: int, where: str) -> FloatArray:
    words = text.split()
    what = "a finite number" if count == 1 else f"{count} finite numbers separated by spaces"
    try:
        values = np.array([float(word) for word in words], dtype=np.float64)
    except ValueError:
        raise InputFileError(f"{where} is {shown(text)}: give {what}") from None
    if len(values) != count or not (np.abs(values) <= LARGEST_NUMBER).all():
        raise InputFileError(f"{where} is {shown(text)}: give {what}")
    return values
