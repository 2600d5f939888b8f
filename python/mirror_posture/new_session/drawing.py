"""The robot with its camera, board and markers, from the front, the side and above."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ..figure_settings import literal
from ..robot import Robot
from ..session.metadata import load_metadata
from ..shapes import shapes_of_links

VIEWS = (
    ("from its right", 0, 2, "x", "z"),
    ("from the front", 1, 2, "y", "z"),
    ("from above", 0, 1, "x", "y"),
)
CAMERA_COLOUR, BOARD_COLOUR = "#1f6feb", "#b35900"


@literal
def draw_setup(
    folder: Path,
    file: Path,
    *,
    positions: Mapping[str, float] | None = None,
) -> list[str]:
    """Draws a session's robot with its mounts as a picture of three views; joints at 0 by default.

    Returns the names of the meshes that were not found: those links are drawn as lines.
    """
    from matplotlib.collections import PolyCollection
    from matplotlib.figure import Figure

    told = load_metadata(folder)
    robot = Robot.from_urdf(folder / told.robot)
    q = robot.positions({name: [float(value)] for name, value in (positions or {}).items()})
    if not len(q):
        q = np.zeros((1, len(robot.position_names)))
    root_from_link = robot.link_poses(q, robot.link_names)[0]
    pose = dict(zip(robot.link_names, root_from_link, strict=True))
    shapes, missing = shapes_of_links(folder / told.robot)
    figure = Figure(figsize=(15, 6), layout="constrained")
    # The views are in the root's frame: for a robot that hangs, or on a wall, down has another direction in
    # them.
    stands = told.gravity_m_per_s2[2] < -0.99 * float(np.linalg.norm(told.gravity_m_per_s2))
    for axes, (title, across, up, across_name, up_name) in zip(figure.subplots(1, 3), VIEWS, strict=True):
        for name, parts in shapes.items():
            for part in parts if name in pose else ():
                seen = _moved(pose[name], part.vertices_m)[:, (across, up)]
                axes.add_collection(
                    PolyCollection(seen[part.faces], facecolors="#d0d5dc", edgecolors="none", zorder=1)
                )
        for joint in robot.joints:
            a, b = pose[joint.parent_link][:3, 3], pose[joint.child_link][:3, 3]
            axes.plot([a[across], b[across]], [a[up], b[up]], color="#57606a", lw=1.2, zorder=2)
        _camera(axes, told, pose, across, up)
        _board(axes, told, pose, across, up)
        for marker in told.markers:
            at = pose[marker.link][:3, 3]
            axes.plot(at[across], at[up], "o", ms=9, color=marker.rgb(), mec="black", zorder=5)
            axes.annotate(
                marker.name,
                (at[across], at[up]),
                xytext=(6, 6),
                textcoords="offset points",
                fontsize=8,
                zorder=6,
            )
        axes.set(title=title, xlabel=f"{across_name}, m", ylabel=f"{up_name}, m")
        axes.set_aspect("equal", adjustable="datalim")
        axes.grid(alpha=0.3)
        if not stands:
            _gravity(axes, told, across, up)
    figure.suptitle(
        f"{robot.name}: camera (blue, with its view), board (brown, with its face's normal), markers"
    )
    figure.savefig(file, dpi=90)
    return missing


def _camera(axes: Any, told: Any, pose: Mapping[str, Any], across: int, up: int) -> None:
    if told.camera_link is None:
        return
    corners = np.array([[x, y, 1.0] for x, y in ((-0.6, -0.45), (0.6, -0.45), (0.6, 0.45), (-0.6, 0.45))])
    seen = _moved(pose[told.camera_link], np.vstack([np.zeros((1, 3)), 0.12 * corners]))
    for corner in (1, 2, 3, 4):
        axes.plot(seen[[0, corner], across], seen[[0, corner], up], color=CAMERA_COLOUR, lw=1, zorder=4)
    ring = seen[[1, 2, 3, 4, 1]]
    axes.plot(ring[:, across], ring[:, up], color=CAMERA_COLOUR, lw=1, zorder=4)
    # The picture's upper edge is the thicker one.
    axes.plot(seen[[1, 2], across], seen[[1, 2], up], color=CAMERA_COLOUR, lw=3, zorder=4)


def _board(axes: Any, told: Any, pose: Mapping[str, Any], across: int, up: int) -> None:
    if told.board is None:
        return
    board = told.board
    half = np.array([(board.columns + 1) * board.square_m / 2.0, (board.rows + 1) * board.square_m / 2.0])
    ring = np.array(
        [[x * half[0], y * half[1], 0.0] for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1), (-1, -1))]
    )
    normal = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 1.5 * half.max()]])
    for points in (ring, normal):
        seen = _moved(pose[board.link], points)
        axes.plot(seen[:, across], seen[:, up], color=BOARD_COLOUR, lw=2, zorder=4)


def _moved(a_from_b: Any, points_in_b: Any) -> Any:
    return points_in_b @ a_from_b[:3, :3].T + a_from_b[:3, 3]


def _gravity(axes: Any, told: Any, across: int, up: int) -> None:
    """An arrow along gravity in a corner, where it is seen from the side."""
    way = np.asarray(told.gravity_m_per_s2)[[across, up]] / float(np.linalg.norm(told.gravity_m_per_s2))
    if np.linalg.norm(way) < 0.2:
        return
    start = np.array([0.1, 0.88]) - 0.05 * way
    axes.annotate(
        "",
        start + 0.1 * way,
        start,
        xycoords="axes fraction",
        arrowprops={"arrowstyle": "-|>", "color": "#444444"},
    )
    axes.annotate("gravity", (0.13, 0.87), xycoords="axes fraction", fontsize=8, color="#444444")
