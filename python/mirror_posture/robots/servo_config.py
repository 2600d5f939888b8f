"""The TOML file of a robot of servos: which servo is which joint, its zero, and its limits of speed and
torque."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from .._core import MirrorPostureError
from ..formats import Section
from ..formats.check import problems
from ..formats.keys import finite
from ..formats.servo_keys import BUS, COUNTS_PER_TURN, SERVO, Make
from ..input_files import given_text, parse_toml
from .nominal import Nominal
from .protocol import JointLimits
from .servo_state import AtEnd

SPEED_UNIT_RAD_PER_S = 0.229 * 2.0 * math.pi / 60.0
"""Dynamixel's, X series."""
ACCELERATION_UNIT_RAD_PER_S2 = 214.577 * 2.0 * math.pi / 3600.0
STS_STEP_RAD = 2.0 * math.pi / COUNTS_PER_TURN
"""Feetech's, STS series: a step; its speeds count 1 step/s or 50."""
STS_ACCELERATION_UNIT_RAD_PER_S2 = 100.0 * STS_STEP_RAD
STEPS = {
    "dynamixel": (SPEED_UNIT_RAD_PER_S, ACCELERATION_UNIT_RAD_PER_S2),
    "feetech": (STS_STEP_RAD, STS_ACCELERATION_UNIT_RAD_PER_S2),
}
"""The smallest speed and acceleration that can be set for each make, rad/s and rad/s²."""


@dataclass(frozen=True)
class Servo:
    """One joint's servo: `theta = direction · (counts − zero_counts) · 2π / counts_per_turn`."""

    joint: str
    servo_id: int
    zero_counts: int
    direction: int
    limits: JointLimits
    counts_per_turn: int = COUNTS_PER_TURN
    reversed: bool = False
    """Dynamixel: whether its drive mode turns the positive sense round; verified before torque."""
    model: str | None = None
    """Its required model and firmware, if the file states them; verified before torque."""
    firmware: str | None = None
    homing_offset: int | None = None
    """Feetech: the offset that `zero_counts` was found with; verified before torque."""

    def counts(self, position_rad: float) -> int:
        """The servo's position for a joint position."""
        turn = self.direction * position_rad * self.counts_per_turn / (2.0 * math.pi)
        return self.zero_counts + round(turn)

    def position_rad(self, counts: int) -> float:
        """The joint's position for a servo's."""
        return self.direction * (counts - self.zero_counts) * 2.0 * math.pi / self.counts_per_turn


@dataclass(frozen=True)
class ServoConfig:
    """The content of the file."""

    port: str
    servos: tuple[Servo, ...]
    baudrate: int = 1_000_000
    speed_rad_per_s: float = 0.5
    acceleration_rad_per_s2: float = 5.0
    current_a: float | None = None
    """Dynamixel: the torque limit, as motor current: position control limited by current."""
    pwm_share: float | None = None
    """Dynamixel: the torque limit of servos without current control, as a share of the supply. Exactly one of the two is given."""
    current_unit_a: float | None = None
    """Dynamixel: not needed; where it is given, it must be the model's."""
    torque_share: float | None = None
    """Feetech: the torque limit, as a share of the servo's."""
    tolerance_rad: float = 0.05
    """A joint that comes to rest farther from its command did not arrive."""
    at_end: AtEnd = "off"
    """The torque after a stop and at rest."""
    end_with_parent: bool = True
    """Whether the end of the process that started this one stops the robot."""
    rest: Mapping[str, float] = field(default_factory=dict)
    """A posture to go to before torque is taken off, where nothing failed."""


def load_config(file: str | os.PathLike[str], nominal: Nominal, make: Make = "dynamixel") -> ServoConfig:
    """Reads the file of a robot of this make against the nominal robot. Raises `MirrorPostureError`: the
    key, what was given, what was required.

    See docs/robots.md for its keys.
    """
    file = Path(file)
    text = given_text(file, "the servos' TOML file")
    try:
        raw = parse_toml(text)
    except ValueError as error:
        raise MirrorPostureError(f"{file}: cannot be read: {error}") from None
    for key in raw:
        if key not in ("bus", "rest", "joints"):
            raise MirrorPostureError(f"{file}: {key}: is no key of this file; there are bus, joints, rest")
    given = _table(raw, "bus", file)
    bus = _read(given, BUS[make], file, "bus")
    if make == "dynamixel" and ("current_a" in given) == ("pwm_share" in given):
        raise MirrorPostureError(
            f"{file}: [bus] needs exactly one torque limit: current_a (A) for servos with current control, or pwm_share (0 to 1)"
        )
    servos = _servos(_table(raw, "joints", file), file, nominal, make)
    limits = {servo.joint: servo.limits for servo in servos}
    rest = {}
    resting = raw.get("rest", {})
    if not isinstance(resting, dict):
        raise MirrorPostureError(f"{file}: rest: got {resting!r}, needed a table of joint positions (rad)")
    for joint, value in resting.items():
        if joint not in limits or not limits[joint].holds(_number(value, file, f"rest.{joint}")):
            raise MirrorPostureError(
                f"{file}: rest.{joint}: got {value!r}, needed a position within the limits of a joint of [joints]"
            )
        rest[joint] = float(value)
    config = ServoConfig(servos=servos, rest=rest, **bus)
    speed, acceleration = STEPS[make]
    if config.speed_rad_per_s < speed or config.acceleration_rad_per_s2 < acceleration:
        raise MirrorPostureError(
            f"{file}: speed_rad_per_s {config.speed_rad_per_s:g} or acceleration_rad_per_s2 {config.acceleration_rad_per_s2:g} is "
            f"below a servo's step ({speed:.3g}, {acceleration:.3g}), and 0 would mean no limit"
        )
    return config


