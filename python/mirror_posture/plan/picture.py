"""A plan as a picture: the robot in front of its mirror from the side and from above, and what the plan
will show."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ..arrays import Floats
from ..counted import counted
from ..figure_settings import literal
from .options import MirrorPlace, square_to
from .run import Plan
from .sizes import size_in_words

MOST_ROWS = 24
SHOWN = {
    "joint_offset": "wrong zero",
    "gear_ratio": "gear",
    "backlash": "play",
    "joint_compliance": "gives way",
    "axis_tilt": "axis tilt",
    "link_length": "length",
}
"""The effects of the table, in words for the reader."""


@literal
def draw_plan(plan: Plan, file: Path) -> None:
    """Writes the picture as PNG."""
    from matplotlib.collections import LineCollection
    from matplotlib.figure import Figure

    joints = plan.setting.joint_names
    figure = Figure(figsize=(15, 6.5 + 0.26 * min(len(joints), MOST_ROWS)), layout="constrained")
    top, bottom = np.asarray(
        figure.subfigures(2, 1, height_ratios=[6.0, 0.5 + 0.26 * min(len(joints), MOST_ROWS)])
    ).tolist()
    robot, setting = plan.setting.nominal.robot, plan.setting
    across, _ = square_to(setting.forward, setting.up)
    # Square to `up`: where the robot looks down at its mirror, `forward` is not.
    ahead = np.cross(across, setting.up)
    axes = top.subplots(1, 2)
    poses = robot.link_poses(plan.positions, list(robot.link_names))[:, :, :3, 3]
    index = {name: k for k, name in enumerate(robot.link_names)}
    bones = [[index[joint.parent_link], index[joint.child_link]] for joint in robot.joints]
    markers = setting.nominal.metadata.markers
    for panel, (vertical, title, word) in zip(
        axes, ((setting.up, "from the side", "up, m"), (across, "from above", "to its left, m")), strict=True
    ):
        ends = poses[:, bones] @ np.stack([ahead, vertical], axis=-1)
        panel.add_collection(
            LineCollection(list(ends.reshape(-1, 2, 2)), colors="#57606a", linewidths=0.6, alpha=0.25)
        )
        for number, marker in enumerate(markers):
            seen = plan.markers[:, number]
            points = poses[seen][:, index[marker.link]]
            panel.plot(points @ ahead, points @ vertical, "o", ms=4, color=marker.rgb(), label=marker.name)
        for view, mirror in enumerate(plan.mirrors):
            _mirror(panel, plan, mirror, (ahead, vertical), view)
        for link, word_of, colour in (
            (setting.camera_link, "camera", "#1f6feb"),
            (setting.board.link, "board", "#b35900"),
        ):
            at = poses[0][index[link]]
            panel.plot(at @ ahead, at @ vertical, "s", ms=8, color=colour, label=word_of)
        panel.set(title=title, xlabel="towards the mirror, m", ylabel=word)
        panel.set_aspect("equal", adjustable="datalim")
        panel.grid(alpha=0.3)
    axes[0].legend(fontsize=8, loc="best")
    _table(bottom.subplots(), plan)
    figure.suptitle(
        f"{robot.name}: {counted(len(plan.view), 'picture')}, {counted(len(plan.mirrors), 'view')}, a mirror of "
        f"{100 * plan.mirrors[0].width_m:.0f} x {100 * plan.mirrors[0].height_m:.0f} cm, {100 * plan.distance_m:.0f} cm before the board"
    )
    figure.savefig(file, dpi=80)


def _mirror(panel: Any, plan: Plan, mirror: MirrorPlace, axes: tuple[Floats, Floats], view: int) -> None:
    ahead, vertical = axes
    turn, shift = plan.setting.base_from_root[:3, :3], plan.setting.base_from_root[:3, 3]
    half = np.array(
        [
            a * mirror.right_in_root * mirror.width_m / 2 + b * mirror.up_in_root * mirror.height_m / 2
            for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1), (-1, -1))
        ]
    )
    ring = (mirror.center_in_root_m + half) @ turn.T + shift
    panel.plot(ring @ ahead, ring @ vertical, color="#0a7f5a", lw=2)
    top = ring[np.argmax(ring @ vertical)]
    # One below the other, because the mirrors of several views are nearly at one place.
    panel.annotate(
        f"view {view}", (top @ ahead, top @ vertical), xytext=(-6, -4 - 11 * view), textcoords="offset points", fontsize=8, ha="right"
    )  # fmt: skip


def _table(axes: Any, plan: Plan) -> None:
    axes.axis("off")
    rows = table_rows(plan)
    if len(rows) > MOST_ROWS:
        more = f"... and {len(rows) - MOST_ROWS} more, see plan.json"
        axes.text(0.5, 0.0, more, transform=axes.transAxes, ha="center", va="bottom", fontsize=9)
        rows = rows[:MOST_ROWS]
    drawn = axes.table(
        cellText=[row[1:] for row in rows],
        rowLabels=[row[0] for row in rows],
        colLabels=list(SHOWN.values()),
        loc="upper center",
        colWidths=[0.13] * len(SHOWN),
    )
    drawn.auto_set_font_size(False)
    drawn.set_fontsize(9)
    axes.set_title("found surely from this size on (* : has a twin)", fontsize=10)


def table_rows(plan: Plan) -> list[list[str]]:
    """A row for each joint: its name, and of each effect the smallest size that is found surely."""
    told = {(one.effect, one.at): one for one in plan.tells}
    parents = {joint.name: joint.parent_link for joint in plan.setting.nominal.robot.joints}
    rows = []
    for name in plan.setting.joint_names:
        cells = [name]
        for effect in SHOWN:
            one = told.get((effect, f"link:{parents[name]}" if effect == "link_length" else f"joint:{name}"))
            if one is None:
                cells.append("–")
                continue
            text = size_in_words(plan, one, max(one.parameters.values())) if one.seen else "not seen"
            cells.append(text + ("*" if one.twins and one.seen else ""))
        rows.append(cells)
    return rows
