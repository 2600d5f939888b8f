"""Plausibility of a session: invalid units, sizes and ids, found before any estimate.

Each check compares numbers that must agree in size: commands with encoders, points with the robot's reach,
the focal length with the picture. A value that no real robot, camera or room can have is an error; one that
hardly any has is a warning.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from .errors import Problems, SessionError
from .plausible_boards import board_distance, facing, flat_boards
from .plausible_rows import encoders, one_command_a_posture, points

if TYPE_CHECKING:
    from ..camera import Camera
    from ..robot import Robot
    from .types import Session

LONGEST_REACH_M = 50.0
"""Sum of the origins' lengths from the root to a link: beyond it they are in mm."""
SHORTEST_REACH_M, BOARD_SHARE = 0.005, 0.2
"""A robot is larger than this, and than this share of the board that it carries."""
LEAST_PICTURE_PX = 16
FOCAL_SHARE = (0.1, 100.0)
"""Focal length in widths of the picture: below the first a lens sees 157° and more, fisheyes have 0.3."""
UNSET = 0.02
"""A principal point nearer to the first pixel than this share of the picture's sides is an unset value."""
ASPECT = 3.0
"""fx and fy of real cameras differ by a few per cent."""


def check_plausible(session: Session, problems: Problems) -> list[str]:
    """All checks; errors go to `problems`, unusual findings are returned as warnings."""
    warnings: list[str] = []
    reach_m = robot_reach_m(session.robot)
    with problems.kept():
        _reach(session, reach_m)
    with problems.kept():
        warnings += _camera(session)
    with problems.kept():
        flat_boards(session)
    with problems.kept():
        board_distance(session)
    with problems.kept():
        one_command_a_posture(session)
    with problems.kept():
        warnings += encoders(session)
    with problems.kept():
        points(session, reach_m)
    if not problems.found:
        warnings += facing(session)
    return warnings


def robot_reach_m(robot: Robot) -> float:
    """The longest way from the root to a link along the joints' origins, and along the travel of prismatic ones."""
    ways: dict[str, float] = {}
    for joint in robot.joints:
        travel = max(abs(joint.lower), abs(joint.upper)) if joint.kind == "prismatic" else 0.0
        step = float(np.linalg.norm(joint.parent_from_joint[:3, 3])) + (
            travel if np.isfinite(travel) else 0.0
        )
        ways[joint.child_link] = ways.get(joint.parent_link, 0.0) + step
    return max(ways.values(), default=0.0)


def _reach(session: Session, reach_m: float) -> None:
    if reach_m > LONGEST_REACH_M:
        raise SessionError(
            session.robot_file.name,
            f"got a reach of {reach_m:g} m from the root to the farthest link, needed at most {LONGEST_REACH_M:g} m: "
            "are the origins in mm?",
        )
    board = session.board
    board_m = float(np.hypot(*board.corners)) * board.square_m if board else 0.0
    least_m = max(SHORTEST_REACH_M, BOARD_SHARE * board_m)
    if reach_m < least_m:
        than = f"a fifth of its board's {board_m:.3g} m" if board_m > 0.0 else "any robot"
        raise SessionError(
            session.robot_file.name,
            f"got a reach of {reach_m:.3g} m from the root to the farthest link, smaller than {than}; needed origins in m: were they divided "
            "by 1000, or is the board's square in another unit?",
        )


def _camera(session: Session) -> list[str]:
    if session.camera is None:
        return []
    return check_camera(session.camera, str(session.metadata.get("camera", "camera.yaml")))


def check_camera(camera: Camera, name: str) -> list[str]:
    """A camera of a file of this name: raises `SessionError` for numbers that none has; returns what is unusual."""
    width, height = camera.width_px, camera.height_px
    if min(width, height) < LEAST_PICTURE_PX:
        raise SessionError(
            name, f"got a picture of {width} × {height} px, needed at least {LEAST_PICTURE_PX} px a side"
        )
    for key, focal in (("fx", camera.fx_px), ("fy", camera.fy_px)):
        share = focal / max(width, height)
        if not FOCAL_SHARE[0] <= share <= FOCAL_SHARE[1]:
            raise SessionError(
                name,
                f"camera_matrix: got {key} = {focal:g} px for a picture of {width} × {height} px, needed from "
                f"{FOCAL_SHARE[0] * max(width, height):g} to {FOCAL_SHARE[1] * max(width, height):g} px: is it in mm?",
            )
    if not 1.0 / ASPECT <= camera.fx_px / camera.fy_px <= ASPECT:
        raise SessionError(
            name,
            f"camera_matrix: got fx = {camera.fx_px:g} and fy = {camera.fy_px:g} px, needed about the same",
        )
    centre = (camera.cx_px / width, camera.cy_px / height)
    if not all(-1.0 <= c <= 2.0 for c in centre):
        raise SessionError(
            name,
            f"camera_matrix: got the principal point ({camera.cx_px:g}, {camera.cy_px:g}) px, needed one near the middle of "
            f"the picture of {width} × {height} px",
        )
    if all(abs(c) < UNSET for c in centre):
        raise SessionError(
            name,
            f"camera_matrix: got the principal point ({camera.cx_px:g}, {camera.cy_px:g}) px, the picture's corner: was it never "
            f"set? Needed one near the middle of the picture of {width} × {height} px",
        )
    if not all(0.0 <= c <= 1.0 for c in centre):
        return [f"{name}: the principal point ({camera.cx_px:g}, {camera.cy_px:g}) px is outside the picture"]
    return []
