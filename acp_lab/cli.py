"""`acp-lab`: the command line. Options and one-line errors are here, the commands in acp_lab/commands.

Exit status: 0 done; 2 bad input or bad usage, with exactly one line `error: …` on stderr; 130 after Ctrl-C;
1 for anything else, which is our fault. ACP_LAB_DEBUG=1 shows tracebacks.

Only light modules are imported here: `acp-lab --help` must come at once, and the thread limits of a command
have to be set before NumPy is first imported.
"""

from __future__ import annotations

import io
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer

from acp_lab import __version__
from acp_lab.commands import console, interrupt
from acp_lab.commands.choices import Device, EdgeSource, Generator, Iterations, PaintingFrame, Unit
from acp_lab.commands.failure import tell_failure
from acp_lab.commands.regions import joined_regions, regions_of

app = typer.Typer(
    help="6DoF tracking of metal parts from their CAD models.",
    add_completion=False,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
    epilog="Start with: acp-lab demo. Each command has its own --help.",
)


Seed = Annotated[int, typer.Option(min=0, max=2**32 - 1, help="Seed of everything random.", metavar="N")]
PartsDir = Annotated[Path, typer.Option("--parts", help="Where `acp-lab prepare` put the parts.", metavar="PARTS_DIR")]


def _print_version(wanted: bool) -> None:
    if wanted:
        print(f"acp_lab {__version__}")
        raise typer.Exit


@app.callback()
def _top(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version and stop.")
    ] = False,
) -> None:
    """6DoF tracking of metal parts from their CAD models."""


@app.command()
def demo(
    out: Annotated[Path, typer.Option(help="Where to write.", metavar="DIR")] = Path("acp_lab_demo"),
) -> None:
    """Prepare the sample part, track the sample sequence, print accuracy and speed."""
    from acp_lab.commands.demo import run_demo

    run_demo(out)


@app.command()
def prepare(
    meshes: Annotated[list[Path], typer.Argument(help="PLY, OBJ, STL or STEP files.", metavar="MESH...")],
    out: Annotated[Path, typer.Option(help="Where the prepared parts go, one folder each.", metavar="PARTS_DIR")],
    generator: Annotated[
        Generator, typer.Option(help="both = templates + learned; autoencoder is the paper's.")
    ] = Generator.BOTH,
    fast: Annotated[bool, typer.Option("--fast", help="Train shortly: to try things out.")] = False,
    regions: Annotated[
        str, typer.Option(help="View regions to prepare: all, or some of 0 to 5.", metavar="all|K...")
    ] = "all",
    unit: Annotated[Unit, typer.Option(help="Of the numbers in PLY, OBJ and STL files.")] = Unit.MM,
    edge_break: Annotated[
        float | None,
        typer.Option(
            min=0,
            help="Size of the part's broken edges in mm; if not given, what was given before, else 0.25, in proportion "
            "beyond 60 to 160 mm.",
            metavar="MM",
        ),
    ] = None,
    symmetries: Annotated[
        bool,
        typer.Option(
            "--symmetries/--no-symmetries",
            help="Find turns after which the mesh looks the same, unless models_info.json tells them.",
        ),
    ] = True,
    edges: Annotated[
        EdgeSource, typer.Option(help="What the auto-encoder learns: the mesh's edges, or Canny on rendered normals.")
    ] = EdgeSource.ANALYTIC,
    painting_frame: Annotated[
        PaintingFrame, typer.Option(help="Where the auto-encoder paints: at the pose, or at a frame's prediction.")
    ] = PaintingFrame.POSE,
    painting_px: Annotated[
        int | None,
        typer.Option(help="Side of what the auto-encoder paints; 192 if not given, 128 with --fast.", metavar="PX"),
    ] = None,
    device: Annotated[
        Device, typer.Option(help="Trains the auto-encoder; auto is a GPU where there is one.")
    ] = Device.AUTO,
    seed: Seed = 0,
    threads: Annotated[
        int, typer.Option(min=1, help="CPU threads; more rarely pay. Networks train in two.", metavar="N")
    ] = 1,
    resume: Annotated[
        bool,
        typer.Option("--resume/--no-resume", help="Go on with what is there, or replace it."),
    ] = True,
    jobs: Annotated[int, typer.Option(help="Parts prepared at a time, a process each.", metavar="N")] = 1,
    scheduler: Annotated[
        str | None, typer.Option(help="Prepare on a dask cluster: its scheduler's address.", metavar="ADDRESS")
    ] = None,
) -> None:
    """Prepare CAD models for tracking: edges, control points and the generators of edges."""
    from acp_lab.commands.machine import limit_threads

    # One thread is the default: the networks are so small that threads wait for each other longer than they work (on
    # a busy machine of two cores, two threads took seven times as long as one), and the numbers are the same on every
    # machine. The auto-encoder is large enough for two and takes them by itself; visibility networks train two at a
    # time, in a thread each.
    limit_threads(threads)
    from acp_lab.commands.prepare import Spread, prepare_parts
    from acp_lab.prepared_part import PrepareOptions

    options = PrepareOptions(
        generator=generator.value,
        fast=fast,
        regions=regions_of(regions),
        edge_break_mm=edge_break,
        edge_source=edges.value,
        seed=seed,
        resume=resume,
        painting_frame=painting_frame.value,
        painting_px=painting_px,
        device=device.value,
    )
    prepare_parts(meshes, out, options, unit.value, Spread(jobs, scheduler, threads), symmetries)


