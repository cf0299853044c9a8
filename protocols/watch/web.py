"""The live page: GET of the page, its script, its style and view.json (the View as JSON), and nothing else.

Where it may also control the recording, POST /control {"action", "run", "text"} with the token that the terminal has
shown, as the header X-Shockrig-Token, which no form and no other site can send; from this machine's own address alone.
A name that an attacker's DNS points at this machine is refused by the Host header (addresses and localhost pass, so
that an SSH tunnel works); the page's policy allows no script but its own file, which writes text as text.
"""

from __future__ import annotations

import contextlib
import hmac
import ipaddress
import json
import socket
import socketserver
import sys
import threading
import time
from collections.abc import Callable
from dataclasses import asdict
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib import resources
from typing import Any, Protocol, cast
from urllib.parse import urlsplit

from shockrig.protocols.watch import step_back
from shockrig.rig.bench_errors import BenchError
from shockrig.rig.requests import Request, leave_request
from shockrig.rig.watch.follow import Follower

POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; img-src data:; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
FILES = {
    "/": ("{page}.html", "text/html; charset=utf-8"),
    "/page.js": ("{page}.js", "text/javascript; charset=utf-8"),
    "/page.css": ("page.css", "text/css; charset=utf-8"),
}
TOKEN_HEADER = "X-Shockrig-Token"
LONGEST_REQUEST = 4096
LOOK_AT_MOST_EVERY_S = 0.2
REQUEST_WITHIN_S = 10.0


class Watched(Protocol):
    """What a page shows: a dataclass with a `summary()`, made anew at each look."""

    def look(self) -> Any: ...


class WatchServer(ThreadingHTTPServer):
    """Serves one campaign on `host`:`port` (0: any free port), or something else with a `page` of its own in
    data/watch. `url` is where.

    With a `token` the page may control the recording; its address then ends in the token, behind a # that no browser
    sends.
    """

    daemon_threads = True
    request_queue_size = 128  # a page with several tabs asks at once, and so does whoever measures

    def __init__(self, follower: Watched, host: str, port: int, token: str = "", page: str = "page") -> None:
        self.host = host
        self.token = token
        self._follower = follower
        self._lock = threading.Lock()
        self._answer = b""
        self._answered_s = float("-inf")
        folder = resources.files("shockrig.data") / "watch"
        self.files = {
            path: ((folder / name.format(page=page)).read_bytes(), kind) for path, (name, kind) in FILES.items()
        }
        if ":" in host:
            self.address_family = socket.AF_INET6
        super().__init__((host, port), _Handler)

    def server_bind(self) -> None:
        """Without the name lookup of HTTPServer, which may take long."""
        socketserver.TCPServer.server_bind(self)
        self.server_name, self.server_port = self.host, self.server_address[1]

    @property
    def url(self) -> str:
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"http://{host}:{self.server_port}/" + (f"#{self.token}" if self.token else "")

    def handle_error(self, request: Any, client_address: Any) -> None:
        """A client that hangs up, or says nothing for too long, is none of the operator's concern."""
        if not isinstance(sys.exception(), OSError):
            super().handle_error(request, client_address)

    def view(self) -> bytes:
        """The View as JSON; however many look, the folder is read a few times a second only."""
        with self._lock:
            if time.monotonic() - self._answered_s > LOOK_AT_MOST_EVERY_S:
                view = self._follower.look()
                content = asdict(view) | {"summary": view.summary()}
                self._answer = json.dumps(content, allow_nan=False).encode("ascii")
                self._answered_s = time.monotonic()
            return self._answer

    def pass_on(self, content: bytes) -> None:
        """Leave what the page asks for to the recorder; raises BenchError where it cannot be done, OSError."""
        try:
            asked = json.loads(content)
            request = Request(*(asked.get(key, "") for key in ("action", "run", "text")))
        except BenchError:
            raise
        except (ValueError, AttributeError, TypeError, RecursionError):
            raise BenchError('expected {"action": ..., "run": ..., "text": ...}') from None
        with self._lock:
            campaign = cast(Follower, self._follower)  # nothing else is controlled
            if campaign.look().state not in ("recording", "asking", "stalled"):
                raise BenchError("nothing is being recorded")
            leave_request(campaign.path, request)

    def is_known(self, host: str | None) -> bool:
        """Whether a Host header is an address, localhost, or the name that the server was told to listen at."""
        try:
            name = urlsplit(f"//{host}").hostname or ""
            return name in ("localhost", self.host.lower()) or bool(ipaddress.ip_address(name))
        except ValueError:
            return False

    def is_own(self, origin: str | None) -> bool:
        """Whether an Origin header is of a page that this machine serves itself; without one no browser asks."""
        try:
            return origin is None or is_local(urlsplit(origin).hostname or "")
        except ValueError:
            return False


class _Handler(BaseHTTPRequestHandler):
    server: WatchServer
    timeout = REQUEST_WITHIN_S
    server_version, sys_version = "shockrig", ""

    def setup(self) -> None:
        super().setup()
        # `timeout` is for each piece that arrives: one byte now and then would hold a thread for hours.
        self._limit = threading.Timer(REQUEST_WITHIN_S, self._hang_up)
        self._limit.daemon = True
        self._limit.start()

    def finish(self) -> None:
        self._limit.cancel()
        super().finish()

    def _hang_up(self) -> None:
        with contextlib.suppress(OSError):
            self.connection.shutdown(socket.SHUT_RDWR)

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

    def do_POST(self) -> None:
        """Control of the recording: refused before anything is read, unless it may be."""
        server, address = self.server, self.client_address[0]
        if self.path != "/control" or not server.token:
            return self._refuse()
        self.close_connection = True  # whatever is refused leaves its body unread
        given = self.headers.get(TOKEN_HEADER, "").encode("utf-8", "replace")
        stated = self.headers.get("Content-Length", "")
        is_length = stated.isascii() and stated.isdigit() and len(stated) <= len(str(LONGEST_REQUEST))
        length = int(stated) if is_length else LONGEST_REQUEST + 1
        if not is_local(address) or not server.is_known(self.headers.get("Host")):
            return self._send(HTTPStatus.FORBIDDEN, b"only from this machine\n")
        if not server.is_own(self.headers.get("Origin")) or not hmac.compare_digest(given, server.token.encode()):
            return self._send(HTTPStatus.FORBIDDEN, b"the token is wrong: open the address that was printed\n")
        if length > LONGEST_REQUEST:
            return self._send(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, b"expected a short request of stated length\n")
        content = self.rfile.read(length)
        if len(content) < length:
            return self._send(HTTPStatus.REQUEST_TIMEOUT, b"the request is not whole\n")
        try:
            server.pass_on(content)
        except BenchError as error:
            return self._send(HTTPStatus.CONFLICT, f"{error}\n".encode())
        except OSError as error:
            return self._send(HTTPStatus.INTERNAL_SERVER_ERROR, f"{error.strerror or error}\n".encode())
        return self._send(HTTPStatus.ACCEPTED, b"asked for\n")

    do_HEAD = do_PUT = do_PATCH = do_DELETE = do_OPTIONS = do_TRACE = do_CONNECT = _refuse

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


def is_local(host: str) -> bool:
    """Whether a name or an address is this machine's own, which nobody else can reach."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def serve(follower: Follower, host: str, port: int, tell: Callable[[str], None], token: str = "") -> None:
    """Serve until Ctrl-C; `tell` gets the address. Raises OSError where the port cannot be had."""
    with WatchServer(follower, host, port, token) as server:
        step_back()
        tell(server.url)
        server.serve_forever(poll_interval=0.5)
