"""The properties of a make of servos: its registers, the conditions before torque, its limits.

`ServoRobot` uses every make in the same way; nothing here decides when torque goes on or off.
"""

from __future__ import annotations

import logging
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from .errors import HardwareFaultError
from .servo_config import Servo, ServoConfig
from .servo_line import Register, ServoLine

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Identity:
    """The identity that a servo reports."""

    model: str
    firmware: str


@dataclass(frozen=True)
class Reading:
    """The readings of all servos at one moment, by id."""

    position: Mapping[int, int]
    speed: Mapping[int, int]
    goal: Mapping[int, int]
    torque: Mapping[int, bool]
    fault: Mapping[int, int]
    limits: Mapping[int, Mapping[Register, int]]
    watchdog: Mapping[int, int]
    """Empty where the make has none."""


class ServoDrive(ABC):
    """A make of servos. A subclass fills in the registers and defines `verify` and `limits`."""

    make: str
    torque: Register
    goal: Register
    position: Register
    speed: Register
    fault: Register
    watchdog: Register | None = None
    """The register of the watchdog: a servo without communication for this long stops by itself."""
    watchdog_unit_s: float = 0.0
    watchdog_bitten: int = 255
    still_units: int
    """Of `speed`: a servo at rest reads no more."""
    speed_unit_rad_per_s: float
    """Of `speed`, unless `speed_unit_of` returns another for a servo."""
    standing: Sequence[Register]
    """Lasting settings that decide what goals and limits mean; read again before every motion."""
    position_limits: tuple[Register, Register]
    faults: Mapping[int, str]
    """The meaning of each bit of `fault`."""

    def __init__(self, config: ServoConfig, line: ServoLine) -> None:
        self.config, self.line = config, line
        self.ids = [servo.servo_id for servo in config.servos]
        self.identities: dict[int, Identity] = {}
        self._wanted: dict[int, dict[Register, int]] = {}
        self._settings: dict[int, dict[Register, int]] = {}

    # The part that a make defines.

    @abstractmethod
    def verify(self, servo: Servo, model_number: int) -> Identity:
        """Checks model, firmware and lasting settings with the torque off, and sets what may be set.

        Raises `HardwareFaultError` for a servo that must not get torque.
        """

    @abstractmethod
    def limits(self, servo: Servo) -> dict[Register, int]:
        """What must be in force before torque, and at every moment of it: speed, acceleration, torque."""

    # What follows from it.

    def fault_words(self, status: int) -> str:
        """The meaning of a servo's fault status."""
        words = ", ".join(word for bit, word in self.faults.items() if status & (1 << bit))
        return words or f"{self.fault.name} {status}"

    def prepare(self) -> None:
        """From unknown servos to servos without torque whose limits are in force. Raises `RobotError`s."""
        numbers = {servo.servo_id: self.line.ping(servo.servo_id) for servo in self.config.servos}
        self.line.write_everywhere(self.torque, 0)
        for servo in self.config.servos:
            # The ends of a servo's range and its mode are not reliable, and cannot be written, under torque.
            self.line.write(servo.servo_id, self.torque, 0)
            if self.watchdog is not None:
                self.line.write(servo.servo_id, self.watchdog, 0)
            identity = self.verify(servo, numbers[servo.servo_id])
            self._check_identity(servo, identity)
            self._check_range(servo)
            self.identities[servo.servo_id] = identity
            # Only when the servo's identity is known.
            self._wanted[servo.servo_id] = self.limits(servo)
            for register, value in self._wanted[servo.servo_id].items():
                self.line.write(servo.servo_id, register, value)
        self._settings = self.line.read_block(self.standing, self.ids)

    def read(self) -> Reading:
        """All relevant readings of all servos, each requested once."""
        limits = {r for wanted in self._wanted.values() for r in wanted}
        registers = [self.torque, self.goal, self.position, self.speed, self.fault, *limits]
        if self.watchdog is not None:
            registers.append(self.watchdog)
        found = self.line.read_block(registers, self.ids)

        def of(register: Register) -> dict[int, int]:
            return {servo_id: values[register] for servo_id, values in found.items()}

        return Reading(
            position=of(self.position),
            speed=of(self.speed),
            goal=of(self.goal),
            torque={servo_id: bool(on) for servo_id, on in of(self.torque).items()},
            fault=of(self.fault),
            limits={i: {r: values[r] for r in self._wanted.get(i, {})} for i, values in found.items()},
            watchdog={} if self.watchdog is None else of(self.watchdog),
        )

    def check(self, reading: Reading, *, torque: bool) -> None:
        """Raises `HardwareFaultError` for a fault, a limit that is not in force, a torque that went off by itself."""
        told = []
        for servo in self.config.servos:
            i = servo.servo_id
            if reading.fault[i]:
                told.append(f"{_who(servo)}: {self.fault_words(reading.fault[i])}")
            told += [
                f"{_who(servo)}: {r.name} is {reading.limits[i][r]} instead of {value}: it was reset (a dip of its power?)"
                for r, value in self._wanted[i].items()
                if reading.limits[i][r] != value
            ]
            if torque and not reading.torque[i] and not reading.fault[i]:
                told.append(f"{_who(servo)}: its torque went off by itself (a dip of its power?)")
        if told:
            raise HardwareFaultError("; ".join(told))

    def check_settings(self) -> None:
        """Raises `HardwareFaultError` if a permanent setting has changed since it was verified."""
        found = self.line.read_block(self.standing, self.ids)
        for servo in self.config.servos:
            for register, was in self._settings[servo.servo_id].items():
                if (now := found[servo.servo_id][register]) != was:
                    raise HardwareFaultError(
                        f"{_who(servo)}: {register.name} is {now} and was {was} when it was verified: another program writes to "
                        "this line, or the servo was exchanged"
                    )

    def speed_unit_of(self, servo_id: int) -> float:
        """rad/s of one unit of this servo's present speed."""
        return self.speed_unit_rad_per_s

    def watch(self, seconds: float) -> None:
        """Sets the servos' own watchdogs; 0 s has them sleep. Nothing to do for a make without."""
        if self.watchdog is not None:
            counts = round(seconds / self.watchdog_unit_s)
            self.line.write_all(self.watchdog, dict.fromkeys(self.ids, counts))

    def _check_identity(self, servo: Servo, found: Identity) -> None:
        for what, wanted, is_ in (
            ("model", servo.model, found.model),
            ("firmware", servo.firmware, found.firmware),
        ):
            if wanted is not None and wanted.lower() != is_.lower():
                raise HardwareFaultError(
                    f"{_who(servo)}: {what} is {is_}, and the file says {wanted}; is it the servo that is meant?"
                )

    def _check_range(self, servo: Servo) -> None:
        lower, upper = (self.line.read(servo.servo_id, r) for r in self.position_limits)
        ends = sorted(servo.counts(x) for x in (servo.limits.lower, servo.limits.upper))
        if ends[0] < lower or ends[1] > upper:
            raise HardwareFaultError(
                f"{_who(servo)}: its own position limits are {lower} to {upper} counts, and the joint's limits {ends[0]} to "
                f"{ends[1]}: goals would be refused. Narrow lower_rad and upper_rad, or set the servo's"
            )

    def _set(self, servo: Servo, register: Register, value: int, why: str, *, usual: bool = False) -> None:
        """Changes a permanent setting, and logs it; as a warning if it is not `usual`."""
        was = self.line.read(servo.servo_id, register)
        if was != value:
            self.line.write(servo.servo_id, register, value)
            level = logging.INFO if usual else logging.WARNING
            log.log(level, "%s: %s was %d and is %d now: %s", _who(servo), register.name, was, value, why)


def _who(servo: Servo) -> str:
    return f"{servo.joint} (servo {servo.servo_id})"
