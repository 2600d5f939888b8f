"""`JOINT=DEGREES`, or with a unit, as commands take it."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import TYPE_CHECKING

from .._core import MirrorPostureError

if TYPE_CHECKING:
    from ..robot import Robot

ANGLES = {"rad": 1.0, "deg": math.radians(1.0), "°": math.radians(1.0), "": math.radians(1.0)}
LENGTHS = {"mm": 0.001, "cm": 0.01, "m": 1.0}


def joint_values(given: Iterable[str], option: str, robot: Robot | None = None) -> dict[str, float]:
    """Joint name to rad or m, from texts such as `elbow=15`, `elbow=0.26rad`, `rail=12mm`, or several with
    commas between them.

    Raises `MirrorPostureError`, which names the option, what was given and what is required, for an invalid
    text, a number that is not finite, and (with a robot) a length for a revolute joint or an angle for a
    prismatic one.
    """
    kinds = {} if robot is None else {joint.name: joint.kind for joint in robot.joints}
    found: dict[str, float] = {}
    for text in given:
        for part in text.split(","):
            joint, equals, value = (piece.strip() for piece in part.partition("="))
            unit = next((u for u in ("rad", "mm", "cm", "deg", "°", "m") if value.endswith(u)), "")
            try:
                number = float(value.removesuffix(unit))
            except ValueError:
                equals = ""
            if not equals or not math.isfinite(number):
                raise MirrorPostureError(
                    f"{option}: got {part!r}, needed JOINT=DEGREES (or a unit: 0.26rad, 12mm), as in elbow=15"
                )
            if joint in kinds and (kinds[joint] == "prismatic") != (unit in LENGTHS):
                needed = (
                    "slides: needed a length, as in {}=12mm"
                    if unit in ANGLES
                    else "turns: needed an angle, as in {}=15"
                )
                raise MirrorPostureError(f"{option}: got {part!r}, and {joint} {needed.format(joint)}")
            found[joint] = number * (ANGLES | LENGTHS)[unit]
    return found
