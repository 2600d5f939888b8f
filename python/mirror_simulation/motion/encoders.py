"""The robot's own encoders as independent sensors of a motion: their readings compared with the simulator's
joints, by the log's clock.

No fit uses them. An encoder is at the motor: it shows what servo, friction, inertia and limits do, but not
a wrong zero, a gear error, play or a spring behind it, nor a late camera.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from .effects import Causes
from .problem import Problem


def encoder_witness(problem: Problem, causes: Causes) -> list[dict[str, Any]]:
    """One entry for each joint with a column `measured:<joint>` in states.csv, in rad (m for a prismatic
    joint).

    `before` and `after` are RMS(reading − simulated position) without and with the causes,
    `before_zero_free` and `after_zero_free` the same with a constant of the encoder estimated; `named` says
    whether a cause is named there.
    """
    states = problem.recording.states
    nominal, (moved,) = problem.rollouts.nominal(), problem.rollouts.motions([causes])
    assert moved is not None
    out = []
    for column, name in enumerate(states.measured_names):
        if name not in problem.joints:
            continue
        j = problem.joints.index(name)
        reading = states.measured[:, column]
        kept = np.isfinite(reading)
        if not kept.any():
            continue
        before, after = (reading[kept] - motion.at(states.time_s)[kept, j] for motion in (nominal, moved))
        out.append(
            {
                "joint": name,
                "named": any(at == f"joint:{name}" for _, at in causes),
                "before": float(np.sqrt(np.mean(before**2))),
                "after": float(np.sqrt(np.mean(after**2))),
                "before_zero_free": float(np.std(before)),
                "after_zero_free": float(np.std(after)),
            }
        )
    return out
