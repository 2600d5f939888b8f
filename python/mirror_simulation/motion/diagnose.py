"""Diagnoses a session in motion: causes in the simulator's servos, joints, mounts and clock, written as
`diagnosis.json`."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from mirror_posture.arrays import Floats, Mask
from mirror_posture.diagnosis.result import Diagnosis
from mirror_posture.session import Session, as_session
from mirror_posture.short_repr import ShortRepr

from .alternatives import Rivals, rivals_of
from .beginning import leave_out_beginning
from .effects import Key
from .fit import design, evaluated, fit
from .problem import Problem
from .report import document
from .search import AT_NOISE, Found, search
from .springs import stiffening_columns

MOST_CAUSES = 4
FALSE_DEVIATIONS = 5.0
FEW_FALSE = 0.005
"""Of the images: so few bend the parameters, not the choice of causes."""
MOST_FALSE = 0.05
"""Of the images: where more lie far off, the model is wrong, not they."""


EXACT = 0.002


@dataclass(frozen=True, eq=False, repr=False)
class MotionDiagnosis(ShortRepr):
    """A diagnosis with its models: for plots, and for predicting another motion."""

    diagnosis: Diagnosis
    problem: Problem
    found: Found


def diagnose_motion(
    session: Session | str | os.PathLike[str],
    *,
    model: str | os.PathLike[str] | None = None,
    most_causes: int = MOST_CAUSES,
    progress: Callable[[str], None] | None = None,
) -> MotionDiagnosis:
    """Diagnoses a motion: where the simulator is wrong, which effects cause it, and how far the gap
    shrinks.

    `model` is the user's MJCF, executed by MuJoCo with the log's commands. It needs a position servo at every joint that moves what
    is visible; the session's URDF (None) has none, and how it follows its log is unknown.

    Raises:
        MirrorPostureError: a session that does not move or is too short, or without camera and board; a model that MuJoCo cannot load,
            or that lacks a joint or its position servo.
    """
    loaded = as_session(session)
    problem = Problem(loaded, None if model is None else Path(model))
    found = search(problem, most_causes, progress)
    before = problem.view.false
    false = _false(problem, found)
    if (false != before).any():
        # One false image bends a fit, and what the first screening took for false may be the effect of a
        # cause.
        problem.leave_out(false)
        changed = int((false != before).sum())
        few = changed < FEW_FALSE * problem.view.seen.sum()
        found = (
            _refitted(problem, found)
            if few
            else search(problem, most_causes, progress, start=found.best.causes)
        )
    found, rivals = _likeliest(problem, found)
    tree = document(problem, found, rivals, covariance(problem, found))
    return MotionDiagnosis(Diagnosis.from_document(tree), problem, found)


def _likeliest(problem: Problem, found: Found) -> tuple[Found, dict[Key, Rivals]]:
    """The causes with their alternatives. If an alternative is more probable, it becomes the cause, unless
    something is left unexplained."""
    been = {frozenset(found.best.causes)}
    while True:
        rivals = {key: rivals_of(problem, found, key) for key in found.best.causes}
        better = next((one.better for one in rivals.values() if one.better is not None), None)
        misfit = found.best.misfit
        left = misfit.squares > AT_NOISE**2 * misfit.rows
        if better is None or left or frozenset(better.causes) in been:
            return found, rivals
        been.add(frozenset(better.causes))
        problem.rollouts.refine(better.causes)
        best = fit(problem, better.causes, found.noise_scale, iterations=4) or better
        trace = (*found.trace, "likelier: " + ", ".join(f"{e}@{at}" for e, at in best.causes))
        found = replace(found, best=best, trace=trace)


def covariance(problem: Problem, found: Found) -> tuple[list[tuple[Key, int]], Floats, Floats]:
    """Covariance of the fitted parameters, in steps: which they are, their covariance, and their columns in
    units of the noise.

    `(JᵀJ)⁻¹`, times the ratio of the residuals to white noise; plus the effect of a nonlinear spring on all
    that was fitted; plus EXACT of each parameter, because no simulator and no law is more accurate than
    that.
    """
    of, columns = design(problem, found.best.causes)
    columns = columns / found.noise_scale
    seen = problem.view.seen
    matrix = columns[seen].reshape(2 * int(seen.sum()), len(of))
    normal, inflation = matrix.T @ matrix + 1e-9 * np.eye(len(of)), found.best.misfit.inflation
    out = np.linalg.pinv(normal) * inflation
    # How far the usual stiffening of a spring moves the parameters that were fitted without it.
    springs = (
        stiffening_columns(problem, found.best.causes)[seen].reshape(len(matrix), -1) / found.noise_scale
    )
    shift = np.linalg.pinv(normal) @ (matrix.T @ springs)
    return of, out + shift @ shift.T + np.diag((EXACT * _sizes(problem, found, of)) ** 2), columns


def _sizes(problem: Problem, found: Found, of: list[tuple[Key, int]]) -> Floats:
    """How large the fitted parameters are, in steps; a gain's is that of the whole gain."""
    return np.array(
        [
            (abs(found.best.causes[key][k]) + (1.0 if key[0] == "servo_gain" else 0.0))
            / problem.hypotheses[key].step[k]
            for key, k in of
        ]
    )


