"""Identifiability in a motion: could another law of the same joint's position produce the same pictures, within the noise?

A wrong zero, a gear, a spring and a play each add a curve to a joint's position: a constant, its position, the load on it, the side of
the load. A play whose load never turns is a wrong zero. With e the curve that the cause adds, b a rival's at its best size a, J the
images' derivative by the joint and σ the noise that the session truly has,

    D = min over a of Σ |J (e − a b)|² / σ² is the expected difference of χ² for a reference that knows all else; without that knowledge it
is smaller. Noise scatters it by 2√D. Below `MARGIN`, or below `CLEAR_DEVIATIONS` of its scatter, the two are rivals.

The laws of a servo (lag, gain, friction) are not compared: they have no rivals here.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

LAWS_OF_POSITION = ("joint_offset", "gear_ratio", "joint_compliance", "backlash")
NEVER_NEGATIVE = ("joint_compliance", "backlash")
MARGIN = 10.0
"""Twice the logarithm of the odds at which one is clearly better: 150 to 1."""
CLEAR_DEVIATIONS = 2.6
"""In standard deviations: the reference itself errs in one case of 200."""


@dataclass(frozen=True)
class Bent:
    """Of one joint, picture by picture: position, load, the side of its play (F,); and the images' derivative (F, M, 2), px/rad."""

    position: Array
    load: Array
    side: Array
    px_per_rad: Array

    def curve(self, effect: str) -> Array:
        """(F,): what an effect of size 1 adds to the joint's position."""
        return {
            "joint_offset": np.ones_like(self.position),
            "gear_ratio": self.position,
            "joint_compliance": self.load,
            "backlash": 0.5 * self.side,
        }[effect]


def rivals_of(cause: dict[str, Any], true: Array, bent: Bent, noise_px: float) -> list[str]:
    """Laws of the same joint that the pictures do not clearly distinguish from a cause that adds the curve `true`, as `effect@place`."""
    weight = np.sqrt((np.nan_to_num(bent.px_per_rad) ** 2).sum(axis=(1, 2))) / noise_px
    wanted = weight * true
    out = []
    for effect in LAWS_OF_POSITION:
        if effect == cause["effect"]:
            continue
        curve = weight * bent.curve(effect)
        size = float(curve @ wanted / max(float(curve @ curve), 1e-300))
        if effect in NEVER_NEGATIVE:
            size = max(size, 0.0)
        if not clearly(float(((wanted - size * curve) ** 2).sum())):
            out.append(f"{effect}@{cause['at']}")
    return out


def clearly(difference: float) -> bool:
    """Whether two explanations with this expected difference of squares are distinguished."""
    return difference > MARGIN and difference > CLEAR_DEVIATIONS * 2.0 * np.sqrt(difference)
