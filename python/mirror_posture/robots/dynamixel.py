"""Dynamixel servos of the X series, protocol 2.0: their registers, and the conditions before torque.

Needs the extra `dynamixel` (the vendor's SDK). A TOML file says which servo is which joint, see
docs/robots.md. Source of registers, models and units: the vendor's e-Manual, X series.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from .._core import MirrorPostureError
from .errors import HardwareFaultError
from .servo_config import (
    ACCELERATION_UNIT_RAD_PER_S2,
    SPEED_UNIT_RAD_PER_S,
    Servo,
    ServoConfig,
)
from .servo_drive import Identity, ServoDrive
from .servo_line import Register, Sdk, ServoLine
from .servo_robot import ServoRobot

try:
    import dynamixel_sdk
except ImportError:
    raise MirrorPostureError(
        "the Dynamixel SDK is not installed; install the extra: pip install 'mirror-posture[dynamixel]'"
    ) from None

FIRMWARE = Register("firmware version", 6, 1)
DRIVE_MODE = Register("drive mode", 10, 1)
OPERATING_MODE = Register("operating mode", 11, 1)
SECONDARY_ID = Register("secondary id", 12, 1)
MAX_POSITION = Register("max position limit", 48, 4, True)
MIN_POSITION = Register("min position limit", 52, 4, True)
STARTUP = Register("startup configuration", 60, 1)
TORQUE_ENABLE = Register("torque enable", 64, 1)
HARDWARE_ERROR = Register("hardware error status", 70, 1)
BUS_WATCHDOG = Register("bus watchdog", 98, 1)
GOAL_PWM = Register("goal PWM", 100, 2, True)
GOAL_CURRENT = Register("goal current", 102, 2, True)
PROFILE_ACCELERATION = Register("profile acceleration", 108, 4)
PROFILE_VELOCITY = Register("profile velocity", 112, 4)
GOAL_POSITION = Register("goal position", 116, 4, True)
PRESENT_VELOCITY = Register("present velocity", 128, 4, True)
PRESENT_POSITION = Register("present position", 132, 4, True)

POSITION_CONTROL = 3
CURRENT_BASED_POSITION_CONTROL = 5
REVERSE, SLAVE, TIME_BASED, TORQUE_BY_GOAL = 1, 2, 4, 8
"""Bits of the drive mode."""
TORQUE_AT_STARTUP = 1
"""Bit of the startup configuration."""
NO_SECONDARY_ID = 253
"""From here on the secondary id is none."""
OLDEST_FIRMWARE = 38
"""Below it there is no bus watchdog."""
STARTUP_FIRMWARE = 45
"""Below it there is no startup configuration, and no torque by goal."""

PWM_COUNTS = 885
"""Full PWM, 100 %."""

HARDWARE_FAULTS = {
    0: "input voltage",
    2: "overheating",
    3: "motor encoder",
    4: "electrical shock",
    5: "overload",
}
GARBLED = 3
"""A servo's answer to a packet whose check sum is wrong."""


@dataclass(frozen=True)
class Model:
    """A model of the series."""

    name: str
    current_unit_a: float | None
    """None: it cannot limit its current."""


_M, _L = 0.00269, 0.001
MODELS = {
    number: Model(name, unit)
    for number, name, unit in (
        (1000, "XH430-W350", _M),
        (1010, "XH430-W210", _M),
        (1020, "XM430-W350", _M),
        (1030, "XM430-W210", _M),
        (1040, "XH430-V350", _M),
        (1050, "XH430-V210", _M),
        (1060, "XL430-W250", None),
        (1070, "XC430-W150", None),
        (1080, "XC430-W240", None),
        (1090, "2XL430-W250", None),
        (1100, "XH540-W270", _M),
        (1110, "XH540-W150", _M),
        (1120, "XM540-W270", _M),
        (1130, "XM540-W150", _M),
        (1140, "XH540-V270", _M),
        (1150, "XH540-V150", _M),
        (1160, "2XC430-W250", None),
        (1170, "XW540-T260", _M),
        (1180, "XW540-T140", _M),
        (1190, "XL330-M077", _L),
        (1200, "XL330-M288", _L),
        (1210, "XC330-T181", _L),
        (1220, "XC330-T288", _L),
        (1230, "XC330-M181", _L),
        (1240, "XC330-M288", _L),
        (1270, "XW430-T333", _M),
        (1280, "XW430-T200", _M),
    )
}
"""By model number; current units in A."""


