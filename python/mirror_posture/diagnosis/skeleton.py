"""The robot as a stick figure, from the front and from the side, with the causes' places marked."""

from __future__ import annotations

import re
from typing import Any

import numpy as np

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
)  # fmt: skip
from ..session import Session
from . import formatting
from .result import Diagnosis

CAUSE_COLOURS = (BEFORE, FOURTH, FIFTH, GOOD, AFTER, SIXTH)
VIEWS = (("the front", 1, 1.0), ("its left", 0, -1.0))
"""Name, the root axis that runs to the right, and its sign on the page: x looks ahead and z up (REP 103)."""
MARGIN = 0.08
"""Free edge around the robot, as a share of its largest extent."""
LEAST_SHARE = 0.05
"""An unexplained place is marked from this share of the gap on."""


def draw_robot(session: Session, found: Diagnosis) -> Drawing:
    """Forward kinematics of the nominal model at the session's median posture; joints as dots, guilty places in colour."""
    robot = session.robot
    poses = robot.forward_kinematics(np.median(session.positions, axis=0, keepdims=True))[0]
    base = np.linalg.inv(poses[robot.link_index(session.root_link)])
    place = {name: (base @ poses[i])[:3, 3] for i, name in enumerate(robot.link_names)}
    # Both views on one scale: the page is shared out by what each has to show.
    points = 1000.0 * np.array(list(place.values()))
    low, high = points.min(axis=0), points.max(axis=0)
    edge = MARGIN * float((high - low).max()) + 1.0
    span = high - low + 2.0 * edge
    marked = [entry for entry in guilty(session, found) if entry[0] in place]
    names = 0.3 * float(span[1] + span[0]) if marked else 0.0
    width = 6.4
    height = float(np.clip(width * span[2] / (span[0] + span[1] + names), 2.8, 7.0))
    drawn, axes = figure(width, height + 0.6, columns=2, width_ratios=[span[1] + names, span[0]], sharey=True)
    for ax, (title, axis, sign) in zip(axes[0], VIEWS, strict=True):

        def flat(point: np.ndarray, axis: int = axis, sign: float = sign) -> tuple[float, float]:
            return sign * 1000.0 * point[axis], 1000.0 * point[2]

        for joint in robot.joints:
            a, b = flat(place[joint.parent_link]), flat(place[joint.child_link])
            moving = joint.kind != "fixed"
            ax.plot(
                *zip(a, b, strict=True),
                color=BODY if moving else FIXED,
                linewidth=2.4 if moving else 1.0,
                solid_capstyle="round",
                zorder=1,
            )
        joints = np.array([flat(place[j.child_link]) for j in robot.joints if j.kind != "fixed"])
        if len(joints):
            ax.plot(*joints.T, "o", color=JOINT, markersize=3.5, zorder=2)
        for marker in session.markers:
            ax.plot(
                *flat(place[marker.link]),
                "o",
                markerfacecolor=PAPER,
                markeredgecolor=INK,
                markersize=5,
                zorder=3,
            )
        ends = sorted((sign * low[axis], sign * high[axis]))
        named = axis == VIEWS[0][1]
        ax.set_xlim(ends[0] - edge, ends[1] + edge + (names if named else 0.0))
        ax.set_ylim(low[2] - edge, high[2] + edge)
        _mark(ax, [(flat(place[link]), colour, text) for link, colour, text in marked], named, ends[1] + edge)
        # The unit once: a slim robot's side has no room for it.
        unit = ", mm" if ax is axes[0][0] else ""
        ax.set_title(f"from {title}{unit}", color=INK, fontsize=10, loc="left")
        ax.set_aspect("equal")
        ax.tick_params(labelsize=8, colors=FLOOR)
        # The axis ends with the robot; names are beside it.
        ax.set_xticks([t for t in ax.get_xticks() if ends[0] - edge <= t <= ends[1] + edge])
        ax.spines.bottom.set_bounds(ends[0] - edge, ends[1] + edge)
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
