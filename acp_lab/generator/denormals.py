"""Numbers too small for a processor's fast path count as zero while networks are trained.

Weights that no image pulls at, and Adam's moments of them, shrink until they are denormal (below 1e-38). Processors
work many times slower on such numbers, some of them on every one: a training took four times as long. As zeros they
make no difference that could be seen.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def denormals_as_zeros() -> Iterator[None]:
    """In this thread, and as before afterwards; imports torch when it is entered."""
    import torch

    before = flushes_denormals()
    torch.set_flush_denormal(True)
    try:
        yield
    finally:
        torch.set_flush_denormal(before)


def flushes_denormals() -> bool:
    """Whether this thread takes denormal numbers for zeros."""
    import torch

    return (torch.full((1,), 1e-30) * 1e-10).item() == 0.0
