"""Denormal numbers while networks are trained."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
import torch

from acp_lab.generator.denormals import denormals_as_zeros, flushes_denormals
from acp_lab.generator.painted.half_batches import two_threads


@pytest.fixture(autouse=True)
def with_denormals() -> Iterator[None]:
    before = flushes_denormals()
    if not torch.set_flush_denormal(True):
        pytest.skip("torch cannot take denormals for zeros on this processor")
    torch.set_flush_denormal(False)
    yield
    torch.set_flush_denormal(before)


def test_they_are_zeros_inside_and_numbers_again_afterwards() -> None:
    assert not flushes_denormals()
    with denormals_as_zeros():
        assert flushes_denormals()
        with denormals_as_zeros():
            assert flushes_denormals()
        assert flushes_denormals()
    assert not flushes_denormals()


def test_an_error_inside_changes_nothing_for_others() -> None:
    with pytest.raises(ZeroDivisionError), denormals_as_zeros():
        raise ZeroDivisionError
    assert not flushes_denormals()


def test_both_workers_of_a_training_take_them_for_zeros() -> None:
    with two_threads() as workers:
        assert all(workers.map(lambda _: flushes_denormals(), range(8)))
    assert not flushes_denormals()
