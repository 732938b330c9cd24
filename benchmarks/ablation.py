"""The paper's ablation (Table III) on what the network paints: control points, none, and points without regression.

Each method tracks with painted ridges, by a regressor of its own W onto the decoder, and gets the same search over
alpha, which is annealed in the same way. What a sequence is scored with is chosen on the
sequences of all *other* parts, by the share of frames within 5%, from truth; with that it is run again from a disturbed
start, as the paper does, which tells no size. No resets, the first frame left out, one thread. Intervals are 95% from
a hierarchical block bootstrap. Times are the defaults' CPU times, of each frame the shortest of ten runs, at the size
of the first sequence's images and at the paper's.

Example: python -m benchmarks.ablation path/to/dataset/test/000001... --parts out/parts
(prepared before: acp-lab prepare MESH --out out/parts/DATASET, again with --generator autoencoder)
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING

from acp_lab.commands import machine

# Before NumPy is imported: its linear algebra reads the number of threads once.
machine.limit_threads(1)

import numpy as np  # noqa: E402

from acp_lab.evaluation.bootstrap import bootstrap_mean  # noqa: E402
from benchmarks.deviations import DecodedScene, errors_along, load, name_of  # noqa: E402

if TYPE_CHECKING:
    from acp_lab.geometry.arrays import FloatArray
    from acp_lab.prepared_part import PreparedPart
    from acp_lab.sequences.frame import Frame
    from acp_lab.tracking.method import Method
    from acp_lab.tracking.tracker import Tracker

METHOD_NAMES = ("acp-paper", "direct-6dof", "unoptimised-points")
ALPHAS = (0.035, 0.05, 0.07)
LIMITS = (0.02, 0.05, 0.10)
STARTS = {"truth": (0.0, 0.0), "2 deg, 2 mm off": (2.0, 2.0)}
PAPER_SIZE = (1224, 1024)
TIMED_FRAMES = 20
TIMED_RUNS = 10


@dataclass(frozen=True)
class Track:
    """One run: ADD as a share of the diameter per frame, infinite where there is no pose. part: its mesh's hash."""

    sequence: str
    part: str
    method: str
    setting: str
    start: str
    errors: np.ndarray


def settings(method: Method) -> Iterator[tuple[str, Method]]:
    """The searched variants of a method, by name; levels and steps are its own, so that all cost the same."""
    from acp_lab.tracking.schedule import ShareSchedule

    own = method.schedule if isinstance(method.schedule, ShareSchedule) else ShareSchedule()
    for alpha in ALPHAS:
        yield f"alpha {alpha:g}", replace(method, schedule=replace(own, alpha=alpha))


def track(decoded: DecodedScene, model: PreparedPart, method: Method, setting: str, start: str) -> Track:
    """One run from a start of `STARTS`; a start that is refused is a run without poses."""
    errors, _ = errors_along(decoded, model, method, STARTS[start])
    return Track(name_of(decoded.scene), model.part.sha256, method.name, setting, start, errors)


def chosen_without(part: str, tracks: list[Track]) -> str:
    """The setting with the most frames within 5% from truth, mean over the sequences of all other parts."""
    shares: dict[str, list[float]] = {}
    for item in tracks:
        if item.part != part and item.start == "truth":
            shares.setdefault(item.setting, []).append(float((item.errors < 0.05).mean()))
    return max(shares, key=lambda setting: float(np.mean(shares[setting])))


def rows_of(tracks: list[Track]) -> dict[str, dict[str, list[float]]]:
    """Per start and method: shares of frames with their intervals."""
    rows = {}
    for start, method in product(STARTS, dict.fromkeys(item.method for item in tracks)):
        own = [item for item in tracks if (item.start, item.method) == (start, method)]
        shares = {limit: bootstrap_mean([(t.errors < limit).astype(float) for t in own]) for limit in LIMITS}
        rows[f"{start}: {method}"] = {f"@{100 * k:g}": [v.mean, v.low, v.high] for k, v in shares.items()}
    return rows


def times_ms(decoded: DecodedScene, model: PreparedPart) -> dict[str, dict[str, float]]:
    """CPU ms per frame of the methods' defaults, median over some frames, at both sizes of images.

    Of each frame the shortest of some runs: what a busy machine adds to CPU times differs from run to run.
    """
    from acp_lab.tracking.method import METHODS
    from acp_lab.tracking.tracker import Tracker

    as_they_are = list(decoded.frames())[: TIMED_FRAMES + 1]
    rows: dict[str, dict[str, float]] = {}
    for frames in (as_they_are, [_resized(frame, PAPER_SIZE) for frame in as_they_are]):
        size = f"{frames[0].camera.width}x{frames[0].camera.height}"
        rows[size] = {}
        for name in METHOD_NAMES:
            tracker = Tracker(model, METHODS[name])
            runs = [_frame_times_ms(tracker, frames, decoded.first_pose) for _ in range(TIMED_RUNS)]
            rows[size][name] = median(map(min, *runs))
    return rows


