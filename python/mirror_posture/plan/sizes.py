"""Sizes of causes in readable units."""

from __future__ import annotations

import math

from .run import Plan
from .telling import Rival, Tells

TURNED = {
    "joint_offset": (180.0 / math.pi, "°"),
    "gear_ratio": (100.0, " %"),
    "gear_eccentricity": (180.0 / math.pi, "°"),
    "backlash": (180.0 / math.pi, "°"),
    "joint_compliance": (180.0 / math.pi, "°/N m"),
    "drift": (180.0 / math.pi, "°/s"),
    "axis_tilt": (180.0 / math.pi, "°"),
    "link_length": (1000.0, " mm"),
    "marker_mount": (1000.0, " mm"),
}
"""Factor and unit of an effect's parameters, of joints that turn."""
SLID = {
    "joint_offset": (1000.0, " mm"),
    "backlash": (1000.0, " mm"),
    "joint_compliance": (1000.0, " mm/N"),
    "drift": (1000.0, " mm/s"),
}
"""Of prismatic joints, where it is another."""


def size_in_words(plan: Plan, told: Tells, size: float) -> str:
    """A size of a cause's parameter with its unit."""
    factor, unit = TURNED[told.effect]
    slides = {f"joint:{j.name}" for j in plan.setting.nominal.robot.joints if j.kind == "prismatic"}
    if told.at in slides:
        factor, unit = SLID.get(told.effect, (factor, unit))
    # Two digits, without a power of ten.
    return f"{float(f'{factor * size:.2g}'):g}{unit}"


def apart_in_words(plan: Plan, told: Tells, rival: Rival) -> str:
    """The size from which the cause is separated from its alternative."""
    if math.isinf(rival.apart_from):
        return "at no size"
    return f"from {size_in_words(plan, told, rival.apart_from)} on"
