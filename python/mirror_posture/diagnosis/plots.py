"""The report's plots: the gap as bars, and the signature of each cause."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ..arrays import Floats
from ..pages.drawing import (
    AFTER,
    BAR_ALPHA,
    BEFORE,
    FLOOR,
    FREE,
    INK,
    MANY_POINTS,
    Drawing,
    figure,
    finished,
    styled,
)
from . import formatting
from .parts import Gap, Signature

UNCLEAR = 6.0
"""A posture whose standard deviation is this many times the typical one gives little information, and is not drawn."""
MOSTLY_NOISE = 1.5
"""A gap in space below this many noise floors is mostly noise: the same bound as the core's for `closed`."""


def shows_in_pixels(gap: Gap) -> bool:
    """Whether the picture shows the gap better: where triangulated positions are mostly noise (their depth), or are none."""
    if None in (gap.before_px, gap.after_px, gap.noise_floor_px):
        return False
    if gap.before_m is None or gap.noise_floor_m is None:
        return True
    return gap.before_m < MOSTLY_NOISE * gap.noise_floor_m


def gap_told(gap: Gap) -> tuple[list[float], str, str]:
    """Before, after and noise floor in the unit that shows the gap, the unit, and its name; no values where
    there is nothing to compare.

    If the gap is shown in pixels, so is `closed`.
    """
    if shows_in_pixels(gap):
        in_pixels = (gap.before_px, gap.after_px, gap.noise_floor_px)
        return (
            [v for v in in_pixels if v is not None],
            "px",
            "RMS distance of predicted from seen markers, px",
        )
    in_space = [1000.0 * v for v in (gap.before_m, gap.after_m, gap.noise_floor_m) if v is not None]
    return (
        in_space if len(in_space) == 3 else [],
        "mm",
        "RMS distance of predicted from observed markers, mm",
    )


@styled
def draw_steps(gap: Gap) -> Drawing:
    """Bars: the held-out gap as causes are added one by one, from the nominal model to the remainder."""
    in_pixels = shows_in_pixels(gap)
    values = [step.rms_px if in_pixels else step.rms_m for step in gap.steps]
    floor = gap.noise_floor_px if in_pixels else gap.noise_floor_m
    factor, unit = (1.0, "px") if in_pixels else (1000.0, "mm")
    drawn, axes = figure(5.2, 0.9 + 0.36 * len(values))
    ax = axes[0, 0]
    lengths = [factor * (value or 0.0) for value in values]
    ax.barh(range(len(values)), lengths, color=[BEFORE, *[AFTER] * (len(values) - 1)], height=0.62)
    longest = max(*lengths, factor * (floor or 0.0), 1e-9)
    for row, value in enumerate(values):
        text = "not told by itself" if value is None else f"{factor * value:.2f} {unit}"
        ax.text(lengths[row] + 0.02 * longest, row, text, va="center")
    if floor is not None:
        ax.axvline(factor * floor, color=FLOOR, linestyle="--", linewidth=1.2)
    ax.set_yticks(range(len(values)), [_step_name(step.added) for step in gap.steps])
    ax.set_xlim(0.0, 1.3 * longest)
    ax.invert_yaxis()
    ax.set_xlabel(f"held-out gap, {unit} (dashed: noise floor)")
    return finished(drawn, "steps")


def _step_name(added: str | None) -> str:
    if added is None:
        return "the model as it is"
    effect, _, place = added.partition("@")
    text = f"+ {formatting.effect_in_words(effect)}, {formatting.place_in_words(place)}"
    return text if len(text) <= LONGEST_NAME else text[: LONGEST_NAME - 1] + "…"


LONGEST_NAME = 34
"""Letters of a step's name at most: more would leave no room for its bar."""


