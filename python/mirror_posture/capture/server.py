"""The capture's page, served on this machine only: 127.0.0.1, a secret address, no request from another
site.

The server binds to 127.0.0.1. It answers only if the `Host` is its own (a foreign name that resolves to
this machine is refused), under a path that contains a random token, and accepts actions only by POST with
its own `Origin`.
"""

from __future__ import annotations

import hmac
import json
import secrets
import threading
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

from .._core import MirrorPostureError
from .live import live_jpeg, state_of
from .loop import Capture

PAGE = Path(__file__).parent / "page.html"
LARGEST_REQUEST = 1000
HTTP_PORT = 80
POLICY = (
    "default-src 'none'; img-src 'self' blob:; style-src 'unsafe-inline'; script-src 'nonce-{nonce}'; connect-src 'self'; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)


class CaptureServer:
    """Serves the page of a capture from a separate thread. `address` is the URL for a browser."""

    def __init__(self, capture: Capture, port: int = 0) -> None:
        self._token = secrets.token_urlsafe(24)
        token, nonce = self._token, secrets.token_urlsafe(12)
        page = PAGE.read_text(encoding="utf-8").replace("{{nonce}}", nonce).encode("utf-8")

        class Handler(BaseHTTPRequestHandler):
            server_version, sys_version = "mirror-posture", ""

            def log_message(self, format: str, *args: Any) -> None:
                """Nothing: the address holds the token."""

            def do_GET(self) -> None:
                """The page, its state, the live picture."""
                what = self._asked()
                if what == "":
                    self._answer(page, "text/html; charset=utf-8")
                elif what == "state.json":
                    self._answer(json.dumps(state_of(capture)).encode("utf-8"), "application/json")
                elif what == "live.jpg":
                    picture = live_jpeg(capture)
                    if picture is None:
                        self.send_error(HTTPStatus.NOT_FOUND)
                    else:
                        self._answer(picture, "image/jpeg")
                elif what is not None:
                    self.send_error(HTTPStatus.NOT_FOUND)

            def do_POST(self) -> None:
                """An action."""
                what = self._asked()
                if what is None:
                    return
                if self.headers.get("Origin") not in self._own("http://"):
                    self.send_error(HTTPStatus.FORBIDDEN, "another origin")
                    return
                try:
                    length = int(self.headers.get("Content-Length", "0"))
                    if what != "do" or not 0 < length <= LARGEST_REQUEST:
                        raise ValueError
                    action = json.loads(self.rfile.read(length))["action"]
                    done = capture.do(str(action))
                except (ValueError, KeyError, TypeError, RecursionError):
                    self.send_error(HTTPStatus.BAD_REQUEST)
                except MirrorPostureError as error:
                    self._answer(json.dumps({"error": str(error)}).encode("utf-8"), "application/json", 400)
                else:
                    self._answer(json.dumps({"done": done}).encode("utf-8"), "application/json")

            def _own(self, scheme: str = "") -> tuple[str, ...]:
                port_ = int(self.server.server_address[1])  # type: ignore[index]
                # Browsers leave out the port that `http` means anyway.
                ports = (f":{port_}", "") if port_ == HTTP_PORT else (f":{port_}",)
                return tuple(
                    f"{scheme}{name}{ending}" for name in ("127.0.0.1", "localhost") for ending in ports
                )

            def _asked(self) -> str | None:
                """The requested path below the token; None where the request was refused."""
                if self.headers.get("Host") not in self._own():
                    self.send_error(HTTPStatus.FORBIDDEN, "another host")
                    return None
                path = self.path.split("?", 1)[0].lstrip("/")
                given, slash, rest = path.partition("/")
                if not slash or not hmac.compare_digest(given.encode("utf-8"), token.encode("utf-8")):
                    self.send_error(HTTPStatus.NOT_FOUND)
                    return None
                return rest

            def _answer(self, body: bytes, kind: str, status: int = 200) -> None:
                self.send_response(status)
                for name, value in (
                    ("Content-Type", kind),
                    ("Content-Length", str(len(body))),
                    ("Cache-Control", "no-store"),
                    ("Content-Security-Policy", POLICY.format(nonce=nonce)),
                    ("X-Content-Type-Options", "nosniff"),
                    ("Referrer-Policy", "no-referrer"),
                    ("Cross-Origin-Resource-Policy", "same-origin"),
                ):
                    self.send_header(name, value)
                self.end_headers()
                try:
                    self.wfile.write(body)
                except (BrokenPipeError, ConnectionResetError):
                    # The browser went away.
                    pass

        try:
            self._server = ThreadingHTTPServer(("127.0.0.1", port), Handler)
        except OSError as error:
            raise MirrorPostureError(
                f"--port {port}: cannot be opened ({error.strerror}); give another, or 0 for any"
            ) from None
        self._server.daemon_threads = True
        self._thread = threading.Thread(target=self._server.serve_forever, args=(0.2,), daemon=True)
        self._thread.start()

    @property
    def address(self) -> str:
        """The page's address, with its token."""
        return f"http://127.0.0.1:{self._server.server_address[1]}/{self._token}/"

    def close(self) -> None:
        """Ends the server."""
        self._server.shutdown()
        self._server.server_close()
