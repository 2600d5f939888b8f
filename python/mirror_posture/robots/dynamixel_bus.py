"""A Dynamixel bus through the vendor's SDK: registers of many servos, every failure an error that says what it is.

Protocol 2.0, the X series' control table. The SDK gives result codes, raises what the serial line raises, and stays
"busy" after an exception: all of that ends here.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

from .._core import MirrorPostureError
from .errors import HardwareFaultError, LostRobotError

try:
    from dynamixel_sdk import (
        COMM_RX_CORRUPT,
        COMM_SUCCESS,
        GroupSyncRead,
        GroupSyncWrite,
        PacketHandler,
        PortHandler,
    )
except ImportError:
    raise MirrorPostureError(
        "the Dynamixel SDK is not installed; install the extra: pip install 'mirror-posture[dynamixel]'"
    ) from None

T = TypeVar("T")

BROADCAST_ID = 254
TRIES = 4
"""A packet that is lost or garbled is asked for again so often before the line counts as lost."""
GARBLED = 3
"""A servo's answer to a packet whose check sum is wrong."""
READ_WAIT_S = 0.002
"""The SDK polls without a pause; a short wait in each read leaves the processor to others."""
PATIENCE_MS = 80.0
"""Beyond the SDK's own 34 ms: USB converters and busy computers are late."""


QUIET_S = 0.03
"""After a lost answer the line is left quiet so long, and emptied: a late answer must not pass for that of the next question."""


@dataclass(frozen=True)
class Register:
    """A place in the control table."""

    name: str
    address: int
    size: int
    signed: bool = False


OPERATING_MODE = Register("operating mode", 11, 1)
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
WATCHDOG_UNIT_S = 0.02

HARDWARE_FAULTS = {
    0: "input voltage",
    2: "overheating",
    3: "motor encoder",
    4: "electrical shock",
    5: "overload",
}


def _patient_port(path: str) -> Any:
    """The SDK's port, with reads that wait a little and a longer patience."""

    class PatientPort(PortHandler):  # type: ignore[misc]
        def setPacketTimeout(self, packet_length: int) -> None:
            super().setPacketTimeout(packet_length)
            self.packet_timeout += PATIENCE_MS

        def setupPort(self, cflag_baud: int) -> bool:
            done = super().setupPort(cflag_baud)
            self.ser.timeout = READ_WAIT_S
            self.ser.write_timeout = 0.5
            return bool(done)

    return PatientPort(path)