@app.command()
def track(
    dataset: Annotated[Path | None, typer.Argument(help="A data set in the BOP layout.", metavar="DATASET")] = None,
    *,
    parts: PartsDir,
    out: Annotated[Path, typer.Option(help="The results, replaced.", metavar="results.csv")],
    split: Annotated[str, typer.Option(help="The data set's folder of scenes.")] = "test",
    scene: Annotated[
        list[int] | None,
        typer.Option(min=0, help="A scene to track, repeatable; all by default.", metavar="N"),
    ] = None,
    object_id: Annotated[
        list[int] | None,
        typer.Option("--object", min=0, help="An object to track, repeatable; all by default.", metavar="N"),
    ] = None,
    method: Annotated[
        str | None,
        typer.Option(help="acp (default) or another; acp-lab methods lists them.", metavar="NAME"),
    ] = None,
    config: Annotated[
        Path | None, typer.Option(help="Instead of --method: a method's settings as TOML.", metavar="FILE")
    ] = None,
    video: Annotated[
        Path | None,
        typer.Option(help="Instead of a data set: a video, a folder of images, or a camera, 0.", metavar="FILE|DIR|N"),
    ] = None,
    mesh: Annotated[Path | None, typer.Option(help="With --video: the part.", metavar="MESH")] = None,
    camera: Annotated[Path | None, typer.Option(help="With --video: the camera.", metavar="CAMERA.json")] = None,
    init: Annotated[
        str | None,
        typer.Option(
            help="Start poses: gt (the first frame's truth), auto (found in the images) or a results file; "
            "with --video auto, a POSE.json or a results file.",
            metavar="gt|auto|FILE",
        ),
    ] = None,
    init_noise_deg: Annotated[
        float, typer.Option(min=0, help="Turn each start pose by D degrees, at random.", metavar="D")
    ] = 0.0,
    init_noise_mm: Annotated[
        float, typer.Option(min=0, help="Shift each start pose by M mm, at random.", metavar="M")
    ] = 0.0,
    seed: Seed = 0,
    replay: Annotated[Path | None, typer.Option(help="Also write a replay.", metavar="FILE.rrd")] = None,
    replay_iterations: Annotated[
        Iterations, typer.Option(help="Frames whose iterations go into the replay, too.")
    ] = Iterations.OFF,
    replay_max_mb: Annotated[
        float | None, typer.Option(min=5, help="Keep the replay below N MB: images are dropped first.", metavar="N")
    ] = None,
    threads: Annotated[int, typer.Option(min=1, help="CPU threads.", metavar="N")] = 1,
    max_frames: Annotated[
        int | None, typer.Option(min=1, help="Stop after that many frames of each scene.", metavar="N")
    ] = None,
    first_frame: Annotated[
        int | None,
        typer.Option(min=0, help="Start in image N; by default in the first one that has start poses.", metavar="N"),
    ] = None,
    resume: Annotated[bool, typer.Option("--resume", help="Go on after the rows of a run that was stopped.")] = False,
) -> None:
    """Track prepared parts through a data set or a video."""
    from acp_lab.commands.machine import limit_threads
    from acp_lab.commands.track import TrackOptions

    limit_threads(threads)  # before NumPy is imported
    options = TrackOptions(
        dataset=dataset,
        video=video,
        mesh=mesh,
        camera=camera,
        parts=parts,
        out=out,
        split=split,
        scenes=tuple(scene or ()),
        objects=tuple(object_id or ()),
        method=method,
        config=config,
        init=init,
        noise_deg=init_noise_deg,
        noise_mm=init_noise_mm,
        seed=seed,
        replay=replay,
        replay_iterations=replay_iterations.value,
        replay_max_mb=replay_max_mb,
        threads=threads,
        max_frames=max_frames,
        resume=resume,
        first_frame=first_frame,
    )
    from acp_lab.commands.track_run import track_parts

    track_parts(options)


