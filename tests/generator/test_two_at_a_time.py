"""Two trainings beside each other: their order, their threads, and how they end."""

from __future__ import annotations

import threading
from concurrent.futures import CancelledError

import pytest

from acp_lab.generator.two_at_a_time import Progress, two_at_a_time

PATIENCE_S = 20.0


def test_results_come_in_the_order_of_the_regions() -> None:
    second_is_done = threading.Event()

    def train(region: int, tell: Progress) -> str:
        if region == 3:
            assert second_is_done.wait(PATIENCE_S)  # begun, though the first one is not done
        else:
            second_is_done.set()
        return f"region {region}"

    assert list(two_at_a_time(train, [3, 1, 4])) == ["region 3", "region 1", "region 4"]
    assert list(two_at_a_time(train, [])) == []


def test_progress_is_told_in_the_callers_thread_for_all_regions_together() -> None:
    told: list[tuple[int, int, threading.Thread]] = []

    def train(region: int, tell: Progress) -> int:
        for done in range(5):
            tell(done + 1, 5)
        return region

    trainings = two_at_a_time(train, [0, 2], lambda *count: told.append((*count, threading.current_thread())))
    assert list(trainings) == [0, 2]
    assert told[-1][:2] == (10, 10)
    assert {total for _, total, _ in told} == {10}
    assert {thread for *_, thread in told} == {threading.current_thread()}


@pytest.mark.parametrize("ended_by", ["an error of a training", "Ctrl-C", "a caller who has enough"])
def test_whatever_ends_one_training_ends_the_others(ended_by: str) -> None:
    begun, ended = threading.Barrier(2), list[str]()

    def train(region: int, tell: Progress) -> int:
        if region < 2:
            begun.wait(PATIENCE_S)
        if region == 0 and ended_by == "an error of a training":
            raise ValueError("no edges")
        if region == 0 and ended_by == "a caller who has enough":
            return region
        try:
            for epoch in range(10**9):
                tell(epoch, 10**9)
        except CancelledError:
            ended.append(f"region {region}")
            raise
        return region

    def pressed(done: int, total: int) -> None:
        if ended_by == "Ctrl-C":
            raise KeyboardInterrupt

    trainings = two_at_a_time(train, [0, 1, 2, 3], pressed)
    if ended_by == "a caller who has enough":
        assert next(trainings) == 0
        trainings.close()
    else:
        with pytest.raises(ValueError if ended_by == "an error of a training" else KeyboardInterrupt):
            next(trainings)
    assert "region 1" in ended
    assert "region 3" not in ended  # it never began


def test_torch_works_in_one_thread_inside_each() -> None:
    import torch

    before = torch.get_num_threads()
    assert set(two_at_a_time(lambda region, tell: torch.get_num_threads(), [0, 1, 2, 3])) == {1}
    assert torch.get_num_threads() == before
