"""The page of rerun's web viewer, passed on with a policy that keeps the browser from the net.

In a browser the viewer has no switch for its usage statistics, its fonts and its news of versions; the program that
serves its page adds no such policy either. So the page is served once more, on 127.0.0.1, with the policy on top.
"""

from __future__ import annotations

import shutil
import threading
import urllib.error
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from urllib.parse import parse_qs, urlsplit

_HOST = "127.0.0.1"
# Without the proxy that a company's environment may name: what is asked for is on this machine.
_DIRECT = urllib.request.build_opener(urllib.request.ProxyHandler({}))


@contextmanager
def kept_home(address: str) -> Iterator[str]:
    """Serve the viewer's page on a free port of 127.0.0.1; its address there, until the block ends.

    address: where rerun serves it, with the address of the replay's data in its query.
    """
    url = urlsplit(address)
    data = urlsplit(parse_qs(url.query)["url"][0].removeprefix("rerun+"))
    policy = policy_for(f"{data.scheme}://{data.netloc}")
    source = f"{url.scheme}://{url.netloc}"

    class Page(BaseHTTPRequestHandler):
        """Hands on what rerun serves."""

        def do_GET(self) -> None:
            if not self.path.startswith("/"):  # it would name another host
                return self.send_error(400)
            try:
                with _DIRECT.open(source + self.path) as found:
                    self.send_response(found.status)
                    for name in ("Content-Type", "Content-Length"):
                        if name in found.headers:
                            self.send_header(name, found.headers[name])
                    self.send_header("Content-Security-Policy", policy)
                    self.end_headers()
                    shutil.copyfileobj(found, self.wfile)
            except urllib.error.HTTPError as error:
                self.send_error(error.code)
            except urllib.error.URLError:
                self.send_error(502)
            except ConnectionError:
                pass  # the page was closed while it was loading
            return None

        def log_message(self, *_: object) -> None:
            """The terminal is for the address."""

    server = ThreadingHTTPServer((_HOST, 0), Page)
    server.daemon_threads = True
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    try:
        yield f"http://{_HOST}:{server.server_port}/?{url.query}"
    finally:
        server.shutdown()
        thread.join()
        server.server_close()


def policy_for(data: str) -> str:
    """The Content-Security-Policy: everything from the page's own server, and the replay from `data` ("http://...")."""
    return (
        "default-src 'self' 'unsafe-inline' 'wasm-unsafe-eval' data: blob:; "
        f"connect-src 'self' {data} data: blob:"
    )
