"""Who must act: the causes grouped by whom they concern, and what to do about each."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

from . import formatting
from .parts import Cause, Member
from .result import Diagnosis
from .vocabulary import IN_WORDS, remedy

AMBIGUOUS = 0.1
"""With an alternative of at least this probability, these postures do not separate the cause from it."""
SHOWN = 0.005
"""Shares and probabilities below this would be shown as 0 %."""
LARGEST_MEMBERS = 3
"""So many of the small angles, and of the small lengths, of a group are named on the page's top."""
WHO = {
    "robot": ("The robot", "Repair or re-calibrate it, or write the values into its model."),
    "setup": ("The set-up", "Measure again, or fasten again, what a person mounted."),
    "data": ("The data", "Correct the log or the recording; the robot is not to blame for these."),
}
"""Whom a cause concerns, in the order of the page, and what that means."""
OF_KIND = {"robot": "robot", "setup": "setup", "camera": "setup", "mirror": "setup", "data": "data"}
OF_PLACE = {"camera": "setup", "board": "setup", "mirror": "setup", "data": "data", "marker": "setup"}
"""For documents whose causes have no kind."""


@dataclass(frozen=True)
class Action:
    """One cause and what to do about it."""

    number: int
    """As the causes are numbered, from 1."""
    what: str
    do: str
    instead: tuple[str, ...]
    """Its alternatives, with probabilities; empty where these postures separate it from them."""


@dataclass(frozen=True)
class Concerned:
    """Who must act, on which causes."""

    who: str
    meaning: str
    actions: tuple[Action, ...]


def concerned(found: Diagnosis) -> list[Concerned]:
    """All who must act: robot, set-up, data; only those whom a cause concerns."""
    groups: dict[str, list[Action]] = {who: [] for who in WHO}
    for number, cause in enumerate(found.causes, start=1):
        what = f"{formatting.effect_in_words(cause.effect)} at {formatting.place_with_article(cause.at)}"
        groups[whom(cause)].append(Action(number, what, what_to_do(cause), rivals(cause)))
    return [Concerned(*WHO[who], tuple(actions)) for who, actions in groups.items() if actions]


def whom(cause: Cause) -> str:
    """`robot`, `setup` or `data`."""
    return OF_KIND.get(cause.kind) or OF_PLACE.get(re.split("[:<]", cause.at)[0], "robot")


def what_to_do(cause: Cause) -> str:
    """What the person whom a cause concerns does about it."""
    if cause.effect in formatting.BY_HAND and not cause.members:
        return formatting.BY_HAND[cause.effect]
    if cause.effect in IN_WORDS:
        return remedy(cause.effect)
    return "write the corrected model with `mirror-posture apply`"


def is_ambiguous(cause: Cause) -> bool:
    """Whether these postures cannot separate a cause from one of its alternatives."""
    return any(alternative.probability >= AMBIGUOUS for alternative in cause.alternatives)


def rivals(cause: Cause) -> tuple[str, ...]:
    """The alternatives of an ambiguous cause, in words."""
    if not is_ambiguous(cause):
        return ()
    return tuple(
        f"{formatting.effect_in_words(a.effect)} at {formatting.place_with_article(a.at)} ({formatting.percent(a.probability)})"
        for a in cause.alternatives
        if a.probability >= SHOWN
    )


def largest_members(cause: Cause) -> list[str]:
    """The largest small errors of a group, angles before lengths before springs, each by name with its standard deviation."""
    chosen: list[Member] = []
    for unit in ("_rad", "_m", "_per_nm"):
        of_unit = [m for m in told_members(cause.members) if m.parameter.endswith(unit)]
        chosen += sorted(of_unit, key=lambda m: -abs(m.value))[:LARGEST_MEMBERS]
    return [
        f"{formatting.effect_in_words(m.effect)} at {formatting.place_with_article(m.at)}: {formatting.tell(m.parameter, m)}"
        for m in chosen
    ]


def told_members(members: Sequence[Member]) -> list[Member]:
    """The members that are not zero in the digits that are shown, the clearest first."""
    told = [m for m in members if not formatting.is_zero(formatting.tell(m.parameter, m))]
    return sorted(told, key=lambda m: -abs(m.value) / m.std if m.std > 0.0 else 0.0)