class DynamixelDrive(ServoDrive):
    """X series."""

    make = "Dynamixel"
    torque, goal = TORQUE_ENABLE, GOAL_POSITION
    position, speed, fault = PRESENT_POSITION, PRESENT_VELOCITY, HARDWARE_ERROR
    watchdog, watchdog_unit_s = BUS_WATCHDOG, 0.02
    still_units = 1
    speed_unit_rad_per_s = SPEED_UNIT_RAD_PER_S
    standing = (DRIVE_MODE, OPERATING_MODE, SECONDARY_ID)
    position_limits = (MIN_POSITION, MAX_POSITION)
    faults = HARDWARE_FAULTS

    def __init__(self, config: ServoConfig) -> None:
        packets = dynamixel_sdk.PacketHandler(2.0)
        sdk = Sdk(
            module=dynamixel_sdk,
            packets=packets,
            payload_bytes=lambda packet: packet[5] + 256 * packet[6] - 4,
            garbled=lambda error: error & 0x7F == GARBLED,
            # The highest bit only says that the hardware error status is not 0, which is read elsewhere.
            refused=lambda error: packets.getRxPacketError(error & 0x7F) if error & 0x7F else "",
        )
        super().__init__(config, ServoLine(sdk, config.port, config.baudrate))

    def verify(self, servo: Servo, model_number: int) -> Identity:
        """Model, firmware, drive mode, operating mode, start-up; see docs/robots.md."""
        who, config, line = f"{servo.joint} (servo {servo.servo_id})", self.config, self.line
        model = MODELS.get(model_number)
        if model is None:
            raise HardwareFaultError(
                f"{who}: model number {model_number} is not known; known are {', '.join(m.name for m in MODELS.values())}"
            )
        firmware = line.read(servo.servo_id, FIRMWARE)
        if firmware < OLDEST_FIRMWARE:
            raise HardwareFaultError(
                f"{who}: {model.name} has firmware {firmware}, needed {OLDEST_FIRMWARE} or later, which stops by itself when the "
                "line is cut; update it"
            )
        if config.current_a is not None:
            if model.current_unit_a is None:
                raise HardwareFaultError(
                    f"{who}: {model.name} cannot limit its current; give pwm_share in place of current_a"
                )
            if config.current_unit_a is not None and config.current_unit_a != model.current_unit_a:
                raise HardwareFaultError(
                    f"{who}: {model.name} counts current in {model.current_unit_a:g} A, and current_unit_a says "
                    f"{config.current_unit_a:g}; leave it out"
                )
        mode = line.read(servo.servo_id, DRIVE_MODE)
        if mode & SLAVE:
            raise HardwareFaultError(
                f"{who}: is the slave of a dual joint (drive mode {mode}); name its master"
            )
        if bool(mode & REVERSE) != servo.reversed:
            raise HardwareFaultError(
                f"{who}: drive mode {mode} {'turns' if mode & REVERSE else 'does not turn'} its positive sense round, and the "
                f"file says reversed = {str(servo.reversed).lower()}: it would go the wrong way. Correct the file, or the servo"
            )
        if firmware >= STARTUP_FIRMWARE:
            startup = line.read(servo.servo_id, STARTUP)
            self._set(servo, STARTUP, startup & ~TORQUE_AT_STARTUP, "no torque after a dip of its power")
        self._set(
            servo,
            DRIVE_MODE,
            mode & ~(TIME_BASED | TORQUE_BY_GOAL),
            "its profile is a speed, not a time, and a goal alone puts no torque on",
        )
        by_current = config.current_a is not None
        self._set(
            servo,
            OPERATING_MODE,
            CURRENT_BASED_POSITION_CONTROL if by_current else POSITION_CONTROL,
            "position control within a torque limit",
            usual=True,
        )
        secondary = line.read(servo.servo_id, SECONDARY_ID)
        if secondary < NO_SECONDARY_ID and secondary in self.ids:
            raise HardwareFaultError(
                f"{who}: also obeys to id {secondary} (secondary id), which is another joint's; set it to 255"
            )
        return Identity(model.name, str(firmware))

    def limits(self, servo: Servo) -> dict[Register, int]:
        """Profile and torque; rounded down: a limit is never exceeded."""
        config = self.config
        found = {
            # 0 would mean no limit.
            PROFILE_ACCELERATION: max(
                1, math.floor(config.acceleration_rad_per_s2 / ACCELERATION_UNIT_RAD_PER_S2)
            ),
            PROFILE_VELOCITY: max(1, math.floor(config.speed_rad_per_s / SPEED_UNIT_RAD_PER_S)),
        }
        if config.current_a is not None:
            unit = next(
                m.current_unit_a
                for m in MODELS.values()
                if m.name == self._model_of(servo) and m.current_unit_a
            )
            found[GOAL_CURRENT] = max(1, math.floor(config.current_a / unit))
        elif config.pwm_share is not None:
            found[GOAL_PWM] = max(1, math.floor(config.pwm_share * PWM_COUNTS))
        return found

    def _model_of(self, servo: Servo) -> str:
        return self.identities[servo.servo_id].model


class DynamixelRobot(ServoRobot):
    """A robot of Dynamixel servos; see `ServoRobot`."""

    make = "dynamixel"
    drive = DynamixelDrive
