"""Whether a session was recorded in motion."""

from __future__ import annotations

import numpy as np

from .types import Session

MOVING_RAD_PER_S = 0.01
MOVING_SHARE = 0.5
"""A session moves where most of its pictures were taken while a joint did."""


def is_moving(session: Session) -> bool:
    """Whether a session was recorded in motion: it has a log, and a joint moves in most of its pictures."""
    states, time_s = session.states, session.frames.time_s
    if states is None or time_s is None or len(states.time_s) < 3 or not states.joint_names:
        return False
    speed = np.abs(np.gradient(states.commanded, states.time_s, axis=0)).max(axis=1)
    return float((np.interp(time_s, states.time_s, speed) > MOVING_RAD_PER_S).mean()) > MOVING_SHARE
