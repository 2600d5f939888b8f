"""The first screening: the gain of each hypothesis, by one linear step on columns that are computed once.

With the residuals r and the columns Q of the causes that a model has projected out, a hypothesis with the
columns C lowers the squares by `2 aᵀCᵀr − aᵀCᵀC a` at its best amplitude a within its bounds. A limit has
no derivative before it is reached, so it is tried at several sizes: the mildest first, and tighter ones if
that one shows an effect.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from mirror_posture.arrays import Floats, Mask

from .effects import Causes, Hypothesis, Key
from .problem import Problem

RIDGE = 1e-9
LIMIT_AMPLITUDE = (0.3, 1.6)
"""How much more or less than at the size tried a limit may change the prediction, to be counted."""
TOLD_DEVIATIONS = 3.0
"""The mildest limit must be significant by this many standard deviations before tighter ones are simulated."""
MOST_PLACES, MOST_SCANNED = 3, 40_000
"""Joints whose tighter limits are simulated: those with the largest gain; and the total number of time
steps for all of them."""
BLOCKS = 10
"""Parts of the time whose sums are kept apart."""


@dataclass(frozen=True)
class Scored:
    """A hypothesis, its reduction of the squares, and the start of its fit."""

    key: Key
    gain: float
    start: tuple[float, ...]


@dataclass(frozen=True, eq=False)
class Free:
    """Products of all columns with those of the causes taken projected out, in units of the noise; and their squares before."""

    normal: Floats
    whole: Floats

    @property
    def squares(self) -> Floats:
        """Of each column."""
        return np.maximum(np.diag(self.normal), 0.0)


class Screen:
    """All hypotheses' columns at the nominal model."""

    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        smooth = [h for h in problem.hypotheses.values() if not h.effect.is_limit]
        of, self._columns = problem.columns({}, [h.key for h in smooth], central=False)
        self.slots: dict[Key, list[int]] = {}
        for column, (key, _) in enumerate(of):
            self.slots.setdefault(key, []).append(column)
        self.limits: list[tuple[Hypothesis, tuple[float, ...], int]] = []
        self._counted: Mask | None = None
        self._matrix, self._blocks = np.zeros((0, 0)), np.zeros((BLOCKS, 0, 0))
        # A limit acts wherever a tighter one acts, in the same direction: if the mildest one shows no effect,
        # none does.
        limits = [h for h in problem.hypotheses.values() if h.effect.is_limit]
        self._try_limits([(h, h.starts[-1]) for h in limits])

    def _try_limits(self, sizes: list[tuple[Hypothesis, tuple[float, ...]]]) -> None:
        # A body that its servo cannot hold falls far: nothing of that is linear.
        changes = self.problem.large_changes([{h.key: start} for h, start in sizes])
        kept = [(size, change) for size, change in zip(sizes, changes, strict=True) if change is not None]
        first = self._columns.shape[-1]
        self.limits += [(h, start, first + i) for i, ((h, start), _) in enumerate(kept)]
        self._columns = np.concatenate([self._columns, *(change[..., None] for _, change in kept)], axis=-1)

    @property
    def matrix(self) -> Floats:
        """(rows, P): the columns of the images that count."""
        seen, count = self.problem.view.seen, self._columns.shape[-1]
        if self._counted is not seen:
            self._counted, self._matrix, self._blocks = (
                seen,
                np.zeros((2 * int(seen.sum()), 0)),
                self._blocks[:, :0, :0],
            )
        old = self._matrix.shape[1]
        if old < count:
            fresh = self._columns[..., old:][seen].reshape(len(self._matrix), count - old)
            self._matrix = np.concatenate([self._matrix, fresh], axis=1)
            blocks = np.empty((BLOCKS, count, count))
            blocks[:, :old, :old] = self._blocks
            for b, rows in enumerate(self.blocks_of_rows()):
                blocks[b, :, old:] = self._matrix[rows].T @ fresh[rows]
                blocks[b, old:, :old] = blocks[b, :old, old:].T
            self._blocks = blocks
        return self._matrix

    def blocks_of_rows(self) -> list[slice]:
        """The rows of each part of the time."""
        seen = self.problem.view.seen
        block = np.repeat(np.nonzero(seen)[0], 2) * BLOCKS // len(seen)
        ends = np.searchsorted(block, np.arange(BLOCKS + 1))
        return [slice(int(begin), int(end)) for begin, end in pairwise(ends)]

    @property
    def by_block(self) -> Floats:
        """(BLOCKS, P, P): products of the columns, part by part of the time."""
        _ = self.matrix
        return self._blocks

    def free_of(self, taken: Floats, scale: float) -> Free:
        """The columns' products with the columns `taken` (rows, k) projected out."""
        return self._free(_basis(taken, len(self.matrix)), scale)

    def _free(self, q: Floats, scale: float) -> Free:
        normal = self.by_block.sum(axis=0) / scale**2
        whole = np.diag(normal).copy()
        shared = q.T @ self.matrix / scale
        return Free(normal - shared.T @ shared, whole)

    def scores(self, residual: Floats, taken: Floats, skip: Sequence[Key], scale: float) -> list[Scored]:
        """Hypotheses by gain, the best first: `residual` (F, markers, 2) and the columns `taken` (rows, P) in units of the noise."""
        r = residual[self.problem.view.seen].reshape(-1)
        q = _basis(taken, len(r))
        r = r - q @ (q.T @ r)
        free, by_residual = self._free(q, scale), self.matrix.T @ r / scale
        out = []
        for key, slots in self.slots.items():
            if key in skip:
                continue
            h, own = self.problem.hypotheses[key], np.ix_(slots, slots)
            gain, amplitude = _best(h, free.normal[own], by_residual[slots], free.whole[slots])
            if gain > 0.0:
                out.append(Scored(key, gain, h.clipped(amplitude * np.array(h.step))))
        tried = self._limits_scored(free, by_residual, skip)
        if tighter := self._tighter(free, by_residual, [*out, *tried], skip):
            self._try_limits(tighter)
            tried = self._limits_scored(self._free(q, scale), self.matrix.T @ r / scale, skip)
        return sorted([*out, *tried], key=lambda s: -s.gain)

    def _limits_scored(self, free: Free, by_residual: Floats, skip: Sequence[Key]) -> list[Scored]:
        """Each limit at the best of its sizes tried so far."""
        squares = free.squares
        best: dict[Key, Scored] = {}
        for h, start, column in self.limits:
            if h.key in skip or squares[column] < 1e-6 * max(1.0, free.whole[column]):
                continue
            a = float(np.clip(by_residual[column] / squares[column], *LIMIT_AMPLITUDE))
            gain = 2.0 * a * by_residual[column] - a * a * squares[column]
            if gain > 0.0 and (h.key not in best or gain > best[h.key].gain):
                best[h.key] = Scored(h.key, float(gain), start)
        return list(best.values())

    def _tighter(
        self, free: Free, by_residual: Floats, scored: Sequence[Scored], skip: Sequence[Key]
    ) -> list[tuple[Hypothesis, tuple[float, ...]]]:
        """Untried sizes of the limits whose mildest size shows an effect, at the joints with the largest
        gain."""
        clear, falling = [], self.problem.rollouts.falling_joint()
        tried = {(h.key, start) for h, start, _ in self.limits}
        for h, start, column in self.limits:
            power = free.squares[column]
            if h.key not in skip and start == h.starts[-1] and power >= 1e-6 * max(1.0, free.whole[column]):
                # Where a limb falls before the log begins a limit that hardly acts need not look like the one that it has.
                told = by_residual[column] > TOLD_DEVIATIONS * np.sqrt(power)
                if told or (h.effect.name == "torque_limit" and h.at == f"joint:{falling}"):
                    clear.append(h)
        gains: dict[str, float] = {}
        for one in scored:
            gains[one.key[1]] = max(gains.get(one.key[1], 0.0), one.gain)
        several = MOST_SCANNED // len(self.problem.rollouts.time_s)
        first = f"joint:{falling}"
        places = sorted({h.at for h in clear}, key=lambda at: (at != first, -gains.get(at, 0.0)))
        return [
            (h, start)
            for h in clear
            for start in h.starts
            if h.at in places[: min(MOST_PLACES, max(1, several))] and (h.key, start) not in tried
        ]


def _basis(taken: Floats, rows: int) -> Floats:
    """Orthonormal columns that span those taken."""
    return np.linalg.qr(taken)[0] if taken.shape[1] else np.zeros((rows, 0))


def _best(h: Hypothesis, normal: Floats, by_residual: Floats, whole: Floats) -> tuple[float, Floats]:
    """Gain and amplitudes (in steps) of a hypothesis; 0 where its columns are lost in those projected out."""
    if (np.diag(normal) < 1e-5 * np.maximum(whole, 1e-12)).all():
        return 0.0, np.zeros(len(whole))
    normal = normal + np.diag(1e-6 * np.maximum(whole, 1e-12) + RIDGE)
    amplitude = np.linalg.solve(normal, by_residual)
    step = np.array(h.step)
    amplitude = np.clip(amplitude, np.array(h.lower) / step, np.array(h.upper) / step)
    gain = float(2.0 * amplitude @ by_residual - amplitude @ normal @ amplitude)
    return gain, amplitude


def with_cause(causes: Causes, scored: Scored) -> Causes:
    """A model with one more cause, and the start of its fit."""
    return {**causes, scored.key: scored.start}
