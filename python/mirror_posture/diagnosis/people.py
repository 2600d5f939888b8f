"""Parameters and places in people's words and units: degrees and millimetres instead of rad and m."""

from __future__ import annotations

import math
from dataclasses import dataclass

from .result import Cause, Estimate

UNITS = {
    # Longest endings first: `_rad_per_nm` also ends with what others end with.
    "_rad_per_nm": ("°/N m", math.degrees(1.0)),
    "_rad_per_s": ("°/h", math.degrees(1.0) * 3600.0),
    "_per_m": ("1/m", 1.0),
    "_rad": ("°", math.degrees(1.0)),
    "_px": ("px", 1.0),
    "_m": ("mm", 1000.0),
    "scale_error": ("%", 100.0),
    "coupling": ("%", 100.0),
}
"""Ending of a parameter's name, its unit for people, and the factor from the SI unit."""


@dataclass(frozen=True)
class Told:
    """A parameter as people read it."""

    name: str
    value: str
    std: str
    unit: str

    def __str__(self) -> str:
        return f"{self.name} {self.value} ± {self.std} {self.unit}".rstrip()


def tell(name: str, estimate: Estimate) -> Told:
    """A parameter in people's units; the digits follow its standard deviation."""
    unit, factor, short = "", 1.0, name
    for ending, (of_people, times) in UNITS.items():
        if name.endswith(ending):
            unit, factor = of_people, times
            short = name.removesuffix(ending) or name
            break
    value, std = factor * estimate.value, factor * estimate.std
    # Two digits of the standard deviation; a value without one keeps four of its own.
    size = std / 10.0 if std > 0.0 else abs(value) / 1000.0
    digits = max(0, min(6, -math.floor(math.log10(size)))) if size > 0.0 else 2
    spaced = short.replace("_", " ")
    whole = name in ("first_frame", "last_frame", "shift_rows")
    if whole:
        return Told(spaced, f"{value:.0f}", f"{std:.1f}", "")
    return Told(spaced, f"{value:+.{digits}f}", f"{std:.{digits}f}", unit)


def tell_all(cause: Cause) -> list[Told]:
    """All parameters of a cause in people's units."""
    return [tell(name, estimate) for name, estimate in cause.parameters.items()]


def effect_in_words(effect: str) -> str:
    """`joint_offset` as `joint offset`."""
    return effect.replace("_", " ")


def place_in_words(at: str) -> str:
    """`joint:r_elbow` as `r_elbow`; `joint:a<-joint:b` as `a from b`."""
    return at.replace("<-", " from ").replace("joint:", "").replace("link:", "").replace("marker:", "")


def millimetres(value_m: float | None) -> str:
    """A length in mm with digits enough to compare; empty where there is none."""
    if value_m is None:
        return ""
    value = 1000.0 * value_m
    return f"{value:.3f}" if abs(value) < 0.1 else f"{value:.2f}"


def percent(share: float | None) -> str:
    """A share as per cent; probabilities short of certainty are not rounded up to it."""
    if share is None:
        return ""
    return f"{100.0 * share:.1f} %" if 0.985 < share < 0.9995 else f"{100.0 * share:.0f} %"


def next_step(verdict: str, has_alternatives: bool, has_next: bool) -> str:
    """What to do next, in one sentence."""
    if verdict == "none":
        return "Nothing to mend: the model predicts as well as the measurement's noise allows."
    if has_alternatives and has_next:
        return "Take the suggested postures and diagnose again: they tell the rivals apart."
    if has_alternatives:
        return "Record further postures, far from those of this session, and diagnose again: rivals remain."
    if verdict == "explained":
        return "Write the better model with `mirror-posture apply`, and check it on a session of other postures with --check."
    if verdict == "partial":
        return "Write what was found back with `mirror-posture apply`; then look at the place of the unexplained part and on what it depends."
    return "Look at the place and at what the unexplained part depends on: no effect of the vocabulary explains it."
