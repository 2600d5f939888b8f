"""The few statistics of a score: Wilson intervals, reliability of probabilities, coverage of intervals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

Z95 = 1.959964


@dataclass(frozen=True)
class Rate:
    """A share with its 95 % interval by Wilson's score; without observations the interval is 0 to 1."""

    hits: int
    of: int

    @property
    def value(self) -> float | None:
        return self.hits / self.of if self.of else None

    @property
    def interval(self) -> tuple[float, float]:
        """(p + z²/2n ± z sqrt(p(1−p)/n + z²/4n²)) / (1 + z²/n)."""
        if self.of == 0:
            return 0.0, 1.0
        p, n = self.hits / self.of, self.of
        middle = p + Z95**2 / (2 * n)
        half = Z95 * float(np.sqrt(p * (1 - p) / n + Z95**2 / (4 * n * n)))
        return max(0.0, (middle - half) / (1 + Z95**2 / n)), min(1.0, (middle + half) / (1 + Z95**2 / n))

    def as_json(self) -> dict[str, Any]:
        return {"hits": self.hits, "of": self.of, "rate": self.value, "wilson95": list(self.interval)}


def rate(hits: Sequence[bool]) -> Rate:
    return Rate(int(sum(hits)), len(hits))


def reliability(claimed: Sequence[float], right: Sequence[bool], bins: int = 10) -> dict[str, Any]:
    """Reliability diagram over equal bins of probability, and the expected calibration error:
    Σ (share of the bin) · |mean claimed − share right|."""
    p, y = np.asarray(claimed, dtype=float), np.asarray(right, dtype=float)
    rows, error = [], 0.0
    which = np.clip((p * bins).astype(int), 0, bins - 1)
    for b in range(bins):
        inside = which == b
        if not inside.any():
            continue
        share = rate([bool(v) for v in y[inside]])
        mean = float(p[inside].mean())
        error += inside.mean() * abs(mean - float(y[inside].mean()))
        rows.append({"low": b / bins, "high": (b + 1) / bins, "claimed": mean, **share.as_json()})
    return {"bins": rows, "expected_calibration_error": error if len(p) else None, "number": len(p)}


def coverage(normalised: Sequence[float]) -> dict[str, Any]:
    """Of errors over their claimed deviations: how many lie within 1.96 (95 % claimed) and within 3; RMS."""
    z = np.abs(np.asarray(normalised, dtype=float))
    return {
        "within_95": rate([bool(v) for v in z <= Z95]).as_json(),
        "within_3_std": rate([bool(v) for v in z <= 3]).as_json(),
        "rms": float(np.sqrt(np.mean(z**2))) if len(z) else None,
    }
