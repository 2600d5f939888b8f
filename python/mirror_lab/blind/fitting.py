"""Hypotheses fitted to noise-free pixels: a first-order screening of all, and Gauss and Newton for the few."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .hypotheses import Hypothesis
from .kinematics import Change
from .linear import Linear
from .reference import Reference

Array = NDArray[np.float64]

GAUSS_NEWTON_STEPS = 5
NOTHING_LEFT = 1e-3
"""Steps that would reduce χ² by less are not taken: margins are of the order of 10."""


@dataclass
class Fit:
    """A fitted set of hypotheses: parameters, planes, χ² and BIC of the noise-free data."""

    hypotheses: list[Hypothesis]
    parameters: list[Array]
    planes: Array
    chi2: float
    bic: float


def _changed(hypotheses: Sequence[Hypothesis], parameters: Sequence[Array]) -> Change:
    change = Change()
    for h, p in zip(hypotheses, parameters, strict=True):
        h.apply(change, p)
    return change


def _columns(linear: Linear, hypotheses: list[Hypothesis], parameters: list[Array]) -> Array:
    """Jacobian (F, 2K, n) of the residual by all parameters, to first order in the body's motions."""
    columns = []
    for i, h in enumerate(hypotheses):
        for k, step in enumerate(h.steps):
            moved = [p.copy() for p in parameters]
            moved[i][k] += step
            columns.append(linear.column(_changed(hypotheses, moved), True) / step)
    return np.stack(columns, axis=-1)


def _without(basis: Array, columns: Array) -> Array:
    result: Array = columns - np.einsum(
        "fkp,fp...->fk...", basis, np.einsum("fkp,fk...->fp...", basis, columns)
    )
    return result


def fit(ref: Reference, hypotheses: list[Hypothesis], planes: Array, start: list[Array] | None = None) -> Fit:
    """Gauss–Newton over the hypotheses' parameters and all planes, with step halving."""
    parameters = start or [np.zeros(len(h.steps)) for h in hypotheses]
    change = _changed(hypotheses, parameters)
    points = ref.points(change)
    r = ref.residual(points, planes, change)
    chi2 = float(np.sum(r**2))
    for _ in range(GAUSS_NEWTON_STEPS):
        if chi2 < NOTHING_LEFT:
            break
        jacobian, basis = ref.plane_basis(points, planes, change, r)
        delta = np.zeros(0)
        target = r
        if hypotheses:
            columns = _columns(Linear(ref, change, planes), hypotheses, parameters)
            flat = _without(basis, columns).reshape(-1, columns.shape[-1])
            scale = np.maximum(np.linalg.norm(flat, axis=0), 1e-12)
            delta = -np.linalg.lstsq(flat / scale, _without(basis, r).ravel(), rcond=1e-9)[0] / scale
            target = r + columns @ delta
        normal = np.einsum("fki,fkj->fij", jacobian, jacobian) + 1e-12 * np.eye(3)
        move = -np.linalg.solve(normal, np.einsum("fki,fk->fi", jacobian, target)[..., None])[..., 0]
        share, improved = 1.0, False
        for _ in range(6):
            cut = (
                np.split(delta * share, np.cumsum([len(h.steps) for h in hypotheses])[:-1])
                if hypotheses
                else []
            )
            trial = [p + d for p, d in zip(parameters, cut, strict=True)]
            trial_change = _changed(hypotheses, trial)
            trial_points = ref.points(trial_change)
            trial_planes = planes + share * move
            trial_r = ref.residual(trial_points, trial_planes, trial_change)
            trial_chi2 = float(np.sum(trial_r**2))
            if trial_chi2 < chi2:
                improved = True
                break
            share /= 2
        if not improved:
            break
        gain = chi2 - trial_chi2
        parameters, planes, points, change, r, chi2 = (
            trial,
            trial_planes,
            trial_points,
            trial_change,
            trial_r,
            trial_chi2,
        )
        if gain < 0.05:
            break
    number = sum(len(h.steps) for h in hypotheses)
    return Fit(hypotheses, parameters, planes, chi2, chi2 + number * float(np.log(ref.size)))


def screen(
    ref: Reference, base: Fit, candidates: Sequence[Hypothesis], prior_std: Array | None = None
) -> tuple[list[tuple[float, Hypothesis]], float]:
    """To first order about `base`: BIC of base and each candidate, best first, and the χ² of the base alone; the base's own
    parameters are free, within normal priors about where they stand where `prior_std` (infinite: no prior) gives them."""
    change = _changed(base.hypotheses, base.parameters)
    linear = Linear(ref, change, base.planes)
    r = linear.residual
    _, basis = ref.plane_basis(linear.points, base.planes, change, r)
    left = _without(basis, r)
    own = None
    if base.hypotheses:
        columns = _without(basis, _columns(linear, base.hypotheses, base.parameters))
        flat = columns.reshape(-1, columns.shape[-1])
        if prior_std is None:
            own = np.linalg.qr(flat)[0]
        else:
            # A prior adds one row for each parameter, with residual 0; the basis spans the rows of the data only.
            # Parameters that neither data nor prior determine are left out.
            size = np.linalg.norm(flat, axis=0)
            said = np.isfinite(prior_std) | (size > 0.0)
            flat, size, held = flat[:, said], size[said], np.isfinite(prior_std[said])
            scale = np.where(held, prior_std[said], 1.0 / np.where(size > 0.0, size, 1.0))
            rows = np.diag(held.astype(float))
            own = np.linalg.qr(np.concatenate([flat * scale, rows]))[0][: len(flat)]
        before = left.ravel()
        left = (before - own @ (own.T @ before)).reshape(left.shape)
        whole_chi2 = float(before @ left.ravel())
        own = own.reshape(*r.shape, -1)
    else:
        whole_chi2 = float(np.sum(left**2))
    logarithm = float(np.log(ref.size))
    free = sum(len(x.steps) for x in base.hypotheses)
    out = []
    for h in candidates:
        # A body's hypothesis does not move the corners: only the markers' rows are used.
        part = slice(0, None) if h.optical else slice(2 * ref.count, None)
        columns = np.empty((len(r), r[:, part].shape[1], len(h.steps)))
        for k, step in enumerate(h.steps):
            p = np.zeros(len(h.steps))
            p[k] = step
            moved = change.copy()
            h.apply(moved, p)
            columns[..., k] = linear.column(moved, h.optical) / step
        # `left` is already free of the nuisances, so the inner products need the columns' nuisance part
        # only once.
        shared = np.swapaxes(basis[:, part], 1, 2) @ columns
        flat = columns.reshape(-1, columns.shape[-1])
        normal = flat.T @ flat - np.tensordot(shared, shared, ((0, 1), (0, 1)))
        pull = flat.T @ left[:, part].ravel()
        if own is not None:
            mixed = own[:, part].reshape(len(flat), -1).T @ flat
            normal = normal - mixed.T @ mixed
        scale = np.sqrt(np.maximum(np.diag(normal), 1e-24))
        scaled = normal / np.outer(scale, scale)
        pulled = pull / scale
        gain = float(pulled @ np.linalg.pinv(scaled, rcond=1e-9, hermitian=True) @ pulled)
        out.append((whole_chi2 - gain + (free + len(h.steps)) * logarithm, h))
    return sorted(out, key=lambda pair: pair[0]), whole_chi2
