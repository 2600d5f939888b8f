"""A robot that turns before its mirror on its own legs or waist: which joints may turn it, and what that moves besides.

A posture's frames are one body from several viewpoints (docs/formats.md): joints that move what is measured stand still in them.
Markers that the correction does not use, on a foot for example, may move with the turning joints: they are no part of its looks.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

import numpy as np

from .._core import MirrorPostureError
from ..robots.nominal import Nominal
from ..robots.protocol import Look
from ..session.plausible_rows import joints_between
from .target import Target


def check_turning(target: Target, stations: Sequence[Mapping[str, float]]) -> None:
    """Raises `MirrorPostureError` for a joint that would move what is measured, or that the robot does not have."""
    robot = target.nominal.robot
    measured: set[str] = set()
    for link in (target.board_link, *target.marker_links):
        measured |= joints_between(robot, target.camera_link, link)
    for joint in dict.fromkeys(joint for station in stations for joint in station):
        robot.position_index(joint)
        if joint in measured:
            raise MirrorPostureError(
                f"view_joints: {joint!r} lies between camera, board and a marker, which must stand still within a look; "
                "turn with joints outside of them (waist, legs)"
            )


def without_turned(nominal: Nominal, turning: Collection[str], look: Look) -> Look:
    """A look without the markers that these joints move as the camera sees them."""
    if not turning:
        return look
    markers, base = nominal.metadata.markers, nominal.metadata.camera_link or nominal.metadata.root
    moved = [not joints_between(nominal.robot, base, marker.link).isdisjoint(turning) for marker in markers]
    if look.points is not None:
        seen = look.points.marker_seen & ~np.array(moved)
        look = replace(look, points=replace(look.points, marker_seen=seen))
    if look.marker_points is not None:
        seen = look.marker_points.seen & ~np.array(moved)
        look = replace(look, marker_points=replace(look.marker_points, seen=seen))
    return look
