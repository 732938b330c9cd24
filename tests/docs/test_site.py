"""The site: its table of contents has every page, its settings load, and its link checker sees a broken link."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
BOOK = ROOT / "book"


def test_every_page_is_in_the_contents() -> None:
    entries = re.findall(r"^\.\./([\w/.-]+)$", (BOOK / "index.md").read_text(encoding="utf-8"), re.MULTILINE)
    for entry in entries:
        assert any((ROOT / f"{entry}{suffix}").is_file() for suffix in (".md", ".ipynb")), entry
    pages = [*(ROOT / "docs").glob("*.md"), *(ROOT / "notebooks").glob("[0-9]*.ipynb")]
    assert {str(page.relative_to(ROOT).with_suffix("")) for page in pages} <= set(entries)


def test_the_reference_has_every_layer() -> None:
    text = (BOOK / "api.md").read_text(encoding="utf-8")
    layers = {path.parent.name for path in (ROOT / "acp_lab").glob("*/__init__.py")} - {"commands", "sample"}
    assert layers <= set(re.findall(r"^   acp_lab\.(\w+)$", text, re.MULTILINE))


def test_the_root_leads_to_the_first_page() -> None:
    """Who opens the address of the site gets its root, where Sphinx puts no page."""
    root = (BOOK / "root" / "index.html").read_text(encoding="utf-8")
    assert re.findall(r"url=([^\"]+)", root) == ["book/index.html"]
    settings = (BOOK / "conf.py").read_text(encoding="utf-8")
    assert 'html_extra_path = ["root"]' in settings
    assert 'root_doc = "book/index"' in settings


def test_broken_links_are_seen(tmp_path: Path) -> None:
    (tmp_path / "a.html").write_text('<a href="b.html#there">x</a> <a href="https://nowhere.invalid">y</a>')
    (tmp_path / "b.html").write_text('<p id="there"><a href="a.html">x</a>')
    command = [sys.executable, str(BOOK / "links.py"), str(tmp_path)]
    assert subprocess.run(command, capture_output=True, check=False).returncode == 0
    (tmp_path / "b.html").write_text('<a href="c.html">x</a>')
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert done.stdout.splitlines() == ["a.html: b.html#there", "b.html: c.html"]


def test_what_comes_over_a_network_is_seen(tmp_path: Path) -> None:
    (tmp_path / "a.html").write_text('<script src="here.js"></script><a href="https://nowhere.invalid/a">x</a>')
    (tmp_path / "here.js").write_text("")
    command = [sys.executable, str(BOOK / "links.py"), str(tmp_path)]
    assert subprocess.run(command, capture_output=True, check=False).returncode == 0
    (tmp_path / "b.html").write_text('<link rel="stylesheet" href="//nowhere.invalid/b.css"><img src="data:,">')
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert done.stdout.splitlines() == ["b.html: loads //nowhere.invalid/b.css"]
