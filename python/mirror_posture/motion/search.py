"""One search over all causes of a moving session: add, exchange, drop, by a criterion that a wrong model cannot buy.

Two models are compared by their squares over the inflation φ of the better one's (what it leaves, correlated in time, counts
accordingly) and a price for each parameter: `squares / φ + parameters · log(independent rows)`, as BIC has it; a new cause pays
for being one of H hypotheses besides. A cause must move the markers by a tenth of the noise, and predict segments of time that its
parameters were not fitted to.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from .effects import Causes, Key
from .fit import Fitted, design, evaluated, fit
from .problem import Problem
from .screen import Scored, Screen, with_cause
from .statistics import noise_scale

Floats = npt.NDArray[np.float64]

TRIED = 6
"""Hypotheses of the first look that are fitted, each round."""
MARGIN = 6.0
"""Twice the log odds that a new cause must have over its price."""
LEAST_SHIFT = 0.1
"""In units of the noise: a cause that moves the markers by less, RMS, is not told."""
SEGMENTS = 5


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
    first_fit = fit(problem, start, 1.0, iterations=3) if start else evaluated(problem, {}, 1.0)
    assert first_fit is not None
    scale = noise_scale(first_fit.residual, problem.view.seen)
    base, best = evaluated(problem, {}, scale), evaluated(problem, first_fit.causes, scale)
    assert base is not None and best is not None
    say("first look")
    screen = Screen(problem)
    trace: list[str] = [
        f"nominal: {_told(base)}, {len(problem.hypotheses)} hypotheses, noise scale {scale:.3f}"
    ]
    nominal, first = base, screen.scores(base.residual, np.zeros((base.misfit.rows, 0)), (), scale)[:20]
    price = 2.0 * np.log(len(problem.hypotheses))
    while len(best.causes) < most_causes:
        known, taken = columns_of(problem, best, scale)
        scored = screen.scores(best.residual, taken, list(best.causes), scale)
        trial = _best_addition(problem, best, scored, known, scale)
        if trial is None:
            break
        trial = fit(problem, trial.causes, scale) or trial
        gained = best.misfit.squares - trial.misfit.squares
        worth = advantage(trial, best)
        (new,) = [key for key in trial.causes if key not in best.causes]
        held = held_out_squares(problem, trial, scale) < held_out_squares(problem, best, scale)
        taken_in = worth > price + MARGIN and gained > LEAST_SHIFT**2 * trial.misfit.rows and held
        trace.append(
            f"{'+' if taken_in else 'not'} {new[0]}@{new[1]}: {_told(trial)}, worth {worth:.1f} of {price + MARGIN:.1f}"
            + ("" if held else ", not on segments held out")
        )
        say(trace[-1])
        if not taken_in:
            break
        best = _revised(problem, screen, trial, scale, trace)
        problem.rollouts.refine(best.causes)
        best = fit(problem, best.causes, scale, iterations=2) or best
        fresh = noise_scale(best.residual * scale, problem.view.seen)
        if abs(fresh / scale - 1.0) > 0.02:
            scale = fresh
            best = evaluated(problem, best.causes, scale) or best
            nominal = evaluated(problem, {}, scale) or nominal
    best = fit(problem, best.causes, scale, iterations=4) or best
    return Found(nominal, best, scale, screen, tuple(trace), tuple(first))


def advantage(one: Fitted, other: Fitted) -> float:
    """By how much a model is better than another: positive speaks for the first."""
    inflation = one.misfit.inflation if one.misfit.squares <= other.misfit.squares else other.misfit.inflation
    rows = max(2.0, one.misfit.effective_rows)
    dearer = (one.parameters - other.parameters) * float(np.log(rows))
    return (other.misfit.squares - one.misfit.squares) / inflation - dearer


def columns_of(problem: Problem, model: Fitted, scale: float) -> tuple[dict[tuple[Key, int], Floats], Floats]:
    """The columns of a model's own parameters: by parameter (whitened), and as a matrix in units of the noise."""
    of, columns = design(problem, model.causes)
    seen = problem.view.seen
    return {one: columns[..., i] for i, one in enumerate(of)}, columns[seen].reshape(
        2 * int(seen.sum()), len(of)
    ) / scale


def _best_addition(
    problem: Problem, base: Fitted, scored: list[Scored], known: dict[tuple[Key, int], Floats], scale: float
) -> Fitted | None:
    inflation, rows = base.misfit.inflation, max(2.0, base.misfit.effective_rows)
    ranked = sorted(scored, key=lambda s: -(s.gain / inflation - len(s.start) * np.log(rows)))
    trials = []
    for one in ranked[:TRIED]:
        trial = fit(problem, with_cause(base.causes, one), scale, iterations=4, known=known)
        if trial is not None:
            trials.append(trial)
    return best_of(trials)


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
    for key in list(model.causes)[:-1]:
        if key not in best.causes:
            continue
        rest = {k: v for k, v in best.causes.items() if k != key}
        without = fit(problem, rest, scale, iterations=3)
        if without is None:
            continue
        if advantage(without, best) > 0.0:
            trace.append(f"- {key[0]}@{key[1]}: {_told(without)}")
            best = without
            continue
        known, taken = columns_of(problem, without, scale)
        scored = screen.scores(without.residual, taken, list(rest), scale)[:3]
        trials = [
            fit(problem, with_cause(without.causes, one), scale, iterations=3, known=known)
            for one in scored
            if one.key != key
        ]
        other = best_of([trial for trial in trials if trial is not None])
        if other is not None and advantage(other, best) > 0.0:
            trace.append(f"{key[0]}@{key[1]} exchanged: {_told(other)}")
            best = fit(problem, other.causes, scale) or other
    return best


def held_out_squares(problem: Problem, model: Fitted, scale: float) -> float:
    """Squares on segments of time, each predicted with parameters that were fitted (one linear step) to the others."""
    if not model.causes:
        return model.misfit.squares
    of, columns = design(problem, model.causes)
    columns = columns / scale
    seen, frames = problem.view.seen, len(columns)
    matrix, residual = columns[seen].reshape(2 * int(seen.sum()), len(of)), model.residual[seen].reshape(-1)
    row_frame = np.repeat(np.nonzero(seen)[0], 2)
    normal, gradient = matrix.T @ matrix + 1e-6 * np.eye(len(of)), matrix.T @ residual
    total = 0.0
    for segment in range(SEGMENTS):
        out = (row_frame * SEGMENTS) // frames == segment
        if not out.any():
            continue
        m, r = matrix[out], residual[out]
        step = np.linalg.lstsq(normal - m.T @ m, gradient - m.T @ r, rcond=1e-10)[0]
        total += float(((r - m @ step) ** 2).sum())
    return total


def _told(model: Fitted) -> str:
    return (
        f"rms {np.sqrt(model.misfit.squares / model.misfit.rows):.3f}, correlation {model.misfit.correlation:.2f}, "
        + ", ".join(
            f"{e}@{at} {tuple(round(v, 6) for v in values)}" for (e, at), values in model.causes.items()
        )
    )
