"""The TOML file of a robot of servos: which servo is which joint, where its zero is, how fast and how strong it may be."""

from __future__ import annotations

import math
import os
import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from .._core import MirrorPostureError
from ..input_files import given_text
from .nominal import Nominal
from .protocol import JointLimits
from .servo_state import AtEnd

if sys.version_info >= (3, 11):
    import tomllib
else:  # pragma: no cover
    import tomli as tomllib

Make = Literal["dynamixel", "feetech"]
COUNTS_PER_TURN = 4096
SPEED_UNIT_RAD_PER_S = 0.229 * 2.0 * math.pi / 60.0
"""Dynamixel's, X series."""
ACCELERATION_UNIT_RAD_PER_S2 = 214.577 * 2.0 * math.pi / 3600.0
STS_STEP_RAD = 2.0 * math.pi / 4096
"""Feetech's, STS series: a step; its speeds count 1 step/s or 50."""
STS_ACCELERATION_UNIT_RAD_PER_S2 = 100.0 * STS_STEP_RAD
STEPS = {
    "dynamixel": (SPEED_UNIT_RAD_PER_S, ACCELERATION_UNIT_RAD_PER_S2),
    "feetech": (STS_STEP_RAD, STS_ACCELERATION_UNIT_RAD_PER_S2),
}
"""The smallest speed and acceleration that each make can be told, rad/s and rad/s²."""
LARGEST_ID = 252


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
    """What it must be, if the file says so; verified before torque."""
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
    """All that the file says."""

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


NUMBERS = ("speed_rad_per_s", "acceleration_rad_per_s2", "tolerance_rad")
TORQUE: dict[str, tuple[str, ...]] = {
    "dynamixel": ("current_a", "pwm_share", "current_unit_a"),
    "feetech": ("torque_share",),
}
OF_A_SERVO: dict[str, tuple[str, ...]] = {"dynamixel": ("reversed",), "feetech": ("homing_offset",)}


