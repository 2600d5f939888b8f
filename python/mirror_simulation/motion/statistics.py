"""Noise and misfit of the residuals of a session in motion.

Pictures are fast compared with the motion of a body, so the fourth difference of a marker's residuals in
time contains the noise (times √70) and almost nothing of a wrong model. The remainder of a model is
correlated in time: its rows count as `n (1 − ρ) / (1 + ρ)` independent ones, and its squares are divided by
their mean times `(1 + ρ) / (1 − ρ)`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mirror_posture.arrays import Floats, Mask

FOURTH = np.array([1.0, -4.0, 6.0, -4.0, 1.0])
MAD_TO_STD = 1.4826
LEAST_SCALE, MOST_SCALE = 0.2, 6.0
"""Of the stated noise: where a model is wildly wrong its own error is quick too, and would pass for noise."""
TAILS = 6.0
RHO = np.linspace(0.0, 0.6, 121)
"""Correlations that a detector's errors may have from picture to picture."""
MOST_CORRELATION = 0.98
WINDOW, LEAST_WINDOWS = 24, 12
QUIETEST_TENTH = 0.62
"""The tenth-quantile of the power of a window's fourth differences of white noise, in units of its mean: of χ² with 48 / 2.6 degrees
of freedom, 2.6 the sum of the squares of their correlations."""
QUIETER = 1.6
"""By so much less noise in the quietest windows than in all (tails make a tenth or two) not all of it is noise."""


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
    """The noise in units of the one that whitened the residuals (F, markers, 2).

    A detector's errors may be correlated from picture to picture, ρ to the next: then fourth differences
    contain less of them. How much follows from the correlation of successive differences, which depends on
    ρ alone.

    Where a limb does what the model never does, the model's own error is fast too, at some markers for some
    of the time. The noise is the same everywhere: if the quietest windows contain much less than the whole,
    their content is the noise.
    """
    whole: Mask = np.asarray(np.lib.stride_tricks.sliding_window_view(seen, 6, axis=0).all(axis=-1))
    differences = np.lib.stride_tricks.sliding_window_view(whitened, 5, axis=0) @ FOURTH
    now, following = differences[:-1][whole], differences[1:][whole]
    if now.size < 100:
        return 1.0
    quiet = _quietest(differences[:-1], whole)
    usual = MAD_TO_STD * float(np.median(np.abs(now)))
    # The tails of a detector's errors are part of its noise; what is farther out is false.
    inner = (np.abs(now) < TAILS * usual) & (np.abs(following) < TAILS * usual)
    now, following = now[inner], following[inner]
    power = 0.5 * float(np.mean(now**2) + np.mean(following**2))
    if power <= 0.0:
        return LEAST_SCALE
    variance, correlation = _of_differences(RHO)
    if quiet is not None and power > QUIETER**2 * quiet:
        # What is left is not the noise's: nor is its correlation.
        out = float(np.sqrt(quiet / variance[0]))
    else:
        ratio = float(np.mean(now * following)) / power
        out = float(np.sqrt(power / variance[int(np.argmin(np.abs(correlation - ratio)))]))
    return min(MOST_SCALE, max(LEAST_SCALE, out))


def _quietest(differences: Floats, whole: Mask) -> float | None:
    """The power of fourth differences in windows of one marker's, as the quietest tenth of them has it; None of too few."""
    frames = len(differences) // WINDOW * WINDOW
    if frames == 0:
        return None
    inside = whole[:frames].reshape(-1, WINDOW, whole.shape[1])
    squares = np.where(inside[..., None], differences[:frames].reshape(*inside.shape, 2) ** 2, 0.0)
    count = inside.sum(axis=1)
    full = count > 0.8 * WINDOW
    if int(full.sum()) < LEAST_WINDOWS:
        return None
    powers = squares.sum(axis=(1, 3))[full] / (2.0 * count[full])
    return float(np.quantile(powers, 0.1)) / QUIETEST_TENTH


def _of_differences(rho: Floats) -> tuple[Floats, Floats]:
    """Variance of the fourth differences of errors of unit variance, and their lag-one correlation, by the errors' own ρ."""
    products = np.convolve(FOURTH, FOURTH[::-1])
    lags = np.arange(-4, 5)
    variance, successive = ((products * rho[:, None] ** np.abs(lags - shift)).sum(axis=1) for shift in (0, 1))
    return variance, successive / variance


def misfit(residual: Floats, seen: Mask) -> Misfit:
    """Of residuals (F, markers, 2) in units of the noise."""
    both = seen[1:] & seen[:-1]
    now, before = residual[1:][both], residual[:-1][both]
    squares = float((residual[seen] ** 2).sum())
    power = float(0.5 * ((now**2).sum() + (before**2).sum()))
    correlation = float((now * before).sum() / power) if power > 0.0 else 0.0
    return Misfit(squares, 2 * int(seen.sum()), min(MOST_CORRELATION, max(0.0, correlation)))
