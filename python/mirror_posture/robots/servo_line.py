"""Servos on one serial line through their vendor's SDK: registers of many servos; every failure is an error
that names it.

The vendors' SDKs give result codes, raise the serial line's exceptions, stay "busy" after an exception, and
wait by a clock that can be set; all of that is handled here. Dynamixel's and Feetech's have the same
functions; `Sdk` names them.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import ModuleType
from typing import Any, TypeVar

from .errors import HardwareFaultError, LostRobotError

T = TypeVar("T")

BROADCAST_ID = 254
TRIES = 4
"""A lost or garbled packet is requested again this many times before the line counts as lost."""
READ_WAIT_S = 0.002
"""The SDKs poll without a pause; a short wait in each read leaves the processor to others."""
PATIENCE_MS = 80.0
"""Beyond the SDKs' own 34 ms: USB converters and busy computers are late."""
QUIET_S = 0.03
"""After a lost answer the line is left quiet so long, and emptied: a late answer must not pass for that of the next question."""


@dataclass(frozen=True)
class Register:
    """A place in a servo's memory, little-endian: unsigned, in two's complement, or with a separate sign
    bit."""

    name: str
    address: int
    size: int
    signed: bool = False
    sign_bit: int | None = None
    """Number of the bit that means "negative" where the rest is the magnitude."""

    def encode(self, value: int) -> int:
        """The bits of a value. Raises `ValueError` for one that does not fit."""
        bits = 8 * self.size
        if self.sign_bit is not None:
            good = abs(value) < 2**self.sign_bit
            raw = abs(value) | (1 << self.sign_bit if value < 0 else 0)
        elif self.signed:
            good, raw = -(2 ** (bits - 1)) <= value < 2 ** (bits - 1), value % 2**bits
        else:
            good, raw = 0 <= value < 2**bits, value
        if not good:
            raise ValueError(f"{self.name}: {value} does not fit into {self.size} bytes")
        return raw

    def decode(self, raw: int) -> int:
        """The value of its bits."""
        if self.sign_bit is not None:
            magnitude = raw & ((1 << self.sign_bit) - 1)
            return -magnitude if raw & (1 << self.sign_bit) else magnitude
        half = 256**self.size // 2
        return raw - 2 * half if self.signed and raw >= half else raw

    def bytes(self, value: int) -> list[int]:
        """As they go over the line."""
        return list(self.encode(value).to_bytes(self.size, "little"))


@dataclass(frozen=True)
class Sdk:
    """A vendor's SDK: its module, its packets, and the meaning of its servos' error byte."""

    module: ModuleType
    packets: Any
    payload_bytes: Callable[[Sequence[int]], int]
    """How many bytes of data an answer carries."""
    garbled: Callable[[int], bool]
    """Whether a servo's error byte says that the packet arrived broken: it is sent again."""
    refused: Callable[[int], str]
    """What a servo refuses by its error byte; empty where it refuses nothing."""


def _exact_packets(sdk: Sdk) -> Any:
    """The SDK's packets, with `expected_bytes`: an answer of another length is a late one to an earlier question."""
    packets = sdk.packets
    receive = packets.rxPacket
    packets.expected_bytes = None

    def exact(*args: Any) -> tuple[Any, int]:
        packet, result = receive(*args)
        wanted = packets.expected_bytes
        if (
            result == sdk.module.COMM_SUCCESS
            and wanted is not None
            and sdk.payload_bytes(packet) not in (wanted, 0)
        ):
            result = sdk.module.COMM_RX_CORRUPT
        return packet, result

    packets.rxPacket = exact
    return packets


def _patient_port(sdk: Sdk, path: str) -> Any:
    """The SDK's port, with reads that wait a little, a longer timeout, and a monotonic clock."""

    class PatientPort(sdk.module.PortHandler):  # type: ignore[misc, name-defined]
        def setPacketTimeout(self, packet_length: int) -> None:
            super().setPacketTimeout(packet_length)
            self.packet_timeout += PATIENCE_MS

        def setupPort(self, cflag_baud: int) -> bool:
            done = super().setupPort(cflag_baud)
            self.ser.timeout = READ_WAIT_S
            self.ser.write_timeout = 0.5
            return bool(done)

        def clearPort(self) -> None:
            # One of the SDKs waits for what is written here, and leaves in what came late.
            self.ser.reset_input_buffer()

        def getCurrentTime(self) -> float:
            return time.monotonic() * 1000.0

    return PatientPort(path)


