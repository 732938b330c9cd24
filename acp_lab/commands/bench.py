"""`acp-lab bench`: methods and outside trackers on the same frames, as tables and one page."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from acp_lab.errors import AcpLabError, InputFileError, ParameterError

if TYPE_CHECKING:
    from acp_lab.bench.protocol import SequenceKey, Task, Variant
    from acp_lab.bench.record import Run
    from acp_lab.bench.report import Report
    from acp_lab.display.bench_page import Thumbnail
    from acp_lab.tracking.method import Method

MOST_SEEDS = 1000
NOTHING_TO_COMPARE = "no frame but the first has truth: nothing to compare: add truth to scene_gt.json"
_NOTHING_LEFT = "no frame that was tracked has truth but the first: add truth to scene_gt.json, or give smaller --steps"
_REPLAY_MB = 30.0
# Per method and per page: a page should open at once.
_MOST_THUMBNAILS, _MOST_REPLAYS = 3, 8


@dataclass(frozen=True)
class BenchOptions:
    """What to compare, on what: the one argument of `run_bench`.

    Attributes:
        datasets: in the BOP layout; none for the sample. methods: names, split by commas.
        out: where everything goes. parts: prepared parts, one folder per data set, see
            `bench_parts.places_of`; None for out/parts.
        results_from: of outside trackers. noise: "D,M" each, degrees and mm, with `seeds` directions each.
        steps: frame steps, split by commas. resets: whether lost parts are started again.
        split: the data sets' folder of scenes. scheduler: address of a dask scheduler. jobs: processes here.
        install_peers: make the environment of RAPID, OLS and GOS first. config: files of further methods.

    Raises:
        ParameterError: a setting that makes no sense.
    """

    datasets: tuple[Path, ...]
    methods: str
    out: Path
    parts: Path | None = None
    results_from: tuple[Path, ...] = ()
    noise: tuple[str, ...] = ()
    seeds: int = 20
    steps: str = "1"
    resets: bool = False
    split: str = "test"
    scheduler: str | None = None
    jobs: int = 1
    install_peers: bool = False
    config: tuple[Path, ...] = ()

    def __post_init__(self) -> None:
        from acp_lab.bench.workers import check_workers

        if not 1 <= self.seeds <= MOST_SEEDS:
            raise ParameterError(f"--seeds {self.seeds}: give 1 to {MOST_SEEDS}")
        check_workers(self.jobs, self.scheduler)
        if self.out.exists() and not self.out.is_dir():
            raise InputFileError(f"{self.out}: is a file: --out needs a folder")

    def variants(self) -> list[Variant]:
        """How every sequence is run: from truth and from each disturbed start, with every frame step."""
        from acp_lab.bench.protocol import Variant

        starts = [(0.0, 0.0, 0)]
        for text in self.noise:
            degrees, mm = _two_numbers(text)
            if degrees or mm:  # else it is the truth once more
                starts += [(degrees, mm, seed) for seed in range(self.seeds)]
        steps = _whole_numbers(self.steps)
        return list(dict.fromkeys(Variant(step, *start, self.resets) for step in steps for start in starts))

    def chosen_methods(self) -> list[Method | str]:
        """The methods, names of trackers of cv2.rapid, and the methods of files.

        Raises:
            ParameterError: a name that is none of these, or one of a file's that is taken or no file could have.
            InputFileError: a file that is no method.
        """
        from acp_lab.bench.rapid.tracker import NAMES
        from acp_lab.commands.bench_parts import check_painting
        from acp_lab.tracking.method import METHODS

        names = list(dict.fromkeys(name.strip() for name in self.methods.split(",") if name.strip()))
        unknown = [name for name in names if name not in METHODS and name not in NAMES]
        if unknown:
            raise ParameterError(
                f"--methods {unknown[0]}: no such method: there are {', '.join((*METHODS, *NAMES))}; others come by "
                "--config or --results-from"
            )
        chosen = [METHODS.get(name, name) for name in names] + _own_methods(self.config)
        check_painting(chosen)
        return chosen


def _own_methods(files: Sequence[Path]) -> list[Method | str]:
    """Of files, each under a name of its own, which its results file will have, too."""
    from acp_lab.bench.rapid.tracker import NAMES
    from acp_lab.bench.report import results_name
    from acp_lab.tracking.method import METHODS
    from acp_lab.tracking.method_file import read_method

    found: list[Method | str] = []
    taken = {results_name(name, "") for name in (*METHODS, *NAMES)}
    for path in files:
        method = read_method(path)
        if not re.fullmatch(r"[\w .+-]{1,80}", method.name) or "__" in method.name:
            raise ParameterError(
                f"--config {path}: name = {method.name!r}: results are written under it: give up to 80 letters, "
                "digits, blanks, . + - and single _"
            )
        if results_name(method.name, "") in taken:
            raise ParameterError(
                f"--config {path}: name = {method.name!r} is taken: write another one into the file"
            )
        taken.add(results_name(method.name, ""))
        found.append(method)
    return found


def run_bench(options: BenchOptions) -> None:
    """Run everything that is missing, and write tables, page, pictures and replays; print the tables' heads."""
    from acp_lab.bench.outside import outside_runs, roots_by_name
    from acp_lab.bench.report import Report
    from acp_lab.commands.bench_parts import places_of, prepare_missing
    from acp_lab.commands.machine import cores, cpu_model
    from acp_lab.commands.prepare import Spread
    from acp_lab.locks import only_writer
    from acp_lab.sample import sample_dataset

    variants, methods = options.variants(), options.chosen_methods()
    if options.install_peers:
        _install_peers()
    roots = roots_by_name(options.datasets or (sample_dataset(),))
    outside = [run for path in options.results_from for run in outside_runs(path, roots, options.split)]
    if not methods and not outside:
        raise ParameterError("nothing to compare: give --methods, --config or --results-from")
    _check_names(methods, outside)
    sequences = {name: _sequences(root, options.split) for name, root in roots.items()}
    if not any(_has_later_truth(root, options.split) for root in roots.values()):  # before parts take minutes
        raise InputFileError(f"{next(iter(roots.values()))}: {NOTHING_TO_COMPARE}")
    if methods:
        _check_steps(_whole_numbers(options.steps), roots, options.split)
    parts = options.parts or options.out / "parts"
    places: dict[SequenceKey, Path] = {}
    for name, root in roots.items() if methods else ():
        places |= places_of(root, sequences[name], parts, alone=len(roots) == 1)
    with only_writer(options.out / "bench.csv", "this bench"):
        spread = Spread(options.jobs, options.scheduler)
        for name, root in roots.items():
            for place in sorted({places[key] for key in sequences[name]} if methods else ()):
                there = [key for key in sequences[name] if places[key] == place]
                prepare_missing(root, options.split, place, there, methods, spread)
        tasks = _tasks(roots, sequences, methods, variants, places, options.split)
        runs = _run(tasks, options) + outside
        if not any(len(run.frame_ids) for run in runs):
            raise InputFileError(f"{next(iter(roots.values()))}: {_NOTHING_LEFT}")
        report = Report.of(runs, f"{cpu_model()}, {cores()} cores; one thread per run")
        poses = report.write(options.out, options.results_from)
        _write_page(report, roots, tasks, options)
    _print(report, options.out)
    _tell_poses(poses, options.out / "results")


