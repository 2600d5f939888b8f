"""A simulated Dynamixel bus on a pseudo-terminal: protocol 2.0 from the e-Manual, servos that move, and faults.

Written from the protocol's description alone; it shares nothing with the vendor's SDK (its check sum is worked out bit by
bit, not looked up).
"""

from __future__ import annotations

import contextlib
import math
import os
import select
import threading
import time
import tty
from dataclasses import dataclass, field

HEADER = b"\xff\xff\xfd\x00"
BROADCAST = 254
STATUS = 0x55
PING, READ, WRITE, SYNC_READ, SYNC_WRITE = 0x01, 0x02, 0x03, 0x82, 0x83
INSTRUCTION_ERROR, CRC_ERROR, RANGE_ERROR, LIMIT_ERROR, ACCESS_ERROR, ALERT = 2, 3, 4, 6, 7, 0x80
MODEL_NUMBER = 1020  # XM430-W350
TICK_S = 0.002
UNIT_COUNTS_PER_S = 0.229 / 60.0 * 4096


def crc16(data: bytes) -> int:
    """CRC-16 of protocol 2.0: polynomial x¹⁶ + x¹⁵ + x² + 1, starting at 0."""
    crc = 0
    for byte in data:
        crc ^= byte << 8
        for _ in range(8):
            crc = ((crc << 1) ^ 0x8005 if crc & 0x8000 else crc << 1) & 0xFFFF
    return crc


def stuffed(body: bytes) -> bytes:
    """FF FF FD within a packet is followed by one more FD, or it would look like a header."""
    return body.replace(b"\xff\xff\xfd", b"\xff\xff\xfd\xfd")


def unstuffed(body: bytes) -> bytes:
    return body.replace(b"\xff\xff\xfd\xfd", b"\xff\xff\xfd")


def packet(servo_id: int, body: bytes) -> bytes:
    body = stuffed(body)
    head = HEADER + bytes([servo_id]) + (len(body) + 2).to_bytes(2, "little") + body
    return head + crc16(head).to_bytes(2, "little")


@dataclass
class SimulatedServo:
    """Registers, and a motor that follows its goal."""

    servo_id: int
    position: float
    needed_current: int = 10
    """Below it the load is too heavy to move."""
    jammed: bool = False
    table: bytearray = field(default_factory=lambda: bytearray(256))
    speed: float = 0.0
    fastest: float = 0.0
    """Counts a second, over its life."""
    heard_s: float = 0.0

    def __post_init__(self) -> None:
        self.set(0, 2, MODEL_NUMBER)
        self.set(11, 1, 3)
        self.set(38, 2, 1193)
        self.set(48, 4, 4095)
        self.set(102, 2, 1193)
        self.set(100, 2, 885)
        self.set(116, 4, round(self.position))

    def get(self, address: int, size: int) -> int:
        return int.from_bytes(self.table[address : address + size], "little")

    def set(self, address: int, size: int, value: int) -> None:
        self.table[address : address + size] = (value % 256**size).to_bytes(size, "little")

    @property
    def torque(self) -> bool:
        return bool(self.table[64])

    def refuses(self, address: int, data: bytes) -> int:
        """The error of a write, 0 if it is taken."""
        value = int.from_bytes(data, "little", signed=len(data) > 1)
        if address < 64 and self.torque:
            return ACCESS_ERROR
        if self.table[98] == 255 and address in (100, 102, 116):
            return RANGE_ERROR  # the watchdog has bitten, and is cleared by 0 alone
        if address == 116 and not self.get(52, 4) <= value <= self.get(48, 4):
            return LIMIT_ERROR
        if address == 102 and abs(value) > self.get(38, 2):
            return LIMIT_ERROR
        return 0

    def tick(self, dt_s: float, now_s: float) -> None:
        watchdog = self.table[98]
        if watchdog not in (0, 255) and now_s - self.heard_s > 0.02 * watchdog:
            self.table[98] = 255
            self.set(116, 4, round(self.position))
        goal = int.from_bytes(self.table[116:120], "little", signed=True)
        by_current = self.table[11] == 5
        strong = not by_current or self.get(102, 2) >= self.needed_current
        before = self.position
        if self.torque and not self.jammed and strong:
            limit = self.get(112, 4) * UNIT_COUNTS_PER_S
            away = goal - self.position
            step = away if limit == 0 else math.copysign(min(abs(away), limit * dt_s), away)
            self.position += step
        self.speed = (self.position - before) / dt_s
        self.fastest = max(self.fastest, abs(self.speed))
        self.set(128, 4, round(self.speed / UNIT_COUNTS_PER_S))
        self.set(132, 4, round(self.position))


