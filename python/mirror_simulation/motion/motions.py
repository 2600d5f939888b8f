"""A simulated motion: the joint positions of each branch, step by step.

A branch is a set of joints without influence on the others: on a base that stands still each limb is one.
Motions that differ in one limb share the others.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import mujoco
import numpy as np

from mirror_posture.arrays import Floats, Integers
from mirror_posture.short_repr import ShortRepr


@dataclass(eq=False, repr=False)
class Branch(ShortRepr):
    """Positions and velocities (T, joints of the branch) every step from the log's first row on."""

    columns: Integers
    """Which of the robot's joints they are."""
    position: Floats
    velocity: Floats


@dataclass(eq=False, repr=False)
class Motion(ShortRepr):
    """Joint positions every `step_s` from `start_s` on."""

    start_s: float
    step_s: float
    branches: Sequence[Branch]
    loads: dict[tuple[float, int], Floats] = field(default_factory=dict)
    """Requested loads, by the first moment and their number."""

    @property
    def joints(self) -> int:
        """How many."""
        return sum(len(branch.columns) for branch in self.branches)

    @property
    def position(self) -> Floats:
        """(T, joints)."""
        return self._whole([branch.position for branch in self.branches])

    @property
    def velocity(self) -> Floats:
        """(T, joints)."""
        return self._whole([branch.velocity for branch in self.branches])

    def at(self, time_s: Floats) -> Floats:
        """Positions at times of any shape: (..., joints), straight between two steps."""
        return self._at([branch.position for branch in self.branches], time_s)

    def velocity_at(self, time_s: Floats) -> Floats:
        """Velocities at times of any shape: (..., joints)."""
        return self._at([branch.velocity for branch in self.branches], time_s)

    def acceleration_at(self, time_s: Floats) -> Floats:
        """Accelerations at times of any shape: (..., joints)."""
        tables = [np.gradient(branch.velocity, self.step_s, axis=0) for branch in self.branches]
        return self._at(tables, time_s)

    def _at(self, tables: Sequence[Floats], time_s: Floats) -> Floats:
        place = (time_s - self.start_s) / self.step_s
        return self._whole([between(table, place) for table in tables])

    def _whole(self, tables: Sequence[Floats]) -> Floats:
        out: Floats = np.empty((*tables[0].shape[:-1], self.joints))
        for branch, table in zip(self.branches, tables, strict=True):
            out[..., branch.columns] = table
        return out


def between(table: Floats, place: Floats) -> Floats:
    """Rows of a table at fractional places, straight between two."""
    place = np.clip(place, 0.0, len(table) - 1.000001)
    below = place.astype(np.int64)
    share = (place - below)[..., None]
    return np.asarray((1.0 - share) * table[below] + share * table[below + 1])


def independent(model: Any, dof: Integers) -> list[Integers]:
    """Of joints with these degrees of freedom the sets that feel nothing of each other: trees, unless something ties them."""
    ties = (
        model.neq,
        model.ntendon,
        model.nflex,
        (model.actuator_trntype != mujoco.mjtTrn.mjTRN_JOINT).any(),
    )
    tree = np.zeros(len(dof), dtype=np.int64) if any(ties) else model.dof_treeid[dof]
    return [np.flatnonzero(tree == one) for one in np.unique(tree)]
