"""Parameters and places in words and units for the reader: degrees and millimetres instead of rad and m."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Any

from ..counted import counted
from .parts import Cause, Estimate, Ground, LeftOutThere, Member
from .result import Diagnosis
from .vocabulary import BESIDE, IN_WORDS, remedy

UNITS = {
    # Longest endings first: `_rad_per_nm` also ends with what others end with.
    "_nms_per_rad": ("N m s/rad", 1.0),
    "limit_rad_per_s": ("°/s", math.degrees(1.0)),
    "_kgm2": ("kg m²", 1.0),
    "latency_s": ("ms", 1000.0),
    "time_constant_s": ("ms", 1000.0),
    "_rad_per_nm": ("°/N m", math.degrees(1.0)),
    "_rad_per_s": ("°/h", math.degrees(1.0) * 3600.0),
    "_rad_per_nm_m": ("°/N m²", math.degrees(1.0)),
    "_rad_per_m": ("°/m", math.degrees(1.0)),
    "_per_m": ("1/m", 1.0),
    "_rad": ("°", math.degrees(1.0)),
    "_nm": ("N m", 1.0),
    "_px": ("px", 1.0),
    "_by_u": ("px per 1000 px of u", 1000.0),
    "_by_v": ("px per 1000 px of v", 1000.0),
    "delay_s": ("s", 1.0),
    "_m": ("mm", 1000.0),
    "scale_error": ("%", 100.0),
    "coupling": ("%", 100.0),
}
"""Ending of a parameter's name, its unit for the reader, and the factor from the SI unit."""


SLID = {"_rad_per_nm": ("mm/N", 1000.0), "_rad_per_s": ("mm/h", 3.6e6), "_rad": ("mm", 1000.0)}
"""The same of prismatic joints, where it is another."""


def unit_of(name: str, slides: bool) -> tuple[str, float]:
    """The unit of a parameter for the reader, and the factor from the SI unit; `slides`: of a prismatic
    joint."""
    for ending, unit in UNITS.items():
        if name.endswith(ending):
            return SLID.get(ending, unit) if slides else unit
    return "", 1.0


REFUSED = "The pictures do not fit the camera file: "
"""Begins what is said of pictures without image points, where there is too little evidence and their size says why."""
TINY = 0.01
"""Below this, values are printed in units of 10⁻³."""
SIZES = ("width", "spread", "deadband", "thickness", "friction", "compliance", "growth")
"""Parameters that cannot be negative are printed without a sign."""

GLASS, NO_GLASS = "thickness_m", "(no glass: silvered in front)"
"""The pane's thickness, and what it means that there is none."""


@dataclass(frozen=True)
class Quantity:
    """A parameter in readable form."""

    name: str
    value: str
    std: str
    unit: str
    note: str = ""
    """What the number means, where it does not speak for itself."""

    def __str__(self) -> str:
        return " ".join(filter(None, (self.name, self.value, "±", self.std, self.unit, self.note)))


def tell(name: str, estimate: Estimate | Member) -> Quantity:
    """A parameter in readable units; the digits follow its standard deviation."""
    unit, factor, short = "", 1.0, name
    for ending in UNITS:
        if name.endswith(ending):
            unit, factor = unit_of(name, estimate.slides)
            short = name.removesuffix(ending) or re.sub(r"_(rad_per_s|s)$", "", name)
            break
    value, std = factor * estimate.value, factor * estimate.std
    power = ""
    if 0.0 < max(abs(value), std) < TINY:
        value, std, power = 1000.0 * value, 1000.0 * std, "·10⁻³ "
    # Two digits of the standard deviation; a value without one keeps four of its own.
    size = std / 10.0 if std > 0.0 else abs(value) / 1000.0
    digits = max(0, min(6, -math.floor(math.log10(size)))) if 0.0 < size < math.inf else 2
    spaced = short.replace("_", " ")
    whole = name in ("first_frame", "last_frame", "shift_rows")
    if whole:
        return Quantity(spaced, f"{value:.0f}", f"{std:.1f}", "")
    sign = "" if spaced in SIZES else "+"
    shown = f"{value:{sign}.{digits}f}"
    note = NO_GLASS if name == GLASS and float(shown) == 0.0 else ""
    return Quantity(spaced, shown, f"{std:.{digits}f}", power + unit, note)


