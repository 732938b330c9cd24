"""`acp-lab eval`: results against truth, as a table and as JSON."""

from __future__ import annotations

from pathlib import Path

from acp_lab.commands.bench import NOTHING_TO_COMPARE
from acp_lab.errors import InputFileError
from acp_lab.files import check_replaces_own


def evaluate_results(dataset: Path, results: Path, split: str = "test", json: Path | None = None) -> None:
    """Print the table of a results file, and write its numbers to `json` when that is given."""
    from acp_lab.evaluation import evaluate
    from acp_lab.sequences.bop import BopDataset

    if json is not None and json.resolve() == results.resolve():
        raise InputFileError(f"{json}: --json would overwrite the results: choose another file")
    if json is not None and json.is_dir():
        raise InputFileError(f"{json}: is a folder: --json needs a file name")
    if json is not None:
        check_replaces_own(json, b'{\n  "objects"', "--json", "an evaluation")
    scores = evaluate(results, BopDataset(dataset), split)
    if not scores.pooled.frames:
        raise InputFileError(f"{dataset}: {NOTHING_TO_COMPARE}")
    if json is not None:
        scores.write_json(json)
    print(scores)
