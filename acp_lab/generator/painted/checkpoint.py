"""Half-trained networks on disk: one safetensors file, so that an interrupted training resumes where it stopped.

The file names in its metadata what it belongs to; one that belongs to another part, other settings or another seed
is ignored. Written whole or not at all.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save as serialise

from acp_lab.files import write_whole


@dataclass(frozen=True)
class Checkpoint:
    """Where a training stands.

    Attributes:
        belongs_to: identifies part, settings and seed.
        stage: 0-based; epochs: done within it; steps: of the optimiser within it.
        train_s: wall seconds spent so far.
        losses: mean loss over the last epoch of each stage begun so far.
        tensors: weights and the optimiser's state by name.
    """

    belongs_to: str
    stage: int
    epochs: int
    steps: int
    train_s: float
    losses: tuple[float, ...]
    tensors: Mapping[str, torch.Tensor] = field(default_factory=dict, repr=False)

    def save(self, path: Path) -> None:
        """Write the file, replacing an older one."""
        state = {item.name: getattr(self, item.name) for item in fields(self) if item.name != "tensors"}
        tensors = {key: value.detach().contiguous() for key, value in self.tensors.items()}
        write_whole(path, serialise(tensors, {"state": json.dumps(state)}), "the checkpoint")


def load_checkpoint(path: Path, belongs_to: str) -> Checkpoint | None:
    """The checkpoint of that file; None when there is none, it is damaged, or it belongs to something else."""
    try:
        with safe_open(path, framework="pt") as file:
            state = json.loads(file.metadata()["state"])
            if state["belongs_to"] != belongs_to:
                return None
            # Copied: they would map the file, and Windows replaces none that is mapped.
            tensors = {key: file.get_tensor(key).clone() for key in file.keys()}  # noqa: SIM118 - the file is no dict
        return Checkpoint(**{**state, "losses": tuple(state["losses"])}, tensors=tensors)
    except (OSError, SafetensorError, ValueError, KeyError, TypeError):
        return None
