"""Feetech servos of the STS series (STS3215, the servos of SO-101 arms): their registers, and the
conditions before torque.

Needs the extra `feetech` (the SDK that LeRobot uses too, so that both can be installed). A TOML file says
which servo is which joint, see docs/robots.md. Source of registers and units: the vendor's memory table of
the SMS and STS series.

These servos have no watchdog: they get goals a little ahead of their position, so that a cut line ends a
motion here as well.
"""

from __future__ import annotations

import math

from .._core import MirrorPostureError
from .errors import HardwareFaultError
from .servo_config import STS_ACCELERATION_UNIT_RAD_PER_S2, STS_STEP_RAD, Servo, ServoConfig
from .servo_drive import Identity, ServoDrive
from .servo_line import Register, Sdk, ServoLine
from .servo_robot import ServoRobot

try:
    import scservo_sdk
except ImportError:
    raise MirrorPostureError(
        "Feetech's SDK is not installed; install the extra: pip install 'mirror-posture[feetech]'"
    ) from None

if not hasattr(scservo_sdk, "PacketHandler"):  # pragma: no cover
    raise MirrorPostureError(
        "another package has the name scservo_sdk (ftservo-python-sdk?); pip uninstall it, then pip install feetech-servo-sdk"
    )

FIRMWARE_MAJOR = Register("firmware major version", 0, 1)
FIRMWARE_MINOR = Register("firmware minor version", 1, 1)
MIN_ANGLE = Register("min angle limit", 9, 2)
MAX_ANGLE = Register("max angle limit", 11, 2)
PHASE = Register("phase", 18, 1)
HOMING_OFFSET = Register("homing offset", 31, 2, sign_bit=11)
MODE = Register("operating mode", 33, 1)
TORQUE_SWITCH = Register("torque switch", 40, 1)
ACCELERATION = Register("acceleration", 41, 1)
GOAL_POSITION = Register("goal position", 42, 2, sign_bit=15)
GOAL_TIME = Register("goal time", 44, 2)
GOAL_SPEED = Register("goal speed", 46, 2, sign_bit=15)
TORQUE_LIMIT = Register("torque limit", 48, 2)
LOCK = Register("lock", 55, 1)
PRESENT_POSITION = Register("present position", 56, 2, sign_bit=15)
PRESENT_SPEED = Register("present speed", 58, 2, sign_bit=15)
STATUS = Register("status", 65, 1)

POSITION_MODE = 0
FINE_SPEED, MULTI_TURN = 4, 16
"""Bits of the phase, one set where speeds are written and read in units of 1 step/s instead of 50, the other for angles of
several turns."""
COARSE_STEPS = 50
FULL_TORQUE = 1000
LARGEST_ACCELERATION = 254

MODELS = {777: "STS3215", 2825: "STS3250"}
"""By model number."""

FAULTS = {0: "input voltage", 1: "magnetic encoder", 2: "overheating", 3: "overcurrent", 5: "overload"}


class FeetechDrive(ServoDrive):
    """STS series."""

    make = "Feetech"
    torque, goal = TORQUE_SWITCH, GOAL_POSITION
    position, speed, fault = PRESENT_POSITION, PRESENT_SPEED, STATUS
    still_units = 2
    speed_unit_rad_per_s = STS_STEP_RAD
    standing = (PHASE, HOMING_OFFSET, MODE)
    position_limits = (MIN_ANGLE, MAX_ANGLE)
    faults = FAULTS

    def __init__(self, config: ServoConfig) -> None:
        sdk = Sdk(
            module=scservo_sdk,
            packets=scservo_sdk.PacketHandler(0),
            payload_bytes=lambda packet: packet[3] - 2,
            # The error byte is the servo's status, which is read where it is dealt with.
            garbled=lambda error: False,
            refused=lambda error: "",
        )
        self._speed_steps: dict[int, int] = {}
        super().__init__(config, ServoLine(sdk, config.port, config.baudrate))

    def verify(self, servo: Servo, model_number: int) -> Identity:
        """Model, firmware, mode, unit of speed, homing offset; see docs/robots.md."""
        who, line, i = f"{servo.joint} (servo {servo.servo_id})", self.line, servo.servo_id
        model = MODELS.get(model_number)
        if model is None:
            raise HardwareFaultError(
                f"{who}: model number {model_number} is not known; known are "
                f"{', '.join(f'{name} ({number})' for number, name in MODELS.items())}"
            )
        firmware = f"{line.read(i, FIRMWARE_MAJOR)}.{line.read(i, FIRMWARE_MINOR)}"
        phase = line.read(i, PHASE)
        if phase & MULTI_TURN:
            raise HardwareFaultError(f"{who}: counts several turns (phase {phase}); set it to one turn")
        # The bit decides the meaning of the same number: a factor of 50.
        self._speed_steps[i] = 1 if phase & FINE_SPEED else COARSE_STEPS
        offset = line.read(i, HOMING_OFFSET)
        if servo.homing_offset is not None and offset != servo.homing_offset:
            raise HardwareFaultError(
                f"{who}: homing offset is {offset}, and the file says {servo.homing_offset}: its zero is not where zero_counts "
                "says; calibrate it again, or correct the file"
            )
        if line.read(i, MODE) != POSITION_MODE:
            # Only an unlocked memory keeps a mode.
            line.write(i, LOCK, 0)
            self._set(servo, MODE, POSITION_MODE, "position control", usual=True)
        line.write(i, LOCK, 1)
        return Identity(model, firmware)

    def limits(self, servo: Servo) -> dict[Register, int]:
        """Speed, acceleration, torque; rounded down: a limit is never exceeded, and 0 would mean none."""
        steps_per_s = self.config.speed_rad_per_s / STS_STEP_RAD
        speed = math.floor(steps_per_s / self._speed_steps[servo.servo_id])
        acceleration = math.floor(self.config.acceleration_rad_per_s2 / STS_ACCELERATION_UNIT_RAD_PER_S2)
        share = self.config.torque_share
        if speed < 1 or acceleration < 1 or share is None:
            raise HardwareFaultError(
                f"{servo.joint} (servo {servo.servo_id}): speed_rad_per_s {self.config.speed_rad_per_s:g} is below this servo's step "
                f"({self._speed_steps[servo.servo_id] * STS_STEP_RAD:.4f} rad/s), and 0 would mean no limit"
            )
        return {
            ACCELERATION: min(acceleration, LARGEST_ACCELERATION),
            # A time would replace the speed.
            GOAL_TIME: 0,
            GOAL_SPEED: speed,
            TORQUE_LIMIT: max(1, math.floor(share * FULL_TORQUE)),
            LOCK: 1,
        }

    def speed_unit_of(self, servo_id: int) -> float:
        """rad/s of one unit of present speed, according to the phase."""
        return STS_STEP_RAD * self._speed_steps[servo_id]


class FeetechRobot(ServoRobot):
    """A robot of Feetech servos; see `ServoRobot`."""

    make = "feetech"
    drive = FeetechDrive