def _servos(joints: Mapping[str, Any], file: Path, nominal: Nominal, make: Make) -> tuple[Servo, ...]:
    servos: list[Servo] = []
    for joint, given in joints.items():
        place = f"joints.{joint}"
        _refuse_not_turned(joint, f"{file}: {place}", nominal)
        if not isinstance(given, dict):
            raise MirrorPostureError(f"{file}: {place}: needed a table with `id`, `zero_counts`, `direction`")
        servo_keys = _read(given, SERVO[make], file, place)
        if servo_keys["id"] in [servo.servo_id for servo in servos]:
            raise MirrorPostureError(
                f"{file}: {place}.id: got {given['id']}, needed {SERVO[make].key('id').needed}"
            )
        model = nominal.joint_limits[joint]
        lower, upper = (
            end if servo_keys[key] is None else servo_keys[key]
            for key, end in (("lower_rad", model.lower), ("upper_rad", model.upper))
        )
        for key, value in (("lower_rad", lower), ("upper_rad", upper)):
            _number(value, file, f"{place}.{key}")
        limits = JointLimits(max(lower, model.lower), min(upper, model.upper))
        if limits.lower > limits.upper:
            raise MirrorPostureError(f"{file}: {place}: nothing is left between lower_rad and upper_rad")
        counts = servo_keys["counts_per_turn"]
        servo = Servo(
            joint,
            servo_keys["id"],
            servo_keys["zero_counts"],
            servo_keys["direction"],
            limits,
            counts,
            servo_keys.get("reversed", False),
            servo_keys["model"],
            servo_keys["firmware"],
            servo_keys.get("homing_offset"),
        )
        try:
            ends = sorted(servo.counts(x) for x in (limits.lower, limits.upper))
            known, told = 0 <= ends[0] and ends[1] < counts, f"{ends[0]:.6g} to {ends[1]:.6g}"
        # Beyond any integer or double.
        except OverflowError:
            known, told = False, f"at {limits.lower:g} and {limits.upper:g} rad, too many"
        if not known:
            raise MirrorPostureError(
                f"{file}: {place}: its limits are {told} counts, and a servo in position control knows 0 to "
                f"{counts - 1}; correct zero_counts or narrow lower_rad and upper_rad"
            )
        servos.append(servo)
    if not servos:
        raise MirrorPostureError(f"{file}: [joints] is empty; needed a table [joints.NAME] for each servo")
    return tuple(servos)


def _refuse_not_turned(joint: str, place: str, nominal: Nominal) -> None:
    """Raises `MirrorPostureError` for a joint that no servo of this file can move by an angle of its own."""
    robot = nominal.robot
    found = next((one for one in robot.joints if one.name == joint), None)
    turning = [j.name for j in robot.joints if j.name in robot.position_names and j.kind != "prismatic"]
    if found is None:
        raise MirrorPostureError(f"{place}: the URDF has no such joint; it has {', '.join(turning)}")
    if found.position is None:
        raise MirrorPostureError(
            f"{place}: is a fixed joint in the URDF; needed one of {', '.join(turning)}; leave it out, or give it an axis in the URDF"
        )
    if joint not in robot.position_names:
        raise MirrorPostureError(
            f"{place}: follows {robot.position_names[found.position]} by <mimic> in the URDF and has no command of its own; leave it "
            f"out, or take <mimic> out of the URDF where a servo of its own moves it"
        )
    if found.kind == "prismatic":
        # Metres would be taken for radians: 0.1 m as 6°.
        raise MirrorPostureError(
            f"{place}: slides, and a servo's counts are angles: its position in m would be taken as rad; leave it out (it stays where it "
            f"is), or drive it with a class of your own (--robot-class MODULE:CLASS); servos turn {', '.join(turning)}"
        )


def _read(given: Mapping[str, Any], section: Section, file: Path, place: str) -> dict[str, Any]:
    """All keys of a section by name. A misspelt limit must not be a limit that is silently not there: a key that is none is refused too."""
    if wrong := list(problems(section, given, place)):
        raise MirrorPostureError(f"{file}: {'; '.join(wrong)}")
    return {key.name: key.read(given[key.name]) if key.name in given else key.default for key in section.keys}


def _table(raw: Mapping[str, Any], key: str, file: Path) -> dict[str, Any]:
    found = raw.get(key)
    if not isinstance(found, dict):
        raise MirrorPostureError(f"{file}: the section [{key}] is missing")
    return found


def _number(value: object, file: Path, place: str) -> float:
    number = finite(value)
    if number is None:
        raise MirrorPostureError(f"{file}: {place}: got {value!r}, needed a finite number")
    return number