def is_zero(quantity: Quantity) -> bool:
    """Whether a quantity and its deviation are zero in the digits shown; such rows are left out."""
    return float(quantity.value) == 0.0 and float(quantity.std) == 0.0


def tell_all(cause: Cause) -> list[Quantity]:
    """All parameters of a cause in readable units; without those that were no part of the model, which are exactly 0
    (beside mounts by hand small errors are zeros of joints, not lengths)."""
    estimated = {n: e for n, e in cause.parameters.items() if e.value != 0.0 or e.std != 0.0}
    return [tell(name, estimate) for name, estimate in (estimated or cause.parameters).items()]


KINDS = r"\b(joint|link|marker):"
"""Kinds of places that have names."""
WHOLE = ("camera", "board", "mirror", "robot", "data")
"""Places that need none: there is one of each."""


def effect_in_words(effect: str) -> str:
    """`joint_offset` as `joint offset`."""
    return effect.replace("_", " ")


BY_HAND = {
    name: remedy(name) for name, told in {**IN_WORDS, **BESIDE}.items() if told["written_to"] == "nothing"
}
"""Effects that `apply` writes nowhere, and what to do instead."""


def numbers_in_words(numbers: Sequence[int], most_runs: int = 12) -> str:
    """`[1, 2, 3, 7]` as `1 to 3, 7`; of very many runs the first ones, and how many numbers more there are."""
    from_first = enumerate(sorted(numbers))
    runs = [[number for _, number in run] for _, run in groupby(from_first, key=lambda one: one[1] - one[0])]
    told = [
        f"{run[0]} to {run[-1]}" if len(run) > 2 else ", ".join(map(str, run)) for run in runs[:most_runs]
    ]
    more = sum(map(len, runs[most_runs:]))
    return ", ".join(told) + (f", and {more} more" if more else "")


def _joined(at: str) -> str:
    """A place of two parts: a joint that depends on another, a marker on a link, two that changed places."""
    return at.replace("<->", " and ").replace("<-", " on " if at.startswith("marker:") else " from ")


def place_in_words(at: str) -> str:
    """`joint:r_elbow` as `r_elbow`; `joint:a<-joint:b` as `a from b`; `marker:m<-link:l` as `m on l`."""
    return _joined(at).replace("joint:", "").replace("link:", "").replace("marker:", "")


def place_with_article(at: str) -> str:
    """A place with what it is: `the camera`, `joint r_elbow`, `marker r_hand`, `joint a from joint b`."""
    if at == "unknown":
        return "no single place"
    return f"the {at}" if at in WHOLE else re.sub(KINDS, r"\1 ", _joined(at))


def share(part: float) -> str:
    """A share as per cent."""
    return f"{100.0 * part:.0f} %"


def sentence(text: str) -> str:
    """A sentence of the core for a page: a capital at its start, `joint:r_elbow` as `joint r_elbow`."""
    plain = re.sub(KINDS, r"\1 ", text)
    return plain[:1].upper() + plain[1:]


def noise(name: str, value: float) -> str:
    """`corner_px` as `corners 0.18 px`, `point_m` as `points 0.03 mm`."""
    what, _, unit = name.rpartition("_")
    told, factor = UNITS[f"_{unit}"]
    return f"{what}s {factor * value:#.2g} {told}"


def millimetres(value_m: float | None) -> str:
    """A length in mm with digits enough to compare; empty where there is none."""
    if value_m is None:
        return ""
    value = 1000.0 * value_m
    return f"{value:.3f}" if abs(value) < 0.1 else f"{value:.2f}"


def ground_words(ground: Ground) -> str:
    """How another session's base turns under the robot's weight beyond what the causes say, about the axes of which that is known to
    three deviations."""
    axes = zip("xyz", ground.yields_rad_per_nm, ground.std_rad_per_nm, strict=True)
    turns = [
        f"{1e6 * c:+.1f} ± {1e6 * std:.1f} µrad/N m about {axis}"
        for axis, c, std in axes
        if abs(c) > 3.0 * std
    ]
    return f"its base turns by {' and '.join(turns) or 'a little'} under the robot's weight, beyond what the causes contain"


