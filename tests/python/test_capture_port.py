"""The capture's page on the port of `http` itself, which browsers leave out of what they send."""

from __future__ import annotations

import http.client
from typing import cast
from urllib.parse import urlsplit

import pytest

from mirror_posture.capture.loop import Capture
from mirror_posture.capture.server import CaptureServer


class Done:
    """A capture that does whatever is asked."""

    def do(self, action: str) -> str:
        return action


@pytest.mark.parametrize(("told", "answered"), [(80, True), (None, False)])
def test_on_port_80_names_without_a_port_are_its_own(told: int | None, answered: bool) -> None:
    server = CaptureServer(cast("Capture", Done()))
    try:
        address = urlsplit(server.address)
        assert address.port is not None
        # Port 80 belongs to the administrator: only the number that the server goes by is changed.
        server._server.server_address = ("127.0.0.1", told or address.port)

        def ask(method: str, what: str, host: str, body: str | None = None, origin: str = "") -> int:
            connection = http.client.HTTPConnection("127.0.0.1", address.port, timeout=10)
            headers = {"Host": host} | ({"Origin": origin} if origin else {})
            connection.request(method, address.path + what, body, headers)
            status = connection.getresponse().status
            connection.close()
            return status

        action = '{"action": "start"}'
        for name in ("127.0.0.1", "localhost"):
            # Before, the page that the command had named was refused.
            assert ask("GET", "", name) == (200 if answered else 403)
            assert ask("POST", "do", name, action, f"http://{name}") == (200 if answered else 403)
            port = told or address.port
            assert ask("GET", "", f"{name}:{port}") == 200
            assert ask("POST", "do", f"{name}:{port}", action, f"http://{name}:{port}") == 200
        own = f"127.0.0.1:{told or address.port}"
        for foreign in ("evil.example", "127.0.0.1.evil.example", ""):
            assert ask("GET", "", foreign) == 403
        assert ask("POST", "do", own, action, "http://evil.example") == 403
        assert ask("POST", "do", own, action, "https://127.0.0.1") == 403
    finally:
        server.close()
