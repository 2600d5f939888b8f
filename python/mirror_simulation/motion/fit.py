"""Bounded Gauss-Newton (Levenberg-Marquardt) of a moving session's causes, several models side by side.

In steps p of the parameters: minimise |r(p)|², r in units of the noise, by

    (JᵀJ + λ diag(JᵀJ) + I / 200²) δ = Jᵀ r,

J from differences to one side through the simulator; a step that leaves the bounds is cut there, one that does not lower the squares
is tried shorter. What several models ask of the simulator goes to it together, so that all cores are at work.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from mirror_posture.arrays import Floats

from .effects import Causes, Key
from .problem import Problem
from .statistics import Misfit, misfit

Known = Mapping[tuple[Key, int], Floats]

PRIOR_STEPS = 200.0
SEGMENTS = 5
"""Parts of the time, each predicted with parameters from the others."""
SHORTENINGS = 4
SMALL_DECREASE = 0.5
"""Of the squares, in units of the noise's variance: less is no progress."""


@dataclass(frozen=True, eq=False)
class Fitted:
    """Causes with fitted parameters, the residuals (F, markers, 2) in units of the noise, and their misfit.

    `of` and `information` are the parameters and JᵀJ, in steps, of the last fit.
    """

    causes: Causes
    residual: Floats
    misfit: Misfit
    of: tuple[tuple[Key, int], ...] = ()
    information: Floats | None = None

    @property
    def parameters(self) -> int:
        """How many were fitted."""
        return sum(len(values) for values in self.causes.values())


def evaluated(problem: Problem, causes: Causes, scale: float) -> Fitted | None:
    """A model as it is; None where its simulation diverges."""
    return evaluated_all(problem, [causes], scale)[0]


def evaluated_all(problem: Problem, several: Sequence[Causes], scale: float) -> list[Fitted | None]:
    """Models as they are, simulated together; None where a simulation diverges."""
    seen = problem.view.seen
    return [
        None if r is None else Fitted(causes, r / scale, misfit(r / scale, seen))
        for causes, r in zip(several, problem.residuals(several), strict=True)
    ]


def fit(
    problem: Problem,
    start: Causes,
    scale: float,
    *,
    iterations: int = 6,
    known: Known | None = None,
) -> Fitted | None:
    """Fits all parameters of the causes; `known` are columns (of one step, whitened) that need not be
    computed again."""
    return fit_all(problem, [start], scale, iterations=iterations, known=known)[0]


@dataclass(eq=False)
class _Trial:
    best: Fitted
    damping: float = 1e-6
    going: bool = True


def fit_all(
    problem: Problem,
    starts: Sequence[Causes],
    scale: float,
    *,
    iterations: int = 6,
    known: Known | None = None,
    hopeless: Callable[[Fitted, Fitted], bool] | None = None,
    enough: float = SMALL_DECREASE,
) -> list[Fitted | None]:
    """Fits several models side by side.

    `hopeless(one, best)` decides after each step whether the first can be given up, compared with the best
    of all so far; a step that lowers the squares by less than `enough` is the last.
    """
    first = evaluated_all(problem, starts, scale)
    trials = [None if f is None else _Trial(f, going=bool(f.causes)) for f in first]
    for _ in range(iterations):
        going = [trial for trial in trials if trial is not None and trial.going]
        if not going:
            break
        _ahead(problem, [trial.best.causes for trial in going], known)
        systems = [_normal(problem, trial, scale, known) for trial in going]
        waiting = list(zip(going, systems, strict=True))
        before = [trial.best for trial in going]
        for _ in range(SHORTENINGS):
            if not waiting:
                break
            tried = [_step(problem, trial, *system) for trial, system in waiting]
            again = []
            for (trial, system), new in zip(waiting, evaluated_all(problem, tried, scale), strict=True):
                if new is not None and new.misfit.squares < trial.best.misfit.squares:
                    trial.damping = max(1e-8, 0.1 * trial.damping)
                    trial.best = replace(new, of=trial.best.of, information=trial.best.information)
                else:
                    trial.damping = max(1e-2, 10.0 * trial.damping)
                    again.append((trial, system))
            waiting = again
        for trial, old in zip(going, before, strict=True):
            new_misfit = trial.best.misfit
            gained = old.misfit.squares - new_misfit.squares
            trial.going = gained >= enough * max(1.0, new_misfit.squares / new_misfit.rows)
        if hopeless is not None:
            best = min((t.best for t in trials if t is not None), key=lambda f: f.misfit.squares)
            for trial in going:
                trial.going = trial.going and not hopeless(trial.best, best)
    return [None if trial is None else trial.best for trial in trials]


def _ahead(problem: Problem, several: Sequence[Causes], known: Known | None) -> None:
    """Simulates together what the columns of several models need."""
    problem.ahead(
        [(causes, [key for key in causes if (key, 0) not in (known or {})]) for causes in several],
        central=False,
    )


def _normal(problem: Problem, trial: _Trial, scale: float, known: Known | None) -> tuple[Floats, Floats]:
    of, columns = design(problem, trial.best.causes, known, central=False)
    seen = problem.view.seen
    matrix = columns[seen].reshape(2 * int(seen.sum()), len(of)) / scale
    normal = matrix.T @ matrix
    trial.best = replace(trial.best, of=tuple(of), information=normal)
    return normal + np.eye(len(of)) / PRIOR_STEPS**2, matrix.T @ trial.best.residual[seen].reshape(-1)


def _step(problem: Problem, trial: _Trial, normal: Floats, gradient: Floats) -> Causes:
    step = np.asarray(
        np.linalg.solve(normal + trial.damping * np.diag(np.diag(normal)), gradient), dtype=np.float64
    )
    return moved(problem, trial.best.causes, trial.best.of, step)


def design(
    problem: Problem, causes: Causes, known: Known | None = None, *, central: bool = True
) -> tuple[list[tuple[Key, int]], Floats]:
    """All columns of a model's parameters (F, markers, 2, P), those that are known taken over."""
    known = known or {}
    fresh = [key for key in causes if (key, 0) not in known]
    of, columns = problem.columns(causes, fresh, central=central)
    for key in causes:
        if (key, 0) in known:
            for k in range(len(problem.hypotheses[key].step)):
                of.append((key, k))
                columns = np.concatenate([columns, known[(key, k)][..., None]], axis=-1)
    return of, columns


def moved(problem: Problem, causes: Causes, of: Sequence[tuple[Key, int]], step: Floats) -> Causes:
    """Causes after a step, in steps of their parameters, within their bounds."""
    out = {key: list(values) for key, values in causes.items()}
    for (key, k), share in zip(of, step, strict=True):
        out[key][k] += share * problem.hypotheses[key].step[k]
    return {key: problem.hypotheses[key].clipped(np.array(values)) for key, values in out.items()}


def held_out_squares(problem: Problem, model: Fitted, scale: float) -> float:
    """Squares on segments of time, each predicted with parameters that were fitted (one linear step) to the others."""
    if not model.causes:
        return model.misfit.squares
    of, columns = design(problem, model.causes, central=False)
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
