"""Where a falling limb is when its log begins: what encoders read of the first moments, and for how long it had stood.

A robot stands at the first command before its log begins, nobody says for how long. A limb that its servo cannot hold falls from
then on, and where it is when the log begins decides all that follows. Its encoders tell: position and speed at the log's first
row, by a cubic through the first readings. Simulated, the limb falls from the first command on, and the log begins where the
simulated limb is nearest to that, in units of the readings' errors: each model says for how long it had stood.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from .recording import Recording

Floats = npt.NDArray[np.float64]

FIRST_S, LEAST_READINGS = (0.2, 0.14, 0.1), 8
"""Readings by which position and speed are told: of the first so many seconds, the longest that a cubic follows as closely as the others."""
AS_CLOSE = 1.5
LEAST_STD_RAD = 2e-4
"""Of a reading: less than an encoder's tick is not believed."""
MOST_STOOD_S, LEAST_STOOD_S = 3.0, 0.05
MOVING_RAD_PER_S, ELSEWHERE_RAD = 0.1, 0.3
"""A joint that is so much faster than the model as it is, or so far from it, has begun to fall."""
DEVIATIONS = 5.0


@dataclass(frozen=True, eq=False)
class Began:
    """By joint with an encoder: its column, position and speed at the log's first row, and the inverse of their covariance."""

    columns: npt.NDArray[np.int64]
    state: Floats
    information: Floats

    def falling(self, position: Floats, velocity: Floats) -> npt.NDArray[np.int64]:
        """Columns of the joints that fall when the log begins; positions and speeds (joints,) are those of the model as it is."""
        off = np.abs(self.state - np.stack([position[self.columns], velocity[self.columns]], axis=1))
        std = np.sqrt(np.linalg.inv(self.information)[:, 1, 1])
        return self.columns[
            (off[:, 1] > np.maximum(MOVING_RAD_PER_S, DEVIATIONS * std)) | (off[:, 0] > ELSEWHERE_RAD)
        ]

    def fastest(self, position: Floats, velocity: Floats) -> int | None:
        """Of the joints that fall the one that is fastest beside the model as it is; None where none falls."""
        falling = self.falling(position, velocity)
        if not len(falling):
            return None
        speed = {int(c): abs(float(s[1] - velocity[c])) for c, s in zip(self.columns, self.state, strict=True)}
        return max(falling.tolist(), key=lambda column: speed[column])

    def place(self, joints: npt.NDArray[np.int64], position: Floats, velocity: Floats, step_s: float) -> float:
        """Step (a fraction between two) at which these joints, falling (T, joints), are nearest to where the log has them."""
        mine = [i for i, column in enumerate(self.columns) if column in joints]
        at = [int(np.flatnonzero(joints == self.columns[i])[0]) for i in mine]
        off = np.stack([position[:, at], velocity[:, at]], axis=2) - self.state[mine]
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


def began(recording: Recording, joints: tuple[str, ...]) -> Began | None:
    """What the encoders say of the log's first moments; None where they are too few or silent."""
    states = recording.states
    time = states.time_s - states.time_s[0]
    columns, told = [], []
    for column, name in enumerate(states.measured_names):
        tried = [_first(time, states.measured[:, column], first_s) for first_s in FIRST_S]
        found = [one for one in tried if one is not None]
        if name in joints and found:
            closest = min(std for std, _, _ in found)
            columns.append(joints.index(name))
            told.append(next(one for one in found if one[0] <= AS_CLOSE * closest))
    if not columns:
        return None
    return Began(
        np.array(columns), np.array([state for _, state, _ in told]), np.array([i for _, _, i in told])
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
    return std, fitted[:2] * np.diag(unit), np.linalg.inv(covariance)
