"""Usual sizes for each joint in the motion of the unchanged model."""

from __future__ import annotations

import numpy as np

from .effects import JointScale, torque_sizes
from .rollouts import STEP_S, Rollouts

LEAST_SPEED_RAD_PER_S = 1e-3
LARGEST = 0.999
"""Share of the time: larger values are jerks."""


def scales_of(rollouts: Rollouts) -> dict[str, JointScale]:
    """By joint that the log moves."""
    out, model = {}, rollouts.model
    torque = np.abs(rollouts.servo_torque(rollouts.nominal()))
    speed = np.abs(np.gradient(rollouts.commands, STEP_S, axis=0))
    for column, name in enumerate(rollouts.joints):
        if speed[:, column].max() < LEAST_SPEED_RAD_PER_S:
            continue
        a, dof = rollouts.actuator[column], rollouts.dof[column]
        out[name] = JointScale(
            float(model.actuator_gainprm[a, 0] * rollouts.gear[column] ** 2),
            float(-model.actuator_biasprm[a, 2] * rollouts.gear[column] ** 2 + model.dof_damping[dof]),
            float(model.dof_armature[dof]),
            float(model.dof_frictionloss[dof]),
            float(np.quantile(torque[:, column], LARGEST)),
            torque_sizes(torque[:, column]),
            float(np.quantile(speed[:, column], LARGEST)),
            name in rollouts.simulator.kept,
        )
    return out