def left_out_words(left_out: LeftOutThere) -> str:
    """What of another session was left out as false."""
    boards = [f"{counted(left_out.boards, 'board')} that no flat mirror explains"] if left_out.boards else []
    points = [f"{left_out.points} of {counted(left_out.points_given, 'observation')} of markers"]
    return f"left out of it as false: {' and '.join((points if left_out.points else []) + boards)}"


def steps(found: Diagnosis) -> str:
    """The gap step by step, `7.20 → 1.30 → 0.52 mm`; empty where no step lies between before and after."""
    # Of several mistakes at once the steps between are not told, in no unit.
    in_pixels = any(step.rms_m is None and step.rms_px is not None for step in found.gap.steps)
    values = [step.rms_px if in_pixels else step.rms_m for step in found.gap.steps]
    told = ["?" if value is None else f"{value:.2f}" if in_pixels else millimetres(value) for value in values]
    return f"{' → '.join(told)} {'px' if in_pixels else 'mm'}" if len(told) > 2 else ""


def percent(share: float | None) -> str:
    """A share as per cent; probabilities short of certainty are not rounded up to it."""
    if share is None:
        return ""
    return f"{100.0 * share:.1f} %" if 0.985 < share < 0.9995 else f"{100.0 * share:.0f} %"


TRACKS = {
    ("marker", "shift"): "By how much the marker is off its mount, in the frame of the link that carries it",
    ("link", "shift"): "By how much the joints and markers that the link carries are shifted, in its frame",
    ("link", "turn"): "By how much the link is bent in its middle, about the axes of its frame",
    ("joint", "tilt"): "By how much the joint's axis leans, in two directions across it",
    ("camera", "turn"): "By how much the camera is turned, about its own axes (x right, y down, z ahead)",
    ("camera", "shift"): "By how much the camera is shifted, along its own axes (x right, y down, z ahead)",
    ("camera", "focal"): "Relative error of the focal length",
}
"""The quantity of a track, by kind of place and error."""


ROCK = "By how much the joint is turned at its origin, about two directions across its axis"


def track_caption(at: str, what: str, components: int) -> str:
    """What a track of so many components shows: a link bends about three axes, and turns its joint about two."""
    rocks = what == "turn" and components == 2
    quantity = ROCK if rocks else TRACKS[at.partition(":")[0], what]
    return f"{quantity}; each component by itself, all else as the model has it."


def field_caption(over: str, compared: bool) -> str:
    """What a field shows."""
    both = " Left without the cause, right with it, both on one scale." if compared else ""
    if over == "image":
        return f"Where the board's corners and the markers (blue) are seen, less where they are predicted, on average over the picture (px).{both} Grey arrows are within the noise."
    return f"By how much each corner of the board is displaced, on average, facing the print: arrows in its plane, dots out of it (mm).{both} What the mirror's position can take up is not in it."


DEPENDENCES = {
    "nothing": "nothing: it is the same in every posture",
    "position": "its own position",
    "load": "its load",
    "direction": "the direction of its last motion",
    "history": "the path that it came along",
    "time": "time",
    "posture": "how gravity pulls at it",
}
"""The variables on which an unexplained error depends, in words."""


def dependence(depends_on: str) -> str:
    """On what an unexplained error depends: `load` as `its load`, `position of joint:k` as `the position of k`."""
    if depends_on in DEPENDENCES:
        return DEPENDENCES[depends_on]
    both, own, other = depends_on.partition("position and position of ")
    if own and not both:
        return f"its own position and that of {place_in_words(other)}"
    return "the " + place_in_words(depends_on)


def listed(names: Sequence[str]) -> str:
    """`a`, `a and b`, `a, b and c`."""
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"


ENCODER_COLUMNS = ("before", "after", "before_zero_free", "after_zero_free")


def telling_encoders(entries: Sequence[Mapping[str, Any]]) -> list[Mapping[str, Any]]:
    """Of the witness' encoders those that differ from a prediction in the digits shown: a table of zeros tells nothing."""
    return [e for e in entries if any(f"{1e3 * e[key]:.2f}" != "0.00" for key in ENCODER_COLUMNS)]
