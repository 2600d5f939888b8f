"""Pictures of the pages: one style, as SVG that follows the page's light or dark colours, and as PNG."""

from __future__ import annotations

import io
import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ..figure_settings import drawn_with

if TYPE_CHECKING:
    from matplotlib.figure import Figure

BEFORE, AFTER, FLOOR = "#b0413e", "#2f6f9f", "#9a9a9a"
FREE = "#c2185b"
"""What no cause explains."""
INK, PAPER = "#222222", "#ffffff"
BODY, FIXED, JOINT = "#555555", "#c8c8c8", "#333333"
"""Links, fixed links and joints of a drawn robot."""
GOOD, FOURTH, FIFTH, SIXTH = "#2f7f4f", "#c77f1a", "#6b4c9a", "#8a5a44"
COLOURS = (BEFORE, AFTER, FLOOR, FREE, INK, PAPER, BODY, FIXED, JOINT, GOOD, FOURTH, FIFTH, SIXTH)
"""Colours that are others on a dark page: `base.html.j2` names each `--c-` with its six digits."""
PNG_DPI = 140
RASTER_DPI = 110
"""Of what is drawn as pixels within an SVG."""
MANY_POINTS = 300
"""More points than this are drawn small, so that their law shows, and as pixels: each point of an SVG takes 200 bytes."""
BAR_ALPHA = 0.45
"""Bars of one standard deviation are fainter than their points, on light and dark pages."""
STYLE: Any = {
    "font.size": 10,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "svg.fonttype": "none",
    "svg.hashsalt": "mirror-posture",
    "font.family": "sans-serif",
    # A dollar in a name is a dollar.
    "text.parse_math": False,
    "text.color": INK,
    "axes.labelcolor": INK,
    "axes.edgecolor": INK,
    "xtick.color": INK,
    "ytick.color": INK,
}

styled = drawn_with(STYLE)
"""For functions that draw with `figure` and `finished`."""


@dataclass(frozen=True)
class Drawing:
    """One picture, as an SVG element for a page and as PNG bytes."""

    svg: str
    png: bytes


def figure(
    width: float, height: float, rows: int = 1, columns: int = 1, **options: Any
) -> tuple[Figure, Any]:
    """A figure of a function that is `styled`, inches; axes as a (rows, columns) array."""
    from matplotlib import rcParams
    from matplotlib.figure import Figure

    if rcParams["svg.hashsalt"] != STYLE["svg.hashsalt"]:
        raise RuntimeError("figure: got a function that is not `styled`; its texts would be read as formulas")
    drawn = Figure(figsize=(width, height), layout="constrained")
    return drawn, drawn.subplots(rows, columns, squeeze=False, **options)


def finished(drawn: Figure, name: str) -> Drawing:
    """The figure as SVG (ids made unique by the name, since a page has several; no background) and PNG."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.backends.backend_svg import FigureCanvasSVG
    from PIL import Image

    vector, raster = io.StringIO(), io.BytesIO()
    # Drawn once a format and laid out once: `savefig` does each of them twice.
    drawn.set_dpi(PNG_DPI)
    # matplotlib has no types for its canvases.
    picture: Any = FigureCanvasAgg(drawn)
    picture.draw()
    Image.fromarray(np.asarray(picture.buffer_rgba())[..., :3]).save(
        raster, format="png", dpi=(PNG_DPI, PNG_DPI)
    )
    drawn.set_layout_engine("none")
    for background in (drawn.patch, *(ax.patch for ax in drawn.axes)):
        background.set_visible(False)
    drawn.set_dpi(RASTER_DPI)
    vectors: Any = FigureCanvasSVG(drawn)
    vectors.print_svg(vector, metadata={"Date": None})
    svg = vector.getvalue()
    svg = svg[svg.index("<svg") :]
    # Names of robots end up here, and may hold anything.
    prefix = re.sub(r"[^A-Za-z0-9]", "", name) + "-"
    svg = re.sub(r'id="([^"]+)"', lambda found: f'id="{prefix}{found[1]}"', svg)
    svg = re.sub(r'(xlink:href="#|url\(#)', lambda found: found[1] + prefix, svg)
    return Drawing(re.sub(r'style="[^"]*"', _follow_the_page, svg), raster.getvalue())


def _follow_the_page(style: re.Match[str]) -> str:
    """A style attribute whose colours are the page's variables, with the colour itself where there is no page around."""
    return re.sub(
        r"#([0-9a-f]{6})\b",
        lambda found: f"var(--c-{found[1]}, {found[0]})" if found[0] in COLOURS else found[0],
        style[0],
    )
