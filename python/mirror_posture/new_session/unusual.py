"""What is odd about a new session and may be right: told as warnings, so that a person looks."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from ..mirror import Mirror
from ..robot import Robot
from ..session.plausibility import robot_reach_m

FAR, LEAST_REACH_M = 10.0, 0.3
"""Places farther from the root than this many times the robot's reach (at least this one) are probably in another unit."""
USUAL_MIRROR_M = 3.0
"""Mirrors that are larger than this are walls of dancers."""
LEAST_SHARE = 0.5
"""From as far as the board is, a mirror shows it whole from this share of its size on."""


def facing_apart(robot: Robot, camera_link: str, board_link: str) -> list[str]:
    """With all joints at 0, board and camera that look apart: in a mirror before the camera only a face that looks the same way is seen."""
    zero = np.zeros((1, len(robot.position_names)))
    root_from_camera, root_from_board = robot.link_poses(zero, [camera_link, board_link])[0]
    along = float(root_from_camera[:3, 2] @ root_from_board[:3, 2])
    angle = math.degrees(math.acos(min(1.0, max(-1.0, along))))
    if angle > 80.0:
        return [
            f"with all joints at 0 the board's face and the camera look {angle:.0f}° apart: a mirror before the camera then "
            "shows the board's back or edge; check --camera-looks and --board-faces"
        ]
    return []


def far_away(bare: Robot, robot: Robot, places: Mapping[str, str], mirror: Mirror) -> list[str]:
    """Links by what they carry, and the mirror, that are far from the root, compared with the reach of the robot without them."""
    reach_m = robot_reach_m(bare)
    poses = robot.link_poses(np.zeros((1, len(robot.position_names))), list(places.values()))[0]
    near_m = FAR * max(reach_m, LEAST_REACH_M)
    away = {what: float(np.linalg.norm(pose[:3, 3])) for what, pose in zip(places, poses, strict=True)}
    if mirror.center_in_root_m is not None:
        away["the mirror's centre"] = math.hypot(*mirror.center_in_root_m)
    return [
        f"{what} is {far_m:.3g} m from the root, of a robot that reaches {reach_m:.3g} m; places are in m: is it in cm or mm?"
        for what, far_m in away.items()
        if far_m > near_m
    ]


def size_of_mirror(mirror: Mirror, board_m: Sequence[float]) -> list[str]:
    """A mirror too small to show the board of these sides (m), or larger than mirrors are."""
    if mirror.width_m is None or mirror.height_m is None:
        return []
    sides, needed = sorted((mirror.width_m, mirror.height_m)), sorted(LEAST_SHARE * side for side in board_m)
    size = f"a mirror of {100 * mirror.width_m:g} x {100 * mirror.height_m:g} cm"
    if any(side < least for side, least in zip(sides, needed, strict=True)):
        board = " x ".join(f"{100 * side:g}" for side in board_m)
        return [
            f"{size} is too small to show the board of {board} cm whole: it needs half of its width and height; is --mirror-size in cm?"
        ]
    if max(sides) > USUAL_MIRROR_M:
        return [f"{size} is larger than {USUAL_MIRROR_M:g} m: is --mirror-size in mm? It needs cm"]
    return []
