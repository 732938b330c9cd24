"""The course that an installed package brings along, copied to a folder where it can be worked in.

The wheel carries notebooks and docs as data files (`share/acp_lab`), since they are no modules; in a checkout they
are used where they are.
"""

from __future__ import annotations

import shutil
from importlib import metadata
from pathlib import Path, PurePosixPath

from acp_lab.errors import AcpLabError

_SHARE = "share/acp_lab/"


def shipped_files() -> dict[Path, Path]:
    """Path within the course: where the installation keeps it; empty when it brings none."""
    try:
        listed = metadata.files("acp_lab") or []
    except metadata.PackageNotFoundError:
        return {}
    found = {}
    for file in listed:
        _, share, path = PurePosixPath(file).as_posix().rpartition(_SHARE)
        if share:
            found[Path(path)] = Path(str(file.locate()))
    return found


def copy_course(folder: Path) -> int:
    """Copy what is not there yet, so that no work is overwritten; the number of files copied.

    Raises AcpLabError when the installation has no course.
    """
    files = shipped_files()
    if Path("notebooks", "00_start_here.ipynb") not in files:
        raise AcpLabError(
            "this installation has no notebooks: install the wheel again (pip install --force-reinstall --no-deps), "
            "or run acp-lab lab in a checkout of the source"
        )
    missing = {path: source for path, source in files.items() if not (folder / path).exists()}
    for path, source in missing.items():
        (folder / path).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(source, folder / path)
    return len(missing)
