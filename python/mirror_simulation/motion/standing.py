"""The state of a falling limb when its log begins: from the encoders' first readings, with the time that it
had stood.

A robot stands at the first command before its log begins, for an unknown time. A limb that its servo cannot
hold falls from then on, and its state when the log begins decides everything that follows. Its encoders
give position and speed at the log's first row, by a cubic through the first readings. In the simulation the
limb falls from the first command on, and the log begins where the simulated limb is nearest to that state,
in units of the readings' errors. So each model determines the time.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from mirror_posture.arrays import Floats, Integers

from .motions import Motion
from .pool import Pool
from .recording import Recording

FIRST_S, LEAST_READINGS = (0.2, 0.14, 0.1), 8
"""Readings from which position and speed are computed: of the first seconds, the longest interval that a
cubic follows as closely as the others."""
AS_CLOSE = 1.5
LEAST_STD_RAD = 2e-4
"""Smallest error of a reading: less than an encoder's tick is implausible."""
MOST_STOOD_S, LEAST_STOOD_S = 3.0, 0.05
MOVING_RAD_PER_S, ELSEWHERE_RAD = 0.1, 0.3
"""A joint that is so much faster than the model as it is, or so far from it, has begun to fall."""
DEVIATIONS = 5.0
LOOKS = 3
WILD_RAD = 1e3
"""A joint that is so far away has diverged."""


@dataclass(frozen=True, eq=False)
class Began:
    """By joint with an encoder: its column, position and speed at the log's first row, the inverse of their covariance.

    `first_s` and `time_s`: by how much of the log, and the log's times from its first row on.
    """

    columns: Integers
    state: Floats
    information: Floats
    first_s: Floats
    time_s: Floats

    def falling(self, nominal: Motion) -> dict[int, float]:
        """Columns of the joints that fall when the log begins, and how fast relative to the nominal model.

        A log may begin with a jerk of its commands: the model's own motion is treated like the readings.
        """
        readings = nominal.at(nominal.start_s + self.time_s[self.time_s <= max(FIRST_S)])
        std = np.sqrt(np.linalg.inv(self.information)[:, 1, 1])
        out = {}
        for i, column in enumerate(self.columns.tolist()):
            usual = _first(self.time_s[: len(readings)], readings[:, column], float(self.first_s[i]))
            assert usual is not None
            away, faster = np.abs(self.state[i] - usual[1])
            if faster > max(MOVING_RAD_PER_S, DEVIATIONS * float(std[i])) or away > ELSEWHERE_RAD:
                out[column] = float(faster)
        return out

    def place(
        self,
        joints: Integers,
        position: Floats,
        velocity: Floats,
        step_s: float,
        bias: Floats | None = None,
    ) -> float:
        """Step (a fraction between two) at which these joints, falling (T, joints), are nearest to their
        state in the log.

        `bias` (joints, 2) is the error of a cubic in their positions and speeds.
        """
        mine, at = self._common(joints)
        state = self.state[mine] - (0.0 if bias is None else bias[at])
        off = np.stack([position[:, at], velocity[:, at]], axis=2) - state
        information = self.information[mine]
        begin = int(LEAST_STOOD_S / step_s)
        squares = np.einsum("tji,jik,tjk->t", off, information, off)
        k = begin + int(np.argmin(squares[begin:]))
        best = (float(squares[k]), float(k))
        for a, b in ((k - 1, k), (k, k + 1)):
            if begin <= a and b < len(off):
                # Straight between two steps: the nearest place is a quotient of two forms.
                along = off[b] - off[a]
                power = float(np.einsum("ji,jik,jk->", along, information, along))
                share = -float(np.einsum("ji,jik,jk->", along, information, off[a])) / max(power, 1e-300)
                share = min(1.0, max(0.0, share))
                there = off[a] + share * along
                best = min(best, (float(np.einsum("ji,jik,jk->", there, information, there)), a + share))
        return best[1]

    def bias(self, joints: Integers, position: Floats, velocity: Floats, step_s: float) -> Floats:
        """(joints, 2): position and speed by a cubic through the first readings less the true ones, of a motion (T, joints)."""
        out = np.zeros((len(joints), 2))
        time = self.time_s[self.time_s <= max(FIRST_S)]
        for i, j in zip(*self._common(joints), strict=True):
            readings = np.interp(time, step_s * np.arange(len(position)), position[:, j])
            fitted = _first(time, readings, float(self.first_s[i]))
            assert fitted is not None
            out[j] = fitted[1] - (position[0, j], velocity[0, j])
        return out

    def _common(self, joints: Integers) -> tuple[list[int], list[int]]:
        """Which of the joints with an encoder are among these, and their places among them."""
        mine = [i for i, column in enumerate(self.columns) if column in joints]
        return mine, [int(np.flatnonzero(joints == self.columns[i])[0]) for i in mine]


