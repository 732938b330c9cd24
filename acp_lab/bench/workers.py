"""Many calls of one function, spread by dask.distributed: over the cores of this machine, or over a cluster.

What is asked and what is answered are texts, so that results do not depend on who does the work; data is read, and
large results are written, by whoever does it. A worker that dies costs the calls that it had in hand, which another one
does. `bench`, `prepare` and the recipe of synthetic sequences all go through this door.

Dask's processes speak over ports of 127.0.0.1 and run what they are sent, without asking who sends it: where others
whom you do not trust work on the machine, one process (`workers=1`) opens none.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from typing import TYPE_CHECKING, Any

from acp_lab.errors import AcpLabError, ParameterError

if TYPE_CHECKING:
    from distributed import Client

MOST_WORKERS = 256
# Calls that a worker gets ahead of time per core; the rest waits here, so that a kill leaves little to redo.
_IN_HAND = 2
_CONNECT_S = 15.0


def each(
    work: Callable[[str], str], asked: Mapping[str, str], *, workers: int = 1, scheduler: str | None = None
) -> Iterator[tuple[str, str]]:
    """(name, answer) of every call, as they are done.

    Args:
        work: a function of a module, of a text; what it raises is raised here.
        asked: the texts, by a name that errors can tell.
        workers: processes on this machine; scheduler: instead, the address of a dask scheduler such as
            "tcp://10.0.0.5:8786".

    Raises:
        ParameterError: a number of workers that makes no sense, or no scheduler answers at that address.
        AcpLabError: every worker that took a call died, or the scheduler went away.
    """
    check_workers(workers, scheduler)
    if scheduler is None and min(workers, len(asked)) <= 1:
        for name, text in asked.items():  # nobody to be spoken to: no process, no port
            yield name, work(text)
        return
    with ExitStack() as at_the_end:
        cluster = _this_machine(workers, len(asked)) if scheduler is None else _cluster(scheduler)
        client = at_the_end.enter_context(cluster)
        from distributed import as_completed

        waiting = iter(asked.items())
        in_hand: dict[Any, str] = {}

        def next_one() -> Any:
            name, text = next(waiting, (None, ""))
            if name is None:
                return None
            future = client.submit(work, text, pure=False, retries=0)
            in_hand[future] = name
            return future

        cores = max(1, sum(client.nthreads().values()))
        queue = as_completed([future for _ in range(_IN_HAND * cores) if (future := next_one()) is not None])
        for future in queue:
            name = in_hand.pop(future)
            yield name, _answer(future, name)
            further = next_one()
            if further is not None:
                queue.add(further)


def check_workers(workers: int, scheduler: str | None = None) -> None:
    """ParameterError for a number of processes that makes no sense, or an address of a scheduler that is empty."""
    if not 1 <= workers <= MOST_WORKERS:
        raise ParameterError(f"--jobs {workers}: give 1 to {MOST_WORKERS}")
    if scheduler is not None and not scheduler.strip():
        raise ParameterError("--scheduler '': is no address: give one such as tcp://HOST:8786, or leave it out")


def _answer(future: Any, name: str) -> str:
    from distributed import KilledWorker
    from distributed.client import FutureCancelledError
    from distributed.comm import CommClosedError

    try:
        return str(future.result())
    except (FutureCancelledError, CommClosedError):
        raise AcpLabError(
            f"{name}: the scheduler went away; what is done is kept: start it, and run this again"
        ) from None
    except KilledWorker:
        raise AcpLabError(
            f"{name}: every worker that took this died: look at its memory, or leave it out"
        ) from None


@contextmanager
def _this_machine(workers: int, calls: int) -> Iterator[Client]:
    """Processes of one thread each, listening on this machine alone."""
    from distributed import Client, LocalCluster

    _quiet()
    with (
        LocalCluster(
            n_workers=min(workers, calls), threads_per_worker=1, processes=True, host="127.0.0.1",
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
        if max(client.nthreads().values()) > 1:  # calls share what a process holds, such as the process of cv2.rapid
            raise ParameterError(
                f"--scheduler {address}: has workers of several threads: start them with `dask worker --nthreads 1`"
            )
        yield client


def _quiet() -> None:
    """Errors come to us as errors; what dask logs beside them would stand between our lines."""
    for name in ("distributed", "distributed.client"):  # dask gives the client's a level of its own
        logging.getLogger(name).setLevel(logging.CRITICAL)