def _sequences(root: Path, split: str) -> list[SequenceKey]:
    from acp_lab.bench.runner import sequences_of

    found = sequences_of(root, split)
    if not found:
        raise InputFileError(f"{root / split}: no first frame has truth: nothing to start from")
    return found


def _has_later_truth(root: Path, split: str) -> bool:
    """Whether any image of a data set, beside the first of each scene, has truth."""
    from acp_lab.sequences.bop import BopDataset, image_files
    from acp_lab.sequences.scene_truth import instance_truths

    dataset = BopDataset(root)
    folders = (dataset.scene_folder(scene_id, split) for scene_id in dataset.scenes(split))
    return any(
        truth.in_frame(frame_id)
        for folder in folders
        for instances in instance_truths(folder / "scene_gt.json").values()
        for truth in instances
        for frame_id in list(image_files(folder))[1:]
    )


def _check_steps(steps: Sequence[int], roots: dict[str, Path], split: str) -> None:
    """ParameterError for a step that leads beyond the end of every scene."""
    from acp_lab.sequences.bop import BopDataset, image_files

    longest = {}
    for name, root in roots.items():
        dataset = BopDataset(root)
        longest[name] = max(len(image_files(dataset.scene_folder(i, split))) for i in dataset.scenes(split))
    name = max(longest, key=longest.__getitem__)
    for step in steps:
        if step >= longest[name]:
            raise ParameterError(
                f"--steps {step}: {name} has {longest[name]} images in its longest scene: give at most "
                f"{longest[name] - 1}"
            )


def _check_names(methods: Sequence[Method | str], outside: list[Run]) -> None:
    """ParameterError where the rows of two trackers would be taken for one's."""
    from acp_lab.bench.report import results_name

    ours = {results_name(_name(method), "") for method in methods}
    for run in outside:
        if results_name(run.method, "") in ours:
            raise ParameterError(f"--results-from: {run.method} is one of --methods or --config: rename the file")
    told: set[tuple[str, SequenceKey]] = set()
    for run in outside:
        if (run.method, run.sequence) in told:
            raise ParameterError(
                f"--results-from: {run.method} on {run.sequence} stands in two files: rename one, or leave it out"
            )
        told.add((run.method, run.sequence))


def _install_peers() -> None:
    from acp_lab.bench.rapid.environment import folder, install

    print(f"Making {folder()} (once, then kept) ...", flush=True)
    install()


def _name(method: Method | str) -> str:
    return method if isinstance(method, str) else method.name