@app.command()
def detect(
    source: Annotated[
        Path,
        typer.Argument(
            help="A data set in the BOP layout, an image, a video, or a folder of images.",
            metavar="DATASET|IMAGE|VIDEO",
        ),
    ],
    *,
    parts: PartsDir,
    out: Annotated[
        Path, typer.Option(help="The hypotheses, best first; a picture goes beside it.", metavar="FILE.csv")
    ],
    split: Annotated[str, typer.Option(help="The data set's folder of scenes.")] = "test",
    scene: Annotated[
        list[int] | None,
        typer.Option(min=0, help="A scene to look at, repeatable; all by default.", metavar="N"),
    ] = None,
    step: Annotated[int, typer.Option(min=1, help="Look at every N-th frame.", metavar="N")] = 1,
    each: Annotated[
        bool,
        typer.Option("--each", help="Find each of several parts that are alike, as in a tray."),
    ] = False,
    top: Annotated[
        int | None,
        typer.Option(min=1, help="Hypotheses per frame and object, at most: 3, with --each 20.", metavar="K"),
    ] = None,
    depth_mm: Annotated[
        tuple[float, float] | None,
        typer.Option(
            help="Nearest and farthest distance in mm; 250 to 1200, and more for very small or large parts.",
            metavar="MIN MAX",
        ),
    ] = None,
    camera: Annotated[
        Path | None, typer.Option(help="With images or a video: their camera.", metavar="CAMERA.json")
    ] = None,
    mesh: Annotated[
        Path | None,
        typer.Option(help="With images or a video: the part; by default the only one in PARTS_DIR.", metavar="MESH"),
    ] = None,
    threads: Annotated[int, typer.Option(min=1, help="CPU threads.", metavar="N")] = 1,
) -> None:
    """Find prepared parts without a first pose: ranked hypotheses for each frame."""
    from acp_lab.commands.machine import limit_threads

    limit_threads(threads)  # before NumPy is imported
    from acp_lab.commands.detect import DetectOptions, detect_parts

    detect_parts(DetectOptions(source, parts, out, camera, mesh, split, tuple(scene or ()), step, top, depth_mm, each))


@app.command("eval")
def evaluate(
    dataset: Annotated[Path, typer.Argument(help="A data set in the BOP layout, with truth.", metavar="DATASET")],
    results: Annotated[Path, typer.Argument(help="What `acp-lab track` wrote.", metavar="results.csv")],
    split: Annotated[str, typer.Option(help="The data set's folder of scenes.")] = "test",
    json: Annotated[Path | None, typer.Option(help="Also write the numbers as JSON.", metavar="FILE")] = None,
) -> None:
    """Compare results with the truth of a data set."""
    from acp_lab.commands.evaluate import evaluate_results

    evaluate_results(dataset, results, split, json)


@app.command()
def bench(
    datasets: Annotated[
        list[Path] | None,
        typer.Argument(help="Data sets in the BOP layout, with truth; the sample by default.", metavar="[DATASET...]"),
    ] = None,
    *,
    methods: Annotated[
        str, typer.Option(help="Names split by commas; others are held against the first.", metavar="A,B")
    ] = "acp,region",
    config: Annotated[
        list[Path] | None,
        typer.Option(help="Beside --methods: a method's settings as TOML; repeatable.", metavar="FILE"),
    ] = None,
    out: Annotated[Path, typer.Option(help="Where everything goes; taken up again.", metavar="DIR")] = Path(
        "acp_lab_bench"
    ),
    results_from: Annotated[
        list[Path] | None,
        typer.Option(help="Results of another tracker, named TRACKER__DATASET.csv; repeatable.", metavar="FILE"),
    ] = None,
    noise: Annotated[
        list[str] | None,
        typer.Option(help="Also from starts that are off by D degrees and M mm; repeatable.", metavar="D,M"),
    ] = None,
    seeds: Annotated[int, typer.Option(help="Directions of each --noise.", metavar="N")] = 20,
    steps: Annotated[str, typer.Option(help="Use every n-th frame, for each n.", metavar="N,N")] = "1",
    resets: Annotated[bool, typer.Option("--resets/--no-resets", help="Start a lost part again from truth.")] = False,
    parts: Annotated[
        Path | None,
        typer.Option(
            help="Prepared parts, a folder per data set; or of the only one. [default: DIR/parts]", metavar="DIR"
        ),
    ] = None,
    split: Annotated[str, typer.Option(help="The data sets' folder of scenes.")] = "test",
    scheduler: Annotated[
        str | None, typer.Option(help="Run on a dask cluster: its scheduler's address.", metavar="ADDRESS")
    ] = None,
    install_peers: Annotated[
        bool, typer.Option("--install-peers", help="First make the environment of RAPID, OLS and GOS, with pip.")
    ] = False,
    jobs: Annotated[
        int | None, typer.Option(help="Processes on this machine. [default: its cores]", metavar="N")
    ] = None,
) -> None:
    """Compare methods, and other trackers' results, on the same frames: tables and a page."""
    from acp_lab.commands.bench import BenchOptions, run_bench
    from acp_lab.commands.machine import cores, limit_threads

    limit_threads(1)  # before NumPy is imported
    from acp_lab.bench.workers import MOST_WORKERS

    run_bench(
        BenchOptions(
            tuple(datasets or ()),
            methods,
            out,
            parts,
            tuple(results_from or ()),
            tuple(noise or ()),
            seeds,
            steps,
            resets,
            split,
            scheduler,
            min(cores(), MOST_WORKERS) if jobs is None else jobs,
            install_peers,
            tuple(config or ()),
        )
    )


