"""Feed-forward: the command that makes a wanted posture come out right at the first try, from what a diagnosis found.

The robot stands at `θ = q + a + e q + s sin q + c (cos q − 1) + k τ(θ) + Σ c_K q_K ± play`. The torque is that of the wanted
posture, which is known, so q follows joint by joint. A play, and a servo that sticks, leave a joint on the side from which it
came; it is brought there by a way-point beyond the goal, on the side on which its load holds it anyway.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from .._core import MirrorPostureError
from ..arguments import checked_arguments
from ..robot import Robot
from ..session import Session
from .result import Cause, Diagnosis

if TYPE_CHECKING:
    from ..robots.protocol import CommandedRobot

BEYOND = 2.0
"""A way-point lies so many times the whole play beyond the goal: the joint then arrives on the right side for certain."""
LEAST_BEYOND = 0.02
"""rad (m): and this far at least."""
ROUNDS = 60
SETTLED = 1e-12
"""rad (m): commands that change less from round to round are found."""
LARGEST_SHARE = 0.5
"""A share of its own or another's position (`gear_ratio`, `joint_coupling`) beyond this is no error to be fed forward."""


@dataclass
class _Joint:
    """What is known of one joint's error."""

    offset: float = 0.0
    share: float = 0.0
    sine: float = 0.0
    cosine: float = 0.0
    compliance: float = 0.0
    half_play: float = 0.0
    coupled: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class FeedForward:
    """From a wanted posture to commands, joint positions by name, rad (m). Made by `feed_forward`."""

    robot: Robot
    root_link: str
    gravity_m_per_s2: tuple[float, float, float]
    limits: Mapping[str, tuple[float, float]]
    _joints: Mapping[str, _Joint] = field(repr=False)
    left_out: tuple[Cause, ...] = ()
    """Causes that no command of the joints can mend, or that grow with time."""

    def __call__(self, posture: Mapping[str, float]) -> tuple[dict[str, float], ...]:
        """The commands, one after another, that end in the wanted posture: a way-point where a side matters, then the command.

        Joints that the posture does not name are at 0, and are named where they too need a correction. Commands stay
        within the joints' limits.

        Raises:
            MirrorPostureError: a joint that the robot does not have, a position that is not finite.
        """
        wanted = self._wanted(posture)
        torque = self._torques(wanted)
        command = dict(wanted)
        sides = {name: self._side(name, torque[name]) for name in self._joints}
        for _ in range(ROUNDS):
            # In turn, so that a coupled joint sees its driver's command, not its wanted position.
            last = dict(command)
            for name, joint in self._joints.items():
                q = command[name]
                error = (
                    joint.offset
                    + joint.share * q
                    + joint.sine * math.sin(q)
                    + joint.cosine * (math.cos(q) - 1.0)
                    + joint.compliance * torque[name]
                    + sum(share * command[other] for other, share in joint.coupled.items())
                    + sides[name] * joint.half_play
                )
                command[name] = self._within(name, wanted[name] - error)
            if max((abs(command[n] - last[n]) for n in command), default=0.0) < SETTLED:
                break
        told = {name: command[name] for name in (*posture, *(n for n in self._joints if n not in posture))}
        beyond = {
            name: self._within(name, told[name] + sides[name] * self._margin(name))
            for name, joint in self._joints.items()
            if joint.half_play > 0.0
        }
        return ({**told, **beyond}, told) if beyond else (told,)

    def command(self, posture: Mapping[str, float]) -> dict[str, float]:
        """The last of the commands: where the joints are told to stay."""
        return self(posture)[-1]

    def _wanted(self, posture: Mapping[str, float]) -> dict[str, float]:
        wanted = dict.fromkeys(self.robot.position_names, 0.0)
        for name, value in posture.items():
            if name not in wanted:
                raise MirrorPostureError(f"posture: got joint {name!r}, needed one of {', '.join(wanted)}")
            if not math.isfinite(value):
                raise MirrorPostureError(f"posture: got {value} for {name}, needed a finite number")
            wanted[name] = float(value)
        return wanted

    def _torques(self, wanted: Mapping[str, float]) -> dict[str, float]:
        positions = np.array([[wanted[name] for name in self.robot.position_names]])
        torques = self.robot.gravity_torques(positions, self.gravity_m_per_s2, self.root_link)[0]
        return dict(zip(self.robot.position_names, map(float, torques), strict=True))

    def _side(self, name: str, torque: float) -> float:
        """Side of its play on which the joint shall rest: +1 where its load pushes it up, and then it comes from above."""
        return 1.0 if torque > 0.0 else -1.0

    def _margin(self, name: str) -> float:
        return max(LEAST_BEYOND, BEYOND * 2.0 * self._joints[name].half_play)

    def _within(self, name: str, value: float) -> float:
        low, high = self.limits.get(name, (-math.inf, math.inf))
        return min(max(value, low), high)


