"""The machine a run happened on, for results.run.json and for whoever reads a time: CPU, versions."""

from __future__ import annotations

import os
import platform
import sys
from importlib.metadata import PackageNotFoundError, version

import acp_lab
from acp_lab.commands import console
from acp_lab.errors import ParameterError
from acp_lab.machine import cores, cpu_model, peak_memory_mb

__all__ = ["cores", "cpu_model", "limit_threads", "machine", "peak_memory_mb", "versions"]

PACKAGES = (
    "numpy",
    "scipy",
    "opencv-python-headless",
    "trimesh",
    "embreex",
    "torch",
    "kornia",
    "safetensors",
    "rerun-sdk",
    "matplotlib",
    "pyrender",
)

MOST_THREADS = 256
_THREAD_VARIABLES = (
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "VECLIB_MAXIMUM_THREADS",
    "NUMEXPR_NUM_THREADS",
)


def limit_threads(count: int) -> None:
    """Let numerical libraries use `count` threads, with a note where that is more than there are cores.

    It is no error: numbers belong to a count of threads, and a smaller machine must be able to repeat those of a
    larger one. The linear algebra under NumPy reads its limit when NumPy is first imported, so call this before that.
    Raises ParameterError beyond MOST_THREADS, which the libraries do not survive.
    """
    if not 1 <= count <= MOST_THREADS:
        raise ParameterError(f"--threads {count}: give 1 to {MOST_THREADS}, best no more than the {cores()} cores here")
    if count > cores():
        console.note(f"--threads {count} is more than the {cores()} cores here: fewer are faster")
    for name in _THREAD_VARIABLES:
        os.environ[name] = str(count)
    import cv2

    cv2.setNumThreads(count)
    torch = sys.modules.get("torch")
    if torch is not None:
        torch.set_num_threads(count)


def versions() -> dict[str, str]:
    """Version by package name, acp_lab and Python first; packages that are not installed are left out."""
    found = {"acp_lab": acp_lab.__version__, "python": platform.python_version()}
    for name in PACKAGES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            continue
    return found


def machine() -> dict[str, str | int]:
    """What a time should be read against."""
    return {"cpu": cpu_model(), "cores": cores(), "system": platform.platform()}
