"""Rivals of a cause: hypotheses whose columns, the other causes projected out, say the same of these pictures.

Each that the first look puts near is fitted in the cause's place; probabilities follow from the criterion,
`p ∝ exp(advantage / 2)`. A cause that was not near any other has only what the search's own margin leaves.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .effects import Key
from .fit import Fitted, fit
from .problem import Problem
from .screen import with_cause
from .search import Found, advantage, columns_of

NEAR = 60.0
"""In the criterion's units: a rival farther behind at the first look is not fitted."""
RIVALS = 4
LEAST_PROBABILITY = 0.01
MOST_PROBABILITY = 0.999


@dataclass(frozen=True)
class Rivals:
    """The probability of a cause, and of those that might stand in its place."""

    probability: float
    others: tuple[tuple[Key, float], ...]


def rivals_of(problem: Problem, found: Found, key: Key) -> Rivals:
    """The rivals of one of the causes found."""
    best, scale = found.best, found.noise_scale
    rest = {k: v for k, v in best.causes.items() if k != key}
    without = fit(problem, rest, scale, iterations=2)
    if without is None:
        return Rivals(MOST_PROBABILITY, ())
    known, taken = columns_of(problem, without, scale)
    scored = found.screen.scores(without.residual, taken, list(rest), scale)
    inflation, rows = best.misfit.inflation, max(2.0, best.misfit.effective_rows)
    worth = {s.key: s.gain / inflation - len(s.start) * np.log(rows) for s in scored}
    near = sorted((s for s in scored if s.key != key), key=lambda s: -worth[s.key])[:RIVALS]
    own = max([worth.get(key, 0.0), advantage(best, without)])
    weights: dict[Key, float] = {}
    for one in near:
        if worth[one.key] < own - NEAR - 0.2 * abs(own):
            continue
        trial: Fitted | None = fit(problem, with_cause(rest, one), scale, iterations=4, known=known)
        if trial is not None:
            weights[one.key] = float(np.exp(0.5 * min(0.0, advantage(trial, best))))
    total = 1.0 + sum(weights.values())
    others = sorted(((k, w / total) for k, w in weights.items()), key=lambda pair: -pair[1])
    return Rivals(
        min(MOST_PROBABILITY, 1.0 / total), tuple((k, p) for k, p in others if p > LEAST_PROBABILITY)
    )
