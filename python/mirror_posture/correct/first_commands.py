"""The commands before the first look: what a feed-forward says instead of the wanted posture itself."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from numbers import Real
from typing import Any

from .._core import MirrorPostureError
from ..robots.protocol import CommandedRobot

CommandForPosture = Callable[[Mapping[str, float]], Mapping[str, float] | Sequence[Mapping[str, float]]]
"""From the wanted posture to the first command (the feed-forward of a diagnosed model), joint positions,
rad (m); or to several commands, way-points before the first look, of which the last is held."""


def first_commands(told: Any, robot: CommandedRobot) -> list[dict[str, float]]:
    """What a `CommandForPosture` gave, as commands of this robot.

    Raises `MirrorPostureError` for anything else: no command, a joint that the model does not have, no finite number.
    """
    commands = [told] if isinstance(told, Mapping) else told
    if (
        not isinstance(commands, Sequence)
        or not commands
        or not all(isinstance(c, Mapping) for c in commands)
    ):
        raise MirrorPostureError(
            f"command_for_posture: got {told!r:.80}, needed a command (joint name to rad, or m), or a list of at least one"
        )
    known = robot.nominal.robot.position_names
    for command in commands:
        for joint, position in command.items():
            # Such a joint would be passed over, and the robot would begin elsewhere than it was told to.
            if joint not in known:
                raise MirrorPostureError(
                    f"command_for_posture: got joint {joint!r}, and {robot.name} has {', '.join(known)}"
                )
            if isinstance(position, bool) or not isinstance(position, Real) or not math.isfinite(position):
                raise MirrorPostureError(
                    f"command_for_posture: got {position!r} for joint {joint!r}, needed a finite number (rad, m)"
                )
    # A diagnosis may correct joints that this robot has no servo for: they stay where they are.
    return [{n: float(x) for n, x in command.items() if n in robot.joint_names} for command in commands]
