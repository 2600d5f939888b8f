"""Writes the causes into the user's own xacro: the property, argument or origin that contains a joint's
number."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from ..._core import MirrorPostureError
from .own_urdf import SAME, correct_joints
from .urdf import Urdf
from .xacro_numbers import Place, edited, joint_lines, own_places, shared_places
from .xacro_tree import XacroTree
from .xml_text import XmlText

STEP = 1e-4
"""By which a number is moved to see what follows it."""
NOTHING = 1e-12
STEPS = 4
"""Of Newton's method: one is enough where a number enters by a factor."""


class Number(NamedTuple):
    """One of the nine numbers of a joint."""

    joint: str
    attribute: str
    """`origin xyz`, `origin rpy` or `axis xyz`."""
    column: int


@dataclass(frozen=True)
class PatchedXacro:
    """The texts that change, by file; what was changed; what was not, and where to change it by hand."""

    texts: dict[Path, str]
    told: tuple[str, ...]


def patch_own_xacro(tree: XacroTree, before: Urdf, after: Urdf) -> PatchedXacro:
    """Changes the numbers of xacro files so that their URDF gets the origins and axes of a corrected robot.

    Each number of a file is changed slightly and the files are expanded, which shows what depends on it. A
    property, an argument, a macro's default or a call's parameter is changed if no other joint depends on
    it; otherwise the joint's own origin, also inside an expression (`${x}` becomes `${x + 0.05}`). The
    changed files are expanded again: every joint is then as required, and all others are unchanged. A
    change of numbers that other joints share is not made; it is reported with its line.

    Raises:
        MirrorPostureError: a joint whose origin is not the session's: another robot, other arguments, or corrected already.
    """
    now = Urdf(tree.expand({}), str(tree.main))
    wanted = _wanted(tree, now, before, after)
    goal = {number: value for joint in wanted.values() for number, value in joint.items()}
    changes: dict[Place, str] = {}
    told: list[str] = []
    shared = shared_places(tree.sources) if goal else []
    follow = {place: _following(tree, now, place) for place in shared}
    for name, numbers in wanted.items():
        found: dict[Place, str] = {}
        missing: list[Number] = []
        for number, value in numbers.items():
            place = _holder(tree, now, number, follow)
            text = None if place is None or place in changes else _solved(tree, place, number, value)
            if place is None or text is None:
                missing.append(number)
            else:
                found[place] = text
        if missing:
            told.append(_not_written(tree, now, name, numbers, missing, follow))
            goal = {number: value for number, value in goal.items() if number.joint != name}
            continue
        changes |= found
        for place, text in found.items():
            beside = _beside(tree, place, text)
            told.append(
                f"joint {name}: {place.file.name}, line {place.line}, {place.words}: {place.old} to {text}"
                + (f"; {beside} numbers of shapes and masses follow it" if beside else "")
            )
    texts = edited(tree.sources, changes)
    _check(tree, now, goal, texts)
    return PatchedXacro(texts, tuple(told))


def _wanted(tree: XacroTree, now: Urdf, before: Urdf, after: Urdf) -> dict[str, dict[Number, float]]:
    """By joint: the numbers that are to change, with their new values."""
    target = Urdf(tree.expand({}), str(tree.main))
    why = "another robot, other arguments (--xacro-arg), or corrected already"
    names = correct_joints(target, before, after, str(tree.main), why)
    then = _numbers(Urdf(target.text()))
    was = _numbers(now)
    return {
        name: {n: v for n, v in then.items() if n.joint == name and abs(v - was[n]) > SAME} for name in names
    }


def _numbers(urdf: Urdf) -> dict[Number, float]:
    """The nine numbers of each joint."""
    found = {}
    for name in urdf.joints:
        for attribute, values in urdf.numbers(name).items():
            for column, value in enumerate(values):
                found[Number(name, attribute, column)] = float(value)
    return found


