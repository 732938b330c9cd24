"""Checks the built site: every link between its pages leads to a file, and to a place in it; and no page fetches
scripts, styles or pictures from elsewhere. Needs no network.

python book/links.py book/_build/html
"""

from __future__ import annotations

import sys
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit


class _Page(HTMLParser):
    """What a page links to, what it loads, and the places in it."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.links: set[str] = set()
        self.fetched: set[str] = set()
        self.places: set[str] = set()
        self.feed(text)

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        named = dict(attributes)
        loads = named.get("href") if tag == "link" and named.get("rel") == "stylesheet" else named.get("src")
        if loads:
            self.fetched.add(loads)
        for name, value in attributes:
            if name == "id" and value:
                self.places.add(value)
            elif value and (name == "href" or (name == "src" and tag in ("img", "script"))):
                self.links.add(value)


def broken_links(site: Path, pages: dict[Path, _Page]) -> list[str]:
    """`page: link` for each link within the site that leads nowhere."""
    broken = []
    for path, page in sorted(pages.items()):
        for link in sorted(page.links):
            url = urlsplit(link)
            if url.scheme or url.netloc:
                continue
            target = (path.parent / unquote(url.path)).resolve() if url.path else path
            found, place = pages.get(target), unquote(url.fragment)
            if not target.exists() or (found and place and place not in found.places):
                broken.append(f"{path.relative_to(site)}: {link}")
    return broken


def from_elsewhere(site: Path, pages: dict[Path, _Page]) -> list[str]:
    """`page: address` for everything that a page would load over a network."""
    return [
        f"{path.relative_to(site)}: loads {address}"
        for path, page in sorted(pages.items())
        for address in sorted(page.fetched)
        if urlsplit(address).netloc
    ]


def main() -> int:
    """Print what is wrong; 1 when there is anything."""
    site = Path(sys.argv[1]).resolve()
    pages = {path: _Page(path.read_text(encoding="utf-8")) for path in site.rglob("*.html")}
    broken = [*broken_links(site, pages), *from_elsewhere(site, pages)]
    print("\n".join(broken) or "all links within the site lead somewhere, and it needs no network")
    return 1 if broken else 0


if __name__ == "__main__":
    sys.exit(main())
