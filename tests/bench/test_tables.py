"""Groups, intervals, ties, outside results and the files of a bench."""

from __future__ import annotations

import csv
import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from acp_lab.bench.basins import basins
from acp_lab.bench.outside import outside_runs, roots_by_name, tracker_and_dataset
from acp_lab.bench.peers import PAPER_TABLES, PEERS, peer_of, stands_for
from acp_lab.bench.protocol import SequenceKey, Variant
from acp_lab.bench.record import Run
from acp_lab.bench.report import Report, flat_rows, markdown
from acp_lab.bench.tables import difference, main_variant, table, verdict
from acp_lab.display.bench_page import Thumbnail, _cut, failures, thumbnail, write_page
from acp_lab.errors import InputFileError, SequenceError
from acp_lab.evaluation import evaluate
from acp_lab.evaluation.bootstrap import Interval
from acp_lab.sample import sample_dataset
from acp_lab.sequences import read_results
from acp_lab.sequences.results_csv import HEADER, ResultRow, ResultsWriter
from tests.bench.made_runs import made_run
from tests.prepared_sample import sample_scene

GOOD, BAD = [0.01] * 30, [0.2] * 30


def sequences(count: int = 3, dataset: str = "made") -> list[SequenceKey]:
    return [SequenceKey(dataset, number, 1) for number in range(1, count + 1)]


def test_methods_are_paired_and_small_differences_are_ties() -> None:
    rng = np.random.default_rng(0)
    mixed = [rng.choice([0.01, 0.2], 30) for _ in range(6)]
    runs = [made_run(errors, "a", key) for errors, key in zip(mixed, sequences(6), strict=True)]
    runs += [made_run(rng.permutation(errors), "same", key) for errors, key in zip(mixed, sequences(6), strict=True)]
    runs += [made_run(BAD, "bad", key) for key in sequences(6)]
    rows = {row.method: row for row in table(runs)}
    assert rows["a"].verdicts == ()
    assert rows["same"].verdicts == ("tie", "tie", "tie")
    assert rows["bad"].verdicts == ("worse", "worse", "worse")
    gain = rows["bad"].against[0]
    assert gain.mean == pytest.approx(-np.mean([np.mean(errors < 0.02) for errors in mixed]))
    assert gain.low <= gain.mean <= gain.high < 0.0


@pytest.mark.parametrize(
    ("low", "high", "expected"), [(0.1, 0.3, "better"), (-0.3, -0.1, "worse"), (-0.1, 0.3, "tie"), (0.0, 0.0, "tie")]
)
def test_a_tie_is_an_interval_that_holds_zero(low: float, high: float, expected: str) -> None:
    assert verdict(Interval(0.5 * (low + high), low, high)) == expected


def test_only_sequences_that_both_have_are_compared() -> None:
    first = [made_run(GOOD, "a", key) for key in sequences(2)]
    other = [made_run(BAD, "b", sequences(3)[2])]
    assert difference(first, other, 0.05) is None
    shared = [*other, made_run(GOOD, "b", sequences()[0])]
    found = difference(first, shared, 0.05)
    assert found is not None
    assert found.mean == 0.0


def test_seeds_are_averaged_within_their_sequence_and_lost_runs_counted() -> None:
    key = sequences(1)[0]
    runs = [made_run(errors, variant=Variant(noise_deg=2.0, seed=seed), sequence=key)
            for seed, errors in enumerate((GOOD, [0.5] * 30))]  # fmt: skip
    (row,) = table(runs)
    assert (row.sequences, row.runs, row.lost) == (1, 2, 1)
    assert row.recalls[0].mean == pytest.approx(0.5)
    assert row.until_lost == pytest.approx(15.0)


def with_starts(method: str, errors: list[list[float]]) -> list[Run]:
    """Runs on one sequence from as many starts."""
    key = sequences(1)[0]
    return [made_run(e, method, key, Variant(noise_deg=5.0, seed=seed)) for seed, e in enumerate(errors)]


def test_intervals_tell_which_starts_were_drawn() -> None:
    """On one sequence, too: 14 of 15 starts come to the part."""
    runs = with_starts("a", [GOOD] * 14 + [BAD])
    (row,) = table(runs)
    assert row.recalls[0].mean == pytest.approx(14 / 15)
    assert row.recalls[0].low == pytest.approx(0.8)
    assert row.recalls[0].high == 1.0
    (basin,) = basins(runs)
    assert (basin.found.low, basin.found.high) == (pytest.approx(0.8), 1.0)


