"""What the page asks of rerun's statistics host is answered at home; everything else goes on its way."""

from __future__ import annotations

import importlib.util
import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from acp_lab.display.widgets.telemetry_guard import TelemetryGuard

_TRIAL = """
import { keepHome } from "./guard.mjs";
const sent = [];
const scope = { location: { href: "http://127.0.0.1:8888/lab" }, fetch: async (what) => sent.push(what.url ?? what) };
keepHome(scope);
keepHome(scope);
const told = await scope.fetch(new Request("https://tel.rerun.io/api/pog", { method: "POST", body: "{}" }));
await scope.fetch("https://tel.rerun.io/");
await scope.fetch("https://api.github.com/repos/rerun-io/rerun/releases/latest");
await scope.fetch("https://api.github.com/repos/others");
await scope.fetch("/api/kernels");
await scope.fetch(new URL("http://localhost:4000/re_viewer_bg.wasm"));
await scope.fetch(new Request("http://localhost:4000/widget.js"));
console.log(JSON.stringify({ sent: sent.map(String), ok: told.ok }));
"""


def test_requests_to_the_statistics_host_are_not_sent(tmp_path: Path) -> None:
    node = shutil.which("node")
    if node is None:
        pytest.skip("node is not installed")
    (tmp_path / "guard.mjs").write_text(str(TelemetryGuard._esm), encoding="utf-8")
    (tmp_path / "trial.mjs").write_text(_TRIAL, encoding="utf-8")
    done = subprocess.run([node, "trial.mjs"], cwd=tmp_path, capture_output=True, text=True, check=True, timeout=60)
    assert json.loads(done.stdout) == {
        "sent": [
            "https://api.github.com/repos/others",
            "/api/kernels",
            "http://localhost:4000/re_viewer_bg.wasm",
            "http://localhost:4000/widget.js",
        ],
        "ok": True,
    }


def test_the_host_is_the_one_that_reruns_page_names() -> None:
    """Should rerun move it, the guard must move along."""
    rerun_notebook = importlib.util.find_spec("rerun_notebook")
    if rerun_notebook is None or rerun_notebook.origin is None:
        pytest.skip("rerun's notebook viewer is not installed")
    page = (Path(rerun_notebook.origin).parent / "static" / "re_viewer_bg.wasm").read_bytes()
    assert b"https://tel.rerun.io/api/pog" in page
    assert 'const HOST = "tel.rerun.io"' in str(TelemetryGuard._esm)


_RECORDS = """
import sys
from pathlib import Path
from acp_lab.display.replay.recorder import Replay
from acp_lab.display.replay.file import check_replay, read_replay
from tests.display.made_run import play
play([Replay(Path(sys.argv[1]))])
read_replay(check_replay(Path(sys.argv[1])))
"""


def test_a_replay_touches_nothing_in_the_home_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    home = tmp_path / "home"
    home.mkdir()
    for name in ("CI", "XDG_CONFIG_HOME", "XDG_DATA_HOME"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("HOME", str(home))
    monkeypatch.setenv("FORCE_RERUN_ANALYTICS", "1")
    project = Path(__file__).resolve().parents[2]
    subprocess.run([sys.executable, "-c", _RECORDS, str(tmp_path / "run.rrd")], cwd=project, check=True)
    assert (tmp_path / "run.rrd").stat().st_size > 0
    assert not list(home.rglob("*rerun*"))
