"""A moving session diagnosed: causes in the simulator's servos, joints, mounts and clock, as `diagnosis.json` tells them."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import numpy.typing as npt

from ..diagnosis.result import Diagnosis
from ..session import Session, as_session
from ..short_repr import ShortRepr
from .alternatives import rivals_of
from .effects import Key
from .fit import Fitted, design
from .problem import Problem
from .report import document
from .search import Found, search

Floats = npt.NDArray[np.float64]

MOST_CAUSES = 4
FALSE_DEVIATIONS = 5.0
LEAST_FALSE = 1
"""One false image bends a fit; the search is taken up again without it."""


@dataclass(frozen=True, eq=False, repr=False)
class MotionDiagnosis(ShortRepr):
    """A diagnosis with what it was made of: for pictures, and for predicting another motion."""

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
    """Where the simulator is wrong about a motion, by which effects, and how far the gap shrinks.

    `model` is the user's MJCF or URDF, executed by MuJoCo with the log's commands; without it the session's URDF on ideal servos.

    Raises:
        MirrorPostureError: a session that does not move or is too short, or without camera and board; a model that MuJoCo
            cannot load or that lacks a joint.
    """
    loaded = as_session(session)
    problem = Problem(loaded, None if model is None else Path(model))
    found = search(problem, most_causes, progress)
    residual = problem.view.seen[..., None] * found.best.residual
    false = np.abs(residual).max(axis=2) > FALSE_DEVIATIONS * max(1.0, _rms(found.best))
    if LEAST_FALSE <= int(false.sum()) < 0.05 * problem.view.seen.sum():
        problem.leave_out(false)
        found = search(problem, most_causes, progress, start=found.best.causes)
    rivals = {key: rivals_of(problem, found, key) for key in found.best.causes}
    tree = document(problem, found, rivals, covariance(problem, found))
    return MotionDiagnosis(Diagnosis.from_document(tree), problem, found)


def covariance(problem: Problem, found: Found) -> tuple[list[tuple[Key, int]], Floats, Floats]:
    """Of the fitted parameters, in steps: which they are, their covariance, and their columns in units of the noise.

    `(JᵀJ)⁻¹`, times what the residuals exceed white noise by.
    """
    of, columns = design(problem, found.best.causes)
    columns = columns / found.noise_scale
    seen = problem.view.seen
    matrix = columns[seen].reshape(2 * int(seen.sum()), len(of))
    normal = matrix.T @ matrix + 1e-9 * np.eye(len(of))
    return of, np.linalg.pinv(normal) * found.best.misfit.inflation, columns


@dataclass(frozen=True)
class Unseen:
    """Another motion of the same robot, of which nothing was fitted but its own mirrors: RMS distances, px and m."""

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
    before, after = other.rms({}), other.rms(causes)
    other.rollouts.refine(causes)
    after = other.rms(causes)
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


def _rms(fitted: Fitted) -> float:
    return float(np.sqrt(fitted.misfit.squares / fitted.misfit.rows))
