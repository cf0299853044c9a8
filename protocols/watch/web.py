"""The read-only page: GET of the page, its script, its style and view.json (the View as JSON), and nothing else.

A name that an attacker's DNS points at this machine is refused by the Host header (addresses and localhost pass, so
that an SSH tunnel works); the page's policy allows no script but its own file, which writes text as text.
"""

from __future__ import annotations

import ipaddress
import json
import socketserver
import threading
import time
from collections.abc import Callable
from dataclasses import asdict
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib import resources
from typing import Any
from urllib.parse import urlsplit

from shockrig.protocols.watch import step_back
from shockrig.rig.watch.follow import Follower

POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; img-src data:; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
FILES = {
    "/": ("page.html", "text/html; charset=utf-8"),
    "/page.js": ("page.js", "text/javascript; charset=utf-8"),
    "/page.css": ("page.css", "text/css; charset=utf-8"),
}
LOOK_AT_MOST_EVERY_S = 0.2
REQUEST_WITHIN_S = 10.0


class WatchServer(ThreadingHTTPServer):
    """Serves one campaign on `host`:`port` (0: any free port). `url` is where."""

    daemon_threads = True

    def __init__(self, follower: Follower, host: str, port: int) -> None:
        self.host = host
        self._follower = follower
        self._lock = threading.Lock()
        self._answer = b""
        self._answered_s = float("-inf")
        folder = resources.files("shockrig.data") / "watch"
        self.files = {path: ((folder / name).read_bytes(), kind) for path, (name, kind) in FILES.items()}
        if ":" in host:
            import socket

            self.address_family = socket.AF_INET6
        super().__init__((host, port), _Handler)

    def server_bind(self) -> None:
        """Without the name lookup of HTTPServer, which may take long."""
        socketserver.TCPServer.server_bind(self)
        self.server_name, self.server_port = self.host, self.server_address[1]

    @property
    def url(self) -> str:
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"http://{host}:{self.server_port}/"

    def view(self) -> bytes:
        """The View as JSON; however many look, the folder is read a few times a second only."""
        with self._lock:
            if time.monotonic() - self._answered_s > LOOK_AT_MOST_EVERY_S:
                view = self._follower.look()
                content = asdict(view) | {"summary": view.summary()}
                self._answer = json.dumps(content, allow_nan=False).encode("ascii")
                self._answered_s = time.monotonic()
            return self._answer

    def is_known(self, host: str | None) -> bool:
        """Whether a Host header is an address, localhost, or the name that the server was told to listen at."""
        try:
            name = urlsplit(f"//{host}").hostname or ""
            return name in ("localhost", self.host.lower()) or bool(ipaddress.ip_address(name))
        except ValueError:
            return False


class _Handler(BaseHTTPRequestHandler):
    server: WatchServer
    timeout = REQUEST_WITHIN_S
    server_version, sys_version = "shockrig", ""

    def do_GET(self) -> None:
        if not self.server.is_known(self.headers.get("Host")):
            self._send(HTTPStatus.MISDIRECTED_REQUEST, b"this name is not served here\n")
        elif self.path == "/view.json":
            self._send(HTTPStatus.OK, self.server.view(), "application/json")
        elif self.path in self.server.files:
            self._send(HTTPStatus.OK, *self.server.files[self.path])
        else:
            self._send(HTTPStatus.NOT_FOUND, b"there is no such page\n")

    def _refuse(self) -> None:
        self.close_connection = True
        self._send(HTTPStatus.METHOD_NOT_ALLOWED, b"this page can only be read\n")

    do_HEAD = do_POST = do_PUT = do_PATCH = do_DELETE = do_OPTIONS = do_TRACE = do_CONNECT = _refuse

    def _send(self, status: HTTPStatus, content: bytes, kind: str = "text/plain; charset=utf-8") -> None:
        self.send_response(status)
        headers = {
            "Content-Type": kind,
            "Content-Length": str(len(content)),
            "Content-Security-Policy": POLICY,
            "X-Content-Type-Options": "nosniff",
            "X-Frame-Options": "DENY",
            "Referrer-Policy": "no-referrer",
            "Cross-Origin-Resource-Policy": "same-origin",
            "Cache-Control": "no-store",
        }
        if status is HTTPStatus.METHOD_NOT_ALLOWED:
            headers["Allow"] = "GET"
        for name, value in headers.items():
            self.send_header(name, value)
        self.end_headers()
        if self.command != "HEAD":
            self.wfile.write(content)

    def log_message(self, format: str, *args: Any) -> None:
        """Nobody reads it."""


def serve(follower: Follower, host: str, port: int, tell: Callable[[str], None]) -> None:
    """Serve until Ctrl-C; `tell` gets the address. Raises OSError where the port cannot be had."""
    with WatchServer(follower, host, port) as server:
        step_back()
        tell(server.url)
        server.serve_forever(poll_interval=0.5)
