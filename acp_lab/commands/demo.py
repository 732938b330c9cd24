"""`acp-lab demo`: the whole way once, on the sample that comes with the package. Works offline."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from acp_lab.errors import InputFileError
from acp_lab.pasted import quoted

if TYPE_CHECKING:
    from acp_lab.sequences.bop import BopScene

SHOWN_FRAMES = 4


def open_sample() -> BopScene:
    """The sample sequence; InputFileError when it is not there."""
    from acp_lab.sample import sample_dataset
    from acp_lab.sequences import open_sequence

    return open_sequence(sample_dataset())


def run_demo(out: Path) -> None:
    """Prepare the sample part, track the sample sequence; print what came of it and write it to `out`."""
    if out.exists() and not out.is_dir():
        raise InputFileError(f"{out}: is a file: --out needs a folder")
    from acp_lab.commands.machine import cpu_model, limit_threads

    limit_threads(1)  # before anything imports NumPy
    from acp_lab.commands.prepare import prepare_parts
    from acp_lab.commands.track import TrackOptions, scene_jobs
    from acp_lab.commands.track_run import run_jobs
    from acp_lab.display.plots.summary import SummaryPicture
    from acp_lab.evaluation import evaluate

    scene = open_sample()
    meshes = tuple(scene.dataset.part_path(object_id) for object_id in scene.object_ids)
    print(f"Preparing {len(meshes)} part{'s'[: len(meshes) > 1]} (trained once, then kept) ...", flush=True)
    prepare_parts(meshes, out / "parts")
    options = TrackOptions(
        parts=out / "parts", out=out / "results.csv", dataset=scene.dataset.root, replay=out / "replay.rrd"
    )
    print(f"Tracking {len(scene.frame_ids)} frames ...", flush=True)
    picture = SummaryPicture(out / "summary.png", _spread(scene.frame_ids, SHOWN_FRAMES))
    summary = run_jobs(scene_jobs(options), options, extra=[picture])
    print(f"\nAccuracy on the sample, started from its first frame's truth:\n\n{evaluate(options.out, scene)}\n")
    print(summary)
    print(f"on one thread of {cpu_model()}\n")
    print(f"{options.out}: poses in the BOP format; results.run.json beside it tells how they came about")
    print(f"{options.replay}: the replay; look at it with acp-lab replay {quoted(options.replay)}")
    print(f"{picture.path}: one picture of the run")


def _spread(frame_ids: tuple[int, ...], count: int) -> list[int]:
    """At most `count` ids from the first to the last, evenly."""
    count = min(count, len(frame_ids))
    return [frame_ids[round(i * (len(frame_ids) - 1) / max(1, count - 1))] for i in range(count)]
