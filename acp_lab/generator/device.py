"""Where torch computes: the CPU, or a GPU where there is one."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Literal

from acp_lab.errors import PreparationError

if TYPE_CHECKING:
    import torch

Device = Literal["auto", "cpu", "cuda"]


def torch_device(device: Device) -> torch.device:
    """The device of that name; "auto" is the GPU where torch finds one, else the CPU. Imports torch.

    Raises:
        PreparationError: "cuda" on a machine where torch finds no GPU, or any other name.
    """
    import torch

    if device not in ("auto", "cpu", "cuda"):
        raise PreparationError(f"--device {device}: choose auto, cpu or cuda")
    has_gpu = torch.cuda.is_available()
    if device == "cuda" and not has_gpu:
        raise PreparationError("--device cuda: torch finds no GPU on this machine: give --device cpu, or auto")
    return torch.device("cuda" if device == "cuda" or (device == "auto" and has_gpu) else "cpu")


@contextmanager
def repeatable_convolutions(on: torch.device) -> Iterator[None]:
    """On a GPU, the same convolutions on every run, and in full single precision; settings are as before afterwards.

    So that the same seed gives the same weights, and a GPU paints what the CPU paints. On a CPU nothing is touched.
    """
    if on.type != "cuda":
        yield
        return
    import torch

    with torch.backends.cudnn.flags(enabled=True, benchmark=False, deterministic=True, allow_tf32=False):
        yield
