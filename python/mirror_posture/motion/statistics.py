"""Noise and misfit of a moving session's residuals.

Pictures follow each other fast against what a body does: the fourth difference of a marker's residuals along the time holds the
noise (times √70) and next to nothing of a wrong model. What a model leaves is correlated in time; its rows count as
`n (1 − ρ) / (1 + ρ)` independent ones, and its squares are divided by their mean times `(1 + ρ) / (1 − ρ)`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

FOURTH = np.array([1.0, -4.0, 6.0, -4.0, 1.0])
MAD_TO_STD = 1.4826
LEAST_SCALE = 0.2
TAILS = 6.0
MOST_CORRELATION = 0.98


@dataclass(frozen=True)
class Misfit:
    """Sum of squares in units of the noise, rows, their lag-one correlation."""

    squares: float
    rows: int
    correlation: float

    @property
    def inflation(self) -> float:
        """By how much a square counts less than one of white noise."""
        return max(1.0, self.squares / self.rows) * (1.0 + self.correlation) / (1.0 - self.correlation)

    @property
    def effective_rows(self) -> float:
        """As many independent rows."""
        return self.rows * (1.0 - self.correlation) / (1.0 + self.correlation)


def noise_scale(whitened: Floats, seen: Mask) -> float:
    """The noise in units of the one that whitened the residuals (F, markers, 2)."""
    whole = np.lib.stride_tricks.sliding_window_view(seen, 5, axis=0).all(axis=-1)
    windows = np.lib.stride_tricks.sliding_window_view(whitened, 5, axis=0) @ FOURTH
    values = windows[whole]
    if values.size < 100:
        return 1.0
    usual = MAD_TO_STD * float(np.median(np.abs(values)))
    # The tails of a detector's errors are part of its noise; what is farther out is false.
    inner = values[np.abs(values) < TAILS * usual]
    return max(LEAST_SCALE, float(np.sqrt(np.mean(inner**2) / 70.0)))


def misfit(residual: Floats, seen: Mask) -> Misfit:
    """Of residuals (F, markers, 2) in units of the noise."""
    both = seen[1:] & seen[:-1]
    now, before = residual[1:][both], residual[:-1][both]
    squares = float((residual[seen] ** 2).sum())
    power = float(0.5 * ((now**2).sum() + (before**2).sum()))
    correlation = float((now * before).sum() / power) if power > 0.0 else 0.0
    return Misfit(squares, 2 * int(seen.sum()), min(MOST_CORRELATION, max(0.0, correlation)))
