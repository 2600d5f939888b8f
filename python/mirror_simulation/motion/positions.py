"""Link positions while their joints follow a simulated motion: the laws of what lies behind a servo.

A wrong zero and a wrong gear change the position itself; a spring yields and a play changes its side under
the load of gravity and motion on the joint.
"""

from __future__ import annotations

import numpy as np

from mirror_posture.arrays import Floats

from .effects import Causes
from .motions import Motion
from .rollouts import Rollouts

LOAD_SHARE = 0.02
"""Share of a joint's usual load at which its play has gone over to one side."""


def positions(
    rollouts: Rollouts, causes: Causes, motion: Motion, marker_time_s: Floats, board_time_s: Floats
) -> tuple[Floats, Floats]:
    """The link positions of a simulated motion at times (F, markers) and (F,): (F, markers, joints) and (F,
    joints)."""
    latency = causes.get(("latency", "camera"), (0.0,))[0]
    markers = motion.at(marker_time_s - latency)
    board = motion.at(board_time_s - latency)
    for (effect, at), values in causes.items():
        place = at.partition(":")[2]
        if place not in rollouts.joints:
            continue
        j = rollouts.joints.index(place)
        if effect == "joint_offset":
            markers[..., j] += values[0]
            board[..., j] += values[0]
        elif effect == "gear_ratio":
            markers[..., j] *= 1.0 + values[0]
            board[..., j] *= 1.0 + values[0]
        elif effect in ("joint_compliance", "backlash"):
            load = rollouts.load(motion, board_time_s - latency)[:, j]
            if effect == "backlash":
                usual = float(np.sqrt(np.mean(load**2))) + 1e-12
                load = 0.5 * np.tanh(load / (LOAD_SHARE * usual))
            markers[..., j] += values[0] * load[:, None]
            board[..., j] += values[0] * load
    return markers, board
