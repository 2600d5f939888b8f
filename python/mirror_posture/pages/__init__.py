"""Pages for a browser: one HTML file each, which needs no network, no script and no other file."""

from __future__ import annotations

from .drawing import Drawing, figure, finished, styled
from .write import inline, render

__all__ = ["Drawing", "figure", "finished", "inline", "render", "styled"]
