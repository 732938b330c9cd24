"""Runs over processes: the same numbers, taken up again, and a worker's death costs what it had in hand."""

from __future__ import annotations

import logging
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from acp_lab.bench import spread, workers
from acp_lab.bench.protocol import SequenceKey, Task, Variant, task_of
from acp_lab.bench.record import read_run
from acp_lab.bench.runner import run
from acp_lab.bench.spread import complete
from acp_lab.errors import AcpLabError, ParameterError
from acp_lab.preparation import prepare
from acp_lab.prepared_part import PrepareOptions
from acp_lab.sequences.bop import BopDataset
from acp_lab.tracking.method import ACP_EDGES
from tests.bench.made_runs import made_run
from tests.commands.conftest import write_dataset

PROJECT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def tasks(tmp_path_factory: pytest.TempPathFactory) -> list[Task]:
    """Eight runs on two drawn boxes."""
    root = tmp_path_factory.mktemp("spread")
    write_dataset(root / "boxes")
    for object_id in (1, 4):
        prepare(BopDataset(root / "boxes").part(object_id), PrepareOptions(generator="templates"), out=root / "parts")
    variants = [Variant(), *(Variant(noise_deg=1.0, noise_mm=1.0, seed=seed) for seed in range(3))]
    return [
        task_of(root / "boxes", "test", root / "parts", SequenceKey("boxes", 1, object_id), ACP_EDGES, variant)
        for object_id in (1, 4)
        for variant in variants
    ]


@dataclass(frozen=True)
class Cluster:
    """A dask scheduler's address, and its process."""

    address: str
    process: subprocess.Popen[bytes]


@pytest.fixture
def cluster() -> Iterator[Cluster]:
    """A dask scheduler and two workers, as somebody would start them by hand."""
    environment = {**os.environ, "PYTHONPATH": str(PROJECT), "OMP_NUM_THREADS": "1"}

    def start(*words: str) -> subprocess.Popen[bytes]:
        return subprocess.Popen(
            [sys.executable, "-m", "dask", *words], env=environment, cwd=PROJECT,
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )  # fmt: skip

    from distributed import Client
    from distributed.utils import open_port

    address = f"tcp://127.0.0.1:{open_port()}"
    processes = [start("scheduler", "--host", "127.0.0.1", "--port", address.rpartition(":")[2], "--no-dashboard")]
    worker = ("worker", address, "--host", "127.0.0.1", "--nthreads", "1", "--no-dashboard")
    processes += [start(*worker) for _ in range(2)]
    try:
        with Client(address, timeout=30) as client:
            client.wait_for_workers(2, timeout=60)
        yield Cluster(address, processes[0])
    finally:
        for process in processes[::-1]:
            process.terminate()
        for process in processes:
            process.wait(timeout=30)


def assert_same(one, other) -> None:  # type: ignore[no-untyped-def]
    assert (one.method, one.sequence, one.variant) == (other.method, other.sequence, other.variant)
    np.testing.assert_allclose(one.poses, other.poses, rtol=0, atol=1e-8)  # what a file rounds to


@pytest.mark.slow
def test_two_processes_here_or_a_cluster_give_what_one_process_gives(
    tasks: list[Task], cluster: Cluster, tmp_path: Path
) -> None:
    alone = [run(task) for task in tasks]
    for where, how in (("here", {"workers": 2}), ("there", {"scheduler": cluster.address})):
        for one, other in zip(alone, complete(tasks, tmp_path / where, **how), strict=True):  # type: ignore[arg-type]
            assert_same(one, other)


