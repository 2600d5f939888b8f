"""What a motion would have shown, and how firmly its causes stand: both by the search's own criterion, on linear columns.

In units of the noise: c a hypothesis' column with those of the causes found projected out, φ what squares count less, T what the
criterion asks (its price, its margin, and log rows for each parameter). A size s shows with probability 95 % where
`s |c| / √φ ≥ √T + 1.645`, and moves the markers by a tenth of the noise.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from .effects import Hypothesis, Key
from .fit import Fitted, design
from .problem import Problem
from .search import LEAST_SHIFT, MARGIN, Found, columns_of

Floats = npt.NDArray[np.float64]

ONE_SIDED_95 = 1.645
LOST = 1e-5
"""Share of a column's power below which it is lost in those projected out: any size would be hidden."""
BLOCKS = 10
RESAMPLES = 40
RIDGE = 1e-6
AMPLITUDE = (0.3, 1.6)
"""How much more or less than in the whole motion a cause may be in a resample, to be counted as the same."""


def limits(problem: Problem, found: Found) -> list[dict[str, Any]]:
    """The largest size of each effect at each place that this motion would have hidden, 95 %, the causes found free beside it.

    One entry a hypothesis; a parameter's size is None where any would be hidden. The other parameters of the same effect are
    free. Limits of torque and speed, which act only where they are reached, have no such size and are left out.
    """
    scale, misfit = found.noise_scale, found.best.misfit
    _, taken = columns_of(problem, found.best, scale)
    columns = found.screen.matrix / scale
    whole = np.einsum("ij,ij->j", columns, columns)
    free = _without(columns, taken)
    price = 2.0 * np.log(len(problem.hypotheses)) + MARGIN
    out = []
    for key, slots in found.screen.slots.items():
        if key in found.best.causes:
            continue
        hypothesis = problem.hypotheses[key]
        asked = price + len(slots) * np.log(max(2.0, misfit.effective_rows))
        power = (np.sqrt(asked) + ONE_SIDED_95) ** 2 * misfit.inflation
        power = max(float(power), LEAST_SHIFT**2 * misfit.rows)
        sizes: dict[str, float | None] = {}
        for place, slot in enumerate(slots):
            others = [other for other in slots if other != slot]
            (column,) = _without(free[:, [slot]], free[:, others]).T
            left = float(column @ column)
            name = hypothesis.effect.parameters[place]
            hidden = left <= LOST * whole[slot] or whole[slot] <= 0.0
            sizes[name] = None if hidden else float(np.sqrt(power / left) * hypothesis.step[place])
        out.append({"effect": key[0], "at": key[1], "parameters": sizes})
    return out


def stability(problem: Problem, found: Found, without: Mapping[Key, Fitted | None]) -> dict[Key, float]:
    """By cause: the share of resamples of the time, in tenths, in which no other hypothesis stands in its place.

    `without` are the models without each cause, the others as they are. A rival has its best amplitude in each resample, linear
    at the nominal model; the cause has what it does as it was fitted, more or less of it.
    """
    random = np.random.default_rng(0)
    weights = random.multinomial(BLOCKS, np.full(BLOCKS, 1.0 / BLOCKS), size=RESAMPLES).astype(float)
    return {
        key: _share(problem, found, key, model, weights)
        for key, model in without.items()
        if model is not None
    }


def _share(problem: Problem, found: Found, key: Key, model: Fitted, weights: Floats) -> float:
    scale, seen = found.noise_scale, problem.view.seen
    inflation, rows = found.best.misfit.inflation, max(2.0, found.best.misfit.effective_rows)
    of, others = design(problem, {k: v for k, v in model.causes.items() if k != key})
    residual = model.residual[seen].reshape(-1)
    does = residual - found.best.residual[seen].reshape(-1)
    taken = others[seen].reshape(len(residual), len(of)) / scale
    limits_at = {column for _, _, column in found.screen.limits}
    table = np.column_stack([taken, does, found.screen.matrix / scale])
    block = np.repeat(np.nonzero(seen)[0], 2) * BLOCKS // len(seen)
    # Resampling adds up each tenth's own sums.
    normals = np.stack([table[block == b].T @ table[block == b] for b in range(BLOCKS)])
    pulls = np.stack([table[block == b].T @ residual[block == b] for b in range(BLOCKS)])
    count, first = len(of), len(of) + 1
    same = 0
    for weight in weights:
        normal, pull = np.tensordot(weight, normals, axes=1), np.tensordot(weight, pulls, axes=1)
        whole = np.diag(normal).copy()
        if count:
            inner = normal[:count, :count] + RIDGE * np.diag(np.maximum(whole[:count], 1e-12))
            solved = np.linalg.solve(inner, np.column_stack([normal[:count], pull[:count]]))
            normal, pull = (
                normal - normal[:, :count] @ solved[:, :-1],
                pull - normal[:, :count] @ solved[:, -1],
            )
        own = _gain_of(normal[count, count], pull[count]) / inflation
        own -= len(problem.hypotheses[key].step) * np.log(rows)
        best = -np.inf
        for other, slots in found.screen.slots.items():
            if other == key or other in model.causes:
                continue
            at = np.array([first + slot for slot in slots])
            gain = _best_gain(problem.hypotheses[other], normal[np.ix_(at, at)], pull[at], whole[at])
            best = max(best, gain / inflation - len(slots) * np.log(rows))
        for hypothesis, _, column in found.screen.limits:
            if hypothesis.key != key and hypothesis.key not in model.causes and column in limits_at:
                at_one = first + column
                gain = _gain_of(normal[at_one, at_one], pull[at_one])
                best = max(best, gain / inflation - len(hypothesis.step) * np.log(rows))
        same += bool(own > max(best, 0.0))
    return same / len(weights)


def _gain_of(power: float, pull: float) -> float:
    """By how much one column lowers the squares, at an amplitude near the one it was made with."""
    if power <= 0.0:
        return 0.0
    amplitude = float(np.clip(pull / power, *AMPLITUDE))
    return float(2.0 * amplitude * pull - amplitude * amplitude * power)


def _best_gain(hypothesis: Hypothesis, normal: Floats, pull: Floats, whole: Floats) -> float:
    if (np.diag(normal) < LOST * np.maximum(whole, 1e-12)).all():
        return 0.0
    normal = normal + RIDGE * np.diag(np.maximum(whole, 1e-12))
    step = np.array(hypothesis.step)
    amplitude = np.linalg.solve(normal, pull)
    amplitude = np.clip(amplitude, np.array(hypothesis.lower) / step, np.array(hypothesis.upper) / step)
    return float(2.0 * amplitude @ pull - amplitude @ normal @ amplitude)


def _without(columns: Floats, taken: Floats) -> Floats:
    """Columns with others projected out."""
    if not taken.shape[1]:
        return columns
    q, _ = np.linalg.qr(taken)
    out: Floats = columns - q @ (q.T @ columns)
    return out