class ServoLine:
    """Servos by id on one line. Methods raise `LostRobotError` and `HardwareFaultError`."""

    def __init__(self, sdk: Sdk, port: str, baudrate: int) -> None:
        self.port = port
        self._sdk, self._packets = sdk, _exact_packets(sdk)
        self._port = _patient_port(sdk, port)
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
        self._packets.expected_bytes = None
        return self._ask(servo_id, "ping", lambda: self._packets.ping(self._port, servo_id))

    def read(self, servo_id: int, register: Register) -> int:
        """One register of one servo."""

        self._packets.expected_bytes = register.size

        def once() -> tuple[int, int, int]:
            data, result, error = self._packets.readTxRx(
                self._port, servo_id, register.address, register.size
            )
            # An error of the servo comes without data, and is handled as such.
            if result == self._sdk.module.COMM_SUCCESS and len(data) != register.size:
                if self._sdk.refused(error) and not data:
                    return 0, result, error
                result = self._sdk.module.COMM_RX_CORRUPT
            return int.from_bytes(bytes(data), "little"), result, error

        return register.decode(self._ask(servo_id, register.name, once))

    def write(self, servo_id: int, register: Register, value: int, *, check: bool = True) -> None:
        """One register of one servo; `check` reads it back."""
        data = register.bytes(value)
        self._packets.expected_bytes = 0

        def once() -> tuple[int, int, int]:
            result, error = self._packets.writeTxRx(
                self._port, servo_id, register.address, register.size, data
            )
            return 0, result, error

        self._ask(servo_id, register.name, once)
        if check and (found := self.read(servo_id, register)) != value:
            raise HardwareFaultError(
                f"{self.port}: servo {servo_id}: {register.name} was set to {value} and reads {found}; is it of another series?"
            )

    def write_all(self, register: Register, values: Mapping[int, int]) -> None:
        """One register of many servos at the same moment; servos do not answer to it."""
        group = self._sdk.module.GroupSyncWrite(self._port, self._packets, register.address, register.size)
        for servo_id, value in values.items():
            group.addParam(servo_id, register.bytes(value))
        self._send(register.name, group.txPacket)

    def write_everywhere(self, register: Register, value: int) -> None:
        """One register of every servo on the line, named or not; servos do not answer to it."""
        data = register.bytes(value)
        self._send(
            register.name,
            lambda: self._packets.writeTxOnly(
                self._port, BROADCAST_ID, register.address, register.size, data
            ),
        )

    def read_all(self, register: Register, servo_ids: Sequence[int]) -> dict[int, int]:
        """One register of many servos, each of which answers."""
        return {
            servo_id: found[register] for servo_id, found in self.read_block([register], servo_ids).items()
        }

    def read_block(
        self, registers: Sequence[Register], servo_ids: Sequence[int]
    ) -> dict[int, dict[Register, int]]:
        """Registers of many servos, all at the same moment: each servo answers once, with all from the first to the last."""
        start = min(r.address for r in registers)
        length = max(r.address + r.size for r in registers) - start
        success, result = self._sdk.module.COMM_SUCCESS, 0
        self._packets.expected_bytes = length
        for _ in range(TRIES):
            group = self._sdk.module.GroupSyncRead(self._port, self._packets, start, length)
            for servo_id in servo_ids:
                group.addParam(servo_id)
            result = self._safely(group.txRxPacket)
            if result == success:
                answers = {servo_id: bytes(group.data_dict[servo_id]) for servo_id in servo_ids}
                if all(len(answer) == length for answer in answers.values()):
                    return {
                        servo_id: {
                            r: r.decode(
                                int.from_bytes(
                                    answer[r.address - start : r.address - start + r.size], "little"
                                )
                            )
                            for r in registers
                        }
                        for servo_id, answer in answers.items()
                    }
                # A late answer to an earlier question, shorter than this one's.
                result = self._sdk.module.COMM_RX_CORRUPT
            self._fall_quiet()
        names = ", ".join(r.name for r in registers[:2]) + (" …" if len(registers) > 2 else "")
        raise LostRobotError(
            f"{self.port}: {names} of servos {', '.join(map(str, servo_ids))}: "
            f"{self._packets.getTxRxResult(result)} {self._advice()}"
        )

    def _send(self, what: str, once: Callable[[], int]) -> None:
        result = self._safely(once)
        if result != self._sdk.module.COMM_SUCCESS:
            raise LostRobotError(
                f"{self.port}: {what}: {self._packets.getTxRxResult(result)} {self._advice()}"
            )

    def _ask(self, servo_id: int, what: str, once: Callable[[], tuple[int, int, int]]) -> int:
        result = 0
        for _ in range(TRIES):
            value, result, error = self._safely(once)
            if result != self._sdk.module.COMM_SUCCESS or self._sdk.garbled(error):
                self._fall_quiet()
                continue
            if refused := self._sdk.refused(error):
                raise HardwareFaultError(f"{self.port}: servo {servo_id} refuses {what}: {refused}")
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
        return "(check cable, power and rate, and that no two servos have the same id)"