def _tasks(
    roots: dict[str, Path],
    sequences: dict[str, list[SequenceKey]],
    methods: Sequence[Method | str],
    variants: Sequence[Variant],
    places: Mapping[SequenceKey, Path],
    split: str,
) -> list[Task]:
    """What shares a sequence stands together, so that its frames are decoded once."""
    from acp_lab.bench.protocol import task_of

    return [
        task_of(root, split, places[key], key, method, variant)
        for name, root in roots.items()
        for key in sequences[name]
        for method in methods
        for variant in variants
    ]


def _run(tasks: list[Task], options: BenchOptions) -> list[Run]:
    from acp_lab.bench.spread import complete
    from acp_lab.commands import interrupt
    from acp_lab.commands.console import Progress

    with Progress() as bar:

        def progress(done: int, total: int) -> None:
            interrupt.check()
            bar("runs", done, total)

        runs = complete(
            tasks, options.out / "runs", workers=options.jobs, scheduler=options.scheduler, progress=progress
        )
    order = {name: place for place, name in enumerate(dict.fromkeys(task.method_name for task in tasks))}
    return sorted(runs, key=lambda run: order.get(run.method, len(order)))


def _write_page(report: Report, roots: dict[str, Path], tasks: list[Task], options: BenchOptions) -> None:
    from acp_lab.display.bench_page import failures, thumbnail, write_page

    worst = failures(report.runs, _MOST_THUMBNAILS)
    pictures: list[Thumbnail] = []
    for run in worst:
        picture = thumbnail(run, roots[run.sequence.dataset], options.split)
        pictures += [] if picture is None else [picture]
    write_page(report, options.out / "index.html", pictures, _replays(report, worst, tasks, options.out / "replays"))


def _replays(report: Report, worst: list[Run], tasks: list[Task], folder: Path) -> dict[str, Path]:
    """A replay of each method's worst run, or of its first where none went badly; outside trackers have none."""
    from acp_lab.bench.runner import watch
    from acp_lab.commands.console import Progress
    from acp_lab.display.replay.recorder import Replay

    by_key = {(task.method_name, task.sequence, task.variant): task for task in tasks}
    found: dict[str, Path] = {}
    with Progress() as bar:
        for number, method in enumerate(report.methods):
            own = [run for run in (*worst, *report.runs) if run.method == method and not run.variant.resets]
            run = next((run for run in own if (method, run.sequence, run.variant) in by_key), None)
            if run is None or len(found) == _MOST_REPLAYS:
                continue
            task = by_key[method, run.sequence, run.variant]
            path = folder / f"{Path(task.file_name).stem}--{task.state}.rrd"
            if not path.exists():
                path.parent.mkdir(parents=True, exist_ok=True)
                # Under its own name when it is whole: half a replay, of a run that was killed, would be linked to.
                unfinished = path.with_name(f"{path.stem}.unfinished.rrd")
                try:
                    watch(task, [Replay(unfinished, most_mb=_REPLAY_MB)])
                    unfinished.replace(path)
                except AcpLabError:  # a start that is refused leaves nothing to see
                    continue
                finally:
                    unfinished.unlink(missing_ok=True)
            bar("replays", number + 1, len(report.methods))
            found[f"{method}: {run.sequence}, {run.variant}"] = path
    return found


def _print(report: Report, out: Path) -> None:
    for group, how, rows in report.blocks():
        print(f"{group}: {how}")
        for row in rows:
            compared = f"@5% {row.verdicts[1]}" if row.verdicts else ""
            shares = "  ".join(f"{100 * interval.mean:5.1f}" for interval in row.recalls)
            lost = f"{row.lost} of {row.runs} lost"
            print(f"  {row.method:<20} @2/5/10% {shares}  {row.ms_median:6.1f} ms  {lost}  {compared}".rstrip())
    print(f"{out / 'index.html'}: tables, plots, failures; bench.csv, bench.json and bench.md beside it")


def _tell_poses(poses: Sequence[Path], folder: Path) -> None:
    """Which results files are of this bench; others in their folder are of an earlier one, or somebody else's."""
    others = sorted({path.name for path in folder.glob("*.csv")} - {path.name for path in poses})
    told = f"{len(poses)} of this bench" if poses else "none of this bench"
    beside = f"; not of it: {', '.join(others)}" if others else ""
    print(f"{folder}: poses of runs from truth on every frame, without resets: {told}{beside}")


def _two_numbers(text: str) -> tuple[float, float]:
    words = text.split(",")
    try:
        degrees, mm = map(float, words)
    except ValueError:
        raise ParameterError(f"--noise {text}: give degrees and mm, as 2,2") from None
    return degrees, mm


def _whole_numbers(text: str) -> list[int]:
    words = [word.strip() for word in text.split(",")]
    if not all(word.isascii() and word.isdigit() and len(word) < 9 for word in words):
        raise ParameterError(f"--steps {text}: give whole numbers, as 1,2")
    return list(dict.fromkeys(map(int, words)))