def load_config(file: str | os.PathLike[str], nominal: Nominal, make: Make = "dynamixel") -> ServoConfig:
    """Reads the file of a robot of this make against the nominal robot. Raises `MirrorPostureError`: the key, what was got, what was needed.

    See docs/robots.md for its keys.
    """
    file = Path(file)
    text = given_text(file, "the servos' TOML file")
    try:
        raw = tomllib.loads(text)
    # Very deep or odd documents fail below the parser with errors of Python's own.
    except (ValueError, RecursionError, OverflowError) as error:
        raise MirrorPostureError(f"{file}: cannot be read: {' '.join(str(error).split())}") from None
    bus = _table(raw, "bus", file)
    numbers_of = {*NUMBERS, *TORQUE[make]}
    _no_others(bus, {"port", "baudrate", "at_end", "end_with_parent", *numbers_of}, file, "bus")
    _no_others(raw, {"bus", "rest", "joints"}, file, "")
    port = bus.get("port")
    if not isinstance(port, str) or not port:
        raise MirrorPostureError(
            f'{file}: bus.port: got {port!r}, needed a serial line such as "/dev/ttyUSB0"'
        )
    baudrate = bus.get("baudrate", 1_000_000)
    if not isinstance(baudrate, int) or baudrate <= 0:
        raise MirrorPostureError(
            f"{file}: bus.baudrate: got {baudrate!r}, needed the bus's rate such as 1000000"
        )
    if make == "dynamixel" and ("current_a" in bus) == ("pwm_share" in bus):
        raise MirrorPostureError(
            f"{file}: [bus] needs exactly one torque limit: current_a (A) for servos with current control, or pwm_share (0 to 1)"
        )
    if make == "feetech" and "torque_share" not in bus:
        raise MirrorPostureError(f"{file}: [bus] needs a torque limit: torque_share (0 to 1)")
    numbers = {key: _number(bus[key], file, f"bus.{key}") for key in sorted(numbers_of) if key in bus}
    for key in ("pwm_share", "torque_share"):
        if numbers.get(key, 0.0) > 1.0:
            raise MirrorPostureError(f"{file}: bus.{key}: got {numbers[key]:g}, needed a share from 0 to 1")
    at_end, end_with_parent = bus.get("at_end", "off"), bus.get("end_with_parent", True)
    if at_end not in ("off", "hold"):
        raise MirrorPostureError(f'{file}: bus.at_end: got {at_end!r}, needed "off" or "hold"')
    if not isinstance(end_with_parent, bool):
        raise MirrorPostureError(
            f"{file}: bus.end_with_parent: got {end_with_parent!r}, needed true or false"
        )
    servos = _servos(_table(raw, "joints", file), file, nominal, make)
    limits = {servo.joint: servo.limits for servo in servos}
    rest = {}
    resting = raw.get("rest", {})
    if not isinstance(resting, dict):
        raise MirrorPostureError(f"{file}: rest: got {resting!r}, needed a table of joint positions (rad)")
    for joint, value in resting.items():
        if joint not in limits or not limits[joint].holds(_number(value, file, f"rest.{joint}", signed=True)):
            raise MirrorPostureError(
                f"{file}: rest.{joint}: got {value!r}, needed a position within the limits of a joint of [joints]"
            )
        rest[joint] = float(value)
    config = ServoConfig(
        port,
        servos,
        baudrate,
        at_end=at_end,
        end_with_parent=end_with_parent,
        rest=rest,
        **numbers,
    )
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
        if joint not in nominal.joint_limits:
            raise MirrorPostureError(
                f"{file}: {place}: the URDF has no such joint; it has {', '.join(nominal.joint_limits)}"
            )
        if not isinstance(given, dict):
            raise MirrorPostureError(f"{file}: {place}: needed a table with `id`, `zero_counts`, `direction`")
        _no_others(
            given,
            {
                *("id", "zero_counts", "direction", "lower_rad", "upper_rad", "counts_per_turn"),
                *("model", "firmware", *OF_A_SERVO[make]),
            },
            file,
            place,
        )
        for key in ("id", "zero_counts", "direction"):
            if not isinstance(given.get(key), int) or isinstance(given.get(key), bool):
                raise MirrorPostureError(
                    f"{file}: {place}.{key}: got {given.get(key)!r}, needed a whole number"
                )
        if given["direction"] not in (1, -1):
            raise MirrorPostureError(f"{file}: {place}.direction: got {given['direction']}, needed 1 or -1")
        if not 0 <= given["id"] <= LARGEST_ID or given["id"] in [servo.servo_id for servo in servos]:
            raise MirrorPostureError(
                f"{file}: {place}.id: got {given['id']}, needed 0 to {LARGEST_ID}, each only once"
            )
        counts = given.get("counts_per_turn", COUNTS_PER_TURN)
        if not isinstance(counts, int) or counts < 1:
            raise MirrorPostureError(
                f"{file}: {place}.counts_per_turn: got {counts!r}, needed a whole number above 0"
            )
        model = nominal.joint_limits[joint]
        lower = _number(given.get("lower_rad", model.lower), file, f"{place}.lower_rad", signed=True)
        upper = _number(given.get("upper_rad", model.upper), file, f"{place}.upper_rad", signed=True)
        limits = JointLimits(max(lower, model.lower), min(upper, model.upper))
        if limits.lower > limits.upper:
            raise MirrorPostureError(f"{file}: {place}: nothing is left between lower_rad and upper_rad")
        servo = Servo(
            joint,
            given["id"],
            given["zero_counts"],
            given["direction"],
            limits,
            counts,
            **{
                key: _typed(given[key], kind, file, f"{place}.{key}")
                for key, kind in OPTIONAL.items()
                if key in given
            },
        )
        ends = sorted(servo.counts(x) for x in (limits.lower, limits.upper))
        if ends[0] < 0 or ends[1] > counts - 1:
            raise MirrorPostureError(
                f"{file}: {place}: its limits are {ends[0]} to {ends[1]} counts, and a servo in position control knows 0 to "
                f"{counts - 1}; correct zero_counts or narrow lower_rad and upper_rad"
            )
        servos.append(servo)
    if not servos:
        raise MirrorPostureError(f"{file}: [joints] is empty; needed a table [joints.NAME] for each servo")
    return tuple(servos)


OPTIONAL: dict[str, type] = {"reversed": bool, "model": str, "firmware": str, "homing_offset": int}


def _typed(value: object, kind: type, file: Path, place: str) -> Any:
    words = {bool: "true or false", str: "a text", int: "a whole number"}
    if not isinstance(value, kind) or (kind is int and isinstance(value, bool)):
        raise MirrorPostureError(f"{file}: {place}: got {value!r}, needed {words[kind]}")
    return value


def _table(raw: Mapping[str, Any], key: str, file: Path) -> dict[str, Any]:
    found = raw.get(key)
    if not isinstance(found, dict):
        raise MirrorPostureError(f"{file}: the section [{key}] is missing")
    return found


def _no_others(table: Mapping[str, Any], known: set[str], file: Path, place: str) -> None:
    # A misspelt limit must not be a limit that is silently not there.
    for key in table:
        if key not in known:
            raise MirrorPostureError(
                f"{file}: {place + '.' if place else ''}{key}: is no key of this file; there are {', '.join(sorted(known))}"
            )


def _number(value: object, file: Path, place: str, *, signed: bool = False) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
        raise MirrorPostureError(f"{file}: {place}: got {value!r}, needed a finite number")
    if not signed and value <= 0.0:
        raise MirrorPostureError(f"{file}: {place}: got {value!r}, needed a number above 0")
    return float(value)