@checked_arguments
def feed_forward(found: Diagnosis, of: Session | CommandedRobot) -> FeedForward:
    """The commands that make postures come out right, from the causes at the joints of a diagnosis.

    `of` is the session that was diagnosed, or the robot that will be commanded. Taken are `joint_offset`, `gear_ratio`,
    `gear_eccentricity`, `joint_compliance`, `joint_coupling`, `backlash`, `stiction` and the joint zeros of `geometry`;
    the other causes are named in `left_out`.

    Raises:
        MirrorPostureError: a joint that the robot does not have; an error half as large as the motion itself.
    """
    # A commanded robot carries its own model.
    model: Any = of if isinstance(of, Session) else of.nominal
    robot = model.robot
    where = model if isinstance(of, Session) else model.metadata
    root = where.root_link if isinstance(of, Session) else where.root
    joints: dict[str, _Joint] = {}
    left_out = []
    for cause in found.causes:
        if not _take(cause, joints, robot):
            left_out.append(cause)
    limits = {j.name: (float(j.lower), float(j.upper)) for j in robot.joints if j.kind != "fixed"}
    gravity = tuple(float(x) for x in where.gravity_m_per_s2)
    return FeedForward(robot, root, gravity, limits, joints, tuple(left_out))  # type: ignore[arg-type]


def _take(cause: Cause, joints: dict[str, _Joint], robot: Robot) -> bool:
    """Adds a cause to its joint's error; False where it is none of a joint's position."""
    if cause.effect == "geometry":
        zeros = [m for m in cause.members if m.effect == "joint_offset"]
        for member in zeros:
            _joint(member.at, joints, robot).offset += member.value
        return False
    value = {name: estimate.value for name, estimate in cause.parameters.items()}
    if not cause.at.startswith("joint:"):
        return False
    at, _, other = cause.at.partition("<-")
    if cause.effect == "joint_offset":
        _joint(at, joints, robot).offset += value["offset_rad"]
    elif cause.effect == "gear_ratio":
        _joint(at, joints, robot).share += _share(cause, value["scale_error"])
    elif cause.effect == "gear_eccentricity":
        joint = _joint(at, joints, robot)
        joint.sine += _share(cause, value["sin_rad"])
        joint.cosine += _share(cause, value["cos_rad"])
    elif cause.effect == "joint_compliance":
        _joint(at, joints, robot).compliance += value["compliance_rad_per_nm"]
    elif cause.effect == "backlash":
        _joint(at, joints, robot).half_play += value["width_rad"] / 2.0
    elif cause.effect == "stiction":
        _joint(at, joints, robot).half_play += value["deadband_rad"]
    elif cause.effect == "joint_coupling":
        _known(other, robot)
        coupled = _joint(at, joints, robot).coupled
        driver = other.removeprefix("joint:")
        coupled[driver] = coupled.get(driver, 0.0) + _share(cause, value["coupling"])
    else:
        return False
    return True


def _known(at: str, robot: Robot) -> str:
    name = at.removeprefix("joint:")
    if name not in robot.position_names:
        raise MirrorPostureError(
            f"the diagnosis names joint {name!r}, which this robot does not move; it moves {', '.join(robot.position_names)}"
        )
    return name


def _joint(at: str, joints: dict[str, _Joint], robot: Robot) -> _Joint:
    return joints.setdefault(_known(at, robot), _Joint())


def _share(cause: Cause, value: float) -> float:
    if abs(value) >= LARGEST_SHARE:
        raise MirrorPostureError(
            f"{cause.effect} at {cause.at}: got {value:g}, needed less than {LARGEST_SHARE:g}: no small error that a command can mend"
        )
    return value
