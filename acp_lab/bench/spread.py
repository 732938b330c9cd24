"""Many runs, spread by dask.distributed: over the cores of this machine, or over a cluster whose workers read the data.

What is kept is kept: each run is written as soon as it is there, by the process that asked, and taken up again as long
as neither its method, its prepared part nor the sources changed. A worker that dies costs the runs that it had in hand,
which another one does; a bench that is killed costs the same. Tasks and runs travel as JSON, so that results do not
depend on who does them; what one process does is the same wherever it does it.

Dask's processes speak over ports of 127.0.0.1 and run what they are sent, without asking who sends it: where others
whom you do not trust work on the machine, one process (`workers=1`) opens none.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from acp_lab.bench.protocol import Task
from acp_lab.bench.record import Run, read_run
from acp_lab.bench.runner import run_task
from acp_lab.errors import AcpLabError, InputFileError, ParameterError

if TYPE_CHECKING:
    from distributed import Client

Progress = Callable[[int, int], None]
# Tasks that a worker gets ahead of time per core; the rest waits here, so that a kill leaves little to redo.
_IN_HAND = 2
_CONNECT_S = 15.0


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
    if scheduler is None and min(workers, len(tasks)) == 1:
        for task in tasks:  # nobody to be spoken to: no process, no port
            yield task, Run.from_json(run_task(task.to_json()), task.file_name)
        return
    with ExitStack() as at_the_end:
        client = at_the_end.enter_context(_cluster(scheduler) if scheduler else _this_machine(workers, len(tasks)))
        from distributed import as_completed

        waiting = iter(tasks)
        in_hand: dict[Any, Task] = {}

        def next_one() -> Any:
            task = next(waiting, None)
            if task is None:
                return None
            future = client.submit(run_task, task.to_json(), pure=False, retries=0)
            in_hand[future] = task
            return future

        cores = max(1, sum(client.nthreads().values()))
        queue = as_completed([future for _ in range(_IN_HAND * cores) if (future := next_one()) is not None])
        for future in queue:
            task = in_hand.pop(future)
            yield task, Run.from_json(_outcome(future, task), task.file_name)
            further = next_one()
            if further is not None:
                queue.add(further)


def _outcome(future: Any, task: Task) -> str:
    from distributed import KilledWorker

    try:
        return str(future.result())
    except KilledWorker:
        raise AcpLabError(
            f"{task.file_name}: every worker that took this run died: look at its memory, or leave the method out"
        ) from None


@contextmanager
def _this_machine(workers: int, tasks: int) -> Iterator[Client]:
    """Processes of one thread each, listening on this machine alone."""
    from distributed import Client, LocalCluster

    _quiet()
    with (
        LocalCluster(
            n_workers=min(workers, tasks), threads_per_worker=1, processes=True, host="127.0.0.1",
            dashboard_address=None, silence_logs=logging.CRITICAL, memory_limit=0,
            scheduler_kwargs={"dashboard_address": "127.0.0.1:0"},
        ) as cluster,
        Client(cluster) as client,
    ):  # fmt: skip
        yield client


@contextmanager
def _cluster(address: str) -> Iterator[Client]:
    from distributed import Client

    _quiet()
    try:
        client = Client(address, timeout=_CONNECT_S)
    except (OSError, ValueError, TypeError) as error:
        raise ParameterError(
            f"--scheduler {address}: no dask scheduler answers there ({type(error).__name__}): start one with "
            "`dask scheduler`, and give its address as tcp://HOST:8786"
        ) from None
    with client:
        if not client.nthreads():
            raise ParameterError(f"--scheduler {address}: has no worker: start some with `dask worker {address}`")
        if max(client.nthreads().values()) > 1:  # runs share what a process holds, such as the process of cv2.rapid
            raise ParameterError(
                f"--scheduler {address}: has workers of several threads: start them with `dask worker --nthreads 1`"
            )
        yield client


def _quiet() -> None:
    """Errors come to us as errors; what dask logs beside them would stand between our lines."""
    logging.getLogger("distributed").setLevel(logging.CRITICAL)
