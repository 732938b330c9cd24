"""One JupyterLab, one Chromium and one page for all tests here; without Chromium they skip and say so.

With ACP_REQUIRE_BROWSER=1 they fail instead. Screenshots go to the folder ACP_SCREENSHOTS, else to pytest's own.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from tests.browser.lab import CHROMIUM_FLAGS, Lab, lab_server

if TYPE_CHECKING:
    from playwright.sync_api import Browser

HERE = Path(__file__).parent
NAMES = ("chromium", "chromium-browser", "google-chrome", "chrome")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """All tests of this folder are browser tests."""
    for item in items:
        if HERE in item.path.parents:
            item.add_marker(pytest.mark.browser)


@pytest.fixture(scope="session")
def chromium() -> str:
    """The path of a Chromium; skips, or fails where one is required, when it or playwright is missing."""
    try:
        import playwright.sync_api  # noqa: F401
    except ImportError:
        _without("playwright is not installed: pip install playwright")
    found = next((path for path in map(shutil.which, NAMES) if path), None)
    return found or _without(f"no Chromium on the path (looked for {', '.join(NAMES)}): apt-get install chromium")


def _without(reason: str) -> str:
    if os.environ.get("ACP_REQUIRE_BROWSER") == "1":
        pytest.fail(f"ACP_REQUIRE_BROWSER=1, but {reason}", pytrace=False)
    pytest.skip(reason)


@pytest.fixture(scope="session")
def browser(chromium: str) -> Iterator[Browser]:
    """One for all: playwright's synchronous half runs once in a thread."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=CHROMIUM_FLAGS)
        try:
            yield browser
        finally:
            browser.close()


@pytest.fixture(scope="session")
def lab(browser: Browser, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Lab]:
    """A page of JupyterLab."""
    folder = tmp_path_factory.mktemp("lab")
    shots = Path(os.environ.get("ACP_SCREENSHOTS", folder / "shots"))
    shots.mkdir(parents=True, exist_ok=True)
    with lab_server(folder) as url:
        page = browser.new_page(viewport={"width": 1400, "height": 1150})
        try:
            yield Lab(page, url, folder, shots)
        finally:
            page.close()


@pytest.fixture
def closes(lab: Lab) -> Iterator[None]:
    """Shuts the notebook's kernel down after the test: kernels with torch are large."""
    yield
    lab.close()
