"""The recording's joints as those of the robot: names, units, limits."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from .._core import MirrorPostureError
from ..robot import Robot
from ..session.errors import SessionError
from .recording import JointLog, Recording

BEYOND_LIMIT = 0.05
"""rad (m) by which a position may be beyond a joint's limit without a warning."""


def only_joints(log: JointLog, kept: list[tuple[int, str]]) -> JointLog:
    """The log of the columns that are the robot's joints, under the robot's names: a counter or a voltage never rests."""
    columns = [index for index, _ in kept]
    return replace(
        log,
        names=tuple(name for _, name in kept),
        position=log.position[:, columns],
        measured=None if log.measured is None else log.measured[:, columns],
    )


def refuse_other_case(log: JointLog, columns: list[tuple[int, str]], robot: Robot) -> None:
    """Refuses a column that is one of the robot's joints but for capitals: left out, the joint would be taken to stand at 0."""
    names = {name for _, name in columns}
    free = {name.casefold(): name for name in robot.position_names if name not in names}
    for index, name in columns:
        if name not in robot.position_names and (joint := free.get(name.casefold())) is not None:
            theirs = log.names[index]
            raise SessionError(
                log.source,
                f"the robot has no joint {name!r}, but {joint!r}: capitals count; add --joint {theirs}={joint}, or rename the column",
                column=theirs,
            )


def taken_back(log: JointLog, columns: list[int]) -> JointLog:
    """The log with some columns as they were before they were taken for degrees."""
    factor = np.ones(len(log.names))
    factor[columns] = 180.0 / np.pi
    return replace(
        log, position=log.position * factor, measured=None if log.measured is None else log.measured * factor
    )


def check_limits(recording: Recording, robot: Robot, kept: list[tuple[int, str]]) -> list[str]:
    """Positions beyond the joints' limits: warnings, or `MirrorPostureError` where they cannot be in rad (m)."""
    limits = {joint.name: (joint.lower, joint.upper) for joint in robot.joints}
    warnings = []
    for index, name in kept:
        low, high = limits[name]
        least, most = (
            float(recording.joints.position[:, index].min()),
            float(recording.joints.position[:, index].max()),
        )
        span = max(high - low, 0.1)
        told = f"{recording.source}: {name} goes from {least:.4g} to {most:.4g}, its limits are {low:.4g} to {high:.4g} rad (m)"
        if least < low - span or most > high + span:
            raise MirrorPostureError(
                f"{told}: are these degrees (--degrees), or is it another joint (--joint THEIRS=OURS)?"
            )
        if least < low - BEYOND_LIMIT or most > high + BEYOND_LIMIT:
            warnings.append(told)
    return warnings
