"""The causes at places for which a plan's sensitivity is reported, and the moments of postures."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays import Floats


@dataclass(frozen=True, eq=False)
class Moment:
    """One frame: the posture, from which side each joint arrived (−1, 0, 1), the torques of gravity, the time."""

    positions: Floats
    side: Floats
    torque_nm: Floats
    time_s: float


@dataclass(frozen=True)
class Cause:
    """An effect at a place, with its parameters, the sizes at which they begin to matter, and its columns."""

    effect: str
    at: str
    parameters: tuple[str, ...]
    typical: tuple[float, ...]
    columns: slice

    @property
    def name(self) -> str:
        """`effect@place`."""
        return f"{self.effect}@{self.at}"


def moments(rows: Floats, torque_nm: Floats, seconds_a_frame: float) -> list[Moment]:
    """The moments of postures (F, nq) in the order of execution, from rest at 0, with gravity's torques (F, nq) in them."""
    before = np.vstack([np.zeros((1, rows.shape[1])), rows[:-1]])
    side = np.zeros_like(rows)
    last = np.zeros(rows.shape[1])
    for number, change in enumerate(rows - before):
        # A joint that does not move keeps the side from which it came.
        last = np.where(np.abs(change) > 1e-6, np.sign(change), last)
        side[number] = last
    return [Moment(rows[i], side[i], torque_nm[i], i * seconds_a_frame) for i in range(len(rows))]
