"""The evidence of a fitted model: the probability of the pictures under the usual sizes of its parameters.

By Laplace's approximation at the fit, u the parameters' usual sizes (the scale of a Cauchy prior), φ the
factor by which squares are reduced:

    log E = −|r|² / 2φ − ½ log det(I + U JᵀJ U / φ) − Σ log(1 + (p / u)²)

A parameter that the pictures hardly determine costs nothing. A price for each parameter by the number of
rows, which the search requires of a new cause, would exclude such a model, and its simpler alternative
would look certain.

No law is exact: the real body may differ from it by LAW_SHARE of what a cause does, RMS, and by ALONG of it
in the direction in which two models differ. All squares are reduced by `1 + ALONG² G / φ`, G the reduction
of the squares by the cause.
"""

from __future__ import annotations

import numpy as np

from .fit import Fitted
from .problem import Problem

LAW_SHARE, ALONG = 0.1, 0.05
EXACT_LAWS = frozenset({"latency", "joint_offset", "marker_mount", "camera_mount", "board_mount"})
"""A rigid body and a clock have exact laws: two of these are separated by everything that the pictures
show."""


NEVER_TURNED = float(np.log(2.0))
"""Log odds against a play compared with a wrong zero: only one whose load never turns is equivalent, and
the zero is the simpler hypothesis."""


def volume(problem: Problem, model: Fitted, inflation: float) -> float:
    """The evidence of a fitted model in addition to its squares (Occam factor)."""
    if model.information is None or not model.of:
        return 0.0
    step = np.array([problem.hypotheses[key].step[k] for key, k in model.of])
    usual = np.array([problem.hypotheses[key].usual[k] for key, k in model.of])
    u = usual / step
    inner = np.eye(len(u)) + model.information * np.outer(u, u) / inflation
    out = -0.5 * float(np.linalg.slogdet(inner)[1])
    for (key, k), size in zip(model.of, usual, strict=True):
        # A limit is not small where it is usual.
        if not problem.hypotheses[key].effect.is_limit:
            out -= float(np.log1p((model.causes[key][k] / size) ** 2))
    return out - NEVER_TURNED * sum(effect == "backlash" for effect, _ in model.causes)


def log_odds(problem: Problem, one: Fitted, other: Fitted, inflation: float, does: float) -> float:
    """Log odds of one fitted model against another in its place; `does`: the reduction of the squares by
    the cause in question."""
    inflation *= trusted_to(does, inflation)
    by_squares = 0.5 * (other.misfit.squares - one.misfit.squares) / inflation
    return by_squares + volume(problem, one, inflation) - volume(problem, other, inflation)


def trusted_to(does: float, inflation: float) -> float:
    """The factor by which squares are reduced because laws are not exact; `does`: the reduction of the
    squares by the cause in question."""
    return 1.0 + ALONG**2 * max(0.0, does) / inflation
