"""Sizes of causes in readable units."""

from __future__ import annotations

import math

from ..diagnosis.formatting import unit_of
from ..diagnosis.vocabulary import IN_WORDS, along_joint
from .run import Plan
from .telling import Rival, Tells


def size_in_words(plan: Plan, told: Tells, size: float) -> str:
    """A size of a cause's parameter with its unit, as a diagnosis tells it."""
    slides = {f"joint:{j.name}" for j in plan.setting.nominal.robot.joints if j.kind == "prismatic"}
    parameters = IN_WORDS[told.effect]["parameters"]
    assert isinstance(parameters, list)
    unit, factor = unit_of(parameters[0], told.at in slides and along_joint(told.effect))
    # Two digits, without a power of ten.
    return f"{float(f'{factor * size:.2g}'):g}{'' if unit.startswith('°') else ' '}{unit}"


def apart_in_words(plan: Plan, told: Tells, rival: Rival) -> str:
    """The size from which the cause is separated from its alternative."""
    if math.isinf(rival.apart_from):
        return "at no size"
    return f"from {size_in_words(plan, told, rival.apart_from)} on"