def test_methods_are_paired_by_start_whatever_the_order_of_runs() -> None:
    """What is better from one start of fifteen may come from that start alone; from each it is better."""
    first = with_starts("a", [BAD] * 15)
    once, always = with_starts("once", [GOOD] + [BAD] * 14), with_starts("always", [GOOD] * 15)
    rows = {row.method: row for row in table([*first, *once[::-1], *always[::-1]])}
    assert rows["once"].verdicts == ("tie", "tie", "tie")
    assert rows["always"].verdicts == ("better", "better", "better")
    mixed = [GOOD, BAD] * 10
    same = difference(with_starts("a", mixed), with_starts("b", mixed)[::-1], 0.05)
    assert (same.mean, same.low, same.high) == (0.0, 0.0, 0.0)  # type: ignore[union-attr]
    fewer = difference(with_starts("a", mixed), with_starts("b", mixed)[:3], 0.05)
    assert (fewer.mean, fewer.low, fewer.high) == (0.0, 0.0, 0.0)  # type: ignore[union-attr]


def test_groups_are_data_sets_and_kinds() -> None:
    runs = [made_run(GOOD, sequence=SequenceKey("x", 1, 1), kind="fast"),
            made_run(BAD, sequence=SequenceKey("x", 2, 1), kind="slow"),
            made_run(GOOD, sequence=SequenceKey("y", 1, 1))]  # fmt: skip
    assert [row.group for row in table(runs)] == ["all", "x", "x: fast", "x: slow", "y"]


def test_times_are_those_of_frames_that_are_not_lost() -> None:
    run = made_run([0.01, 0.02, 0.9])
    run.ms[:] = 2.0, 4.0, 1000.0
    (row,) = table([run])
    assert row.ms_median == pytest.approx(3.0)


def sample_rows(shift_mm: float) -> list[ResultRow]:
    rows = []
    for frame_id in sample_scene().frame_ids:
        pose = sample_scene().truth(frame_id, 1)
        assert pose is not None
        pose[2, 3] += shift_mm
        rows.append(ResultRow(1, frame_id, 1, 0.7, pose, 0.012))
    return rows


def write_rows(path: Path, rows: list[ResultRow]) -> Path:
    with ResultsWriter(path) as results:
        for row in rows:
            results.append(row)
    return path


def test_an_outside_tracker_is_scored_as_eval_scores_it(tmp_path: Path) -> None:
    path = write_rows(tmp_path / "Their_tracker.csv", [row for row in sample_rows(2.5) if row.im_id % 5])
    (run,) = outside_runs(path, {"sample": sample_dataset()})
    assert run.method == "Their tracker"
    shown = run.distance[np.isfinite(run.distance)]
    np.testing.assert_allclose(shown, 2.5 / sample_scene().dataset.part(1).diameter, rtol=1e-9)
    np.testing.assert_allclose(run.ms[np.isfinite(run.ms)], 12.0)
    expected = evaluate(path, sample_scene()).pooled
    (row,) = table([run])
    assert (row.pooled.recall_2, row.pooled.frames) == (expected.recall_2, expected.frames)
    assert row.pooled.frames_until_lost == expected.frames_until_lost


def test_the_file_name_tells_the_data_set(tmp_path: Path) -> None:
    roots = {"x": tmp_path, "y": tmp_path}
    assert tracker_and_dataset(Path("SRT3D__y.csv"), roots) == ("SRT3D", "y")
    assert tracker_and_dataset(Path("SRT3D.csv"), {"x": tmp_path}) == ("SRT3D", "x")
    for name in ("SRT3D.csv", "SRT3D__z.csv"):
        with pytest.raises(InputFileError, match=r"SRT3D__DATASET\.csv"):
            tracker_and_dataset(Path(name), roots)


def test_outside_rows_of_nothing_are_refused(tmp_path: Path) -> None:
    empty = tmp_path / "t.csv"
    empty.write_text(",".join(HEADER) + "\n")
    with pytest.raises(InputFileError, match="no rows"):
        outside_runs(empty, {"sample": sample_dataset()})
    wrong = write_rows(tmp_path / "u.csv", [ResultRow(1, 10**6, 1, 1.0, np.eye(4))])
    with pytest.raises(SequenceError, match=r"u\.csv: image 1000000 of scene 1: .* has none of it"):
        outside_runs(wrong, {"sample": sample_dataset()})
    wrong = write_rows(tmp_path / "v.csv", [ResultRow(9, 0, 1, 1.0, np.eye(4))])
    with pytest.raises(SequenceError, match=r"v\.csv: scene 9: .* has none of it: remove its rows"):
        outside_runs(wrong, {"sample": sample_dataset()})


def test_two_data_sets_of_one_name_are_refused(tmp_path: Path) -> None:
    for above in ("a", "b"):
        (tmp_path / above / "data").mkdir(parents=True)
    with pytest.raises(InputFileError, match="same name"):
        roots_by_name([tmp_path / "a" / "data", tmp_path / "b" / "data"])


