"""Steps many models at once (`mujoco.rollout`, all cores), and extracts joint positions and speeds from
their states."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np
from mujoco import rollout

from mirror_posture.arrays import Floats, Integers

from ..simulate.quiet import quiet

Columns = Integers


class Pool:
    """Threads, and the memory of each. A state is the time, then positions, then velocities."""

    def __init__(self, model: Any, qpos: Columns, dof: Columns) -> None:
        self.model, self._qpos, self._dof = model, qpos, dof
        cores = os.cpu_count() or 1
        self._pool = rollout.Rollout(nthread=cores)
        self.data = [mujoco.MjData(model) for _ in range(cores)]

    def run(self, models: Sequence[Any], begin: Floats, controls: Sequence[Floats]) -> Floats:
        """States (N, steps, states) of several models, each from its own state (N, states); row i is after step i."""
        # A motion that diverges gives no result.
        with quiet():
            states, _ = self._pool.rollout(models, self.data, begin, np.stack(controls))
        return np.asarray(states)

    def at_rest(self, position: Floats) -> Floats:
        """The state of a body at rest at these joint positions."""
        state = np.zeros(mujoco.mj_stateSize(self.model, mujoco.mjtState.mjSTATE_FULLPHYSICS))
        begin = self.data[0]
        mujoco.mj_resetData(self.model, begin)
        begin.qpos[self._qpos] = position
        mujoco.mj_getState(self.model, begin, state, mujoco.mjtState.mjSTATE_FULLPHYSICS)
        return state

    def positions_at(self, joints: Columns) -> Columns:
        """Where in a state the positions of these joints are."""
        return np.asarray(1 + self._qpos[joints])

    def velocities_at(self, joints: Columns) -> Columns:
        """Where in a state their velocities are."""
        return np.asarray(1 + self.model.nq + self._dof[joints])