@pytest.mark.slow
def test_a_worker_that_is_killed_costs_only_what_it_had_in_hand(
    tasks: list[Task], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from distributed import get_client

    victims: list[int] = []
    done: list[int] = []

    def progress(count: int, _: int) -> None:
        done.append(count)
        if count == 2 and not victims:
            victims.extend(get_client().run(os.getpid).values())
            os.kill(victims[0], signal.SIGKILL)

    assert len(complete(tasks, tmp_path, workers=2, progress=progress)) == len(tasks)
    assert len(victims) == 2
    assert done == list(range(len(tasks) + 1))
    assert len(list(tmp_path.glob("*.json"))) == len(tasks)


def die_of(text: str) -> str:
    """What a process without memory does, where the text says so."""
    if text == "too much":
        os.kill(os.getpid(), signal.SIGKILL)
    return text


@pytest.mark.slow
def test_what_kills_every_worker_is_named() -> None:
    with pytest.raises(AcpLabError, match="large: every worker that took this died: look at its memory"):
        list(workers.each(die_of, {"small": "little", "large": "too much", "other": "little"}, workers=2))


@pytest.mark.slow
def test_a_scheduler_that_goes_away_costs_only_what_was_in_hand(
    tasks: list[Task], cluster: Cluster, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    def progress(count: int, _: int) -> None:
        if count == 2:
            cluster.process.kill()

    log = logging.getLogger("distributed.client")
    log.addHandler(caplog.handler)
    try:
        with pytest.raises(AcpLabError, match="the scheduler went away; what is done is kept"):
            complete(tasks, tmp_path, scheduler=cluster.address, progress=progress)
    finally:
        log.removeHandler(caplog.handler)
    assert caplog.records == []  # the error is one line, and dask adds none
    kept = {path: path.stat().st_mtime_ns for path in tmp_path.glob("*.json")}
    assert 2 <= len(kept) < len(tasks)
    for one, other in zip(complete(tasks, tmp_path, workers=1), map(run, tasks), strict=True):
        assert_same(one, other)
    assert {path: path.stat().st_mtime_ns for path in kept} == kept


def test_a_run_of_workers_with_other_files_is_refused_and_not_kept(
    tasks: list[Task], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def elsewhere(work: object, asked: dict[str, str], **_: object) -> Iterator[tuple[str, str]]:
        for name in asked:
            yield name, made_run([0.01]).to_json()  # whose state is another than the task's

    monkeypatch.setattr(workers, "each", elsewhere)
    with pytest.raises(AcpLabError, match=rf"{tasks[0].file_name}: done with other sources.*restart the workers"):
        complete(tasks, tmp_path, scheduler="tcp://somewhere:8786")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_a_bench_that_is_killed_costs_only_what_was_in_hand_and_leaves_no_process(
    tasks: list[Task], tmp_path: Path
) -> None:
    psutil = pytest.importorskip("psutil")
    root, out = Path(tasks[0].dataset), tmp_path / "out"
    parts = tmp_path / "parts"
    shutil.copytree(tasks[0].parts, parts / "boxes")
    words = ("bench", root, "--methods", "acp-edges", "--noise", "1,1", "--seeds", "40", "--parts", parts, "--out", out)
    environment = {**os.environ, "PYTHONPATH": str(PROJECT)}
    command = [sys.executable, "-m", "acp_lab", *map(str, words), "--jobs", "2"]
    bench = subprocess.Popen(command, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    deadline = time.monotonic() + 120
    while len(kept := list((out / "runs").glob("*.json"))) < 3:
        assert bench.poll() is None
        assert time.monotonic() < deadline
        time.sleep(0.02)
    family = psutil.Process(bench.pid).children(recursive=True)
    bench.kill()
    bench.wait(timeout=30)
    _, alive = psutil.wait_procs(family, timeout=30)
    assert len(family) >= 2
    assert alive == []
    kept = sorted((out / "runs").glob("*.json"))
    assert 3 <= len(kept) < 82
    written = {path: path.stat().st_mtime_ns for path in kept}
    assert all(read_run(path) is not None for path in kept)  # none is torn
    assert subprocess.run([*command[:-2], "--jobs", "1"], env=environment, check=False).returncode == 0
    assert len(list((out / "runs").glob("*.json"))) == 82
    assert {path: path.stat().st_mtime_ns for path in kept} == written


@pytest.mark.slow
def test_all_ports_are_of_this_machine_alone() -> None:
    psutil = pytest.importorskip("psutil")
    with workers._this_machine(2, 2):
        family = [psutil.Process(), *psutil.Process().children(recursive=True)]
        ports = [port for process in family for port in process.net_connections() if port.status == "LISTEN"]
    assert len(ports) >= 3
    assert {port.laddr.ip for port in ports} == {"127.0.0.1"}


def test_one_process_opens_no_port(tasks: list[Task], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise AssertionError("a cluster was asked for")

    monkeypatch.setattr(workers, "_this_machine", refuse)
    (found,) = complete(tasks[:1], tmp_path, workers=1)
    assert_same(found, run(tasks[0]))


def test_what_is_kept_is_not_run_again_unless_the_method_changed(
    tasks: list[Task], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[Task] = []

    def new_runs(missing: list[Task], processes: int, scheduler: str | None):  # type: ignore[no-untyped-def]
        for task in missing:
            asked.append(task)
            made = made_run([0.01], task.method_name, task.sequence, task.variant)
            object.__setattr__(made, "state", task.state)
            yield task, made
            if len(asked) == 3:
                raise KeyboardInterrupt

    monkeypatch.setattr(spread, "_new_runs", new_runs)
    with pytest.raises(KeyboardInterrupt):
        complete(tasks, tmp_path)
    first = list(asked)
    complete(tasks, tmp_path)
    assert len(first) == 3
    assert [*first, *asked[3:]] == tasks
    # One of another state, one that was torn: both are done again.
    old = read_run(tmp_path / tasks[0].file_name)
    assert old is not None
    object.__setattr__(old, "state", "old")
    old.write(tmp_path / tasks[0].file_name)
    (tmp_path / tasks[1].file_name).write_text("{")
    asked.clear()
    complete(tasks, tmp_path)
    assert asked == tasks[:2]


def test_nobody_at_the_address(tasks: list[Task], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(workers, "_CONNECT_S", 0.5)
    start = time.monotonic()
    with pytest.raises(ParameterError, match=r"--scheduler tcp://127\.0\.0\.1:9: no dask scheduler"):
        complete(tasks, tmp_path, scheduler="tcp://127.0.0.1:9")
    with pytest.raises(ParameterError, match="no dask scheduler answers"):
        complete(tasks, tmp_path, scheduler="no address at all")
    assert time.monotonic() - start < 60
