"""Checks the built site: every link between its pages leads to a file, and to a place in it. Needs no network.

python book/links.py book/_build/html
"""

from __future__ import annotations

import sys
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit


class _Page(HTMLParser):
    """What a page links to, and the places in it."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.links: set[str] = set()
        self.places: set[str] = set()
        self.feed(text)

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        for name, value in attributes:
            if name == "id" and value:
                self.places.add(value)
            elif value and (name == "href" or (name == "src" and tag in ("img", "script"))):
                self.links.add(value)


def broken_links(site: Path) -> list[str]:
    """`page: link` for each link within the site that leads nowhere."""
    pages = {path.resolve(): _Page(path.read_text(encoding="utf-8")) for path in site.rglob("*.html")}
    broken = []
    for path, page in sorted(pages.items()):
        for link in sorted(page.links):
            url = urlsplit(link)
            if url.scheme or url.netloc:
                continue
            target = (path.parent / unquote(url.path)).resolve() if url.path else path
            found = pages.get(target)
            place = unquote(url.fragment)
            if not target.exists() or (found and place and place not in found.places):
                broken.append(f"{path.relative_to(site.resolve())}: {link}")
    return broken


def main() -> int:
    """Print the broken links; 1 when there are any."""
    broken = broken_links(Path(sys.argv[1]))
    print("\n".join(broken) or "all links within the site lead somewhere")
    return 1 if broken else 0


if __name__ == "__main__":
    sys.exit(main())
