"""`acp-lab lab` as its user meets it: the first notebook, nothing in front of it, and links that work."""

from __future__ import annotations

import os
import sys
import urllib.request
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from tests.browser.lab import server

if TYPE_CHECKING:
    from playwright.sync_api import Browser


def test_lab_opens_the_first_notebook_and_its_links(browser: Browser, tmp_path: Path) -> None:
    shots = Path(os.environ.get("ACP_SCREENSHOTS", tmp_path))
    command = [sys.executable, "-m", "acp_lab", "lab", "--no-browser"]
    with server(command, tmp_path) as (url, token):
        page = browser.new_page(viewport={"width": 1400, "height": 900})
        page.set_default_timeout(120_000)
        page.goto(f"{url}?token={token}")
        page.locator(".jp-NotebookPanel h1", has_text="Start here").wait_for()
        page.wait_for_timeout(3000)  # the news come seconds after the page
        page.screenshot(path=shots / "lab_first.png")
        assert page.locator(".Toastify__toast, .jp-Dialog").count() == 0
        page.locator(".jp-NotebookPanel a", has_text="glossary").first.click()
        glossary = page.locator(".jp-MarkdownViewer h1", has_text="Glossary")
        glossary.wait_for()
        page.screenshot(path=shots / "lab_glossary.png")
        # A link between documents of docs/, and one from a document into the notebooks.
        page.locator(".jp-MarkdownViewer:visible a[href]", has_text="conventions").first.click()
        page.locator(".jp-MarkdownViewer h1", has_text="Conventions").wait_for()
        page.close()
    # `server` ends acp-lab, and that has to end JupyterLab.
    with pytest.raises(OSError, match="refused"):
        urllib.request.urlopen(url)