def _frame_times_ms(tracker: Tracker, frames: list[Frame], first_pose: FloatArray) -> list[float]:
    times = []
    tracker.start(frames[0], first_pose)
    for frame in frames[1:]:
        begin = time.process_time()
        tracker.track(frame)
        times.append(1e3 * (time.process_time() - begin))
    return times


def _resized(frame: Frame, size: tuple[int, int]) -> Frame:
    """The same view by a camera of another size, both axes scaled by themselves."""
    import cv2

    camera = frame.camera
    sx, sy = size[0] / camera.width, size[1] / camera.height
    # Pixel centres: (0, 0) lies half a pixel inside the image's corner.
    cx, cy = (camera.cx + 0.5) * sx - 0.5, (camera.cy + 0.5) * sy - 0.5
    larger = replace(camera, width=size[0], height=size[1], fx=camera.fx * sx, fy=camera.fy * sy, cx=cx, cy=cy)
    image = np.asarray(cv2.resize(frame.image, size, interpolation=cv2.INTER_CUBIC), np.uint8)
    return replace(frame, image=image, camera=larger)


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scenes", nargs="+", type=Path, help="scene folders of BOP data sets")
    parser.add_argument("--parts", type=Path, required=True, help="prepared parts, one folder per data set")
    parser.add_argument("--config", nargs="*", type=Path, default=[], help="further methods as TOML, searched likewise")
    parser.add_argument("--json", type=Path, help="also keep the errors of every frame")
    parser.add_argument("--times", action="store_true", help="only the times per frame, on the first scene")
    parser.add_argument("--record", action="store_true", help="write to docs/measured.json")
    options = parser.parse_args()
    from acp_lab.sequences import open_sequence
    from acp_lab.tracking.method import METHODS
    from acp_lab.tracking.method_file import read_method

    if options.times:
        decoded = DecodedScene(open_sequence(options.scenes[0]))
        times = times_ms(decoded, load(options.parts, decoded.scene))
        print(times)
        if options.record:
            record_times(times, decoded)
        return
    methods = [*(METHODS[name] for name in METHOD_NAMES), *map(read_method, options.config)]
    opened = [DecodedScene(open_sequence(folder)) for folder in options.scenes]
    models = [load(options.parts, decoded.scene) for decoded in opened]
    searched, scored = list[Track](), list[Track]()
    for method in methods:
        variants = dict(settings(method))
        own = list[Track]()
        for (decoded, model), (setting, variant) in product(zip(opened, models, strict=True), variants.items()):
            own.append(track(decoded, model, variant, setting, "truth"))
            print(own[-1].sequence, method.name, setting, (own[-1].errors < 0.05).mean().round(2), flush=True)
        for decoded, model in zip(opened, models, strict=True):
            setting = chosen_without(model.part.sha256, own)
            name = name_of(decoded.scene)
            scored += [item for item in own if (item.sequence, item.setting) == (name, setting)]
            others = [start for start in STARTS if start != "truth"]
            scored += [track(decoded, model, variants[setting], setting, start) for start in others]
            print(name, method.name, setting, scored[-1].start, (scored[-1].errors < 0.05).mean().round(2), flush=True)
        searched += own
    if options.json is not None:
        kept = [{**vars(item), "errors": [float(e) for e in item.errors.round(5)]} for item in [*searched, *scored]]
        options.json.write_text(json.dumps(kept))
    rows, times = rows_of(scored), times_ms(opened[0], models[0])
    for name, row in rows.items():
        print(f"| {name} | " + " | ".join(f"{m:.2f} [{lo:.2f}, {hi:.2f}]" for m, lo, hi in row.values()) + " |")
    print(times)
    if options.record:
        from benchmarks.measured import record

        unit = "share of frames with ADD below 2, 5, 10% of the diameter, and its 95% interval"
        about = "the paper's Table III on painted ridges: search over alpha and annealing on other parts"
        data = ", ".join(dict.fromkeys(item.sequence for item in scored))
        record("ablation.painted", about, {"@*": unit}, data, rows)
        record_times(times, opened[0])


def record_times(times: dict[str, dict[str, float]], decoded: DecodedScene) -> None:
    """Into docs/measured.json."""
    from benchmarks.measured import record

    about = "the same methods' defaults, of each frame the shortest of ten runs"
    record("ablation.times", about, "CPU ms per frame, median", name_of(decoded.scene), times)


if __name__ == "__main__":
    main()
