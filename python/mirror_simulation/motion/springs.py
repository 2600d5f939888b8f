"""The nonlinearity of springs: a nuisance parameter of the intervals, never a cause.

A real spring stiffens: `give (1 − s min(|load| / 3 usual, 1)) load` with s of about a tenth in either
direction. The fitted linear law depends on the loads that occurred, so an interval that contains only the
noise is too narrow.
"""

from __future__ import annotations

import numpy as np

from mirror_posture.arrays import Floats

from .effects import Causes
from .problem import Problem

STIFFENING = 0.1
FAR = 3.0
"""Loads from this multiple of the usual one on stiffen no further."""


def stiffening_columns(problem: Problem, causes: Causes) -> Floats:
    """(F, markers, 2, springs): whitened change of the prediction by a standard deviation of each spring's stiffening."""
    springs = [
        (problem.joints.index(at.partition(":")[2]), values[0])
        for (effect, at), values in causes.items()
        if effect == "joint_compliance"
    ]
    out = np.zeros((*problem.view.seen.shape, 2, len(springs)))
    if not springs:
        return out
    (motion,) = problem.rollouts.motions([causes])
    assert motion is not None
    load = problem.rollouts.load(motion, problem.recording.board_time_s)
    for k, (j, give) in enumerate(springs):
        usual = float(np.sqrt(np.mean(load[:, j] ** 2))) + 1e-12
        moved = -STIFFENING * give * load[:, j] * np.minimum(np.abs(load[:, j]) / (FAR * usual), 1.0)
        out[..., k] = problem.by_position()[..., j] * moved[:, None, None]
    return out
