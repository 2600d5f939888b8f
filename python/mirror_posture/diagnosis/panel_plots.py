"""Signatures of causes that are not joint positions: tracks of markers, links, axes and the camera; fields
of arrows over image and board."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from ..arrays import Floats
from ..pages.drawing import AFTER, BEFORE, FLOOR, FREE, INK, Drawing, figure, finished, styled
from . import formatting
from .parts import Field, Track
from .plots import draw_postures

if TYPE_CHECKING:
    from matplotlib.axes import Axes

UNITS = {"rad": ("°", math.degrees(1.0)), "m": ("mm", 1000.0), "1": ("%", 100.0), "px": ("px", 1.0)}
"""A unit of the core, its readable unit, and the factor."""
MOST_COLUMNS = 4
"""More plots than this side by side are not readable."""
WORST = 3.0
"""A component that is so much less certain than the best one does not set the common scale."""
ARROW_SHARE = 0.09
"""The longest arrow, as a share of the picture's width."""
BOARD_EDGE = 0.14
"""Free edge around the board's corners, as a share of their extent."""
SIGNIFICANT = 3.0
"""Arrows shorter than this many standard deviations are grey."""
HEIGHTS = "PuOr"
"""Colours of a displacement out of the board's plane: orange away from the viewer, violet towards."""


@styled
def draw_track(track: Track, index: int, timed: bool = True) -> Drawing:
    """One row for each component, one column for each quantity: the value of each posture alone, and the
    cause's; one scale for all.

    Against one quantity alone the components are side by side. Not `timed`: the session has no times, and
    its rows are counted.
    """
    unit, factor = UNITS[track.unit]
    columns = _columns(track)
    components = len(track.components)
    if len(columns) == 1:
        drawn, axes = figure(11.0, 2.6, columns=components, sharey=True)
        axes = axes.T
    else:
        height = 1.45 * components + 1.25
        drawn, axes = figure(11.0, height, components, len(columns), sharex="col", sharey=True)
    limit = factor * _limit(track)
    error, std, fitted = (factor * a for a in (track.error, track.std, track.fitted))
    for row, component in enumerate(track.components):
        for ax, column in zip(axes[row], columns, strict=True):
            x, label = _quantity(track, column)
            if not timed and track.against[column] == "time":
                label = "row"
            draw_postures(ax, x, error[:, row], std[:, row], fitted[:, row], track.cause is None)
            ax.set_ylim(-limit, limit)
            if row == components - 1 or len(columns) == 1:
                ax.set_xlabel(label)
        axes[row, 0].set_ylabel(f"{component}, {unit}")
    drawn.legend(
        *axes[0, 0].get_legend_handles_labels(), fontsize=8, frameon=False, loc="outside upper left", ncols=2
    )
    return finished(drawn, f"track{index}")


def _columns(track: Track) -> list[int]:
    """The quantities that are drawn: of many moments those that vary most; the order stays."""
    count = len(track.against)
    if count <= MOST_COLUMNS:
        return list(range(count))
    span = np.ptp(track.values, axis=0)
    moments = [k for k in range(count) if track.against[k].startswith("moment")]
    dropped = sorted(moments, key=lambda k: span[k])[: count - MOST_COLUMNS]
    return [k for k in range(count) if k not in dropped][:MOST_COLUMNS]


def _limit(track: Track) -> float:
    """Half of the common scale: everything of the cause, and nearly everything of the well-observed
    components."""
    typical = np.median(track.std, axis=0)
    well = typical <= WORST * typical.min()
    shown = np.quantile(np.abs(track.error[:, well]) + track.std[:, well], 0.98)
    return max(1.15 * float(shown), 1.3 * float(np.abs(track.fitted).max()), 1e-9)


def _quantity(track: Track, column: int) -> tuple[Floats, str]:
    """Values and label of a quantity, in readable units."""
    name, unit, values = track.against[column], track.against_units[column], track.values[:, column]
    told, factor = UNITS.get(unit, (unit, 1.0))
    name = formatting.place_in_words(name)
    # A long name in two lines, because four of them are side by side.
    for start in ("position of ", "torque of "):
        if name.startswith(start):
            name = f"{'commanded position' if start[0] == 'p' else 'gravity torque'} of\n{name.removeprefix(start)}"
    return factor * values, f"{name}, {told}" if told else name


