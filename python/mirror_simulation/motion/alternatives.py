"""Alternatives of a cause: hypotheses that explain the same pictures, with the other causes free.

Every hypothesis is scored in the cause's place by the first screening. Those with a similar score are
fitted there; probabilities follow from the evidence of each. For one that was not fitted the score of the
screening is used, so that no close alternative is left out of the sum.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from .effects import EFFECTS, Key
from .evidence import EXACT_LAWS, log_odds, trusted_to
from .fit import Fitted, fit, fit_all
from .problem import Problem
from .search import Found, columns_of, start_of, without_cause

NEAR = 30.0
"""Log odds: an alternative farther behind in the first screening is not fitted..."""
SHARE = 0.25
"""... nor one farther behind than this share of the cause's gain, because large effects are not linear."""
RIVALS = 6
CLOSE = 4.0
"""Log odds: alternatives as near as this are fitted once more with steps that are exact near them."""
LEAST_PROBABILITY = 0.01
MOST_PROBABILITY = 0.999


@dataclass(frozen=True, eq=False)
class Rivals:
    """The probability of a cause, and of its alternatives, the most probable first.

    `models` are those that were fitted with an alternative in its place; `better` is the one that is more
    probable than the cause, if any is.
    """

    probability: float
    others: tuple[tuple[Key, float], ...]
    models: Mapping[Key, Fitted] = field(default_factory=dict)
    better: Fitted | None = None


def rivals_of(problem: Problem, found: Found, key: Key) -> Rivals:
    """The alternatives of one of the causes found."""
    best, scale = found.best, found.noise_scale
    inflation = best.misfit.inflation
    columns, _ = columns_of(problem, best, scale)
    without, known, scored = without_cause(problem, found.screen, best, columns, key, scale)
    if without is None:
        return Rivals(MOST_PROBABILITY, ())
    gain = {s.key: 0.5 * s.gain / inflation for s in scored}
    own = max(gain.get(key, 0.0), 0.5 * (without.misfit.squares - best.misfit.squares) / inflation)
    behind = {s.key: own - gain[s.key] for s in scored if s.key != key}
    near = [s for s in scored if s.key != key and behind[s.key] < NEAR + SHARE * own][:RIVALS]
    # The cause itself once more, with the same columns where possible.
    starts = [dict(best.causes), *(start_of(problem, without, one, scale) for one in near)]
    itself, *trials = fit_all(problem, starts, scale, iterations=6, known=known, enough=0.05)
    itself, does = itself or best, without.misfit.squares - best.misfit.squares
    off = {k: 0.0 if {key[0], k[0]} <= EXACT_LAWS else does for k in behind}
    odds = {k: -max(0.0, distance) / trusted_to(off[k], inflation) for k, distance in behind.items()}
    models: dict[Key, Fitted] = {}
    better: tuple[float, Fitted | None] = (0.0, None)
    for one, trial in zip(near, trials, strict=True):
        odds.pop(one.key)
        if trial is None:
            continue
        odds[one.key] = log_odds(problem, trial, itself, inflation, off[one.key])
        if odds[one.key] > -CLOSE and _simulated(one.key, key):
            trial = exact(problem, trial, scale)
            odds[one.key] = log_odds(problem, trial, itself, inflation, off[one.key])
        models[one.key] = trial
        if odds[one.key] > better[0]:
            better = (odds[one.key], trial)
    most = max([0.0, *odds.values()])
    weights = {k: float(np.exp(o - most)) for k, o in odds.items()}
    total = float(np.exp(-most)) + sum(weights.values())
    others = sorted(((k, w / total) for k, w in weights.items()), key=lambda pair: -pair[1])
    return Rivals(
        min(MOST_PROBABILITY, float(np.exp(-most)) / total),
        tuple((k, p) for k, p in others if p > LEAST_PROBABILITY),
        models,
        better[1],
    )


def _simulated(one: Key, other: Key) -> bool:
    """Whether the motions of two causes differ, and so the simulator's integration errors."""
    return EFFECTS[one[0]].in_rollout or EFFECTS[other[0]].in_rollout


def exact(problem: Problem, model: Fitted, scale: float) -> Fitted:
    """A model fitted once more with steps that are exact near it."""
    with problem.rollouts.near(model.causes):
        fitted = fit(problem, model.causes, scale, iterations=2)
    return model if fitted is None else fitted