def began(recording: Recording, joints: tuple[str, ...]) -> Began | None:
    """The encoders' state at the log's first moments; None where they are too few or absent."""
    states = recording.states
    time = states.time_s - states.time_s[0]
    columns, told, window = [], [], []
    for column, name in enumerate(states.measured_names):
        tried = [(_first(time, states.measured[:, column], first_s), first_s) for first_s in FIRST_S]
        found = [(one, first_s) for one, first_s in tried if one is not None]
        if name in joints and found:
            closest = min(one[0] for one, _ in found)
            best, first_s = next(pair for pair in found if pair[0][0] <= AS_CLOSE * closest)
            columns.append(joints.index(name))
            told.append(best)
            window.append(first_s)
    if not columns:
        return None
    return Began(
        np.array(columns),
        np.array([state for _, state, _ in told]),
        np.array([information for _, _, information in told]),
        np.array(window),
        time,
    )


def _first(time: Floats, readings: Floats, first_s: float) -> tuple[float, Floats, Floats] | None:
    """Standard deviation of a reading about a cubic through the first ones, position and speed at 0, their information."""
    taken = (time <= first_s) & np.isfinite(readings)
    if int(taken.sum()) < LEAST_READINGS:
        return None
    powers = (time[taken, None] / first_s) ** np.arange(4)
    fitted = np.linalg.lstsq(powers, readings[taken], rcond=None)[0]
    left = readings[taken] - powers @ fitted
    std = max(LEAST_STD_RAD, float(np.sqrt((left**2).sum() / (len(left) - 4))))
    unit = np.diag([1.0, 1.0 / first_s])
    covariance = unit @ np.linalg.inv(powers.T @ powers)[:2, :2] @ unit * std**2
    return std, np.asarray(fitted[:2] * np.diag(unit)), np.asarray(np.linalg.inv(covariance))


def where_logs_begin(
    pool: Pool,
    began: Began,
    models: Sequence[Any],
    at_rest: Floats,
    controls: Sequence[Floats],
    falling: Sequence[Sequence[Integers]],
    step_s: float,
    settle_s: float,
) -> Floats:
    """States (N, states) in which the log begins, of several models that stand `at_rest`; their controls
    (T, …) from then on.

    Of each model's `falling` sets of joints in their encoders' state; the others after `settle_s`.
    """
    steps, first = int(MOST_STOOD_S / step_s), int(max(FIRST_S) / step_s) + 2
    begin = np.repeat(at_rest[None], len(models), axis=0)
    states = pool.run(models, begin, [np.repeat(one[:1], steps, axis=0) for one in controls])
    out = np.asarray(states[:, int(settle_s / step_s) - 1].copy())
    motions = None
    for _ in range(LOOKS):
        for n, (run, sets) in enumerate(zip(states, falling, strict=True)):
            for joints in sets:
                q, v = pool.positions_at(joints), pool.velocities_at(joints)
                if not (np.abs(run[:, q]) <= WILD_RAD).all():
                    continue
                # A swing is not a cubic: the simulated motion gives the error.
                off = (
                    None
                    if motions is None
                    else began.bias(joints, motions[n][:, q], motions[n][:, v], step_s)
                )
                k, share = divmod(began.place(joints, run[:, q], run[:, v], step_s, off), 1.0)
                after = run[min(int(k) + 1, steps - 1)]
                there = (1.0 - share) * run[int(k)] + share * after
                out[n, q], out[n, v] = there[q], there[v]
        followed = pool.run(models, out, [one[:first] for one in controls])
        motions = np.concatenate([out[:, None], followed], axis=1)
    return out