def test_every_row_of_the_papers_tables_has_a_source() -> None:
    for paper in PAPER_TABLES:
        assert all(peer_of(row).where for row in paper.rows)
    srt3d = next(peer for peer in PEERS if peer.name == "SRT3D")
    assert stands_for(srt3d, ["acp", "region"]) == "region"
    assert stands_for(srt3d, ["acp", "region", "SRT3D"]) == "SRT3D"
    assert stands_for(srt3d, ["acp"]) is None


def report_of(tmp_path: Path) -> tuple[Report, list[Run]]:
    rows = sample_rows(40.0)
    theirs = outside_runs(write_rows(tmp_path / "SRT3D.csv", rows), {"sample": sample_dataset()})
    ours = made_run([0.01] * len(theirs[0].frame_ids), "acp", theirs[0].sequence)
    ours = Run(**{**vars(ours), "frame_ids": theirs[0].frame_ids, "poses": theirs[0].poses, "kind": theirs[0].kind})
    return Report.of([ours, *theirs], "a machine"), [ours, *theirs]


def test_all_files_say_the_same(tmp_path: Path) -> None:
    report, runs = report_of(tmp_path)
    report.write(tmp_path / "out")
    with (tmp_path / "out" / "bench.csv").open(encoding="utf-8") as file:
        told = list(csv.DictReader(file))
    kept = json.loads((tmp_path / "out" / "bench.json").read_text())["rows"]
    assert [row["method"] for row in told] == ["acp", "SRT3D"] == [row["method"] for row in kept]
    assert float(told[0]["mean_recall_2"]) == kept[0]["mean_recall_2"] == 1.0
    assert kept[1]["gain_2_is"] == "worse"
    assert all(value is None or value == value for row in flat_rows(report) for value in row.values())
    text = (tmp_path / "out" / "bench.md").read_text(encoding="utf-8")
    assert text == markdown(report)
    reported = next(line for line in text.splitlines() if line.startswith("| SRT3D | 27.5"))
    assert "| SRT3D | 0.0 [0.0, 0.0]" in reported
    assert len(read_results(tmp_path / "out" / "results" / "SRT3D__sample.csv")) == len(runs[1].frame_ids)


def test_the_page_holds_everything_and_asks_for_nothing(tmp_path: Path) -> None:
    report, runs = report_of(tmp_path)
    (lost,) = failures(runs)
    assert lost.method == "SRT3D"
    picture = thumbnail(lost, sample_dataset(), "test")
    assert isinstance(picture, Thumbnail)
    assert picture.jpeg[:2] == b"\xff\xd8"
    write_page(report, tmp_path / "index.html", [picture], {"a <run>": tmp_path / "replays" / "x.rrd"})
    page = (tmp_path / "index.html").read_text(encoding="utf-8")
    assert 'href="replays/x.rrd"' in page
    assert "a &lt;run&gt;" in page
    assert page.count("data:image/jpeg;base64,") == 1
    assert "<svg" in page
    assert "Table III" in page
    # Namespaces and licences of SVG are names, nothing is fetched.
    assert 'src="http' not in page
    assert "<script" not in page
    assert "<link" not in page


@pytest.mark.parametrize(
    "points",
    [
        [[635.0, 100.0], [700.0, 400.0]],  # leaves at the right
        [[700.0, 100.0], [800.0, 400.0]],  # has left
        [[-300.0, 100.0], [-200.0, 400.0]],
        [[900.0, 900.0], [950.0, 950.0]],  # beyond a corner
        [[100.0, 470.0], [500.0, 600.0]],  # leaves below
        [[10.0, 10.0], [600.0, 400.0]],
        [],
    ],
)
def test_pictures_of_parts_at_the_border_have_a_usual_shape(points: list[list[float]]) -> None:
    image = np.zeros((480, 640, 3), np.uint8)
    height, width = _cut(image, np.array(points, float).reshape(-1, 2)).shape[:2]
    assert width == 280
    assert 100 <= height <= 2 * 280 + 10


def test_a_picture_names_the_metric_of_its_part(tmp_path: Path) -> None:
    sequence = SequenceKey("sample", 1, 1)
    run = replace(made_run([0.01, 0.4], sequence=sequence), metric="ADD-S")
    picture = thumbnail(run, sample_dataset(), "test")
    assert picture is not None
    assert "; ADD-S 40% of the diameter" in picture.told


