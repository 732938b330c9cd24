"""`acp-lab replay --web` in a real browser: its page reaches the replay, and nothing beyond this machine."""

from __future__ import annotations

import subprocess
import sys
import urllib.parse
from pathlib import Path
from typing import TYPE_CHECKING

from acp_lab.display.replay.recorder import Replay
from tests.browser.lab import PROJECT
from tests.display.made_run import play

if TYPE_CHECKING:
    from playwright.sync_api import Browser

_TRY = """async (urls) => {
    const refused = [];
    document.addEventListener("securitypolicyviolation", (event) => refused.push(event.blockedURI));
    for (const url of urls) await fetch(url, { mode: "no-cors" }).catch(() => {});
    await new Promise((done) => setTimeout(done, 500));
    return urls.filter((url) => refused.some((one) => url.startsWith(one)));
}"""


def test_the_page_of_a_replay_stays_on_this_machine(browser: Browser, tmp_path: Path) -> None:
    play([Replay(tmp_path / "run.rrd")])
    command = [sys.executable, "-m", "acp_lab", "replay", str(tmp_path / "run.rrd"), "--web"]
    served = subprocess.Popen(command, cwd=PROJECT, stdout=subprocess.PIPE, text=True)
    page = browser.new_page()
    try:
        assert served.stdout is not None
        address = next(line.strip() for line in served.stdout if line.startswith("http"))
        answered: list[str] = []
        page.on("response", lambda response: answered.append(str(urllib.parse.urlsplit(response.url).hostname)))
        with page.expect_response("**/re_viewer_bg.wasm*") as viewer:
            page.goto(address)
        assert viewer.value.ok
        data = urllib.parse.parse_qs(urllib.parse.urlsplit(address).query)["url"][0].removeprefix("rerun+")
        outside = ["https://tel.rerun.io/api/pog", "https://api.github.com/repos/rerun-io", "https://nowhere.invalid/"]
        assert page.evaluate(_TRY, [*outside, data, "/re_viewer.js"]) == outside
        assert set(answered) == {"127.0.0.1"}
    finally:
        page.close()
        served.terminate()
        served.wait(timeout=30)
