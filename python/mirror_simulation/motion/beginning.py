"""The first pictures of a motion: what they show of how long the robot stood before its log began.

In the simulation it stands at the first command and settles. A limb that its servo cannot hold falls from
then on, for an unknown time.
"""

from __future__ import annotations

import numpy as np

from .effects import Causes
from .problem import Problem
from .recording import LEAST_FRAMES

DEPENDS = 0.5
"""In units of the noise: a picture that is shifted by more depends on something that the log does not
contain."""


def leave_out_beginning(problem: Problem, causes: Causes) -> bool:
    """Leaves out the first pictures as long as they depend on it; returns whether other pictures count than before."""
    (motion,), other = problem.rollouts.motions([causes]), problem.rollouts.stood_longer(causes)
    if motion is None or other is None:
        return False
    before = problem.view.first
    problem.begin_at(0)
    moved = (problem.places(causes, other).markers - problem.places(causes, motion).markers)[
        ..., problem.columns_of
    ]
    shift = np.einsum("fmij,fmj->fmi", problem.by_position(), moved)
    depends = np.flatnonzero(np.abs(shift).max(axis=(1, 2)) > DEPENDS)
    first = int(depends[-1]) + 1 if len(depends) else 0
    # A limb that depends on it throughout cannot be left out.
    problem.begin_at(first if len(shift) - first >= LEAST_FRAMES else 0)
    return problem.view.first != before
