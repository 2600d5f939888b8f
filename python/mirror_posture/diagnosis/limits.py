"""Limits of detection of a diagnosis, in readable units: as a line, as a table, and on the robot."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from ..pages.drawing import FIXED, INK, Drawing, finished, styled
from ..session import Session
from . import formatting
from .parts import Limit
from .result import Diagnosis
from .skeleton import VIEWS, Stance, links_of

CLASSES = (
    (np.radians(0.2), 0.001, "#2f7f4f", "up to 0.2° or 1 mm"),
    (np.radians(1.0), 0.003, "#c77f1a", "up to 1° or 3 mm"),
    (np.inf, np.inf, "#b0413e", "more"),
)
"""Largest hidden angle and length, colour and words of a place on the robot."""
ANY, ANY_COLOUR = "any size", "#7b1fa2"
BEYOND = 1e4
"""In people's units: from this size on nothing is meant any more (a spring where gravity has no lever)."""
DRAWN = ("joint_offset", "link_length", "marker_mount", "board_mount", "camera_mount")
"""Effects whose limits the picture shows: where each place sits, and how a joint's zero lies."""


@dataclass(frozen=True)
class Told:
    """An effect with the place where these postures show it best, and the one where they hide most."""

    effect: str
    places: int
    best: str
    best_size: str
    worst: str
    worst_size: str


def size_of(limit: Limit) -> float:
    """The largest limit of an effect's parameters; infinite where any size would be hidden. Units as the parameters say."""
    return max((np.inf if size is None else size for size in limit.parameters.values()), default=0.0)


def in_words(limit: Limit) -> str:
    """The largest limit, in people's units; of a mount both the angle and the length."""
    parts: dict[str, tuple[float, float]] = {}
    for name, size in limit.parameters.items():
        unit, factor = formatting.unit_of(name, limit.slides)
        value = np.inf if size is None else factor * size
        if value >= parts.get(unit, (-1.0, 0.0))[0]:
            parts[unit] = (value, factor)
    return ", ".join(_rounded(value, unit) for unit, (value, _) in parts.items())


def _rounded(value: float, unit: str) -> str:
    return ANY if not value < BEYOND else f"{float(f'{value:.2g}'):g} {unit}".rstrip()


def table(found: Diagnosis) -> list[Told]:
    """One row an effect, those that are hidden most first within their unit."""
    # Angles and lengths are not compared.
    by_effect: dict[tuple[str, bool], list[Limit]] = {}
    for limit in found.limits:
        other = any(formatting.unit_of(n, True) != formatting.unit_of(n, False) for n in limit.parameters)
        by_effect.setdefault((limit.effect, limit.slides and other), []).append(limit)
    rows = []
    for (effect, _), limits in by_effect.items():
        ordered = sorted(limits, key=size_of)
        best, worst = ordered[0], ordered[-1]
        rows.append(
            Told(
                formatting.effect_in_words(effect),
                len(limits),
                formatting.place_in_words(best.at),
                in_words(best),
                formatting.place_in_words(worst.at),
                in_words(worst),
            )
        )
    return rows


def line(found: Diagnosis) -> str:
    """The limits in one line: zeros of joints and mounts of markers, at the middle place and at the worst, and where nothing of
    them is seen; empty without any."""
    parts, unseen = [], []
    for effect, slides, what in (
        ("joint_offset", False, "a joint's zero"),
        ("joint_offset", True, "a prismatic joint's zero"),
        ("marker_mount", False, "a marker's mount"),
    ):
        limits = sorted(
            (one for one in found.limits if (one.effect, one.slides) == (effect, slides)), key=size_of
        )
        nowhere = [formatting.place_in_words(one.at) for one in limits if ANY in in_words(one)]
        if nowhere:
            unseen.append(f"{what} at {formatting.listed(nowhere)}")
        seen = limits[: len(limits) - len(nowhere)]
        # The middle of all places, where it is seen there.
        middle = len(limits) // 2
        if middle >= len(seen):
            continue
        text = f"{what} by {in_words(seen[middle])}"
        if len(limits) > 1:
            text += f" ({in_words(seen[-1])} at {formatting.place_in_words(seen[-1].at)})"
        parts.append(text)
    told = [f"These postures would have hidden (95 %) {formatting.listed(parts)}."] if parts else []
    if unseen:
        told.append(
            f"{'They' if parts else 'These postures'} cannot show {formatting.listed(unseen)} at all."
        )
    return " ".join(told)


@styled
def draw_limits(session: Session, found: Diagnosis) -> Drawing:
    """The robot at the session's median posture; each place in the colour of what would have been hidden there."""
    keys = [(colour, words) for _, _, colour, words in CLASSES] + [(ANY_COLOUR, ANY)]
    worse = [colour for colour, _ in keys]
    stance = Stance(session)
    drawn, axes = stance.figure(more_inches=0.8)
    marks: dict[tuple[str, str], list[str]] = {}
    for link, colour, shape in _marks(session, found):
        marks.setdefault((colour, shape), []).append(link)
    for ax, view in zip(axes, VIEWS, strict=True):
        stance.bones(ax, view, [True, False], color=FIXED, linewidth=1.6)
        # Where two fall on one place, the worse one is on top.
        for (colour, shape), links in sorted(marks.items(), key=lambda mark: worse.index(mark[0][0])):
            at = np.array([stance.flat(link, view) for link in links])
            ax.plot(*at.T, shape, color=colour, markersize=7, markeredgecolor=INK, zorder=3)
        ax.set_title(f"from {view[0]}, mm", color=INK, fontsize=10, loc="left")
    handles = [axes[0].plot([], [], "o", color=colour, markeredgecolor=INK)[0] for colour, _ in keys]
    drawn.legend(
        handles, [words for _, words in keys], fontsize=8, frameon=False, loc="outside lower center", ncols=4
    )
    return finished(drawn, "limits")


def _marks(session: Session, found: Diagnosis) -> Iterable[tuple[str, str, str]]:
    """Link, colour and shape: joints' zeros as dots, markers as diamonds, board and camera as squares."""
    shapes = {"joint": "o", "marker": "D", "board": "s", "camera": "s"}
    for limit in found.limits:
        kind = limit.at.partition(":")[0]
        if limit.effect in DRAWN and kind in shapes:
            for link in links_of(session, limit.at)[:1]:
                yield link, _colour(limit), shapes[kind]


def _colour(limit: Limit) -> str:
    for angle, length, colour, _ in CLASSES:
        bounds = [
            (angle if name.endswith("_rad") and not limit.slides else length, size)
            for name, size in limit.parameters.items()
        ]
        if all(size is not None and size <= most for most, size in bounds):
            return colour
    return ANY_COLOUR
