"""Take the tables of `acp-lab bench` into the file of measured numbers.

Example: acp-lab bench path/to/dataset --methods acp,region --out out/bench
         python -m benchmarks.side_by_side out/bench --key bench.mine --command "acp-lab bench dataset"
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

UNITS = {
    "@*": "share of frames with ADD (ADD-S for symmetric parts) below 2, 5, 10% of the diameter, mean over sequences",
    "pooled*": "the same over all frames together",
    "lost": "runs with ADD above 30% of the diameter in any frame, or a pose missing",
    "runs": "runs",
    "ms*": "CPU ms of one thread per frame that is not lost; of outside trackers what their files tell",
    "prepare s": "CPU seconds of preparing a part, mean over the parts where they were counted",
    "found": "share of runs with ADD(-S) below 5% of the diameter in the tenth frame after the start",
}


def values(rows: list[dict[str, Any]]) -> dict[str, dict[str, float]]:
    """The rows of bench.json as rows of an entry: "GROUP, METHOD", and the variant where it is not the plain one."""
    found = {}
    for row in rows:
        variant = _variant(row) + (", resets" if row["with_resets"] else "")
        fields = {f"@{limit}": row[f"mean_recall_{limit}"] for limit in (2, 5, 10)}
        fields |= {f"pooled @{limit}": row[f"recall_{limit}"] for limit in (2, 5, 10)}
        fields |= {"lost": row["lost_runs"], "runs": row["runs"], "ms": row["ms_median"], "ms 95%": row["ms_95"]}
        fields["prepare s"] = row["prepare_s"]
        known = {name: value for name, value in fields.items() if value is not None}
        found[f"{row['group']}, {row['method']}{variant}"] = known
    return found


def basin_values(rows: list[dict[str, Any]]) -> dict[str, dict[str, float]]:
    """The basins of bench.json as rows of an entry: "basin of GROUP, METHOD", and the variant."""
    return {
        f"basin of {row['group']}, {row['method']}{_variant(row)}": {"found": row["found"], "runs": row["runs"]}
        for row in rows
    }


def _variant(row: dict[str, Any]) -> str:
    step = "" if row["step"] == 1 else f", step {row['step']}"
    return step + (f", {row['noise_deg']:g} deg {row['noise_mm']:g} mm" if row["noise_deg"] or row["noise_mm"] else "")


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, help="what `acp-lab bench --out` named")
    parser.add_argument("--key", required=True, help="of the entry")
    parser.add_argument("--command", required=True, help="that made the tables, as it may be typed elsewhere")
    options = parser.parse_args()
    from benchmarks.measured import load, record, save

    told = json.loads((options.folder / "bench.json").read_text(encoding="utf-8"))
    groups = list(dict.fromkeys(row["group"] for row in told["rows"] if ":" not in row["group"]))
    about = "methods and outside trackers side by side, from truth unless said; first frame left out, no resets"
    entry = values(told["rows"]) | basin_values(told["basins"])
    record(options.key, about, UNITS, ", ".join(groups), entry)
    entries = load()
    entries[options.key] = type(entries[options.key])(**{**vars(entries[options.key]), "command": options.command})
    save(entries)


if __name__ == "__main__":
    main()