class DynamixelBus:
    """Servos by id on one line. Methods raise `LostRobotError` and `HardwareFaultError`."""

    def __init__(self, port: str, baudrate: int) -> None:
        self.port = port
        self._port = _patient_port(port)
        self._packets = PacketHandler(2.0)
        self._port.baudrate = baudrate
        try:
            opened = self._port.openPort()
        except Exception as error:  # pyserial's own, and the operating system's
            raise LostRobotError(f"{port}: the serial line cannot be opened: {error}") from None
        if not opened:
            raise LostRobotError(
                f"{port}: the SDK does not know the rate {baudrate}; use 57600 or 1000000, say"
            )

    def close(self) -> None:
        """Closes the line; nothing is sent."""
        try:
            if self._port.ser is not None:
                self._port.closePort()
        except Exception:
            # A line that is gone is closed.
            return

    def ping(self, servo_id: int) -> int:
        """The servo's model number."""
        return self._ask(servo_id, "ping", lambda: self._packets.ping(self._port, servo_id))

    def read(self, servo_id: int, register: Register) -> int:
        """One register of one servo."""
        read = {
            1: self._packets.read1ByteTxRx,
            2: self._packets.read2ByteTxRx,
            4: self._packets.read4ByteTxRx,
        }[register.size]
        return _signed(
            self._ask(servo_id, register.name, lambda: read(self._port, servo_id, register.address)), register
        )

    def write(self, servo_id: int, register: Register, value: int, *, check: bool = True) -> None:
        """One register of one servo; `check` reads it back."""
        write = {
            1: self._packets.write1ByteTxRx,
            2: self._packets.write2ByteTxRx,
            4: self._packets.write4ByteTxRx,
        }[register.size]
        raw = value & (256**register.size - 1)

        def once() -> tuple[int, int, int]:
            result, error = write(self._port, servo_id, register.address, raw)
            return 0, result, error

        self._ask(servo_id, register.name, once)
        if check and (found := self.read(servo_id, register)) != value:
            raise HardwareFaultError(
                f"{self.port}: servo {servo_id}: {register.name} was set to {value} and reads {found}; is it of another series?"
            )

    def write_all(self, register: Register, values: Mapping[int, int]) -> None:
        """One register of many servos at the same moment; servos do not answer to it."""
        group = GroupSyncWrite(self._port, self._packets, register.address, register.size)
        for servo_id, value in values.items():
            group.addParam(
                servo_id, list((value & (256**register.size - 1)).to_bytes(register.size, "little"))
            )
        result = self._safely(group.txPacket)
        if result != COMM_SUCCESS:
            raise LostRobotError(
                f"{self.port}: {register.name}: {self._packets.getTxRxResult(result)} {self._advice()}"
            )

    def write_everywhere(self, register: Register, value: int) -> None:
        """One register of every servo on the line, named or not; servos do not answer to it."""

        def send() -> int:
            return int(
                self._packets.writeTxOnly(
                    self._port,
                    BROADCAST_ID,
                    register.address,
                    register.size,
                    list(value.to_bytes(register.size, "little")),
                )
            )

        result = self._safely(send)
        if result != COMM_SUCCESS:
            raise LostRobotError(f"{self.port}: {self._packets.getTxRxResult(result)} {self._advice()}")

    def read_all(self, register: Register, servo_ids: Sequence[int]) -> dict[int, int]:
        """One register of many servos, each of which answers."""
        result = 0
        for _ in range(TRIES):
            group = GroupSyncRead(self._port, self._packets, register.address, register.size)
            for servo_id in servo_ids:
                group.addParam(servo_id)
            result = self._safely(group.txRxPacket)
            if result == COMM_SUCCESS:
                try:
                    return {
                        servo_id: _signed(group.getData(servo_id, register.address, register.size), register)
                        for servo_id in servo_ids
                    }
                except IndexError:
                    # A late answer to an earlier question, shorter than this one's.
                    result = COMM_RX_CORRUPT
            self._fall_quiet()
        raise LostRobotError(
            f"{self.port}: {register.name} of servos {', '.join(map(str, servo_ids))}: "
            f"{self._packets.getTxRxResult(result)} {self._advice()}"
        )

    def _ask(self, servo_id: int, what: str, once: Callable[[], tuple[int, int, int]]) -> int:
        result = 0
        for _ in range(TRIES):
            value, result, error = self._safely(once)
            if result != COMM_SUCCESS or error & 0x7F == GARBLED:
                self._fall_quiet()
                continue
            # The highest bit only says that the hardware error status is not 0: that is read where it is dealt with.
            if error & 0x7F:
                raise HardwareFaultError(
                    f"{self.port}: servo {servo_id} refuses {what}: {self._packets.getRxPacketError(error & 0x7F)}"
                )
            return value
        raise LostRobotError(
            f"{self.port}: servo {servo_id}, {what}: {self._packets.getTxRxResult(result) or 'garbled'} {self._advice()}"
        )

    def _fall_quiet(self) -> None:
        time.sleep(QUIET_S)
        self._safely(self._port.clearPort)

    def _safely(self, call: Callable[[], T]) -> T:
        # After an exception, Ctrl-C's as well, the SDK would take its port for busy for good.
        self._port.is_using = False
        try:
            return call()
        except Exception as error:  # what a vanished line raises: of pyserial, termios, the SDK's indexing
            raise LostRobotError(f"{self.port}: the serial line failed: {error} {self._advice()}") from None

    def _advice(self) -> str:
        return "(check cable, power, ids and rate)"


def _signed(raw: int, register: Register) -> int:
    half = 256**register.size // 2
    return raw - 2 * half if register.signed and raw >= half else raw


def fault_words(status: int) -> str:
    """What a hardware error status says."""
    return ", ".join(word for bit, word in HARDWARE_FAULTS.items() if status & (1 << bit)) or f"code {status}"
