"""The robot as a stick figure, from the front and from the side, with the causes' places marked."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ..arrays import Floats
from ..pages.drawing import (
    AFTER,
    BEFORE,
    BODY,
    FIFTH,
    FIXED,
    FLOOR,
    FOURTH,
    FREE,
    GOOD,
    INK,
    JOINT,
    PAPER,
    SIXTH,
    Drawing,
    figure,
    finished,
    styled,
)  # fmt: skip
from ..session import Session
from . import formatting
from .result import Diagnosis

CAUSE_COLOURS = (BEFORE, FOURTH, FIFTH, GOOD, AFTER, SIXTH)
VIEWS = (("the front", 1, 1.0), ("its left", 0, -1.0))
"""Name, the root axis that runs to the right, and its sign on the page: x looks ahead and z up (REP 103)."""
MARGIN = 0.08
"""Free edge around the robot, as a share of its largest extent."""
WIDTH = 6.4
"""Of the picture, inches."""
LEAST_SHARE = 0.05
"""An unexplained place is marked from this share of the gap on."""


@dataclass(frozen=True)
class Stance:
    """The nominal robot at the session's median posture, flattened for the two views; lengths in mm in the base's frame."""

    session: Session

    @cached_property
    def place_mm(self) -> dict[str, Floats]:
        """The origin of each link, (3,)."""
        robot = self.session.robot
        poses = robot.forward_kinematics(np.median(self.session.positions, axis=0, keepdims=True))[0]
        base = np.linalg.inv(poses[robot.link_index(self.session.root_link)])
        return {name: 1000.0 * (base @ poses[i])[:3, 3] for i, name in enumerate(robot.link_names)}

    @cached_property
    def ends_mm(self) -> tuple[Floats, Floats]:
        """The lower and the upper corner (3,) of the robot with a free edge around it."""
        points = np.array(list(self.place_mm.values()))
        low, high = points.min(axis=0), points.max(axis=0)
        edge = MARGIN * float((high - low).max()) + 1.0
        return low - edge, high + edge

    def flat(self, link: str, view: tuple[str, int, float]) -> tuple[float, float]:
        """Where a view shows a link's origin: to the right, and up."""
        point = self.place_mm[link]
        return view[2] * float(point[view[1]]), float(point[2])

    def width_mm(self, view: tuple[str, int, float]) -> tuple[float, float]:
        """The ends of a view, from left to right."""
        low, high = sorted(view[2] * float(end[view[1]]) for end in self.ends_mm)
        return low, high

    def figure(self, names: float = 0.0, more_inches: float = 0.6) -> tuple[Any, Any]:
        """A figure and an axes for each of `VIEWS`, both on one scale; beside the first view `names` mm of room for names."""
        low, high = self.ends_mm
        ahead, left, up = high - low
        height = float(np.clip(WIDTH * up / (ahead + left + names), 2.8, 7.0))
        drawn, axes = figure(
            WIDTH, height + more_inches, columns=2, width_ratios=[left + names, ahead], sharey=True
        )
        for view, ax in zip(VIEWS, axes[0], strict=True):
            start, end = self.width_mm(view)
            ax.set_xlim(start, end + (names if view is VIEWS[0] else 0.0))
            ax.set_ylim(low[2], high[2])
            ax.set_aspect("equal")
            ax.tick_params(labelsize=8, colors=FLOOR)
        return drawn, axes[0]

    def bones(self, ax: Any, view: tuple[str, int, float], kinds: Iterable[bool], **style: Any) -> None:
        """Joints that move (True), that are fixed (False), or both, as one path of lines from link to link."""
        wanted = set(kinds)
        joints = [j for j in self.session.robot.joints if (j.kind != "fixed") in wanted]
        gap = (np.nan, np.nan)
        path = [
            point
            for joint in joints
            for point in (self.flat(joint.parent_link, view), self.flat(joint.child_link, view), gap)
        ]
        if path:
            ax.plot(*np.array(path).T, zorder=1, **style)


