"""Figures in the paper's style: lines with markers over a grid, dashed without and solid with the mirror's constraint."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Floats = npt.NDArray[np.float64]

EQ1, EQ2, OURS = "#b0413e", "#2f6f9f", "#2e8b57"
"""Colours of the two estimators that the paper compares, and of what is beyond the paper."""
MANY = ("#2f6f9f", "#b0413e", "#2e8b57", "#7a4fa3", "#c77f1a", "#444444")
MARKERS = "os^Dv*"
BEYOND = "beyond the paper"

PANEL_INCHES = (4.6, 3.5)
PNG_DPI = 120
COLOURS = 64
"""Enough for a line drawing; the file is a third as large."""
STYLE: Any = {
    "font.size": 9,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.grid.axis": "y",
    "grid.color": "#d8d8d8",
    "grid.linewidth": 0.7,
    "axes.axisbelow": True,
    "legend.frameon": False,
    "legend.fontsize": 8,
}


@dataclass(frozen=True)
class Series:
    """One line: y over x, with its spread where there is one."""

    label: str
    x: Floats
    y: Floats
    spread: Floats | None = None
    color: str = EQ2
    line: str = "-"
    marker: str = "o"
    filled: bool = True


@dataclass(frozen=True)
class Panel:
    """One diagram. `y_top` None leaves the axis to the data; it starts at 0 unless it is logarithmic."""

    title: str
    x_label: str
    y_label: str
    x_ticks: Sequence[float]
    series: Sequence[Series]
    y_top: float | None = None
    y_step: float | None = None
    logarithmic: bool = False
    y_ticks: Sequence[float] | None = None


def drawn(panels: Sequence[Panel], legend_columns: int = 3) -> bytes:
    """The panels side by side, as PNG; the first one's legend above them all."""
    from matplotlib import rc_context
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    width, height = PANEL_INCHES
    with rc_context(STYLE):
        figure = Figure(figsize=(width * len(panels), height), layout="constrained")
        FigureCanvasAgg(figure)
        axes = figure.subplots(1, len(panels), squeeze=False)
        for ax, panel in zip(axes[0], panels, strict=True):
            _draw(ax, panel)
        entries: dict[str, Any] = {}
        for ax in axes[0]:
            entries |= {
                label: handle
                for handle, label in zip(*ax.get_legend_handles_labels(), strict=True)
                if label not in entries
            }
        columns = legend_columns if len(panels) > 1 else 1
        figure.legend(entries.values(), entries.keys(), loc="outside upper center", ncols=columns)
        return png(figure)


def png(figure: Any, colours: int = COLOURS) -> bytes:
    """A matplotlib figure as a small PNG."""
    from PIL import Image

    raster, small = io.BytesIO(), io.BytesIO()
    figure.savefig(raster, format="png", dpi=PNG_DPI)
    raster.seek(0)
    image = Image.open(raster).convert("RGB").quantize(colours, dither=Image.Dither.NONE)
    image.save(small, format="png", optimize=True)
    return small.getvalue()


def _draw(ax: Axes, panel: Panel) -> None:
    for series in panel.series:
        face = series.color if series.filled else "white"
        style: Any = {
            "color": series.color,
            "linestyle": series.line,
            "marker": series.marker,
            "markersize": 4.5,
            "markerfacecolor": face,
            "linewidth": 1.3,
            "label": series.label,
        }
        if series.spread is None:
            ax.plot(series.x, series.y, **style)
        else:
            ax.errorbar(series.x, series.y, series.spread, capsize=2.5, elinewidth=0.8, **style)
    ax.set_title(panel.title, fontsize=9)
    ax.set_xlabel(panel.x_label)
    ax.set_ylabel(panel.y_label)
    ax.set_xticks(list(panel.x_ticks))
    if panel.logarithmic:
        ax.set_yscale("log")
        ax.yaxis.set_major_formatter("{x:g}")
        if panel.y_ticks is not None:
            ax.set_yticks(list(panel.y_ticks))
    else:
        ax.set_ylim(0.0, panel.y_top)
        if panel.y_step is not None and panel.y_top is not None:
            ax.set_yticks(np.arange(0.0, panel.y_top + panel.y_step / 2, panel.y_step))
