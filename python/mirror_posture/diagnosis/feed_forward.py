"""Feed-forward: the command that reaches a wanted posture at the first attempt, from the causes of a
diagnosis.

The robot stands at `θ = q + a + e q + s sin q + c (cos q − 1) + k τ(θ) + Σ κ_K q_K ± play`; the core solves
it for q. A play, and a servo with stiction, leave a joint on the side from which it came. It is moved there
over a way-point beyond the goal, on the side on which its load holds it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from .. import _core
from .._core import MirrorPostureError
from ..arguments import checked_arguments
from ..robot import Robot
from ..session import Session
from .parts import Cause
from .result import Diagnosis
from .vocabulary import joint_terms

if TYPE_CHECKING:
    from ..robots.protocol import CommandedRobot

Error = tuple[str, str, float, str | None]
"""A known error of a joint: joint, term of its law, size, and of a coupling the other joint."""


@dataclass(frozen=True)
class FeedForward:
    """From a wanted posture to commands, joint positions by name, rad (m). Made by `feed_forward`."""

    robot: Robot
    left_out: tuple[Cause, ...] = ()
    """Causes that no command of the joints can compensate, or that grow with time."""
    _core: _core.FeedForward = field(kw_only=True, repr=False)

    def __call__(self, posture: Mapping[str, float]) -> tuple[dict[str, float], ...]:
        """The commands, one after another, that end in the wanted posture: a way-point where a side matters, then the command.

        Joints that the posture does not name are at 0, and are named where they too need a correction. Commands stay
        within the joints' limits.

        Raises:
            MirrorPostureError: a joint that the robot does not have, a position that is not finite.
        """
        names = self.robot.position_names
        wanted = dict.fromkeys(names, 0.0)
        for name, value in posture.items():
            if name not in wanted:
                raise MirrorPostureError(f"posture: got joint {name!r}, needed one of {', '.join(wanted)}")
            if not math.isfinite(value):
                raise MirrorPostureError(f"posture: got {value} for {name}, needed a finite number")
            wanted[name] = float(value)
        way_points, commands = self._core.commands(np.array([list(wanted.values())]))
        corrected = (names[index] for index in self._core.corrected)
        told = [*posture, *(name for name in corrected if name not in posture)]
        rows = (way_points, commands) if self._core.has_way_points else (commands,)
        return tuple({name: float(row[0, names.index(name)]) for name in told} for row in rows)

    def command(self, posture: Mapping[str, float]) -> dict[str, float]:
        """The last of the commands: the final joint positions."""
        return self(posture)[-1]


@checked_arguments
def feed_forward(found: Diagnosis, of: Session | CommandedRobot) -> FeedForward:
    """The commands that reach postures, compensated for the causes at the joints of a diagnosis.

    `of` is the session that was diagnosed, or the robot that will be commanded. Used are the causes whose
    effect has a law at a joint (`joint_law` of `vocabulary.IN_WORDS`), except those that grow with time,
    and the joint zeros of `geometry`; the other causes are named in `left_out`.

    Raises:
        MirrorPostureError: a joint that the robot does not have; an error half as large as the motion itself.
    """
    # A commanded robot carries its own model.
    model: Any = of if isinstance(of, Session) else of.nominal
    robot = model.robot
    where = model if isinstance(of, Session) else model.metadata
    root = where.root_link if isinstance(of, Session) else where.root
    errors: list[Error] = []
    left_out = []
    for cause in found.causes:
        taken = _errors(cause)
        errors += taken
        # Of small errors everywhere the zeros are taken; the rest of them stays.
        if not taken or cause.members:
            left_out.append(cause)
    for joint, _, _, driver in errors:
        for name in (joint, driver):
            _known(name, robot)
    core = _core.FeedForward(robot.core, root, np.array(where.gravity_m_per_s2, float), errors)
    return FeedForward(robot, tuple(left_out), _core=core)


def _errors(cause: Cause) -> list[Error]:
    """A cause, or its members, as terms of joints' laws; none where it is no law of a joint or grows with time."""
    parts = [(m.effect, m.at, {m.parameter: m.value}) for m in cause.members] or [
        (cause.effect, cause.at, {name: estimate.value for name, estimate in cause.parameters.items()})
    ]
    errors: list[Error] = []
    for effect, at, values in parts:
        joint, _, driver = at.removeprefix("joint:").partition("<-joint:")
        terms = joint_terms(effect, values) if at.startswith("joint:") else {}
        errors += [(joint, term, value, driver or None) for term, value in terms.items() if term != "rate"]
    return errors


def _known(name: str | None, robot: Robot) -> None:
    if name is not None and name not in robot.position_names:
        raise MirrorPostureError(
            f"the diagnosis names joint {name!r}, which this robot does not move; it moves {', '.join(robot.position_names)}"
        )
