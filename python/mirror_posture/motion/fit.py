"""Bounded Gauss-Newton (Levenberg-Marquardt) of a moving session's causes.

In steps p of the parameters (their usual sizes): minimise |r(p)|², r in units of the noise, by

    (JᵀJ + λ diag(JᵀJ) + I / 200²) δ = Jᵀ r,

J from central differences through the simulator; a step that leaves the bounds is cut there, one that does not lower the squares
is tried shorter.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from .effects import Causes, Key
from .problem import Problem
from .statistics import Misfit, misfit

Floats = npt.NDArray[np.float64]
Known = Mapping[tuple[Key, int], Floats]

PRIOR_STEPS = 200.0
SHORTENINGS = 4
SMALL_DECREASE = 0.5
"""Of the squares, in units of the noise's variance: less is no progress."""


@dataclass(frozen=True, eq=False)
class Fitted:
    """Causes with fitted parameters, what they leave (F, markers, 2) in units of the noise, and its misfit."""

    causes: Causes
    residual: Floats
    misfit: Misfit

    @property
    def parameters(self) -> int:
        """How many were fitted."""
        return sum(len(values) for values in self.causes.values())


def evaluated(problem: Problem, causes: Causes, scale: float) -> Fitted | None:
    """A model as it is; None where its simulation diverges."""
    (residual,) = problem.residuals([causes])
    if residual is None:
        return None
    residual = residual / scale
    return Fitted(causes, residual, misfit(residual, problem.view.seen))


def fit(
    problem: Problem,
    start: Causes,
    scale: float,
    *,
    iterations: int = 6,
    known: Known | None = None,
) -> Fitted | None:
    """Fits all parameters of the causes; `known` are columns (of one step, whitened) that need not be computed anew."""
    best = evaluated(problem, start, scale)
    if best is None or not start:
        return best
    damping = 1e-6
    for _ in range(iterations):
        of, columns = design(problem, best.causes, known)
        columns = columns / scale
        seen = problem.view.seen
        matrix, residual = (
            columns[seen].reshape(2 * int(seen.sum()), len(of)),
            best.residual[seen].reshape(-1),
        )
        normal, gradient = matrix.T @ matrix, matrix.T @ residual
        normal += np.eye(len(of)) / PRIOR_STEPS**2
        better = None
        for _ in range(SHORTENINGS):
            step = np.linalg.solve(normal + damping * np.diag(np.diag(normal)), gradient)
            trial = evaluated(problem, moved(problem, best.causes, of, step), scale)
            if trial is not None and trial.misfit.squares < best.misfit.squares:
                better = trial
                damping = max(1e-8, 0.1 * damping)
                break
            damping = max(1e-2, 10.0 * damping)
        if better is None:
            break
        gained = best.misfit.squares - better.misfit.squares
        best = better
        if gained < SMALL_DECREASE * max(1.0, best.misfit.squares / best.misfit.rows):
            break
    return best


def design(
    problem: Problem, causes: Causes, known: Known | None = None
) -> tuple[list[tuple[Key, int]], Floats]:
    """All columns of a model's parameters (F, markers, 2, P), those that are known taken over."""
    known = known or {}
    fresh = [key for key in causes if (key, 0) not in known]
    of, columns = problem.columns(causes, fresh)
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
