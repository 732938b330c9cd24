"""Bad files of every type: changed good ones, and those that a fuzzer found interesting."""

from __future__ import annotations

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tests.fuzz.__main__ import CORPUS
from tests.fuzz.readers import BY_NAME, READERS, Reader, try_content
from tests.fuzz.strategies import contents

KEPT = [path for name in BY_NAME for path in sorted((CORPUS / name).glob("*"))]


@pytest.mark.parametrize("reader", READERS, ids=BY_NAME)
def test_good_files_are_read(reader: Reader, tmp_path) -> None:  # type: ignore[no-untyped-def]
    if reader.name in ("part.json", "run.rrd"):
        pytest.skip("a good one is more than one file, or large")
    for seed in reader.seeds:
        path = tmp_path / reader.name
        path.write_bytes(seed)
        reader.read(path)


@pytest.mark.parametrize("reader", READERS, ids=BY_NAME)
def test_bad_files_are_refused_in_one_line(reader: Reader) -> None:
    @settings(max_examples=40, suppress_health_check=[HealthCheck.too_slow])
    @given(st.data())
    def check(data: st.DataObject) -> None:
        try_content(reader, data.draw(contents(reader)))

    check()


@pytest.mark.parametrize("name", BY_NAME)
def test_what_fuzzers_found_interesting(name: str) -> None:
    for path in sorted((CORPUS / name).glob("*")):
        try_content(BY_NAME[name], path.read_bytes())


def test_the_corpus_is_there_and_small() -> None:
    assert {path.parent.name for path in KEPT} == set(BY_NAME)
    assert sum(path.stat().st_size for path in KEPT) < 200_000
