"""What a plan tells: the smallest size of each effect that a diagnosis will find, and which effects stay twins."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..arrays import Floats, Integers, Mask
from .expected import planned_session
from .options import MirrorPlace
from .setting import Setting

SECONDS_A_FRAME = 10.0
"""How long a posture with its picture is taken to last."""
LEAST_LOAD_NM = 2e-3
"""The weight of a sheet of paper at arm's length: below it a spring is nothing that a person would look for."""


@dataclass(frozen=True)
class Rival:
    """Another cause that looks alike, and the size (of the first parameter) from which both are separated;
    infinite: never."""

    name: str
    apart_from: float


@dataclass(frozen=True)
class Tells:
    """The predicted detection limits of one cause."""

    effect: str
    at: str
    parameters: dict[str, float]
    """The smallest size of each parameter that is found in 19 of 20 sessions, in its unit; infinite where any size
    would be hidden."""
    twins: tuple[Rival, ...]
    """Causes that it can be taken for at a size that it commonly has, those that are separated last first."""

    @property
    def name(self) -> str:
        """`effect@place`."""
        return f"{self.effect}@{self.at}"

    @property
    def seen(self) -> bool:
        """Whether the plan shows it at all."""
        return all(math.isfinite(size) for size in self.parameters.values())


def what_it_tells(
    setting: Setting, positions: Floats, mirrors: Sequence[MirrorPlace], view: Integers, markers: Mask
) -> tuple[Tells, ...]:
    """What postures (F, nq) tell, held one after the other in front of the mirrors (in the base's frame) `view` (F,),
    with visible balls (F, M): of the joints that move, the links that they join, and the set-up.

    Of a joint that stands still no posture separates one error from another, and one that bears hardly any load yields to none.
    """
    session = planned_session(setting, positions, mirrors, view, markers, SECONDS_A_FRAME)
    joints = [j for j in setting.nominal.robot.joints if j.name in setting.joint_names]
    still = {f"joint:{j.name}" for j in setting.nominal.robot.joints} - {f"joint:{j.name}" for j in joints}
    still |= {f"link:{name}" for name in setting.nominal.robot.link_names}
    still -= {f"link:{name}" for j in joints for name in (j.parent_link, j.child_link)}
    load_nm = np.abs(setting.torques_nm(positions)).max(axis=0)
    without_load = {
        ("joint_compliance", f"joint:{name}")
        for name, load in zip(setting.nominal.robot.position_names, load_nm, strict=True)
        if load < LEAST_LOAD_NM
    }

    def is_told(effect: str, at: str) -> bool:
        return at not in still and (effect, at) not in without_load

    return tuple(
        Tells(
            effect,
            at,
            {name: _size(size) for name, size in parameters},
            tuple(Rival(f"{other}@{by}", _size(apart)) for other, by, apart in twins if is_told(other, by)),
        )
        for effect, at, parameters, twins in session.foresee()
        if is_told(effect, at)
    )


def _size(size: float | None) -> float:
    return math.inf if size is None else size
