"""The servos' commands: the log's, delayed or limited by the causes."""

from __future__ import annotations

import numpy as np

from mirror_posture.arrays import Floats


def lagged(told: Floats, time_constant_s: float, step_s: float) -> Floats:
    """First order, exact for a command that is straight within a step: T du'/dt = u - u'."""
    if time_constant_s <= 1e-6:
        return told
    decay = float(np.exp(-step_s / time_constant_s))
    # What the rise of a step adds beside the command before it, and what the command itself keeps of it.
    risen = np.diff(told) * (time_constant_s / step_s)
    inputs = (told[1:] - risen) - decay * (told[:-1] - risen)
    now, out = float(told[0]), [float(told[0])]
    for value in inputs.tolist():
        now = decay * now + value
        out.append(now)
    return np.array(out)


def slewed(told: Floats, limit_per_s: float, step_s: float) -> Floats:
    """The command, changing by no more than the limit."""
    most = limit_per_s * step_s
    now, out = float(told[0]), []
    for value in told.tolist():
        now += min(most, max(-most, value - now))
        out.append(now)
    return np.array(out)
