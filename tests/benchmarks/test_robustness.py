"""Runs in any order of frames, what counts in them, what a file of runs keeps, and the numbers of a group."""

from __future__ import annotations

import json
import math
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest

from acp_lab.errors import InputFileError
from acp_lab.prepared_part import PreparedPart
from acp_lab.sample import sample_dataset
from acp_lab.tracking.method import ACP, METHODS
from benchmarks import runs
from benchmarks.robustness import CHECKING, grouped, is_in_split, print_comparison, summary, within
from benchmarks.runs import Job, Run, complete, read_runs, state_of, visible_frames
from data_recipes.metal.plan import FIRST_PARTS, PART_NAMES
from tests.prepared_sample import sample_model, sample_scene

RUN = Run(
    "acp", "0", "made/1/1", "forwards", "truth", "0", "block", "fast",
    frames=[1, 2, 3], errors=[0.01, 0.04, 0.2], counts=[True, True, True], ms=[2.0, 4.0, 9.0],
)  # fmt: skip


def job(order: str = "forwards", start: str = "truth", seed: int = 0) -> Job:
    return Job(sample_dataset(), Path("parts"), sample_scene().scene_id, 1, ACP, order, start, seed)


def test_halves_share_no_part_and_half_of_the_later_made_parts_are_for_checking() -> None:
    later = set(PART_NAMES[8:])
    assert len(CHECKING & later) == len(later) // 2
    assert not CHECKING & set(FIRST_PARTS)
    for part in (*PART_NAMES, "metal_dev/1", "metal_dev/2"):
        assert is_in_split(part, "tuning") != is_in_split(part, "checking")
        assert is_in_split(part, "all")


@pytest.mark.parametrize(("errors", "lost"), [([0.01, 0.31], True), ([0.01, None], True), ([0.01, 0.29], False)])
def test_a_run_is_lost_by_one_frame_beyond_30_percent_or_without_a_pose(errors: list[float], lost: bool) -> None:
    assert replace(RUN, errors=errors, counts=[True, True]).lost == lost
    assert not replace(RUN, errors=errors, counts=[True, False]).lost


def test_times_are_those_of_frames_that_are_not_lost() -> None:
    assert replace(RUN, errors=[0.01, 0.5, None]).ms_while_tracked == [2.0]


def test_frames_of_which_too_little_is_seen_do_not_count(tmp_path: Path) -> None:
    truth = {"0": [{"obj_id": 7}, {"obj_id": 2}], "3": [{"obj_id": 2}]}
    seen = {"0": [{"visib_fract": 0.9}, {"visib_fract": 0.2}], "3": [{"visib_fract": 0.3}]}
    (tmp_path / "scene_gt.json").write_text(json.dumps(truth))
    assert visible_frames(tmp_path, 2, [0, 3]) == {0: True, 3: True}
    (tmp_path / "scene_gt_info.json").write_text(json.dumps(seen))
    assert visible_frames(tmp_path, 2, [0, 3]) == {0: False, 3: True}
    assert visible_frames(tmp_path, 7, [0, 3]) == {0: True, 3: True}


@pytest.fixture
def prepared_sample(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(PreparedPart, "load", lambda *_: sample_model())
    runs._prepared.cache_clear()


@pytest.mark.usefixtures("prepared_sample")
def test_backwards_starts_from_the_truth_of_the_last_frame() -> None:
    run = runs.track(job("backwards"))
    assert run.frames == list(sample_scene().frame_ids[-2::-1])
    assert not run.lost
    assert run.part == "l_bracket"
    assert run.key == job("backwards").key


@pytest.mark.usefixtures("prepared_sample")
def test_every_third_frame_from_a_start_that_is_refused_is_lost(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(runs.STARTS, "truth", (0.0, 5e4))
    run = runs.track(job("third"))
    assert run.frames == list(sample_scene().frame_ids[3::3])
    assert run.errors == [None] * len(run.frames)
    assert run.lost
    assert run.ms_while_tracked == []


class HereInThisProcess:
    """In the place of a pool of processes."""

    def __init__(self, *_: object, **__: object) -> None:
        self.map = map

    def shutdown(self, cancel_futures: bool) -> None: ...


def as_run(job: Job) -> Run:
    name, state, sequence, order, start, seed = job.key
    return replace(RUN, method=name, state=state, sequence=sequence, order=order, start=start, seed=seed)


def test_a_file_that_was_cut_off_is_taken_up_where_it_ends(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file, known, missing = tmp_path / "runs.jsonl", job(), job(start="5", seed=3)
    file.write_text(json.dumps(asdict(as_run(known))) + '\n{"method": "ac')
    asked = []
    monkeypatch.setattr(runs, "ProcessPoolExecutor", HereInThisProcess)
    monkeypatch.setattr(runs, "track", lambda job: asked.append(job) or as_run(job))
    assert list(complete([known, missing], file, processes=1)) == [as_run(known), as_run(missing)]
    assert asked == [missing]
    assert read_runs(file) == [as_run(known), as_run(missing)]


def test_a_file_of_something_else_is_refused(tmp_path: Path) -> None:
    (tmp_path / "runs.jsonl").write_text('{"scene": 1}\n')
    with pytest.raises(InputFileError, match=r"runs\.jsonl: line 1 is no run"):
        read_runs(tmp_path / "runs.jsonl")


def test_a_changed_method_is_another_state() -> None:
    states = {state_of(method) for method in (*METHODS.values(), replace(ACP, margin_px=ACP.margin_px + 1))}
    assert len(states) == len(METHODS) + 1


def test_a_group_averages_seeds_within_a_sequence_and_then_sequences() -> None:
    worse = replace(RUN, seed="1", errors=[0.01, None, 0.2])
    other = replace(RUN, sequence="made/2/1", errors=[0.01], counts=[True], ms=[3.0])
    np.testing.assert_allclose(within([RUN, worse], 0.05)["made/1/1"], [1.0, 0.5, 0.0])
    found = summary([RUN, worse, other])
    assert found["@5"] == pytest.approx((0.5 + 1.0) / 2)
    assert found["@5 low"] <= found["@5"] <= found["@5 high"]
    assert (found["lost"], found["runs"]) == (1, 3)
    assert found["ms worst"] == 9.0
    assert math.isnan(summary([replace(RUN, errors=[None, None, None])])["ms"])


def test_data_sets_are_groups_of_their_own_and_together() -> None:
    other = replace(RUN, sequence="more/1/1", order="backwards")
    groups = grouped([RUN, other])
    assert list(groups) == [
        ("made", "forwards", "truth"), ("all", "forwards", "truth"),
        ("more", "backwards", "truth"), ("all", "backwards", "truth"),
    ]  # fmt: skip


def test_comparison_pairs_runs_and_marks_a_clear_gain(capsys: pytest.CaptureFixture[str]) -> None:
    better = replace(RUN, method="new", errors=[0.01, 0.01, 0.01])
    alone = replace(better, sequence="made/9/1", errors=[0.5, 0.5, 0.5])
    print_comparison("acp", "new", [RUN, better, alone])
    line = capsys.readouterr().out.splitlines()[-1]
    assert line.startswith("| made (1) | forwards | truth | +0.667")
    assert "+0.333 [+0.333, +0.333] *" in line
    assert line.endswith("| 0 to 0 |")
