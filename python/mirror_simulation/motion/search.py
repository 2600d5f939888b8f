"""One search over all causes of a session in motion: add, exchange, drop, by a criterion that a wrong model
cannot satisfy.

Two models are compared by their squares over the inflation φ of the better one (allowing for the
correlation in time of what it leaves) and a price for each parameter: `squares / φ + parameters ·
log(independent rows)`, as in BIC; a new cause also pays for being one of H hypotheses. A cause must move
the markers by a tenth of the noise, and predict held-out segments of time.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from mirror_posture.arrays import Floats

from .beginning import leave_out_beginning
from .effects import Causes, Key
from .evidence import LAW_SHARE
from .fit import Fitted, design, evaluated, evaluated_all, fit, fit_all, held_out_squares
from .problem import Problem
from .screen import Scored, Screen, with_cause
from .statistics import misfit, noise_scale

TRIED = 6
"""Hypotheses of the first look that are fitted, each round."""
MARGIN = 6.0
"""Twice the log odds that a new cause must have over its price."""
AT_NOISE = 1.15
"""RMS of the remainder, in units of the noise: up to here it is small."""
LEAST_SHIFT = 0.1
"""In units of the noise: a cause that moves the markers by less, RMS, is not reported."""
HOPELESS = (60.0, 0.5)
"""A model is fitted no further if it is behind the best by this much in the criterion, and by this share of
the best's gain."""
MOST_AHEAD, FAR = 3, 1.5
"""So many causes may be tried together before they pay, while more than so much of the noise, RMS, is left."""
MOST_STEPS = 13_000_000
"""Of all simulations together, until which the search looks for one more cause: three hundred motions of a minute."""
NEAR_SIZES = 1
"""Sizes of a limit to either side of the single best that are tried with the causes of a model."""
UNLIKE = 0.5
"""Share of a cause's gain, in the first screening, below which another is not tried in its place."""


@dataclass(frozen=True, eq=False)
class Found:
    """What a search found: the nominal model, the fitted one, the noise in units of the stated one, and how it came about."""

    nominal: Fitted
    best: Fitted
    noise_scale: float
    screen: Screen
    trace: tuple[str, ...]
    first_look: tuple[Scored, ...]


def search(
    problem: Problem,
    most_causes: int = 4,
    progress: Callable[[str], None] | None = None,
    start: Causes | None = None,
) -> Found:
    """Searches the causes of a moving session, from none or from those of an earlier search."""
    say = progress or (lambda _: None)
    start = start or {}
    as_it_is = evaluated(problem, {}, 1.0)
    first_fit = fit(problem, start, 1.0, iterations=3) if start else as_it_is
    assert first_fit is not None and as_it_is is not None
    # A model that is wrong in fast motion increases it; none decreases it.
    scale = min(noise_scale(model.residual, problem.view.seen) for model in (as_it_is, first_fit))
    base, best = evaluated(problem, {}, scale), evaluated(problem, first_fit.causes, scale)
    assert base is not None and best is not None
    say("first look")
    screen = Screen(problem)
    trace: list[str] = [
        f"nominal: {_told(base)}, {len(problem.hypotheses)} hypotheses, noise scale {scale:.3f}"
    ]
    nominal, first = base, screen.scores(base.residual, np.zeros((base.misfit.rows, 0)), (), scale)[:20]
    price = 2.0 * float(np.log(len(problem.hypotheses))) + MARGIN
    accepted, ahead = best, 0
    while len(best.causes) < most_causes:
        if problem.rollouts.count * len(problem.rollouts.time_s) > MOST_STEPS:
            trace.append(f"stopped after {problem.rollouts.count} simulated motions")
            break
        known, taken = columns_of(problem, best, scale)
        scored = screen.scores(best.residual, taken, list(best.causes), scale)
        trial = _best_addition(problem, best, scored, known, scale)
        if trial is None:
            break
        trial = fit(problem, trial.causes, scale) or trial
        ahead += 1
        taken_in, why = _pays(problem, accepted, trial, scale, ahead * price)
        trace.append(("+ " if taken_in else "not ") + why)
        say(trace[-1])
        if taken_in:
            best = _revised(problem, screen, trial, scale, trace)
            problem.rollouts.refine(best.causes)
            if leave_out_beginning(problem, best.causes):
                trace.append(f"counted from picture {problem.view.first} on")
                nominal = evaluated(problem, {}, scale) or nominal
                best = evaluated(problem, best.causes, scale) or best
            best = fit(problem, best.causes, scale, iterations=2) or best
            fresh = noise_scale(best.residual * scale, problem.view.seen)
            if fresh < 0.98 * scale:
                scale = fresh
                best = evaluated(problem, best.causes, scale) or best
                nominal = evaluated(problem, {}, scale) or nominal
            accepted, ahead = best, 0
        elif ahead < MOST_AHEAD and trial.misfit.squares > FAR**2 * trial.misfit.rows:
            # If much is wrong a single cause may gain little; it may gain together with the next.
            best = trial
        else:
            break
    best = fit(problem, accepted.causes, scale, iterations=4) or accepted
    return Found(nominal, best, scale, screen, tuple(trace), tuple(first))


