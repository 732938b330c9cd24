"""The sample that ships with the package: one bracket, one sequence of 40 frames, exact truth, BOP layout.

Made by `python -m data_recipes.metal_sequences --sample`; see data_recipes/README.md.
"""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path

from acp_lab.errors import InputFileError


def sample_dataset() -> Path:
    """Folder of the sample data set (`models/`, `test/000001/`).

    Raises InputFileError when the package was installed without its data.
    """
    root = Path(str(files(__name__) / "data"))
    if not (root / "models" / "models_info.json").is_file():
        raise InputFileError(f"{root}: the sample data is missing; reinstall acp_lab from a complete checkout or wheel")
    return root
