"""JupyterLab in a headless Chromium, as a hand that opens notebooks, drags things and reads the kernel back."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING
from uuid import uuid4

import nbformat

if TYPE_CHECKING:
    from playwright.sync_api import Locator, Page

PROJECT = Path(__file__).resolve().parents[2]
START_S = 240.0
STEP_MS = 120_000  # the longest wait for anything in the page, on a busy machine
CHROMIUM_FLAGS = [
    "--no-sandbox",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--disable-dev-shm-usage",
]
# JupyterLab asks newcomers whether it may fetch news: a dialogue in front of everything.
NO_NEWS = {"fetchNews": "false", "checkForUpdates": False}

_EXECUTE = """async (code) => {
    const kernel = window.jupyterapp.shell.currentWidget.sessionContext.session.kernel;
    const future = kernel.requestExecute({ code, store_history: false });
    let text = "";
    future.onIOPub = (message) => {
        const { msg_type } = message.header;
        if (msg_type === "stream") text += message.content.text;
        if (msg_type === "error") text += `${message.content.ename}: ${message.content.evalue}`;
    };
    await future.done;
    return text;
}"""
_CLOSE = """async () => {
    const panel = window.jupyterapp.shell.currentWidget;
    await panel.sessionContext.shutdown();
    panel.context.model.dirty = false; // or JupyterLab asks whether to save
    panel.dispose();
}"""
_TO_SCREEN = """(svg, [x, y]) => {
    const point = new DOMPoint(x, y).matrixTransform(svg.getScreenCTM());
    return [point.x, point.y];
}"""
_LEFT_TO_RUN = """() => {
    const cells = window.jupyterapp.shell.currentWidget.content.widgets.map((cell) => cell.model);
    const code = cells.filter((cell) => cell.type === "code");
    return code.every((cell) => cell.executionCount && cell.executionState !== "running");
}"""


@contextmanager
def lab_server(folder: Path) -> Iterator[str]:
    """A JupyterLab on the loopback address that serves `folder`; its URL with the token, until the block ends."""
    news = folder / ".lab" / "settings" / "@jupyterlab" / "apputils-extension" / "notification.jupyterlab-settings"
    news.parent.mkdir(parents=True)
    news.write_text(json.dumps(NO_NEWS))
    command = [sys.executable, "-m", "jupyterlab", str(folder), "--no-browser", "--ip=127.0.0.1", "--port=0"]
    command += [f"--IdentityProvider.token={uuid4().hex}", "--LabApp.expose_app_in_browser=True"]
    command += ["--allow-root"] if hasattr(os, "geteuid") and os.geteuid() == 0 else []
    with server(command, folder) as (url, token):
        yield f"{url}lab?token={token}"


@contextmanager
def server(command: list[str], folder: Path) -> Iterator[tuple[str, str]]:
    """Run a Jupyter server whose settings are all below `folder`; its address and token, until the block ends."""
    settings = folder / ".lab"
    environment = {
        **os.environ,
        "PYTHONPATH": str(PROJECT),
        "OMP_NUM_THREADS": "1",
        "JUPYTER_CONFIG_DIR": str(settings / "config"),
        "JUPYTER_RUNTIME_DIR": str(settings / "runtime"),
        "JUPYTERLAB_SETTINGS_DIR": str(settings / "settings"),
        "JUPYTERLAB_WORKSPACES_DIR": str(settings / "workspaces"),
        "IPYTHONDIR": str(settings / "ipython"),
        "JUPYTER_PREFER_ENV_PATH": "1",
    }
    with (folder / "server.log").open("w") as log:
        process = subprocess.Popen(command, cwd=folder, env=environment, stdout=log, stderr=subprocess.STDOUT)
        try:
            yield _url(process, settings / "runtime", folder / "server.log")
        finally:
            process.terminate()
            process.wait(timeout=30.0)


def _url(process: subprocess.Popen[bytes], runtime: Path, log: Path) -> tuple[str, str]:
    """What the server writes down once it listens."""
    until = time.monotonic() + START_S
    while time.monotonic() < until and process.poll() is None:
        for path in runtime.glob("jpserver-*.json"):
            try:
                told = json.loads(path.read_text())
                return told["url"], told["token"]
            except (ValueError, KeyError):
                break  # half written
        time.sleep(0.1)
    raise RuntimeError(f"JupyterLab did not start:\n{log.read_text()[-2000:]}")


class Lab:
    """One page of JupyterLab; `folder` is what the server serves, `shots` where screenshots go."""

    def __init__(self, page: Page, url: str, folder: Path, shots: Path) -> None:
        self.page, self.folder, self.shots = page, folder, shots
        page.set_default_timeout(STEP_MS)
        page.goto(url)
        page.wait_for_function("() => window.jupyterapp && window.jupyterapp.restored")
        page.evaluate("() => window.jupyterapp.restored")

    def open(self, name: str, *cells: str) -> Locator:
        """Write a notebook, open it, run all its cells; its panel. A cell that fails is an AssertionError."""
        notebook = nbformat.v4.new_notebook()
        notebook.cells = [nbformat.v4.new_code_cell(cell) for cell in cells]
        notebook.metadata["kernelspec"] = {"name": "python3", "display_name": "Python 3", "language": "python"}
        nbformat.write(notebook, self.folder / f"{name}.ipynb")
        self.command("docmanager:open", path=f"{name}.ipynb")
        self.page.wait_for_function(
            "(path) => window.jupyterapp.shell.currentWidget?.context?.path === path", arg=f"{name}.ipynb"
        )
        # Kept by the page: a promise that only a waiting test holds may be collected before it is kept.
        self.page.evaluate(
            "() => { const shown = window.jupyterapp.shell.currentWidget; window.isReady = false; window.ready = "
            "Promise.all([shown.context.ready, shown.sessionContext.ready]).then(() => { window.isReady = true; }); }"
        )
        self.page.wait_for_function("() => window.isReady")
        self.command("application:toggle-left-area") if self._sidebar_is_open() else None
        self.command("notebook:run-all-cells")
        self.page.wait_for_function(_LEFT_TO_RUN)
        panel = self.page.locator(".jp-NotebookPanel:not(.lm-mod-hidden)")
        errors = panel.locator("[data-mime-type='application/vnd.jupyter.stderr'], [data-mime-type*='jupyter.error']")
        assert errors.count() == 0, errors.all_inner_texts()
        return panel

    def close(self) -> None:
        """Shut the notebook's kernel down and close it."""
        self.page.evaluate(_CLOSE)

    def command(self, name: str, **arguments: object) -> None:
        """One of JupyterLab's own commands."""
        self.page.evaluate("([name, args]) => { window.jupyterapp.commands.execute(name, args); }", [name, arguments])

    def kernel(self, code: str) -> str:
        """What the open notebook's kernel prints when it runs `code`."""
        return str(self.page.evaluate(_EXECUTE, code)).strip()

    def value(self, expression: str) -> object:
        """A Python expression in the kernel, by way of JSON; arrays come as lists."""
        printed = self.kernel(
            f"import json; _v = {expression}; print(json.dumps(_v.tolist() if hasattr(_v, 'tolist') else _v))"
        )
        try:
            return json.loads(printed)
        except ValueError:
            raise AssertionError(f"{expression}: {printed}") from None

    def until(self, condition: str, state: str = "None") -> None:
        """Wait until a Python expression in the kernel is true; AssertionError with `state` when it never is.

        A hand is quicker than the kernel: what it did last may still be on its way. What the page shows comes later
        still, and is waited for with the locator that has the text.
        """
        for _ in range(300):
            if self.value(f"bool({condition})"):
                return
            self.page.wait_for_timeout(100)
        raise AssertionError(f"never true: {condition}; {state} is {self.value(state)}")

    def theme(self, dark: bool) -> None:
        """Change JupyterLab's theme and wait until it is there."""
        self.command("apputils:change-theme", theme="JupyterLab Dark" if dark else "JupyterLab Light")
        self.page.wait_for_selector(f"body[data-jp-theme-light='{str(not dark).lower()}']", state="attached")
        self.page.wait_for_selector("#jupyterlab-splash", state="detached")

    def shot(self, name: str, of: Locator | None = None) -> Path:
        """A screenshot of the page, or of one element, for people to look at."""
        path = self.shots / f"{name}.png"
        (of or self.page).screenshot(path=path)
        return path

    def drag(self, what: Locator, dx: float, dy: float, steps: int = 8, release: bool = True) -> None:
        """Press the mouse in the middle of an element and move it by (dx, dy) screen px."""
        what.scroll_into_view_if_needed()
        box = what.bounding_box()
        assert box is not None, "the element is not on the page"
        x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
        self.page.mouse.move(x, y)
        self.page.mouse.down()
        for step in range(1, steps + 1):
            self.page.mouse.move(x + dx * step / steps, y + dy * step / steps)
        if release:
            self.page.mouse.up()

    def pull(self, handle: Locator, canvas: Locator, target: tuple[float, float]) -> None:
        """Drag a handle to a pixel of the canvas' picture."""
        box = handle.bounding_box()
        assert box is not None, "the handle is not on the page"
        x, y = self.on_screen(canvas, target)
        self.drag(handle, x - box["x"] - box["width"] / 2, y - box["y"] - box["height"] / 2)

    def on_screen(self, canvas: Locator, pixel: tuple[float, float]) -> tuple[float, float]:
        """Where a pixel of a canvas' picture is on the page."""
        x, y = canvas.locator(".acp-svg").evaluate(_TO_SCREEN, list(pixel))
        return float(x), float(y)

    def _sidebar_is_open(self) -> bool:
        return not bool(self.page.evaluate("() => window.jupyterapp.shell.leftCollapsed"))