@styled
def draw_gap(gap: Gap) -> Drawing:
    """Bars: the gap before and after on held-out postures, with the interval of what was closed, and the noise floor."""
    values, unit, label = gap_told(gap)
    drawn, axes = figure(5.2, 2.1)
    ax = axes[0, 0]
    if not values:
        ax.text(0.5, 0.5, "no gap can be computed: nothing to compare", ha="center", va="center", color=FLOOR)
        ax.set_axis_off()
        return finished(drawn, "gap")
    ends = values[1]
    ax.barh(["before", "after", "noise floor"], values, color=[BEFORE, AFTER, FLOOR], height=0.62)
    if gap.closed_ci95 is not None:
        # closed = (before - after) / (before - floor): the interval of what was closed, as one of what is left.
        span = values[0] - values[2]
        low, high = sorted(values[0] - closed * span for closed in gap.closed_ci95)
        middle = values[1]
        ends = max(ends, high)
        ax.errorbar(
            [middle],
            [1],
            xerr=[[max(0.0, middle - low)], [max(0.0, high - middle)]],
            color=INK,
            capsize=4,
            fmt="none",
            linewidth=1.3,
        )
    width = max(*values, ends, 1e-9)
    for row, (value, end) in enumerate(
        zip(values, (values[0], max(values[1], ends), values[2]), strict=True)
    ):
        ax.text(end + 0.02 * width, row, f"{value:.2f} {unit}", va="center")
    ax.set_xlim(0.0, 1.25 * width)
    ax.invert_yaxis()
    ax.set_xlabel(label)
    return finished(drawn, "gap")


@styled
def draw_signature(signature: Signature, index: int, timed: bool = True) -> Drawing:
    """Four panels: the error that each posture shows by itself against position, load, direction and time.

    Not `timed`: the session has no times, and its rows are counted.
    """
    angular = signature.unit == "rad"
    factor, unit = (math.degrees(1.0), "°") if angular else (1000.0, "mm")
    error, std, fitted = (factor * a for a in (signature.error, signature.std, signature.fitted))
    other: tuple[tuple[Any, str], ...] = ()
    if signature.other is not None and signature.other_position is not None:
        # What depends on another joint shows its law against that one's position.
        name = formatting.place_in_words(signature.other)
        other = ((math.degrees(1.0) * signature.other_position, f"position of\n{name}, °"),)
    panels = (
        *other,
        (factor * signature.position, f"commanded position, {unit}"),
        (signature.torque_nm, "gravity torque, N m" if angular else "gravity force, N"),
        (signature.direction, "direction of the last motion"),
        (signature.time_s, "time, s" if timed else "row"),
    )
    drawn, axes = figure(11.0, 2.7, columns=len(panels), sharey=True)
    for ax, (x, label) in zip(axes[0], panels, strict=True):
        order = np.argsort(x, kind="stable")
        draw_postures(ax, x[order], error[order], std[order], fitted[order], signature.cause is None)
        ax.set_xlabel(label)
        # Labels like −0.035 of more places touch.
        ax.locator_params(axis="x", nbins=4)
    direction = len(panels) - 2
    axes[0, direction].set_xticks([-1, 0, 1], ["down", "none", "up"])
    axes[0, direction].set_xlim(-1.5, 1.5)
    axes[0, 0].set_ylabel(f"error, {unit}")
    # Above the panels: inside one it would hide points.
    drawn.legend(
        *axes[0, 0].get_legend_handles_labels(), fontsize=8, frameon=False, loc="outside upper left", ncols=2
    )
    return finished(drawn, f"signature{index}")


def draw_postures(ax: Any, x: Floats, error: Floats, std: Floats, fitted: Floats, free: bool) -> None:
    """An error as each posture shows it by itself, and what is said of it: a cause's law, or one without a law (`free`)."""
    # Postures that hardly show the place have bars that would hide the rest.
    clear = std <= UNCLEAR * (np.median(std) if len(std) else 1.0)
    many = len(x) > MANY_POINTS
    ax.errorbar(
        x[clear], error[clear], yerr=std[clear], fmt="o", markersize=1.2 if many else 3.0, color=FLOOR,
        ecolor=(FLOOR, BAR_ALPHA), elinewidth=1, rasterized=many, label="each posture alone, ± 1 std",
    )  # fmt: skip
    if not free or np.any(fitted):
        said = "smooth error without a law" if free else "what the cause says"
        color = FREE if free else BEFORE
        ax.plot(x, fitted, ".", color=color, markersize=4, zorder=5, rasterized=many, label=said)
    ax.axhline(0.0, color=INK, linewidth=0.6)