@app.command()
def replay(
    files: Annotated[list[Path], typer.Argument(help="Replays; two are shown side by side.", metavar="FILE.rrd...")],
    mp4: Annotated[Path | None, typer.Option(help="Write a film instead of opening a window.", metavar="FILE")] = None,
    web: Annotated[bool, typer.Option("--web", help="Show it in a browser, as without a display.")] = False,
) -> None:
    """Look at a replay."""
    from acp_lab.commands.replay import show_replays

    raise typer.Exit(show_replays(tuple(files), mp4, web))


@app.command()
def explain(
    source: Annotated[
        Path, typer.Argument(help="What `acp-lab track` wrote, results or replay.", metavar="FILE.rrd|results.csv")
    ],
    frame: Annotated[
        int | None, typer.Option(help="Counted from 0; by default where it was lost, or at its worst.", metavar="N")
    ] = None,
    dataset: Annotated[
        Path | None, typer.Option(help="The data set, where it is not where it was.", metavar="DIR")
    ] = None,
    scene: Annotated[int | None, typer.Option(help="By default the first one.", metavar="N")] = None,
    object_id: Annotated[int | None, typer.Option("--object", help="By default the first one.", metavar="N")] = None,
    out: Annotated[Path | None, typer.Option(help="Where the picture goes.", metavar="FILE.png")] = None,
) -> None:
    """Say in words, and with a picture, what was likely wrong in a frame."""
    from acp_lab.commands.explain import ExplainOptions, explain_run

    explain_run(ExplainOptions(source, frame, dataset, scene, object_id, out))


@app.command()
def methods(
    name: Annotated[str | None, typer.Argument(help="Print this method as TOML for --config.", metavar="NAME")] = None,
) -> None:
    """List the tracking methods, or print one of them whole."""
    from acp_lab.commands.methods import print_methods

    print_methods(name)


@app.command()
def doctor() -> None:
    """Say what works on this machine, and how to fix what does not."""
    from acp_lab.commands.doctor import print_report

    raise typer.Exit(print_report())


@app.command()
def lab(
    folder: Annotated[
        Path | None,
        typer.Argument(
            help="After pip install: where the course is copied to. [default: acp_lab_course]", metavar="FOLDER"
        ),
    ] = None,
    browser: Annotated[bool, typer.Option("--browser/--no-browser", help="Open a browser window.")] = True,
) -> None:
    """Open JupyterLab on the first notebook of the course."""
    from acp_lab.commands.lab import open_lab

    raise typer.Exit(open_lab(browser, folder))


def _let_print_anything() -> None:
    """Names and signs such as ° that the terminal's encoding lacks are printed as escapes, and end no command."""
    if isinstance(sys.stdout, io.TextIOWrapper):  # a caller may have put something else in its place
        sys.stdout.reconfigure(errors="backslashreplace")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; the exit status, never an exception. arguments: without the program's name."""
    words = joined_regions(list(sys.argv[1:] if arguments is None else arguments))
    console.drop_notes()
    _let_print_anything()
    with console.native_code_silenced(), console.warnings_as_notes(), interrupt.remembered():
        try:
            # Not app(...): that would install typer's own printing of exceptions.
            status = typer.main.get_command(app).main(words, prog_name="acp-lab", standalone_mode=False)
            # It makes a status of a key that was pressed, and an empty line, for which nobody asked.
            if status == interrupt.EXIT_STATUS or interrupt.pressed():
                raise KeyboardInterrupt
            console.release_notes()
            return status if isinstance(status, int) else 0
        except BaseException as error:
            if isinstance(error, KeyboardInterrupt | typer.Abort) or interrupt.pressed():
                return interrupt.tell()
            if isinstance(error, SystemExit) and isinstance(error.__context__, OSError):
                error = error.__context__  # click leaves like that where the reader of a pipe is gone
            if not isinstance(error, Exception):
                raise
            return tell_failure(error)
