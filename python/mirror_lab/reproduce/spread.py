"""The spread of few repetitions: the deviation of a sample, and Student's distribution."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]


def deviation(values: Floats, axis: int) -> Floats:
    """The standard deviation of a sample (n − 1) along an axis, NaN left out; NaN where there are fewer than two values."""
    count = np.isfinite(values).sum(axis=axis)
    middle = np.nansum(values, axis=axis) / np.maximum(count, 1)
    squares = np.nansum((values - np.expand_dims(middle, axis)) ** 2, axis=axis)
    return np.asarray(np.where(count > 1, np.sqrt(squares / np.maximum(count - 1, 1)), np.nan))


@cache
def students_95(freedom: int) -> float:
    """The number of deviations within which 95 % of Student's distribution lie; NaN below one degree of freedom."""
    if freedom < 1:
        return math.nan
    low, high = 0.0, 0.5 * math.pi
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if _within(middle, freedom) < 0.95 else (low, middle)
    return math.tan(low) * math.sqrt(freedom)


def _within(angle: float, freedom: int) -> float:
    """Student's probability of |t| < tan(angle) √freedom: a finite series (Abramowitz and Stegun, 26.7.3 and 26.7.4)."""
    sine, cosine = math.sin(angle), math.cos(angle)
    odd = freedom % 2 == 1
    term = cosine if odd else 1.0
    total = 0.0
    for k in range(2 if odd else 1, freedom, 2):
        total += term
        term *= cosine * cosine * k / (k + 1)
    return (angle + sine * total) * 2 / math.pi if odd else sine * total