@styled
def draw_field(field: Field, index: int) -> Drawing:
    """Arrows of the mean residual of the board's corners, without the cause and with it, on one scale."""
    std = field.std.max(axis=1)
    # Cells at the edge of the observed area contain few corners: their noise would set the scale.
    clear = std <= WORST * np.array([std[[kind == of for kind in field.of]].min() for of in field.of])
    markers = np.array([of == "markers" for of in field.of])[clear]
    unit, factor = UNITS[field.unit]
    on_image = field.over == "image"
    stretch = 1.0 if on_image else 1000.0
    at, size = stretch * field.at_points[clear], stretch * field.size
    pictures = [(title, factor * residual[clear]) for title, residual in _pictures(field)]
    edge = 0.0 if on_image else BOARD_EDGE * float(size.max())
    width, height = size + 2.0 * edge
    shape = 0.9 + float(np.clip(5.0 * height / width, 2.2, 5.0))
    drawn, axes = figure(5.5 * len(pictures), shape, columns=len(pictures), sharey=True)
    longest = max(1e-9, *(float(np.hypot(r[:, 0], r[:, 1]).max()) for _, r in pictures))
    highest = max(float(np.abs(r[:, 2]).max()) for _, r in pictures) if not on_image else 0.0
    scale = longest / (ARROW_SHARE * width)
    colours = np.where(markers, AFTER, FREE if field.cause is None else BEFORE)
    for ax, (title, residual) in zip(axes[0], pictures, strict=True):
        _arrows(ax, at, residual, factor * field.std[clear], scale, colours)
        if highest > 0.0:
            _heights(ax, at, residual[:, 2], highest)
        ax.set_title(title, fontsize=10, loc="left", color=INK)
        ax.set_aspect("equal")
        if on_image:
            # Rows of a picture run downwards.
            ax.set_xlim(0.0, size[0])
            ax.set_ylim(size[1], 0.0)
        else:
            ax.set_xlim(-width / 2, width / 2)
            ax.set_ylim(-height / 2, height / 2)
        for side in ("top", "right"):
            ax.spines[side].set_visible(True)
        ax.set_xlabel("column, px" if on_image else "x on the board, mm")
    axes[0, 0].set_ylabel("row, px" if on_image else "y on the board, mm")
    _key(axes[0, -1], _round(longest), unit)
    if highest > 0.0:
        bar = drawn.colorbar(axes[0, -1].collections[1], ax=list(axes[0]), shrink=0.9, pad=0.02)
        bar.set_label("out of the board, mm (towards the viewer +)", fontsize=9)
        bar.outline.set_visible(False)
    return finished(drawn, f"field{index}")


def _pictures(field: Field) -> list[tuple[str, Floats]]:
    """Titles and residuals of what is drawn side by side."""
    if field.with_cause is None:
        return [("what is left", field.without)]
    if field.cause is None:
        return [
            ("without the unexplained part", field.without),
            ("with a smooth error without a law", field.with_cause),
        ]
    return [("without the cause", field.without), ("with the cause", field.with_cause)]


def _key(ax: Any, length: float, unit: str) -> None:
    """How long an arrow of a round length is, in the lower right corner."""
    ax.quiverkey(
        ax.collections[0],
        0.84,
        0.05,
        length,
        f"{length:g} {unit}",
        labelpos="E",
        coordinates="axes",
        color=INK,
        fontproperties={"size": 9},
    )


def _arrows(ax: Axes, at: Floats, residual: Floats, std: Floats, scale: float, colours: Any) -> None:
    """The arrows of one picture; those within the noise are grey."""
    length = np.hypot(residual[:, 0], residual[:, 1])
    clear = length > SIGNIFICANT * np.hypot(std[:, 0], std[:, 1]) / math.sqrt(2.0)
    ax.quiver(
        *at.T,
        *residual[:, :2].T,
        angles="xy",
        scale_units="xy",
        scale=scale,
        color=np.where(clear, colours, FLOOR),
        width=0.0042,
        zorder=3,
    )


def _heights(ax: Axes, at: Floats, height: Floats, highest: float) -> None:
    """Displacements out of the board as coloured dots below the arrows."""
    ax.scatter(
        at[:, 0],
        at[:, 1],
        c=height,
        cmap=HEIGHTS,
        vmin=-highest,
        vmax=highest,
        s=70,
        edgecolors="#bbbbbb",
        linewidths=0.5,
        zorder=2,
    )


def _round(length: float) -> float:
    """1, 2 or 5 times a power of ten, not longer than a length."""
    power = 10.0 ** math.floor(math.log10(length))
    return max(step * power for step in (1.0, 2.0, 5.0) if step * power <= length * (1.0 + 1e-9))
