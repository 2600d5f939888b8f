"""A real browser for the tests of pages: Chromium without a window, driven by its own debugging pipe; no further package."""

from __future__ import annotations

import base64
import json
import os
import shutil
import subprocess
import tempfile
from pathlib import Path
from types import TracebackType
from typing import Any

CHROMIUM = next(
    (found for name in ("chromium", "chromium-browser", "google-chrome") if (found := shutil.which(name))),
    None,
)
"""None: no browser is there, and tests of pages skip."""

OVERFLOW = """
(() => {
  document.querySelectorAll('details').forEach(d => d.open = true);
  const wide = document.documentElement.clientWidth, found = [];
  if (document.documentElement.scrollWidth > wide) found.push(`the page is ${document.documentElement.scrollWidth} px wide`);
  const text = [...document.querySelectorAll('h1, h2, h3, p, li, td, th, a, .verdict, .tag, summary')];
  for (const e of text) {
    const box = e.getBoundingClientRect();
    if (box.width && box.right > wide + 1 && !e.closest('.wide')) found.push(`${e.tagName} leaves the page: ${e.textContent.trim().slice(0, 40)}`);
    if (!e.closest('.wide') && e.scrollWidth > e.clientWidth + 1 && getComputedStyle(e).display != 'inline') found.push(`${e.tagName} is cut: ${e.textContent.trim().slice(0, 40)}`);
  }
  const blocks = [...document.querySelectorAll('h1, h2, h3, p, li > b, table, .verdict, svg')].filter(e => e.getBoundingClientRect().height);
  for (let i = 0; i < blocks.length; i++) for (let j = i + 1; j < blocks.length; j++) {
    if (blocks[i].contains(blocks[j]) || blocks[j].contains(blocks[i])) continue;
    const a = blocks[i].getBoundingClientRect(), b = blocks[j].getBoundingClientRect();
    const x = Math.min(a.right, b.right) - Math.max(a.left, b.left), y = Math.min(a.bottom, b.bottom) - Math.max(a.top, b.top);
    if (x > 1 && y > 2) found.push(`${blocks[i].tagName} over ${blocks[j].tagName}: ${blocks[i].textContent.trim().slice(0, 30)} | ${blocks[j].textContent.trim().slice(0, 30)}`);
  }
  return found;
})()
"""
"""What of a page (all that can be unfolded unfolded) sticks out or lies over something else; places that scroll by themselves (`.wide`) may."""


class Browser:
    """One Chromium; use as a context."""

    def __enter__(self) -> Browser:
        assert CHROMIUM is not None
        self._home = tempfile.TemporaryDirectory(prefix="browser-", ignore_cleanup_errors=True)
        in_read, self._in = os.pipe()
        self._out, out_write = os.pipe()

        def pipes() -> None:
            # Chromium reads its commands from 3 and answers on 4; copies first, in case one of ours is 3 or 4.
            a, b = os.dup(in_read), os.dup(out_write)
            a, b = os.dup2(a, 30), os.dup2(b, 31)
            os.dup2(a, 3)
            os.dup2(b, 4)

        self._process = subprocess.Popen(
            [CHROMIUM, "--headless", "--no-sandbox", "--disable-gpu", "--remote-debugging-pipe", "--no-first-run",
             "--disable-dev-shm-usage", f"--user-data-dir={self._home.name}", "about:blank"],
            preexec_fn=pipes, close_fds=False, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )  # fmt: skip
        os.close(in_read)
        os.close(out_write)
        self._buffer, self._count, self._session = b"", 0, None
        targets = self.call("Target.getTargets")["targetInfos"]
        page = next(t["targetId"] for t in targets if t["type"] == "page")
        self._session = self.call("Target.attachToTarget", targetId=page, flatten=True)["sessionId"]
        self.call("Page.enable")
        return self

    def __exit__(self, *_: type[BaseException] | BaseException | TracebackType | None) -> None:
        self._process.kill()
        self._process.wait()
        os.close(self._in)
        os.close(self._out)
        self._home.cleanup()

    def call(self, method: str, **parameters: Any) -> Any:
        """A command of the DevTools protocol and its answer."""
        self._count += 1
        message = {"id": self._count, "method": method, "params": parameters}
        if self._session:
            message["sessionId"] = self._session
        os.write(self._in, json.dumps(message).encode() + b"\0")
        while True:
            answer = self._next()
            if answer.get("id") == self._count:
                assert "error" not in answer, f"{method}: {answer['error']}"
                return answer["result"]

    def _next(self) -> dict[str, Any]:
        while b"\0" not in self._buffer:
            more = os.read(self._out, 1 << 20)
            assert more, "the browser ended"
            self._buffer += more
        line, _, self._buffer = self._buffer.partition(b"\0")
        answer: dict[str, Any] = json.loads(line)
        return answer

    def open(self, page: Path | str, width: int, *, dark: bool = False, printed: bool = False) -> None:
        """Shows a page at a width, px."""
        self.call(
            "Emulation.setDeviceMetricsOverride", width=width, height=900, deviceScaleFactor=1, mobile=False
        )
        colours = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        self.call("Emulation.setEmulatedMedia", media="print" if printed else "screen", features=[colours])
        where = page.resolve().as_uri() if isinstance(page, Path) else page
        self.call("Page.navigate", url=where)
        while self.evaluate("document.readyState") != "complete":
            pass

    def evaluate(self, script: str) -> Any:
        """The value of an expression in the page."""
        return self.call("Runtime.evaluate", expression=script, returnByValue=True)["result"].get("value")

    def picture(self, file: Path) -> None:
        """The whole page as a PNG."""
        taken = self.call("Page.captureScreenshot", captureBeyondViewport=True)
        file.write_bytes(base64.b64decode(taken["data"]))
