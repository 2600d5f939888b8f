"""The TOML file of a Dynamixel robot: which servo is which joint, where its zero is, how fast and how strong it may be."""

from __future__ import annotations

import math
import os
import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from .._core import MirrorPostureError
from .nominal import Nominal
from .protocol import JointLimits

if sys.version_info >= (3, 11):
    import tomllib
else:  # pragma: no cover
    import tomli as tomllib

COUNTS_PER_TURN = 4096
SPEED_UNIT_RAD_PER_S = 0.229 * 2.0 * math.pi / 60.0
ACCELERATION_UNIT_RAD_PER_S2 = 214.577 * 2.0 * math.pi / 3600.0
CURRENT_UNIT_A = 0.00269
"""Of the XM and XH series; XL330 and XC330 have 0.001."""
PWM_COUNTS = 885
"""Full PWM, 100 %."""
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

    def counts(self, position_rad: float) -> int:
        """The servo's position for a joint position."""
        turn = self.direction * position_rad * self.counts_per_turn / (2.0 * math.pi)
        return self.zero_counts + round(turn)

    def position_rad(self, counts: int) -> float:
        """The joint's position for a servo's."""
        return self.direction * (counts - self.zero_counts) * 2.0 * math.pi / self.counts_per_turn


@dataclass(frozen=True)
class DynamixelConfig:
    """All that the file says."""

    port: str
    servos: tuple[Servo, ...]
    baudrate: int = 1_000_000
    speed_rad_per_s: float = 0.5
    acceleration_rad_per_s2: float = 5.0
    current_a: float | None = None
    """The torque limit, as motor current: position control limited by current."""
    pwm_share: float | None = None
    """The torque limit of servos without current control, as a share of the supply: exactly one of the two is given."""
    current_unit_a: float = CURRENT_UNIT_A
    tolerance_rad: float = 0.05
    """A joint that comes to rest farther from its command did not arrive."""
    rest: Mapping[str, float] = field(default_factory=dict)
    """A posture to go to before torque is taken off, where nothing failed."""

    @property
    def speed_units(self) -> int:
        """The profile velocity to write; never 0, which a servo takes for no limit."""
        return round(self.speed_rad_per_s / SPEED_UNIT_RAD_PER_S)

    @property
    def acceleration_units(self) -> int:
        """The profile acceleration to write; never 0."""
        return round(self.acceleration_rad_per_s2 / ACCELERATION_UNIT_RAD_PER_S2)


def load_config(file: str | os.PathLike[str], nominal: Nominal) -> DynamixelConfig:
    """Reads the file against the nominal robot. Raises `MirrorPostureError`: the key, what was got, what was needed.

    See docs/robots.md for its keys.
    """
    file = Path(file)
    try:
        raw = tomllib.loads(file.read_text(encoding="utf-8-sig"))
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise MirrorPostureError(f"{file}: cannot be read: {error}") from None
    bus = _table(raw, "bus", file)
    known = {
        "port",
        "baudrate",
        "speed_rad_per_s",
        "acceleration_rad_per_s2",
        "current_a",
        "pwm_share",
        "current_unit_a",
        "tolerance_rad",
    }
    _no_others(bus, known, file, "bus")
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
    if ("current_a" in bus) == ("pwm_share" in bus):
        raise MirrorPostureError(
            f"{file}: [bus] needs exactly one torque limit: current_a (A) for servos with current control, or pwm_share (0 to 1)"
        )
    numbers = {
        key: _number(bus[key], file, f"bus.{key}") for key in known - {"port", "baudrate"} if key in bus
    }
    servos = _servos(_table(raw, "joints", file), file, nominal)
    limits = {servo.joint: servo.limits for servo in servos}
    rest = {}
    for joint, value in raw.get("rest", {}).items():
        if joint not in limits or not limits[joint].holds(_number(value, file, f"rest.{joint}", signed=True)):
            raise MirrorPostureError(
                f"{file}: rest.{joint}: got {value!r}, needed a position within the limits of a joint of [joints]"
            )
        rest[joint] = float(value)
    config = DynamixelConfig(port, servos, baudrate, rest=rest, **numbers)  # type: ignore[arg-type]
    if config.speed_units < 1 or config.acceleration_units < 1:
        raise MirrorPostureError(
            f"{file}: speed_rad_per_s {config.speed_rad_per_s:g} or acceleration_rad_per_s2 {config.acceleration_rad_per_s2:g} is "
            f"below a servo's step ({SPEED_UNIT_RAD_PER_S:.3f}, {ACCELERATION_UNIT_RAD_PER_S2:.3f}), and 0 would mean no limit"
        )
    if config.pwm_share is not None and config.pwm_share > 1.0:
        raise MirrorPostureError(
            f"{file}: bus.pwm_share: got {config.pwm_share:g}, needed a share from 0 to 1"
        )
    return config


def _servos(joints: Mapping[str, Any], file: Path, nominal: Nominal) -> tuple[Servo, ...]:
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
            {"id", "zero_counts", "direction", "lower_rad", "upper_rad", "counts_per_turn"},
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
        servo = Servo(joint, given["id"], given["zero_counts"], given["direction"], limits, counts)
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
