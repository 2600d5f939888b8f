"""Joints that rest off their logged positions."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from .simulate import Case


def rest_elsewhere(case: Case, rest_rad: float, rng: np.random.Generator) -> None:
    """Every joint that moves rests off its logged position, in each posture by itself. The judges of the causes do not read it: what
    is identifiable is so where joints are where the log says."""
    q_rad = case.plan.commands.q_rad
    moves = np.ptp(q_rad, axis=0) > 0
    case.logged_off_rad = rng.normal(0, rest_rad, q_rad.shape) * moves
    case.answer["rest_rad"] = rest_rad
