"""All runs of a bench: those that are kept, and new ones through `workers`.

What is kept is kept: each run is written as soon as it is there, by the process that asked, and taken up again as long
as neither its method, its data, its prepared part nor the sources changed. A bench that is killed costs the runs in
hand.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

from acp_lab.bench import workers as door
from acp_lab.bench.protocol import Task
from acp_lab.bench.record import Run, read_run
from acp_lab.bench.runner import run_task
from acp_lab.errors import AcpLabError, InputFileError

Progress = Callable[[int, int], None]


def complete(
    tasks: list[Task], folder: Path, *, workers: int = 1, scheduler: str | None = None, progress: Progress | None = None
) -> list[Run]:
    """The runs of all tasks, in their order: those that the folder holds, and new ones.

    Args:
        folder: one file per run.
        workers: processes on this machine; scheduler: instead, the address of a dask scheduler such as
            "tcp://10.0.0.5:8786".
        progress: called with (runs done, runs in all).

    Raises:
        ParameterError: no scheduler answers at that address.
        AcpLabError: data or parts are missing; a file cannot be written.
    """
    paths = {task: folder / task.file_name for task in tasks}
    runs = {task: run for task, path in paths.items() if (run := _kept(task, path)) is not None}
    missing = [task for task in tasks if task not in runs]
    if progress is not None:
        progress(len(runs), len(tasks))
    if missing:
        for task, run in _new_runs(missing, workers, scheduler):
            run.write(paths[task])
            runs[task] = run
            if progress is not None:
                progress(len(runs), len(tasks))
    return [runs[task] for task in tasks]


def _kept(task: Task, path: Path) -> Run | None:
    try:
        kept = read_run(path)
    except InputFileError:  # of an older version, or torn by a machine that went down: done again
        return None
    return kept if kept is not None and kept.state == task.state else None


def _new_runs(tasks: list[Task], workers: int, scheduler: str | None) -> Iterator[tuple[Task, Run]]:
    by_name = {task.file_name: task for task in tasks}
    asked = {name: task.to_json() for name, task in by_name.items()}
    for name, answer in door.each(run_task, asked, workers=workers, scheduler=scheduler):
        run = Run.from_json(answer, name)
        if run.state != by_name[name].state:
            raise AcpLabError(
                f"{name}: done with other sources, another prepared part or other data than those here (times of files "
                "count): restart the workers with this version and these files"
            )
        yield by_name[name], run
