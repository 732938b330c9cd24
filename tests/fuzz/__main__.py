"""Look for files that break a reader: `python -m tests.fuzz [--seconds N] [READER…]`; `make fuzz` does.

With atheris, files that reach new code are kept while it runs, and followed; small ones of them stay in
tests/fuzz/corpus, where every later run tries them, and `make test`. Without atheris hypothesis draws the files. What
breaks a reader is written to tests/fuzz/found, and the exit status is 1.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

HERE = Path(__file__).parent
CORPUS, FOUND = HERE / "corpus", HERE / "found"
SLOW_S = 20
MOST_KEPT, LARGEST_KEPT = 25, 1_500
"""Files per reader in the corpus, and their bytes."""


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("readers", nargs="*", help="names such as part.ply; all by default")
    parser.add_argument("--seconds", type=float, default=600.0, help="for all readers together")
    parser.add_argument("--guided", action="store_true", help=argparse.SUPPRESS)  # the process that atheris takes over
    wanted = parser.parse_args()
    if wanted.guided:
        _fuzz_here(wanted.readers[0], wanted.seconds, Path(wanted.readers[1]))
    from tests.fuzz.readers import BY_NAME

    names, failed = wanted.readers or list(BY_NAME), 0
    for name in names:
        seconds = wanted.seconds / len(names)
        found, told = _guided(name, seconds) if _has_atheris() else _drawn(name, seconds)
        print(f"{name:18s} {told}", flush=True)
        failed += found
    print(f"{len(names) - failed} of {len(names)} readers without a finding")
    return 1 if failed else 0


def _has_atheris() -> bool:
    try:
        import atheris  # noqa: F401
    except ImportError:
        return False
    return True


def _guided(name: str, seconds: float) -> tuple[bool, str]:
    """atheris ends the process that it runs in, so each reader gets one of its own."""
    FOUND.mkdir(exist_ok=True)
    with tempfile.TemporaryDirectory(prefix="fuzz_corpus_") as folder:
        work = Path(folder)
        _fill(name, work)
        command = [sys.executable, "-m", "tests.fuzz", "--guided", "--seconds", str(seconds), name, str(work)]
        # Numba cannot compile what atheris has changed to follow it.
        environment = {**os.environ, "NUMBA_DISABLE_JIT": "1"}
        done = subprocess.run(command, check=False, capture_output=True, text=True, env=environment)
        if done.returncode == 0:
            _keep_best(name, work)
    runs = [line for line in done.stderr.splitlines() if line.startswith("Done ")]
    coverage = [
        word for line in done.stderr.splitlines() if " cov: " in line for word in [line.split(" cov: ")[1].split()[0]]
    ]
    if done.returncode == 0:
        return False, f"{runs[-1] if runs else 'done'}, {coverage[-1] if coverage else '?'} places reached, no finding"
    reason = [line for line in (done.stdout + done.stderr).splitlines() if "Error" in line or "ALARM" in line]
    return True, f"FOUND, see {FOUND}: {reason[-1][:300] if reason else done.stderr[-300:]}"


def _fill(name: str, folder: Path) -> None:
    from tests.fuzz.readers import BY_NAME

    for number, seed in enumerate(BY_NAME[name].seeds):
        (folder / f"seed_{number}").write_bytes(seed)
    for path in (CORPUS / name).glob("*"):
        (folder / path.name).write_bytes(path.read_bytes())


def _keep_best(name: str, folder: Path) -> None:
    """The smallest files of those that reached new code: one corpus stays small enough to be read by every test run."""
    kept = CORPUS / name
    kept.mkdir(parents=True, exist_ok=True)
    small = sorted((path for path in folder.iterdir() if path.stat().st_size <= LARGEST_KEPT), key=_size)
    room = MOST_KEPT - len(list(kept.iterdir()))
    for path in small[:: max(1, len(small) // MOST_KEPT)][: max(0, room)]:
        content = path.read_bytes()
        (kept / hashlib.sha256(content).hexdigest()[:16]).write_bytes(content)


def _size(path: Path) -> int:
    return path.stat().st_size


def _fuzz_here(name: str, seconds: float, folder: Path) -> None:
    import atheris

    with atheris.instrument_imports(include=["acp_lab"]):
        from tests.fuzz.readers import BY_NAME, try_content
    reader = BY_NAME[name]
    limits = [f"-max_total_time={max(1, round(seconds))}", f"-timeout={SLOW_S}", "-rss_limit_mb=3000", "-max_len=4000"]
    options = [sys.argv[0], *limits, f"-artifact_prefix={FOUND}/{name}-", str(folder)]
    atheris.Setup(options, lambda content: try_content(reader, content))
    atheris.Fuzz()


def _drawn(name: str, seconds: float) -> tuple[bool, str]:
    from hypothesis import HealthCheck, given, settings

    from tests.fuzz.readers import BY_NAME, try_content
    from tests.fuzz.strategies import contents

    reader, end, tried = BY_NAME[name], time.monotonic() + seconds, 0

    @settings(max_examples=200, deadline=None, database=None, suppress_health_check=list(HealthCheck))
    @given(contents(reader))
    def once(content: bytes) -> None:
        nonlocal tried
        tried += 1
        try:
            try_content(reader, content)
        except Exception:
            FOUND.mkdir(exist_ok=True)
            (FOUND / f"{name}-{hashlib.sha256(content).hexdigest()[:16]}").write_bytes(content)
            raise

    while time.monotonic() < end:
        try:
            once()
        except Exception as error:
            return True, f"FOUND, see {FOUND}: {type(error).__name__}: {str(error)[:300]}"
    return False, f"{tried} files drawn by hypothesis, no finding"


if __name__ == "__main__":
    sys.exit(main())