@styled
def draw_robot(session: Session, found: Diagnosis) -> Drawing:
    """Forward kinematics of the nominal model at the session's median posture; joints as dots, guilty places in colour."""
    stance = Stance(session)
    marked = [entry for entry in guilty(session, found) if entry[0] in stance.place_mm]
    names = 0.3 * float((stance.ends_mm[1] - stance.ends_mm[0])[:2].sum()) if marked else 0.0
    drawn, axes = stance.figure(names)
    for ax, view in zip(axes, VIEWS, strict=True):
        stance.bones(ax, view, [False], color=FIXED, linewidth=1.0, solid_capstyle="round")
        stance.bones(ax, view, [True], color=BODY, linewidth=2.4, solid_capstyle="round")
        joints = [stance.flat(j.child_link, view) for j in session.robot.joints if j.kind != "fixed"]
        if joints:
            ax.plot(*np.array(joints).T, "o", color=JOINT, markersize=3.5, zorder=2)
        if markers := [stance.flat(marker.link, view) for marker in session.markers]:
            style = {"markerfacecolor": PAPER, "markeredgecolor": INK, "markersize": 5}
            ax.plot(*np.array(markers).T, "o", zorder=3, **style)
        named, (start, end) = view is VIEWS[0], stance.width_mm(view)
        _mark(ax, [(stance.flat(link, view), colour, text) for link, colour, text in marked], named, end)
        # The unit once: a slim robot's side has no room for it.
        unit = ", mm" if named else ""
        ax.set_title(f"from {view[0]}{unit}", color=INK, fontsize=10, loc="left")
        # The axis ends with the robot; names are beside it.
        ax.set_xticks([t for t in ax.get_xticks() if start <= t <= end])
        ax.spines.bottom.set_bounds(start, end)
        for side in ("left", "bottom"):
            ax.spines[side].set_color(FLOOR)
    return finished(drawn, "robot")


def _mark(ax: Any, guilty: list[tuple[tuple[float, float], str, str]], named: bool, column: float) -> None:
    """Places of causes as coloured dots; their names are in a column beside the robot, so that none hides
    another."""
    low, high = ax.get_ylim()
    step, last = 0.085 * (high - low), high
    ordered = sorted(guilty, key=lambda entry: -entry[0][1])
    for index, ((x, y), colour, text) in enumerate(ordered):
        # Of several causes at one place the first is a ring around the next.
        later = sum(at == (x, y) for at, _, _ in ordered[index + 1 :])
        ax.plot(x, y, "o", color=colour, markersize=10 + 6 * later, zorder=6)
        if not named:
            continue
        last = min(y, last - step)
        ax.annotate(
            text,
            (x, y),
            xytext=(column, last),
            color=colour,
            fontsize=9.5,
            fontweight="bold",
            va="center",
            arrowprops={"arrowstyle": "-", "color": colour, "linewidth": 0.9, "relpos": (0.0, 0.5)},
            zorder=7,
        )


def guilty(session: Session, found: Diagnosis) -> list[tuple[str, str, str]]:
    """Link at whose origin a place is drawn, its colour and its label."""
    marked = []
    for index, cause in enumerate(found.causes):
        label = f"{index + 1}  {formatting.effect_in_words(cause.effect)}"
        for link in links_of(session, cause.at)[:1]:
            marked.append((link, CAUSE_COLOURS[index % len(CAUSE_COLOURS)], label))
    if found.verdict in ("partial", "unknown"):
        for where in found.where:
            if where.depends_on and where.share >= LEAST_SHARE:
                marked += [(link, FREE, "unexplained") for link in links_of(session, where.at)[:1]]
    return marked


def links_of(session: Session, at: str) -> list[str]:
    """The links at whose origins a place of the vocabulary is seen; none for the mirror and the data."""
    robot = session.robot
    kind, _, name = at.partition(":")
    if kind == "joint":
        names = re.findall(r"joint:([^<]+)", at)
        children = {joint.name: joint.child_link for joint in robot.joints}
        return [children[name] for name in names if name in children]
    if kind == "link":
        return [name] if name in robot.link_names else []
    if kind == "marker":
        return [marker.link for marker in session.markers if marker.name == name]
    if kind == "camera" and session.camera_link:
        return [session.camera_link]
    if kind == "board" and session.board:
        return [session.board.link]
    return []
