"""`JOINT=DEGREES` as commands take it."""

from __future__ import annotations

import math
from collections.abc import Iterable


def joint_degrees(given: Iterable[str], option: str, example: str) -> dict[str, float]:
    """Joint name to rad, of texts `JOINT=DEGREES`.

    Raises `MirrorPostureError`, which names the option, what was got and the example, for a text that is none or a number
    that is not finite.
    """
    from .._core import MirrorPostureError

    found = {}
    for text in given:
        joint, equals, degrees = text.partition("=")
        try:
            found[joint] = math.radians(float(degrees))
        except ValueError:
            equals = ""
        if not equals or not math.isfinite(found[joint]):
            raise MirrorPostureError(f"{option}: got {text!r}, needed JOINT=DEGREES, as in {example}")
    return found
