"""Trainings of several view regions, two at a time.

A region's network is small: two threads inside one operation of torch wait for each other longer than they work. Two
trainings beside each other, with one thread each, keep two cores busy, and each gives the very weights that it gives
alone.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import CancelledError, ThreadPoolExecutor, wait
from typing import TypeVar

Trained = TypeVar("Trained")
Progress = Callable[[int, int], None]

_TELL_EVERY_S = 0.1


def two_at_a_time(
    train: Callable[[int, Progress], Trained], regions: Sequence[int], progress: Progress | None = None
) -> Iterator[Trained]:
    """What `train` gives for each region, in their order.

    Threads can be begun only while the program's main thread is alive: call it from there, or wait for it there.

    Args:
        train: called in one of the two threads with a region and what it is to call with (epochs done, epochs in all)
            after each epoch; all regions have as many epochs. What it raises is raised here, and ends the others.
        progress: called from the caller's own thread, with the sums over all regions.
    """
    epochs, given_up = dict.fromkeys(regions, (0, 0)), threading.Event()

    def begin(region: int) -> Trained:
        def count(done: int, total: int) -> None:
            if given_up.is_set():
                raise CancelledError
            epochs[region] = done, total

        return train(region, count)

    with ThreadPoolExecutor(2, "region", initializer=_one_thread_inside) as threads:
        begun = [threads.submit(begin, region) for region in regions]
        try:
            for training in begun:
                ready = False
                while not ready:
                    ready = not wait([training], _TELL_EVERY_S).not_done
                    done, total = zip(*epochs.values(), strict=True)
                    if progress is not None and max(total):
                        progress(sum(done), len(regions) * max(total))
                yield training.result()
        finally:  # an error, Ctrl-C, or a caller who has enough: nobody waits for what is not wanted any more
            for training in begun:
                training.cancel()
            given_up.set()


def _one_thread_inside() -> None:
    import torch  # takes seconds; nothing else here needs it

    torch.set_num_threads(1)