def _following(tree: XacroTree, now: Urdf, place: Place) -> dict[Number, float]:
    """The joints' numbers that follow a number of the files, with their slopes; empty where it must not be moved."""
    try:
        moved = Urdf(tree.expand(edited(tree.sources, {place: place.moved_by(STEP)})))
    except (MirrorPostureError, ValueError):
        return {}
    was, then = _numbers(now), _numbers(moved)
    if was.keys() != then.keys():
        return {}
    return {n: (then[n] - was[n]) / STEP for n in was if abs(then[n] - was[n]) > NOTHING}


def _holder(
    tree: XacroTree, now: Urdf, number: Number, follow: Mapping[Place, Mapping[Number, float]]
) -> Place | None:
    """The place on which this number alone depends: a plain number first, because users expect it there."""
    alone = [place for place, slopes in follow.items() if set(slopes) == {number}]
    own = [
        place
        for place, attribute, column in own_places(tree.sources, number.joint)
        if (attribute, column) == number[1:] and set(_following(tree, now, place)) == {number}
    ]
    return next(iter(sorted(alone + own, key=lambda place: not place.plain)), None)


def _solved(tree: XacroTree, place: Place, number: Number, value: float) -> str | None:
    """The text of a place with which a number gets its value."""
    slopes = _following(tree, Urdf(tree.expand({})), place)
    change = 0.0
    text = place.old
    for _ in range(STEPS):
        got = _numbers(Urdf(tree.expand(edited(tree.sources, {place: text}))))[number]
        if abs(got - value) <= SAME:
            return text
        change += (value - got) / slopes[number]
        text = place.moved_by(change)
    got = _numbers(Urdf(tree.expand(edited(tree.sources, {place: text}))))[number]
    return text if abs(got - value) <= SAME else None


def _beside(tree: XacroTree, place: Place, text: str) -> int:
    """How many attributes outside of joints' origins and axes change as well."""
    before, after = (
        XmlText(tree.expand(changed)).elements for changed in ({}, edited(tree.sources, {place: text}))
    )
    return sum(
        one.attributes[key] != other.attributes.get(key)
        for one, other in zip(before, after, strict=True)
        if one.parent is None or one.parent.tag != "joint"
        for key in one.attributes
    )


def _not_written(
    tree: XacroTree,
    now: Urdf,
    name: str,
    numbers: Mapping[Number, float],
    missing: list[Number],
    follow: Mapping[Place, Mapping[Number, float]],
) -> str:
    """Where to change it by hand, and why it was not changed."""
    was = now.numbers(name)
    lines = "; ".join(joint_lines(tree.sources, name)) or tree.main.name
    wanted = []
    for attribute in dict.fromkeys(number.attribute for number in numbers):
        values = list(was[attribute])
        for number, value in numbers.items():
            if number.attribute == attribute:
                values[number.column] = value
        wanted.append(f'{attribute} must become "{" ".join(f"{v + 0.0:.9g}" for v in values)}"')
    shared = {
        other.joint
        for slopes in follow.values()
        if any(number in slopes for number in missing)
        for other in slopes
        if other.joint != name
    }
    for number in missing:
        for place, attribute, column in own_places(tree.sources, name):
            if (attribute, column) == number[1:]:
                shared |= {other.joint for other in _following(tree, now, place) if other.joint != name}
    why = (
        f"its numbers also move {', '.join(sorted(shared))}"
        if shared
        else "no number of these files moves it alone"
    )
    return f"joint {name}: not written: {why}; at {lines}: {', '.join(wanted)}"


def _check(tree: XacroTree, now: Urdf, goal: Mapping[Number, float], texts: Mapping[Path, str]) -> None:
    """All changes together: what should change has, and nothing else."""
    then = _numbers(Urdf(tree.expand(texts)))
    for number, value in _numbers(now).items():
        if abs(then[number] - goal.get(number, value)) > 2.0 * SAME:
            raise MirrorPostureError(
                f"{tree.main}: joint {number.joint} would get {number.attribute} {then[number]:.9g} instead of "
                f"{goal.get(number, value):.9g}: its numbers depend on each other; expand the file (xacro FILE > robot.urdf) and give that"
            )