def _pays(problem: Problem, before: Fitted, trial: Fitted, scale: float, price: float) -> tuple[bool, str]:
    """Whether a model with more causes is better than the previous one by all criteria; and in words."""
    new = [key for key in trial.causes if key not in before.causes]
    gained = before.misfit.squares - trial.misfit.squares
    worth = advantage(trial, before)
    held = held_out_squares(problem, trial, scale) < held_out_squares(problem, before, scale)
    told = f"{', '.join(f'{e}@{at}' for e, at in new)}: {_told(trial)}, worth {worth:.1f} of {price:.1f}"
    pays = worth > price and gained > LEAST_SHIFT**2 * trial.misfit.rows
    if not held:
        return False, f"{told}, not on segments held out"
    places = {at for _, at in new}
    beside = [key for key in before.causes if key[1] in places]
    if pays and beside:
        rest = evaluated(problem, {k: v for k, v in trial.causes.items() if k not in beside}, scale)
        if rest is not None:
            does = rest.misfit.squares - trial.misfit.squares
            if gained < LAW_SHARE**2 * does:
                return False, f"{told}, within what the law of {beside[0][0]} may be off"
    return pays, told


def advantage(one: Fitted, other: Fitted) -> float:
    """By how much a model is better than another: positive speaks for the first."""
    inflation = one.misfit.inflation if one.misfit.squares <= other.misfit.squares else other.misfit.inflation
    rows = max(2.0, one.misfit.effective_rows)
    dearer = (one.parameters - other.parameters) * float(np.log(rows))
    return (other.misfit.squares - one.misfit.squares) / inflation - dearer


def columns_of(problem: Problem, model: Fitted, scale: float) -> tuple[dict[tuple[Key, int], Floats], Floats]:
    """The columns of a model's own parameters: by parameter (whitened), and as a matrix in units of the noise."""
    of, columns = design(problem, model.causes, central=False)
    seen = problem.view.seen
    return {one: columns[..., i] for i, one in enumerate(of)}, columns[seen].reshape(
        2 * int(seen.sum()), len(of)
    ) / scale


def _best_addition(
    problem: Problem, base: Fitted, scored: list[Scored], known: dict[tuple[Key, int], Floats], scale: float
) -> Fitted | None:
    inflation, rows = base.misfit.inflation, max(2.0, base.misfit.effective_rows)
    worth = {one.key: one.gain / inflation - len(one.start) * float(np.log(rows)) for one in scored}
    ranked = sorted(scored, key=lambda one: -worth[one.key])
    if base.misfit.squares <= AT_NOISE**2 * base.misfit.rows:
        # What is left is small, and small effects are linear: those that gain less than they cost need no fit.
        ranked = [one for one in ranked if worth[one.key] > 0.0]
    starts = [start_of(problem, base, one, scale) for one in ranked[:TRIED]]
    return best_of(_fitted(problem, base, starts, known, scale, 4))