def test_a_page_without_data_for_a_plot_says_what_would_fill_it(tmp_path: Path) -> None:
    report, _ = report_of(tmp_path)
    write_page(report, tmp_path / "index.html", [], {})
    page = (tmp_path / "index.html").read_text(encoding="utf-8")
    assert "give several --steps to see this" in page
    more = [made_run(GOOD, variant=Variant(step)) for step in (1, 2)]
    write_page(Report.of(more, ""), tmp_path / "index.html", [], {})
    assert "give several --steps to see this" not in (tmp_path / "index.html").read_text(encoding="utf-8")


def test_a_bench_without_times_or_memory_has_dashes() -> None:
    run = made_run(GOOD, ms=math.nan)
    line = next(line for line in markdown(Report.of([run], "")).splitlines() if line.startswith("| acp |"))
    assert line.endswith("| - | - | 200 | 12.0 |")


def test_only_runs_that_a_results_file_can_tell_are_written_as_one(tmp_path: Path) -> None:
    runs = [made_run(GOOD), made_run(GOOD, "other", variant=Variant(2)), made_run(GOOD, variant=Variant(resets=True))]
    assert Report.of(runs, "").write(tmp_path) == (tmp_path / "results" / "acp__made.csv",)
    assert Report.of(runs[1:], "").write(tmp_path / "none") == ()
    assert not (tmp_path / "none" / "results").exists()


def test_memory_is_told_as_that_of_the_process() -> None:
    text = markdown(Report.of([made_run(GOOD)], ""))
    assert "| MB so far |" in text
    assert "no method's own" in text


def test_the_main_variant_is_that_of_most_methods_and_the_plainest() -> None:
    def variants(*of: tuple[str, Variant]) -> Variant:
        runs = [made_run(GOOD, method, variant=how) for method, how in of]
        assert main_variant(runs) == main_variant(table(runs))
        return main_variant(runs)

    off, seldom, reset = Variant(noise_deg=5.0, seed=3), Variant(2), Variant(resets=True)
    assert variants(("a", off), ("a", seldom), ("a", Variant()), ("b", Variant())) == Variant()
    assert variants(("a", off)) == replace(off, seed=0)
    assert variants(("a", Variant(2, 5.0)), ("a", seldom)) == seldom
    assert variants(("theirs", Variant()), ("a", reset), ("b", reset)) == reset
    assert main_variant([]) == Variant()


def test_basins_count_the_runs_that_come_to_the_part(tmp_path: Path) -> None:
    late, never, lost_later = [0.2] * 5 + [0.01] * 15, [0.2] * 20, [0.01] * 12 + [0.5] * 8
    off = [Variant(noise_deg=5.0, noise_mm=5.0, seed=seed) for seed in range(2)]
    first, second = sequences(2)
    runs = [made_run(GOOD, "a", first), made_run(late, "a", first, off[0]), made_run(never, "a", first, off[1])]
    runs += [made_run(lost_later, "a", second, how) for how in off] + [made_run([0.01] * 3, "b", first, off[0])]
    found = {(basin.method, basin.variant.start): basin for basin in basins(runs)}
    assert found["a", "truth"].found.mean == 1.0
    assert found["a", off[0].start].found.mean == pytest.approx(0.75)  # a half of the first sequence, all of the second
    assert (found["a", off[0].start].runs, found["b", off[0].start].runs) == (4, 1)
    report = Report.of(runs, "")
    report.write(tmp_path)
    told = json.loads((tmp_path / "bench.json").read_text())["basins"]
    assert [row["found"] for row in told] == [1.0, 0.75, 1.0]
    text = markdown(report)
    assert "## made: basin of convergence" in text
    assert "| b | - | 100.0 [100.0, 100.0] |" in text
    write_page(report, tmp_path / "index.html", [], {})
    page = (tmp_path / "index.html").read_text(encoding="utf-8")
    assert "basin of convergence" in page
    assert "give --noise to see this" not in page


def test_without_disturbed_starts_there_is_no_basin() -> None:
    assert basins([made_run(GOOD)]) == ()
    assert basins([made_run(GOOD, variant=Variant(noise_deg=5.0, resets=True))]) == ()


def test_preparation_is_averaged_over_parts_where_it_is_known() -> None:
    runs = [made_run(GOOD, sequence=key) for key in sequences(3)]
    for run, seconds in zip(runs, (10.0, 10.0, math.nan), strict=True):
        object.__setattr__(run, "prepare_s", seconds)
    other = made_run(GOOD, sequence=SequenceKey("made", 4, 2))
    object.__setattr__(other, "prepare_s", 30.0)
    assert table(runs[:2])[0].prepare_s == 10.0
    assert table([*runs[:2], other])[0].prepare_s == pytest.approx(20.0)
    assert math.isnan(table(runs[2:])[0].prepare_s)
