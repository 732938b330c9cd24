"""What `acp-lab prepare MESH` costs: seconds by the clock, CPU seconds, memory.

Every mesh is prepared by a process of its own into a folder of its own, one after the other, while nothing else should
run. Seconds by the clock count starting Python and storing the part. Options that are not this benchmark's go to
`acp-lab prepare`; without any, it is the default that is measured.

Example: python -m benchmarks.preparing acp_lab/sample/data/models/*.ply path/to/dataset/models/*.ply [--record KEY]
         python -m benchmarks.preparing acp_lab/sample/data/models/*.ply --generator=autoencoder --regions=4
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

UNITS = {
    "clock_s": "seconds by the clock",
    "cpu_s": "CPU seconds, user and system",
    "MB": "megabytes that the process held at most",
}


def preparing(mesh: Path, options: Sequence[str] = ()) -> dict[str, float]:
    """What preparing one part took, with options of `acp-lab prepare`. Raises RuntimeError where the command fails."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "acp_lab", "prepare", str(mesh), "--out", folder, *options]
        begin_s = time.perf_counter()
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        _, status, spent = os.wait4(process.pid, 0)
        clock_s = time.perf_counter() - begin_s
        process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise RuntimeError(f"{mesh}: acp-lab prepare ended with {process.returncode}")
    return {"clock_s": clock_s, "cpu_s": spent.ru_utime + spent.ru_stime, "MB": spent.ru_maxrss / 1024}


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("mesh", type=Path, nargs="+", help="PLY, OBJ, STL or STEP, in mm")
    parser.add_argument("--record", metavar="KEY", help="write into docs/measured.json under this key")
    options, of_prepare = parser.parse_known_args()
    values = {}
    for mesh in options.mesh:
        name = f"{mesh.resolve().parent.parent.name} {mesh.stem}"
        values[name] = preparing(mesh, of_prepare)
        print(f"{name:26}", ", ".join(f"{key} {value:.4g}" for key, value in values[name].items()), flush=True)
    slowest = max(values.values(), key=lambda row: row["clock_s"])
    print(f"{'slowest':26}", ", ".join(f"{key} {value:.4g}" for key, value in slowest.items()))
    if options.record:
        from benchmarks.measured import record

        settings, data = " ".join(of_prepare) or "default settings", f"{len(values)} parts"
        about = f"acp-lab prepare with {settings}, a process per part, one after the other"
        record(options.record, about, UNITS, data, values | {"slowest": slowest})


if __name__ == "__main__":
    main()
