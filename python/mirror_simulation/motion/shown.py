"""Limits of detection of a motion, and the stability of its causes: both by the search's own criterion, on
linear columns.

In units of the noise: c a hypothesis' column with those of the causes found projected out, φ the factor by
which squares are reduced, T the criterion (its price, its margin, and log rows for each parameter). A size
s is detected with probability 95 % where `s |c| / √φ ≥ √T + 1.645`, if it moves the markers by a tenth of
the noise.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from mirror_posture.arrays import Floats

from .effects import Hypothesis, Key
from .fit import Fitted, design
from .problem import Problem
from .screen import BLOCKS
from .search import LEAST_SHIFT, MARGIN, Found, columns_of

ONE_SIDED_95 = 1.645
LOST = 1e-5
"""Share of a column's power below which it is lost in those projected out: any size would be hidden."""
RESAMPLES = 40
RIDGE = 1e-6
AMPLITUDE = (0.3, 1.6)
"""How much more or less than in the whole motion a cause may be in a resample, to be counted as the same."""


def limits(problem: Problem, found: Found) -> list[dict[str, Any]]:
    """Limits of detection: the largest size of each effect at each place that this motion would have
    hidden, 95 %, with the causes found free.

    One entry for each hypothesis; a parameter's size is None where any would be hidden. The other
    parameters of the same effect are free. Limits of torque and speed, which act only where they are
    reached, have no such size and are left out.
    """
    scale, misfit = found.noise_scale, found.best.misfit
    _, taken = columns_of(problem, found.best, scale)
    free = found.screen.free_of(taken, scale)
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
            left, whole = _left(free.normal, slot, [o for o in slots if o != slot]), free.whole[slot]
            name = hypothesis.effect.parameters[place]
            hidden = left <= LOST * whole or whole <= 0.0
            sizes[name] = None if hidden else float(np.sqrt(power / left) * hypothesis.step[place])
        out.append({"effect": key[0], "at": key[1], "parameters": sizes})
    return out


def bagged(share: float | None) -> float:
    """The probability that a share of the resamples represents, half a resample on either side (Jeffreys);
    1 where none is computed, or all agree.

    No probability exceeds the stability. Source: Huggins and Miller, "Robust inference and model selection
    using bagged posteriors" (2020).
    """
    if share is None or share >= 1.0:
        return 1.0
    return (RESAMPLES * share + 0.5) / (RESAMPLES + 1.0)


def stability(problem: Problem, found: Found, without: Mapping[Key, Fitted | None]) -> dict[Key, float]:
    """For each cause: the share of resamples of the time, in tenths, in which no other hypothesis replaces
    it.

    `without` are the models without each cause, the others unchanged. An alternative has its best amplitude
    in each resample, linear at the nominal model; the cause has its fitted effect, scaled.
    """
    random = np.random.default_rng(0)
    weights = random.multinomial(BLOCKS, np.full(BLOCKS, 1.0 / BLOCKS), size=RESAMPLES).astype(float)
    return {
        key: _share(problem, found, key, model, weights)
        for key, model in without.items()
        if model is not None
    }


def _share(problem: Problem, found: Found, key: Key, model: Fitted, weights: Floats) -> float:
    scale, seen, screen = found.noise_scale, problem.view.seen, found.screen
    inflation, rows = found.best.misfit.inflation, max(2.0, found.best.misfit.effective_rows)
    of, others = design(problem, {k: v for k, v in model.causes.items() if k != key})
    residual = model.residual[seen].reshape(-1)
    does = residual - found.best.residual[seen].reshape(-1)
    extra = np.column_stack([others[seen].reshape(len(residual), len(of)) / scale, does])
    count, first = len(of), len(of) + 1
    # Resampling adds up each tenth's own sums.
    size = first + screen.matrix.shape[1]
    normals, pulls = np.empty((BLOCKS, size, size)), np.empty((BLOCKS, size))
    for b, part in enumerate(screen.blocks_of_rows()):
        columns = screen.matrix[part]
        normals[b, first:, first:] = screen.by_block[b] / scale**2
        normals[b, :first, :first] = extra[part].T @ extra[part]
        normals[b, :first, first:] = extra[part].T @ columns / scale
        normals[b, first:, :first] = normals[b, :first, first:].T
        pulls[b] = np.concatenate([extra[part].T @ residual[part], columns.T @ residual[part] / scale])
    normal, pull = np.tensordot(weights, normals, axes=1), np.tensordot(weights, pulls, axes=1)
    whole = np.diagonal(normal, axis1=1, axis2=2).copy()
    if count:
        inner = normal[:, :count, :count] + RIDGE * np.eye(count) * np.maximum(whole[:, None, :count], 1e-12)
        solved = np.linalg.solve(inner, np.concatenate([normal[:, :count], pull[:, :count, None]], axis=2))
        across = normal[:, :, :count]
        pull = pull - (across @ solved[..., -1:])[..., 0]
        normal = normal - across @ solved[..., :-1]
    price = np.log(rows)
    own = _gains_of(normal[:, count, count], pull[:, count]) / inflation
    own -= len(problem.hypotheses[key].step) * price
    best = np.zeros(len(weights))
    for other, slots in screen.slots.items():
        if other == key or other in model.causes:
            continue
        at = np.array([first + slot for slot in slots])
        gain = _best_gains(problem.hypotheses[other], normal[:, at[:, None], at], pull[:, at], whole[:, at])
        best = np.maximum(best, gain / inflation - len(slots) * price)
    for hypothesis, _, column in screen.limits:
        if hypothesis.key != key and hypothesis.key not in model.causes:
            at_one = first + column
            gain = _gains_of(normal[:, at_one, at_one], pull[:, at_one])
            best = np.maximum(best, gain / inflation - len(hypothesis.step) * price)
    return float((own > best).mean())


def _gains_of(power: Floats, pull: Floats) -> Floats:
    """By how much one column lowers the squares in each resample, at an amplitude near the one it was made with."""
    amplitude = np.clip(pull / np.maximum(power, 1e-300), *AMPLITUDE)
    return np.where(power > 0.0, 2.0 * amplitude * pull - amplitude * amplitude * power, 0.0)


def _best_gains(hypothesis: Hypothesis, normal: Floats, pull: Floats, whole: Floats) -> Floats:
    """The same of a hypothesis at its best amplitude: (R, p, p), (R, p), (R, p) to (R,)."""
    diagonal = np.diagonal(normal, axis1=1, axis2=2)
    lost = (diagonal < LOST * np.maximum(whole, 1e-12)).all(axis=1)
    normal = normal + RIDGE * np.eye(pull.shape[1]) * np.maximum(whole[:, None], 1e-12)
    step = np.array(hypothesis.step)
    amplitude = np.linalg.solve(normal, pull[..., None])[..., 0]
    amplitude = np.clip(amplitude, np.array(hypothesis.lower) / step, np.array(hypothesis.upper) / step)
    gain = 2.0 * (amplitude * pull).sum(axis=1) - np.einsum("ri,rij,rj->r", amplitude, normal, amplitude)
    return np.where(lost, 0.0, gain)


def _left(normal: Floats, slot: int, others: list[int]) -> float:
    """Squares of a column with others projected out, from their products."""
    if not others:
        return float(normal[slot, slot])
    across = normal[others, slot]
    inner = normal[np.ix_(others, others)]
    return float(normal[slot, slot] - across @ np.linalg.lstsq(inner, across, rcond=1e-10)[0])