@dataclass(frozen=True)
class Unseen:
    """Another motion of the same robot, of which nothing was fitted but its own mirrors: RMS distances, px
    and m."""

    before_px: float
    after_px: float
    noise_floor_px: float
    before_m: float
    after_m: float


def unseen_gap(
    done: MotionDiagnosis,
    session: Session | str | os.PathLike[str],
    model: str | os.PathLike[str] | None = None,
) -> Unseen:
    """The gap of another motion with the model as it is and with the causes found. Raises `MirrorPostureError` as a diagnosis."""
    other = Problem(as_session(session), None if model is None else Path(model))
    causes = done.found.best.causes
    other.rollouts.refine(causes)
    leave_out_beginning(other, causes)
    other.leave_out_false(causes)
    before, after = other.rms({}), other.rms(causes)
    scale = done.found.noise_scale * done.problem.view.noise_px / other.view.noise_px
    return Unseen(before[0], after[0], other.floor_px(scale), before[1], after[1])


def with_checked(
    done: MotionDiagnosis, sessions: Sequence[Session], model: str | os.PathLike[str] | None = None
) -> MotionDiagnosis:
    """The diagnosis with further motions in `gap.checked`, predicted with nothing of them fitted but their own mirrors."""
    if not sessions:
        return done
    tree = dict(done.diagnosis.document)
    checked = []
    for session in sessions:
        gap = unseen_gap(done, session, model)
        checked.append({"session": session.folder.name, "before_m": gap.before_m, "after_m": gap.after_m})
    tree["gap"] = {**tree["gap"], "checked": checked}
    return replace(done, diagnosis=Diagnosis.from_document(tree))


def _refitted(problem: Problem, found: Found) -> Found:
    """The model found, fitted to the images that count now."""
    best = fit(problem, found.best.causes, found.noise_scale)
    nominal = evaluated(problem, {}, found.noise_scale)
    return found if best is None or nominal is None else replace(found, best=best, nominal=nominal)


def _false(problem: Problem, found: Found) -> Mask:
    """(F, markers): of all images shown, those that lie far off the model found."""
    best = found.best
    usual = max(1.0, float(np.sqrt(best.misfit.squares / best.misfit.rows)))
    before = problem.view.false
    false = np.zeros_like(before)
    # The mirror's error is shared by a picture: the farthest image is left out first, and the others are judged without it.
    for _ in range(false.shape[1]):
        problem.leave_out(false)
        (residual,) = problem.residuals([best.causes])
        if residual is None:
            problem.leave_out(before)
            return before
        far = np.abs(residual).max(axis=2)
        more = (far == far.max(axis=1, keepdims=True)) & (far > FALSE_DEVIATIONS * usual * found.noise_scale)
        if not more.any():
            break
        false |= more
    problem.leave_out(before)
    return false if false.sum() < MOST_FALSE * problem.view.seen.sum() else before
