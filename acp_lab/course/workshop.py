"""The sample made ready for the notebooks: opened once, prepared once, shared by all of them.

Prepared parts, replays and results of the course lie in one folder: `course_files` where Jupyter was started, or
the one that the environment variable ACP_LAB_COURSE names. Deleting it costs nothing but time.
"""

from __future__ import annotations

import os
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from acp_lab.errors import AcpLabError, InputFileError
from acp_lab.sample import sample_dataset
from acp_lab.sequences import open_sequence
from acp_lab.sequences.bop import BopScene

if TYPE_CHECKING:
    from acp_lab.cad.part import Part
    from acp_lab.prepared_part import PreparedPart

FOLDER_VARIABLE = "ACP_LAB_COURSE"
FOLDER_NAME = "course_files"
SAMPLE_OBJECT = 1
SAMPLE_REGION = 4
"""Of the six view regions, the one in which the whole sample sequence is seen."""


def start() -> None:
    """What every notebook begins with: one look for all pictures, one thread, errors of the package in one line.

    The networks here are so small that threads wait for each other longer than they work.
    """
    import cv2
    from IPython import get_ipython

    from acp_lab.display.look import use_look

    os.environ.setdefault("OMP_NUM_THREADS", "1")  # torch reads it when it is imported
    cv2.setNumThreads(1)
    use_look()
    shell = get_ipython()
    if shell is not None:
        shell.set_custom_exc((AcpLabError,), _show_in_one_line)


def _show_in_one_line(
    shell: Any, kind: type[AcpLabError], error: AcpLabError, trace: Any, tb_offset: int | None = None
) -> list[str]:
    """IPython's handler for errors that say themselves what to do; the cell has failed all the same."""
    lines = [f"{kind.__name__}: {error}"]
    error._render_traceback_ = lambda: lines  # type: ignore[attr-defined]
    shell.showtraceback((kind, error, trace))
    return lines


def files_folder() -> Path:
    """The folder for what the course makes; made when it is missing, and kept out of git by a file of its own.

    Raises InputFileError when it cannot be made.
    """
    folder = Path(os.environ.get(FOLDER_VARIABLE) or FOLDER_NAME).absolute()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        ignore = folder / ".gitignore"
        if not ignore.exists():
            ignore.write_text("*\n", encoding="utf-8")
    except OSError as error:
        raise InputFileError(
            f"{folder}: not writable ({error.strerror}): set {FOLDER_VARIABLE} to a folder of yours"
        ) from None
    return folder


@cache
def sample_scene() -> BopScene:
    """The sample sequence: 40 frames of a milled bracket, with exact truth."""
    return open_sequence(sample_dataset())


@cache
def sample_part() -> Part:
    """The bracket's CAD model."""
    return sample_scene().dataset.part(SAMPLE_OBJECT)


def sample_model(quick: bool = True, generator: str = "both", regions: tuple[int, ...] | None = None) -> PreparedPart:
    """The bracket, prepared; the first call of all takes its time, later ones read what is there.

    quick: short training (about 15 s in all) instead of the full one (about 40 s); they are kept apart.
    generator, regions: as in `acp_lab.PrepareOptions`; each generator is added to what is there. The autoencoder takes
    longest: ask for (SAMPLE_REGION,) alone.
    """
    from acp_lab.preparation import prepare
    from acp_lab.prepared_part import PrepareOptions

    out = files_folder() / ("parts_quick" if quick else "parts")
    progress = _Progress()
    options = PrepareOptions(generator=generator, fast=quick, regions=regions)
    model = prepare(sample_part(), options, out=out, progress=progress.show)
    progress.close()
    return model


class _Progress:
    """One line that is written over, as long as there is something to wait for."""

    def __init__(self) -> None:
        self._shown = ""

    def show(self, stage: str, done: int, total: int) -> None:
        line = f"preparing, {stage}: {20 * (5 * done // max(total, 1))}%"
        if line != self._shown:
            print(f"\r{line:<70}", end="", flush=True)
            self._shown = line

    def close(self) -> None:
        if self._shown:
            print(f"\r{'prepared, and kept for the next notebook':<70}", flush=True)