class SimulatedBus:
    """Servos on a line whose other end is `port`; a context."""

    def __init__(self, *servos: SimulatedServo) -> None:
        self.servos = {servo.servo_id: servo for servo in servos}
        self.master, slave = os.openpty()
        tty.setraw(slave)
        self._slave = slave  # kept open, so that the line does not hang up between two users
        self.port = os.ttyname(slave)
        self.instructions: list[tuple[int, int, bytes]] = []
        """(id, instruction, parameters) as they were heard."""
        self.torque_on: list[dict[str, int]] = []
        """What was in force at each moment at which a torque went on."""
        self.drop, self.garble = 0, 0
        """How many of the next answers are lost, or have a bit turned."""
        self.mute = False
        self._buffer = b""
        self._lock = threading.Lock()
        self._running = True
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def __enter__(self) -> SimulatedBus:
        return self

    def __exit__(self, *_: object) -> None:
        self._running = False
        self._thread.join()
        self.cut()
        with contextlib.suppress(OSError):
            os.close(self._slave)

    def cut(self) -> None:
        """Cuts the line for good; the servos live on."""
        with self._lock:
            if self.master >= 0:
                os.close(self.master)
                self.master = -1

    def fault(self, servo_id: int, status: int) -> None:
        """A servo shuts itself down."""
        with self._lock:
            servo = self.servos[servo_id]
            servo.table[70], servo.table[64] = status, 0

    def positions(self) -> dict[int, float]:
        with self._lock:
            return {servo_id: servo.position for servo_id, servo in self.servos.items()}

    def all_off(self) -> bool:
        with self._lock:
            return not any(servo.torque for servo in self.servos.values())

    def _run(self) -> None:
        last = time.monotonic()
        while self._running:
            with self._lock:
                master = self.master
            ready = master >= 0 and bool(select.select([master], [], [], TICK_S)[0])
            if master < 0:
                time.sleep(TICK_S)
            with self._lock:
                now = time.monotonic()
                for servo in self.servos.values():
                    servo.tick(max(now - last, 1e-6), now)
                last = now
                if ready and self.master >= 0:
                    with contextlib.suppress(OSError):
                        self._buffer += os.read(self.master, 4096)
                        self._hear(now)

    def _hear(self, now_s: float) -> None:
        if self.mute:
            self._buffer = b""
            return
        while True:
            start = self._buffer.find(HEADER)
            if start < 0:
                self._buffer = self._buffer[-3:]
                return
            self._buffer = self._buffer[start:]
            if len(self._buffer) < 7:
                return
            length = int.from_bytes(self._buffer[5:7], "little")
            if len(self._buffer) < 7 + length:
                return
            whole, self._buffer = self._buffer[: 7 + length], self._buffer[7 + length :]
            servo_id, body = whole[4], unstuffed(whole[7:-2])
            good = crc16(whole[:-2]) == int.from_bytes(whole[-2:], "little")
            if not good:
                self._answer(servo_id, CRC_ERROR)
                continue
            self.instructions.append((servo_id, body[0], body[1:]))
            for servo in self.servos.values():
                servo.heard_s = now_s
            self._obey(servo_id, body[0], body[1:])

    def _obey(self, servo_id: int, instruction: int, given: bytes) -> None:
        if instruction == SYNC_WRITE:
            address, size = (int.from_bytes(given[i : i + 2], "little") for i in (0, 2))
            for at in range(4, len(given), size + 1):
                self._write(given[at], address, given[at + 1 : at + 1 + size])
        elif instruction == SYNC_READ:
            address, size = (int.from_bytes(given[i : i + 2], "little") for i in (0, 2))
            for one in given[4:]:
                if one in self.servos:
                    self._answer(one, 0, bytes(self.servos[one].table[address : address + size]))
        elif instruction == WRITE:
            address, data = int.from_bytes(given[:2], "little"), given[2:]
            for one in self.servos if servo_id == BROADCAST else (servo_id,):
                error = self._write(one, address, data)
                if servo_id != BROADCAST:
                    self._answer(one, error)
        elif instruction == READ:
            address, size = (int.from_bytes(given[i : i + 2], "little") for i in (0, 2))
            if servo_id in self.servos:
                self._answer(servo_id, 0, bytes(self.servos[servo_id].table[address : address + size]))
        elif instruction == PING:
            self._answer(servo_id, 0, MODEL_NUMBER.to_bytes(2, "little") + b"\x2d")
        else:
            self._answer(servo_id, INSTRUCTION_ERROR)

    def _write(self, servo_id: int, address: int, data: bytes) -> int:
        servo = self.servos.get(servo_id)
        if servo is None:
            return 0
        error = servo.refuses(address, data)
        if error:
            return error
        was_on = servo.torque
        servo.table[address : address + len(data)] = data
        if servo.torque and not was_on:
            self.torque_on.append(
                {
                    "id": servo_id,
                    "mode": servo.table[11],
                    "speed": servo.get(112, 4),
                    "acceleration": servo.get(108, 4),
                    "current": servo.get(102, 2),
                    "pwm": servo.get(100, 2),
                    "jump": servo.get(116, 4) - round(servo.position),
                }
            )
        return 0

    def _answer(self, servo_id: int, error: int, data: bytes = b"") -> None:
        servo = self.servos.get(servo_id)
        if servo is None or self.master < 0:
            return
        if self.drop > 0:
            self.drop -= 1
            return
        alert = ALERT if servo.table[70] else 0
        answer = packet(servo_id, bytes([STATUS, error | alert]) + data)
        if self.garble > 0:
            self.garble -= 1
            answer = answer[:8] + bytes([answer[8] ^ 0x10]) + answer[9:]
        with contextlib.suppress(OSError):
            os.write(self.master, answer)