def start_of(problem: Problem, base: Fitted, scored: Scored, scale: float) -> Causes:
    """A model with one more cause, and the start of its fit: a limit at the size that leaves least, near
    the single best."""
    hypothesis = problem.hypotheses[scored.key]
    if not hypothesis.effect.is_limit:
        return with_cause(base.causes, scored)
    at = hypothesis.starts.index(scored.start)
    near = hypothesis.starts[max(0, at - NEAR_SIZES) : at + NEAR_SIZES + 1]
    found = [
        model
        for model in evaluated_all(problem, [{**base.causes, scored.key: size} for size in near], scale)
        if model is not None
    ]
    if not found:
        return with_cause(base.causes, scored)
    return min(found, key=lambda model: model.misfit.squares).causes


def _fitted(
    problem: Problem,
    base: Fitted,
    starts: list[Causes],
    known: dict[tuple[Key, int], Floats],
    scale: float,
    iterations: int,
) -> list[Fitted]:
    """Models fitted side by side, those that fall far behind given up."""

    def hopeless(one: Fitted, best: Fitted) -> bool:
        behind = advantage(best, one)
        return behind > HOPELESS[0] and behind > HOPELESS[1] * advantage(best, base)

    trials = fit_all(problem, starts, scale, iterations=iterations, known=known, hopeless=hopeless)
    return [trial for trial in trials if trial is not None]


def best_of(trials: list[Fitted]) -> Fitted | None:
    """The model that the criterion prefers."""
    out: Fitted | None = None
    for trial in trials:
        if out is None or advantage(trial, out) > 0.0:
            out = trial
    return out


def _revised(problem: Problem, screen: Screen, model: Fitted, scale: float, trace: list[str]) -> Fitted:
    """Tries to exchange each cause for another, and to do without it."""
    if len(model.causes) < 2:
        return model
    best = model
    columns, _ = columns_of(problem, best, scale)
    for key in list(model.causes)[:-1]:
        if key not in best.causes:
            continue
        without, known, scored = without_cause(problem, screen, best, columns, key, scale)
        if without is None:
            continue
        own = max((s.gain for s in scored if s.key == key), default=0.0)
        if advantage(without, best) > -HOPELESS[0]:
            fitted = fit(problem, without.causes, scale, iterations=3) or without
            if advantage(fitted, best) > 0.0:
                trace.append(f"- {key[0]}@{key[1]}: {_told(fitted)}")
                best = fitted
                columns, _ = columns_of(problem, best, scale)
                continue
        starts = [
            start_of(problem, without, one, scale)
            for one in scored[:4]
            if one.key != key and one.gain > UNLIKE * own
        ][:3]
        other = best_of(_fitted(problem, without, starts, known, scale, 3))
        if other is not None and advantage(other, best) > 0.0:
            trace.append(f"{key[0]}@{key[1]} exchanged: {_told(other)}")
            best = fit(problem, other.causes, scale) or other
            columns, _ = columns_of(problem, best, scale)
    return best


def without_cause(
    problem: Problem,
    screen: Screen,
    model: Fitted,
    columns: dict[tuple[Key, int], Floats],
    key: Key,
    scale: float,
) -> tuple[Fitted | None, dict[tuple[Key, int], Floats], list[Scored]]:
    """The model without one of its causes, the others unchanged and free for one linear step: its
    remainder.

    Then the others' columns, and the gain of each hypothesis in its place, the best first.
    """
    rest = {k: v for k, v in model.causes.items() if k != key}
    without = evaluated(problem, rest, scale)
    known = {slot: column for slot, column in columns.items() if slot[0] != key}
    if without is None:
        return None, known, []
    seen = problem.view.seen
    taken = np.zeros((2 * int(seen.sum()), 0))
    if known:
        taken = np.stack([column[seen].reshape(-1) for column in known.values()], axis=1) / scale
        step = np.linalg.lstsq(taken, without.residual[seen].reshape(-1), rcond=1e-10)[0]
        left = without.residual.copy()
        left[seen] -= (taken @ step).reshape(-1, 2)
        without = replace(without, residual=left, misfit=misfit(left, seen))
    return without, known, screen.scores(without.residual, taken, list(rest), scale)


def _told(model: Fitted) -> str:
    return (
        f"rms {np.sqrt(model.misfit.squares / model.misfit.rows):.3f}, correlation {model.misfit.correlation:.2f}, "
        + ", ".join(
            f"{e}@{at} {tuple(round(v, 6) for v in values)}" for (e, at), values in model.causes.items()
        )
    )
